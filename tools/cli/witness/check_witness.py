#!/usr/bin/env python3
"""Checks what `tachless certify --witness FILE` wrote, in interval arithmetic of its own.

    check_witness.py FILE [SCENARIO]

Accepts (exit code 0) or rejects, with the reason (exit code 1). It shares no code with the product. With SCENARIO it
also checks that the file is about that scenario and its URDF; without it nothing ties the file to an arm.

Claim: x = (e, v, p, t) is the deviation of a loop of n = 1 or 2 revolute joints from rest at q, t the
torque that acts over the tick, p = phi nu - beta e what the filter carries over; |x| is the norm of L' x.
Where |x| <= 1, one tick takes x to an x+ with

    |x+| <= rho |x| + gamma,      rho < 1, rho + gamma <= 1,

whatever the rounding |w_i| <= quantum_i of the measured angles; no torque reaches a limit there. So
|x| <= 1 is never left, and what is in it ends in |x| <= gamma / (1 - rho).

The plant over the tick is M(q) vdot + C(q, v) v + D v + g(q) = g(q_ref) + t. With the secant G of g,
g(q_ref + e) - g(q_ref) = G e, it is y' = A(s) y for y = (e, v, t), A a function of (e, v) alone, and x+ = F x.
Boxes of (e, v, t) cover the set. In each, (e, v) over the tick is enclosed (Picard). With q2 and the velocity
at their means over the tick, A is, but for the entries of R, in the hull of A_c at the corners of the box of
(q2, v): linear in v; in q2 between chords, by its second derivative. So by Peano and Baker F is in the hull of
those of exp(h A_c), but for entries that are bounded. |F x| <= rho |x| is checked at the corners. Where it
does not pass, the box is halved.
"""
import json
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from interval import TINY, Iv, Rejected, cos_sin, positive_definite, product, require

NORM_SLACK = 1e-10  # of Cholesky's factorisation of matrices of size 8, relative: 1e-14 is enough


