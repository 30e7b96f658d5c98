#pragma once

/// Elementary functions that give the same bits on every processor. The C library chooses its own
/// functions by the processor (with or without fused multiply-add) and changes them from version to
/// version. These functions use additions, multiplications, divisions and integer operations alone,
/// and IEEE 754 fixes the result of each. Every value is within 1 ulp of the exact one. All code
/// whose results act in the control loop or are logged uses these functions instead of the
/// functions of <cmath>. From <cmath> it may use sqrt, fmod, round, floor, ldexp, abs and copysign,
/// which are exact or correctly rounded.
namespace tachless::base {

/// Returns the sine of `x` [rad]; NaN for an infinite `x`.
double sin(double x);
/// Returns the cosine of `x` [rad]; NaN for an infinite `x`.
double cos(double x);
/// Computes sine and cosine with the same bits as `sin(x)` and `cos(x)`.
void sin_cos(double x, double& sine, double& cosine);

/// Returns e^x.
double exp(double x);
/// Returns e^x - 1 without cancellation.
double expm1(double x);
/// Returns the natural logarithm; -infinity for 0, NaN for x < 0.
double log(double x);
/// Returns the hyperbolic tangent.
double tanh(double x);
/// Returns x^y for x >= 0; NaN for x < 0. pow(x, 0) and pow(1, y) are 1 even for NaN.
double pow(double x, double y);
/// Returns the cube root.
double cbrt(double x);

}  // namespace tachless::base
