#include <tachless/own_loop/own_loop.h>
#include <cstdio>
#include "arm.h"  // replace it by your arm's: positions(), send(), brake()

int main() try {
  tachless::CertifiedLoop loop("arm.yaml");  // certifies, or throws the reason
  tachless::Guards guards(loop);
  Arm arm(loop.period_s());
  for (std::int64_t tick = 0; tick < 5000; ++tick) {  // at the pace of your own clock
    const auto step = guards.check(loop.torque(tick, arm.positions()));
    if (!step.ok()) return arm.brake(), std::puts(guards.reason(step).c_str()), 1;
    arm.send(step.tau);
  }
  return std::puts(loop.certificate().text.c_str()), 0;
} catch (const std::exception& refusal) {
  return std::puts(refusal.what()), 1;
}