class Loop:
    def __init__(self, w):
        self.n = n = w["joints"]
        require(type(n) is int and n in (1, 2), "joints is not the whole number 1 or 2")
        require(type(w["boxes"]) is int, "boxes is no whole number")
        take = lambda key, *shape: self.array(w, key, shape)
        self.q, self.kp, self.kd = take("q_ref", n), take("kp", n), take("kd", n)
        self.phi, self.beta, self.D = take("phi", n), take("beta", n), take("viscous", n)
        self.M = take("M", 3, n, n)  # 1, cos q2, sin q2
        self.g = take("g", n, 3, 3)  # 1, cos q1, sin q1 by 1, cos q2, sin q2
        self.quantum, self.L = take("quantum", n), take("L", 4 * n, 4 * n)
        self.limit = None if w["torque_limit"] is None else take("torque_limit", n)
        require(np.all(self.quantum >= 0), "quantum is negative")
        require(np.array_equal(self.M, self.M.transpose(0, 2, 1)), "M is not symmetric")
        require(self.limit is None or np.all(self.limit > 0), "torque_limit is not above 0")
        require(np.all(self.D >= 0), "viscous is negative")
        at = lambda q: [[float(x.middle()) for x in row] for row in self.gradient([Iv(np.float64(y)) for y in q])]
        self.G = np.array(at(self.q))
        self.h, self.rho, self.gamma = float(w["period_s"]), float(w["rho"]), float(w["gamma"])
        self.most = int(w["boxes"])
        require(0 < self.rho < 1 and self.gamma >= 0 and self.h > 0, "rho, gamma or the period is out of range")
        require(self.rho + self.gamma <= 1, "rho + gamma > 1: the set may be left")
        require(1 <= self.most <= 2000000, "boxes is out of range")
        require(n == 2 or not self.M[1:].any(), "the inertia of one joint does not depend on its angle")
        require(n == 1 or not self.M[1:, 1, 1].any(), "the inertia of the second joint does not depend on its angle")
        require(np.array_equal(self.L, np.tril(self.L)) and np.all(np.diag(self.L) > 0), "L is no lower triangle")
        self.X = np.linalg.inv(self.L.T)
        require(np.abs(self.L.T @ self.X - np.eye(4 * n)).sum() < 1e-10, "L cannot be inverted well enough")
        # |x| <= 1 allows |x_i| <= reach_i.
        self.reach = np.sqrt((self.X ** 2).sum(1)) * (1 + 1e-9)
        # |x|² >= |W' (e, v, t)|²: checked as a norm.
        s = [*range(2 * n), *range(3 * n, 4 * n)]
        self.W = np.linalg.cholesky(np.linalg.inv(self.X[s] @ self.X[s].T)) * (1 - 1e-7)
        Z = self.W.T @ self.X[s]
        np.linalg.cholesky(np.eye(4 * n) * (1 - NORM_SLACK) - Z.T @ Z)

    @staticmethod
    def array(w, key, shape):
        x = np.array(w[key], dtype=float)
        require(x.shape == shape and np.all(np.isfinite(x)), f"{key} has the wrong size or is no number")
        return x

    def inertia(self, q2):
        """M^-1 and dM/dq2, from the interval of the angle."""
        n = self.n
        c, s = cos_sin(q2)
        M = [[self.M[0, i, j] + c * self.M[1, i, j] + s * self.M[2, i, j] for j in range(n)] for i in range(n)]
        dM = [[c * self.M[2, i, j] - s * self.M[1, i, j] for j in range(n)] for i in range(n)]
        if n == 1:
            return [[M[0][0].inverse()]], dM
        r = (M[0][0] * M[1][1] - M[0][1] * M[0][1]).inverse()
        return [[M[1][1] * r, -(M[0][1] * r)], [-(M[0][1] * r), M[0][0] * r]], dM

    def gradient(self, q):
        """dg/dq over the box of angles q."""
        n = self.n
        c1, s1 = cos_sin(q[0])
        one = Iv(np.float64(1))
        zero = Iv(np.float64(0))
        c2, s2 = cos_sin(q[1]) if n == 2 else (one, zero)
        first, dfirst = [one, c1, s1], [zero, -s1, c1]
        second, dsecond = [one, c2, s2], [zero, -s2, c2]
        G = [[zero] * n for _ in range(n)]
        for i in range(n):
            for a in range(3):
                for b in range(3):
                    k = self.g[i, a, b]
                    if k == 0:
                        continue
                    G[i][0] = G[i][0] + dfirst[a] * second[b] * k
                    if n == 2:
                        G[i][1] = G[i][1] + first[a] * dsecond[b] * k
        return G

    def secant(self, e, pieces=4):
        """G of g(q + e) - g(q) = G e: the mean of dg/dq along the way, in pieces."""
        n, total = self.n, None
        for k in range(pieces):
            way = Iv(np.float64(k / pieces), np.float64((k + 1) / pieces))
            G = self.gradient([way * e[i] + self.q[i] for i in range(n)])
            total = G if total is None else [[total[i][j] + G[i][j] for j in range(n)] for i in range(n)]
        return [[total[i][j] * (1 / pieces) for j in range(n)] for i in range(n)]

    def coriolis(self, dM, v):
        """C(q, v) of dM/dq2; dM[1][1] = 0 (q2 is the last joint), so that it is Christoffel's."""
        if self.n == 1:
            return [[Iv(np.float64(0))]]
        return [[dM[0][0] * v[1] * 0.5, dM[0][0] * v[0] * 0.5 + dM[0][1] * v[1]],
                [-(dM[0][0] * v[0] * 0.5), dM[1][1] * v[1] * 0.5]]

    def coefficients(self, e, v):
        """A, B of d(e, v)/dt = A (e, v) + B t over the box (e, v)."""
        n = self.n
        Mi, dM = self.inertia(e[1] + self.q[1] if n == 2 else Iv(np.float64(0)))
        G = self.secant(e)
        C = self.coriolis(dM, v)
        for i in range(n):
            C[i][i] = C[i][i] + self.D[i]
        zero, one = [0.0] * n, lambda i: [1.0 if j == i else 0.0 for j in range(n)]
        lower = [[-x for x in row] for row in product(Mi, [G[i] + C[i] for i in range(n)])]
        return [zero + one(i) for i in range(n)] + lower, [list(zero) for _ in range(n)] + Mi

    def acceleration(self, e, v, t):
        """dv/dt over the box."""
        A, B = self.coefficients(e, v)
        x = [[y] for y in [*e, *v]]
        return [of_x[0] + of_t[0] for of_x, of_t in
                zip(product(A[self.n:], x), product(B[self.n:], [[y] for y in t]))]

    def frozen(self, q2, v):
        """A at points, with the gradient of gravity at q_ref; rounded."""
        n, m = self.n, len(v)
        if n == 1:
            Mi, C = np.broadcast_to(1 / self.M[0], (m, 1, 1)), np.zeros((m, 1, 1))
        else:
            c, s = np.cos(q2)[:, None, None], np.sin(q2)[:, None, None]
            Mi, d = np.linalg.inv(self.M[0] + c * self.M[1] + s * self.M[2]), c * self.M[2] - s * self.M[1]
            a, b = d[:, 0, 0] / 2, d[:, 0, 1]
            C = np.stack([a * v[:, 1], a * v[:, 0] + b * v[:, 1], -a * v[:, 0], 0 * a], 1).reshape(m, 2, 2)
        A = np.zeros((m, 3 * n, 3 * n))
        A[:, :n, n:2 * n] = np.eye(n)
        A[:, n:2 * n] = np.concatenate([-Mi @ self.G, -Mi @ (C + np.diag(self.D)), Mi], 2)
        return A

    def bounds(self, e, v, moves_q, moves_v, width):
        """Magnitudes, where (e, v) is in these boxes and within `moves` of its mean over the tick, q2's in a
        box of that width: how far the mean of A is from the hull of its corners; how far A is from its mean."""
        n, m = self.n, len(width)
        size = lambda X: np.stack([np.stack([x.magnitude() + np.zeros(m) for x in row], 1) for row in X], 1)
        Mi, dM = self.inertia(e[1] + self.q[1] if n == 2 else Iv(0 * width))
        off = [[g - g0 for g, g0 in zip(*rows)] for rows in zip(self.secant(e), self.G)]
        R = np.zeros((m, 3 * n, 3 * n))
        near, rows, of_e, of_v = R.copy(), slice(n, 2 * n), slice(0, n), slice(n, 2 * n)
        R[:, rows, of_e] = size(product(Mi, off))
        near[:, rows, of_e] = 2 * R[:, rows, of_e]
        if n == 1:
            return R * (1 + 1e-9), near * (1 + 1e-9)
        c, s = cos_sin(e[1] + self.q[1])
        minus = lambda X: [[-x for x in row] for row in X]
        plus = lambda X, Y: [[x + y for x, y in zip(*rows)] for rows in zip(X, Y)]
        ddM = [[-(c * self.M[1, i, j] + s * self.M[2, i, j]) for j in range(n)] for i in range(n)]
        N1 = minus(product(product(Mi, dM), Mi))
        half_Mi = [[x * 0.5 for x in row] for row in Mi]
        half_N2 = minus(plus(product(product(N1, dM), Mi), product(product(Mi, ddM), half_Mi)))
        N2 = plus(half_N2, half_N2)
        C, C1, C2 = self.coriolis(dM, v), self.coriolis(ddM, v), self.coriolis(minus(dM), v)
        CD = plus(C, np.diag(self.D))
        by_v = [Iv(-x, x) for x in moves_v]
        mixed = product(N1, C1)
        second = np.concatenate([size(product(N2, self.G)), size(plus(
            plus(product(N2, CD), plus(mixed, mixed)), product(Mi, C2))), size(N2)], 2)
        first = np.concatenate([size(product(N1, self.G)), size(plus(product(N1, CD), product(Mi, C1))), size(N1)], 2)
        q = moves_q[:, None, None]
        R[:, rows] += (width[:, None, None] ** 2 / 8 + q ** 2 / 2) * second
        R[:, rows, of_v] += q * size(plus(product(N1, self.coriolis(dM, by_v)), product(Mi, self.coriolis(ddM, by_v))))
        near[:, rows] += q * first
        near[:, rows, of_v] += size(product(Mi, self.coriolis(dM, by_v)))
        return R * (1 + 1e-9), near * (1 + 1e-9)

    def transition(self, A, R, near):
        """exp(h A) at the corners, and what entries of the transition matrix may be off their hull. With the
        mean of A(s) in the hull but for R, and A(s) within `near` of its mean: the first term of Peano and
        Baker is h times the mean; of the second, near counts half, since it has no mean; the variance between
        corners is below the square of half their spread; from the third on both are near the centre."""
        h, n = self.h, self.n
        R = R + 1e-12 * np.abs(A).max(1)
        spread, centre = (A.max(1) - A.min(1)) / 2, np.abs(A.max(1) + A.min(1)) / 2
        most, last, lag = centre + spread + R + near, 16, near / 2 + R
        scale = np.delete(self.reach, range(2 * n, 3 * n))
        alpha = (h * (most * scale / scale[:, None]).sum(2)).max(1)
        require(np.all(alpha < 3), "the period is too long")
        off = h * R + h * h / 2 * (most @ lag + lag @ most + near @ near + spread @ spread)
        power, wide, narrow = h * A, h * most, h * centre
        Phi, total = np.eye(3 * n) + power, np.eye(3 * n) + wide
        for k in range(2, last):
            power, wide, narrow = power @ (h * A) / k, wide @ (h * most) / k, narrow @ (h * centre) / k
            Phi, total = Phi + power, total + wide
            if k > 2:
                off += 2 * (wide - narrow)
        rest = 2 * alpha ** last / 2e13 / (1 - alpha / (last + 1))  # 16! = 2.09e13
        off += rest[:, None, None] * scale[:, None] / scale + 1e-13 * total
        return Phi, off * (1 + 1e-9)

    def tick(self, low, high):
        """Matrices F of x+ = F x at corners, how far entries may be off their hull, and where that holds, for
        boxes low, high of (e, v, t)."""
        n, h, m = self.n, self.h, len(low)
        box = [Iv(low[:, i], high[:, i]) for i in range(3 * n)]
        e, v, t = box[:n], box[n:2 * n], box[2 * n:]
        now = Iv(np.float64(0), np.float64(h))

        def moved(a):
            """Where (e, v) is within the tick, given the acceleration."""
            return [e[i] + now * (v[i] + now * a[i]) for i in range(n)], [v[i] + now * a[i] for i in range(n)]

        a = self.acceleration(e, v, t)
        for _ in range(4):  # Picard: what is found from where it leads must lie in what it was taken for
            found = self.acceleration(*moved(a), t)
            holds = np.all([(f.lo >= x.lo) & (f.hi <= x.hi) for f, x in zip(found, a)], axis=0)
            if np.all(holds):
                break
            margin = [0.02 * f.magnitude() + 1e-9 for f in found]
            a = [x.hull(Iv(f.lo - y, f.hi + y)) for x, f, y in zip(a, found, margin)]
        else:
            found = self.acceleration(*moved(a), t)
            holds = np.all([(f.lo >= x.lo) & (f.hi <= x.hi) for f, x in zip(found, a)], axis=0)
        es, vs = moved(a)
        means = [v[i] + a[i] * (h / 2) for i in range(n)]
        moves_v, moves_q = [h / 2 * x.magnitude() for x in a], np.zeros(m)
        width, corners = np.zeros(m), np.zeros((1, 2))
        if n == 2:  # of (q2, v1, v2)
            corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])
            means.insert(0, e[1] + vs[1] * (h / 2) + self.q[1])
            moves_q, width = h / 2 * vs[1].magnitude(), means[0].hi - means[0].lo
        else:
            means.insert(0, Iv(np.zeros(m)))
        A = []
        for corner in corners:
            at = [x.hi if up else x.lo for x, up in zip(means, corner)]
            A.append(self.frozen(at[0], np.stack(at[1:], 1)))
        Phi, off = self.transition(np.stack(A, 1), *self.bounds(es, vs, moves_q, moves_v, width))
        G, size, plant = self.secant(e), 4 * n, 2 * n
        F, around = np.zeros((m, len(corners), size, size)), np.zeros((m, size, size))
        for to, of in ((F, Phi), (around, off)):
            to[..., :plant, :plant], to[..., :plant, 3 * n:] = of[..., :plant, :plant], of[..., :plant, plant:]
        for i in range(n):
            F[..., 2 * n + i, 2 * n + i], F[..., 2 * n + i, i] = self.phi[i], (self.phi[i] - 1) * self.beta[i]
            F[..., 3 * n + i, :n] = self.G[i]
            for j in range(n):
                around[:, 3 * n + i, j] = (G[i][j] - self.G[i, j]).magnitude()
            F[..., 3 * n + i, i] -= self.kp[i] + self.kd[i] * self.beta[i]
            F[..., 3 * n + i, 2 * n + i] = -self.kd[i]
        return F, around + 1e-14 * np.abs(F).max(1), holds

    def passes(self, low, high):
        """Boxes in which |F x| <= rho |x|, and by how much it is missed, not rigorously."""
        F, around, holds = self.tick(low, high)
        N = self.L.T @ F @ self.X
        y = around @ self.reach  # of entries of the rest times x, |x| <= 1
        rounded = 1e-13 * np.linalg.norm(np.abs(self.L.T) @ np.abs(F).max(1) @ np.abs(self.X), axis=(1, 2))
        rest = np.sqrt(np.einsum("mi,ij,mj->m", y, np.abs(self.L @ self.L.T) * (1 + 1e-9), y)) + rounded
        bound = self.rho * (1 - 3 * NORM_SLACK) - rest
        NN = np.swapaxes(N, 2, 3) @ N
        S = np.maximum(bound, 0)[:, None, None, None] ** 2 * (1 - NORM_SLACK) * np.eye(4 * self.n) - NN
        good = positive_definite(S.reshape(-1, *S.shape[2:])).reshape(S.shape[:2])
        return holds & (bound > 0) & good.all(1), np.sqrt(np.linalg.eigvalsh(NN)[..., -1].max(1)) + rest

    def outside(self, low, high):
        m, r = 0.5 * (low + high), 0.5 * (high - low)
        nearest = np.sqrt(((m @ self.W) ** 2).sum(1)) - np.sqrt(((r @ np.abs(self.W)) ** 2).sum(1))
        return nearest > 1 + 1e-6

    def axis(self, low, high):
        """Along which halves come nearest to passing."""
        quarter = (high - low) / 4
        missed = [self.passes(low + quarter * unit, high - quarter * unit)[1] for unit in np.eye(3 * self.n)]
        return np.argmin(missed, axis=0)

    def cover(self):
        """Boxes of (e, v, t) that cover all the set reaches; their number."""
        reach = np.delete(self.reach, range(2 * self.n, 3 * self.n))
        low, high, done = -reach[None], reach[None], 0
        while True:
            inside = ~self.outside(low, high)
            low, high = low[inside], high[inside]
            require(done + len(low) <= self.most, f"more than {self.most} boxes: somewhere |x| does not fall by rho")
            if len(low) == 0:
                return done
            good = self.passes(low, high)[0]
            done += int(good.sum())
            low, high = low[~good], high[~good]
            if len(low) == 0:
                return done
            axis, rows = self.axis(low, high), np.arange(len(low))
            middle = 0.5 * (low + high)[rows, axis]
            upper, lower = low.copy(), high.copy()
            upper[rows, axis], lower[rows, axis] = middle, middle
            low, high = np.concatenate([low, upper]), np.concatenate([lower, high])

    def alone(self):
        """The largest error of each joint alone, from rest with nu = 0 and no torque but gravity's [rad]."""
        starts = np.eye(4 * self.n)[:self.n] - self.beta[:, None] * np.eye(4 * self.n)[2 * self.n:3 * self.n]
        return 1 / np.linalg.norm(starts @ self.L, axis=1)

    def check_rounding(self):
        """gamma: what w adds to |x+|, and no torque beyond its limit."""
        n = self.n
        e = [Iv(-self.reach[i:i + 1] - self.quantum[i], self.reach[i:i + 1] + self.quantum[i]) for i in range(n)]
        G = self.gradient([e[i] + self.q[i] for i in range(n)])
        total = 0.0
        for j in range(n):
            column = [Iv(np.zeros(1))] * (4 * n)
            column[2 * n + j] = Iv.of((self.phi[j] - 1) * self.beta[j])
            for i in range(n):
                column[3 * n + i] = G[i][j]
            column[3 * n + j] = column[3 * n + j] - self.kp[j] - self.kd[j] * self.beta[j]
            middle = np.array([float(np.ravel(x.middle())[0]) for x in column])
            radius = np.array([float(np.ravel(x.radius())[0]) for x in column]) + TINY * np.abs(middle)
            total += self.quantum[j] * (np.linalg.norm(self.L.T @ middle) + np.linalg.norm(np.abs(self.L.T) @ radius))
        require(total * (1 + 1e-9) <= self.gamma, f"rounding adds up to {total:.6g}, more than gamma")
        if self.limit is not None:
            first, second = [1, np.cos(self.q[0]), np.sin(self.q[0])], [1, 0, 0]
            if n == 2:
                second = [1, np.cos(self.q[1]), np.sin(self.q[1])]
            at_rest = np.einsum("iab,a,b->i", self.g, first, second)
            require(np.all(self.reach[3 * n:] + np.abs(at_rest) * (1 + 1e-9) <= self.limit),
                    "a torque of the set is beyond its limit")


