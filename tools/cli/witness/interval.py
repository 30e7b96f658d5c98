"""Interval arithmetic over arrays of boxes, for check_witness.py."""
import numpy as np

UP, DOWN = np.inf, -np.inf
TINY = 1e-14  # of sums and products of at most some ten rounded numbers, relative


class Rejected(Exception):
    pass


def require(condition, what):
    if not condition:
        raise Rejected(what)


class Iv:
    """Intervals [lo, hi], arrays of one entry per box; every operation rounds outwards."""

    def __init__(self, lo, hi=None):
        self.lo, self.hi = lo, lo if hi is None else hi

    @staticmethod
    def of(x):
        return x if isinstance(x, Iv) else Iv(np.float64(x))

    @staticmethod
    def outward(lo, hi):
        return Iv(np.nextafter(lo, DOWN), np.nextafter(hi, UP))

    def __add__(self, other):
        other = Iv.of(other)
        return Iv.outward(self.lo + other.lo, self.hi + other.hi)

    def __neg__(self):
        return Iv(-self.hi, -self.lo)

    def __sub__(self, other):
        return self + (-Iv.of(other))

    def __mul__(self, other):
        if not isinstance(other, Iv):
            if other == 0:
                return Iv(np.float64(0))
            a, b = self.lo * other, self.hi * other
            return Iv.outward(np.minimum(a, b), np.maximum(a, b))
        a, b = self.lo * other.lo, self.lo * other.hi
        c, d = self.hi * other.lo, self.hi * other.hi
        return Iv.outward(np.minimum(np.minimum(a, b), np.minimum(c, d)),
                          np.maximum(np.maximum(a, b), np.maximum(c, d)))

    __radd__, __rmul__ = __add__, __mul__

    def inverse(self):
        """Of what is greater than 0."""
        require(np.all(self.lo > 0), "the inertia matrix is not positive definite in a box")
        return Iv.outward(1 / self.hi, 1 / self.lo)

    def hull(self, other):
        return Iv(np.minimum(self.lo, other.lo), np.maximum(self.hi, other.hi))

    def magnitude(self):
        return np.maximum(np.abs(self.lo), np.abs(self.hi))

    def middle(self):
        return 0.5 * (self.lo + self.hi)

    def radius(self):
        middle = self.middle()
        return np.nextafter(np.maximum(self.hi - middle, middle - self.lo), UP)


def cos_sin(x):
    """Enclosures by |cos(m + d) - cos m| <= |sin m| |d| + d²/2."""
    m, r = x.middle(), x.radius()
    c, s = np.cos(m), np.sin(m)
    of_c, of_s = np.abs(s) * r + r * r / 2 + TINY, np.abs(c) * r + r * r / 2 + TINY
    clip = lambda y, d: Iv(np.maximum(y - d * (1 + TINY), -1), np.minimum(y + d * (1 + TINY), 1))
    return clip(c, of_c), clip(s, of_s)


def product(A, B):
    """Of matrices whose entries are Iv or numbers."""
    result = [[Iv(np.float64(0)) for _ in B[0]] for _ in A]
    for i, row in enumerate(A):
        for k, a in enumerate(row):
            if not isinstance(a, Iv) and a == 0:
                continue
            for j in range(len(B[0])):
                b = B[k][j]
                if isinstance(b, Iv) or b != 0:
                    result[i][j] = result[i][j] + Iv.of(a) * b
    return result


def positive_definite(S):
    """Which of the matrices; Cholesky's factorisation, all at once."""
    S, good = S.copy(), np.ones(len(S), bool)
    for k in range(S.shape[1]):
        pivot = S[:, k, k]
        good &= pivot > 0
        column = S[:, k + 1:, k] / np.sqrt(np.where(good, pivot, 1.0))[:, None]
        S[:, k + 1:, k + 1:] -= column[:, :, None] * column[:, None, :]
    return good