def rotation(axis, angle):
    """Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def origin_of(element):
    origin = element.find("origin")
    get = lambda key: np.array([float(x) for x in (origin.get(key, "0 0 0") if origin is not None else "0 0 0").split()])
    xyz, (r, p, y) = get("xyz"), get("rpy")
    return rotation(np.eye(3)[2], y) @ rotation(np.eye(3)[1], p) @ rotation(np.eye(3)[0], r), xyz


class Mechanics:
    """Inertia matrix and gravity torque of a URDF, by the Jacobians of its bodies. Joints are in the file's order."""

    def __init__(self, urdf, gravity):
        robot = ElementTree.parse(urdf).getroot()
        self.joints = {j.find("child").get("link"): j for j in robot.findall("joint")}
        self.moving = [j.get("name") for j in robot.findall("joint")
                       if j.get("type") != "fixed" and j.find("mimic") is None]
        require(all(j.get("type") in ("revolute", "continuous", "fixed") for j in self.joints.values()),
                "the URDF has joints that do not turn")
        self.links, self.gravity = robot.findall("link"), np.array([0, 0, -gravity])

    def pose(self, link, q):
        """Rotation and place of a link, and the axes that move it: number, direction times multiplier, place."""
        if link not in self.joints:
            return np.eye(3), np.zeros(3), []
        joint = self.joints[link]
        R, at, axes = self.pose(joint.find("parent").get("link"), q)
        turned, offset = origin_of(joint)
        at, R = at + R @ offset, R @ turned
        if joint.get("type") != "fixed":
            mimic, axis = joint.find("mimic"), joint.find("axis")
            of = lambda key, default: float(mimic.get(key, default)) if mimic is not None else float(default)
            i = self.moving.index(joint.get("name") if mimic is None else mimic.get("joint"))
            axis = np.array([float(x) for x in (axis.get("xyz") if axis is not None else "1 0 0").split()])
            axes = axes + [(i, of("multiplier", "1") * (R @ axis) / np.linalg.norm(axis), at)]
            R = R @ rotation(axis, of("multiplier", "1") * q[i] + of("offset", "0"))
        return R, at, axes

    def at(self, q):
        n = len(self.moving)
        M, g = np.zeros((n, n)), np.zeros(n)
        for link in self.links:
            inertial = link.find("inertial")
            if inertial is None:
                continue
            R, at, axes = self.pose(link.get("name"), q)
            turned, offset = origin_of(inertial)
            centre, R = at + R @ offset, R @ turned
            m, I = float(inertial.find("mass").get("value")), inertial.find("inertia")
            xx, yy, zz, xy, xz, yz = (float(I.get(key)) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
            I = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
            Jv, Jw = np.zeros((3, n)), np.zeros((3, n))
            for i, axis, place in axes:
                Jv[:, i] += np.cross(axis, centre - place)
                Jw[:, i] += axis
            M += m * Jv.T @ Jv + Jw.T @ I @ Jw
            g -= m * Jv.T @ self.gravity
        return M, g


FILTERS = {
    "tustin": lambda a, b, h: ((2 - a * h) / (2 + a * h), 2 * b / (2 + a * h)),
    "first_order_hold": lambda a, b, h: (np.exp(-a * h), -b * np.expm1(-a * h) / (a * h)),
    "backward_euler": lambda a, b, h: (1 / (1 + a * h), b / (1 + a * h)),
    "zero_order_hold": lambda a, b, h: (np.exp(-a * h), b),
}


def require_is_of(loop, scenario):
    """@raise Rejected unless the loop is that of the scenario: its period, gains, filter, drives, encoders and arm."""
    import yaml  # Debian's python3-yaml

    class Loader(yaml.SafeLoader):
        """YAML 1.2: 1e-3 is a number."""

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"^[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?$"),
                                 list("-+0123456789."))
    with open(scenario, encoding="utf-8") as file:
        s = yaml.load(file, Loader)
    n, law, plant, robot = loop.n, s["controller"], s.get("plant", {}), s["robot"]
    drive, encoder = plant.get("drive", {}), plant.get("encoder", {})
    each = lambda x: np.broadcast_to(np.array(x, dtype=float), (n,))

    def same(is_, should, what):
        require(np.allclose(is_, should, rtol=1e-9, atol=1e-12), f"{what} is not that of {scenario}")

    require(law["law"] == "loria_ortega_rigid" and s["loop"].get("command_delay", 0) == 1,
            f"{scenario} has another law or delay")
    require(law.get("filter_start", "at_error") == "at_error", f"{scenario} starts the filter elsewhere")
    gains = law["gains"]
    same(loop.h, s["loop"]["period_s"], "period_s")
    same(loop.kp, each(gains["kp"]), "kp")
    same(loop.kd, each(gains["kd"]), "kd")
    phi, beta = FILTERS[law.get("filter", "tustin")](each(gains["a"]), each(gains["b"]), loop.h)
    same(loop.phi, phi, "phi")
    same(loop.beta, beta, "beta")
    limit = drive.get("torque_limit_Nm", "urdf")
    require(limit != "urdf", f"{scenario} leaves plant.drive.torque_limit_Nm to the URDF: give it, or null")
    require((limit is None) == (loop.limit is None), f"torque_limit is not that of {scenario}")
    if limit is not None:
        same(loop.limit, each(limit), "torque_limit")
    if "viscous_friction_Nms_per_rad" in drive:
        same(loop.D, each(drive["viscous_friction_Nms_per_rad"]), "viscous")
    bits = encoder.get("resolution_bits")
    rounds = np.zeros(n) if bits is None else np.pi * 2.0 ** -each(bits)
    require(np.all(loop.quantum >= rounds), f"quantum is less than the encoders of {scenario} round by")
    reference = s["reference"]
    if "hold" in reference:
        same(loop.q, each(reference["hold"]["position_rad"]), "q_ref")
    arm = Mechanics(Path(scenario).parent / robot["urdf"], float(robot.get("gravity_m_per_s2", 9.81)))
    require(len(arm.moving) == n and not set(robot) - {"name", "urdf", "joints", "gravity_m_per_s2"},
            f"the robot of {scenario} has other joints, or keys that are not read here")
    rotors = robot["joints"]["rigid"]["rotor_inertia_kgm2"] if isinstance(robot["joints"], dict) else 0.0
    for q in np.random.default_rng(1).uniform(-np.pi, np.pi, (20, n)):
        M, g = arm.at(q)
        first, second = [1, np.cos(q[0]), np.sin(q[0])], [1, 0, 0]
        if n == 2:
            second = [1, np.cos(q[1]), np.sin(q[1])]
        same(np.einsum("k,kij->ij", second, loop.M), M + np.diag(each(rotors)), "the inertia matrix")
        same(np.einsum("iab,a,b->i", loop.g, first, second), g, "the torque of gravity")


def checksum(text):
    """FNV-1a, 64 bit, of the text without the line of the checksum."""
    value = 0xCBF29CE484222325
    for byte in re.sub(r'"checksum": "[^"]*"', '"checksum": ""', text).encode():
        value = ((value ^ byte) * 0x100000001B3) & 0xFFFFFFFFFFFFFFFF
    return f"{value:016x}"


def check(text, scenario=None):
    """@return the loop and the number of boxes. @param scenario that it has to be about. @raise Rejected"""
    try:
        witness = json.loads(text)
        require(witness["checksum"] == checksum(text), "the checksum is not that of the text: it was changed")
        require(isinstance(witness, dict), "the file is no object")
        loop = Loop(witness)
        if scenario is not None:
            require_is_of(loop, scenario)
        loop.check_rounding()
        return loop, loop.cover()
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError,
            np.linalg.LinAlgError) as problem:
        raise Rejected(f"{type(problem).__name__}: {problem}") from None


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    try:
        loop, boxes = check(open(sys.argv[1], encoding="utf-8").read(), *sys.argv[2:])
    except (OSError, Rejected) as problem:
        print(f"{sys.argv[1]}: rejected: {problem}")
        sys.exit(1)
    print(f"{sys.argv[1]}: accepted: {boxes} boxes; one error alone from rest up to "
          f"{np.array2string(loop.alone(), precision=3)} rad; |x| falls by {loop.rho:.6g} a tick, "
          f"to {loop.gamma / (1 - loop.rho):.3g}")


if __name__ == "__main__":
    main()
