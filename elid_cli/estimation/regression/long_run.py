"""Long-run variance of correlated scores (HAC); Student's factor.

The covariance of a sum of correlated scores is the sum over all pairs of instants of their products, weighted by a
kernel of the lag (Newey and West 1987), here Parzen's, of a width chosen by Andrews' rule (1991). That kernel is the
autocorrelation of a triangle of half its width: scores smoothed by the triangle are squared and summed, which is
positive definite by construction, and smooth scores need not be summed at every instant.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache

import numpy as np

from elid_cli._types import Array
from elid_cli.signals.lowpass import LowPass

MANY = 400.0
"""Degrees of freedom from which on Student's t is the normal distribution."""


@cache
def _gauss() -> tuple[Array, Array]:
    """Return nodes and weights of Gauss's rule on -1 … 1, made when it is first needed."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    return nodes, weights


@lru_cache(maxsize=256)
def student_quantile(degrees: float, probability: float) -> float:
    """Return the quantile of Student's t with `degrees` (1 or more) of freedom at a probability from 0.5 to 0.999.

    Substituting t = sqrt(d) tan(a) makes the density proportional to cos(a)^(d - 1) on a finite interval, which is
    integrated by Gauss's rule and solved by Newton's.
    """
    nodes, weights = _gauss()
    constant = math.exp(math.lgamma((degrees + 1) / 2) - math.lgamma(degrees / 2)) / math.sqrt(math.pi)
    angle = math.atan(2.0 / math.sqrt(degrees))
    for _ in range(50):
        half = angle / 2
        area = constant * half * float(weights @ np.cos(half * (nodes + 1)) ** (degrees - 1))
        step = (area - (probability - 0.5)) / (constant * math.cos(angle) ** (degrees - 1))
        angle = min(max(angle - step, angle / 2), (angle + math.pi / 2) / 2)
        if abs(step) < 1e-13:
            break
    return math.sqrt(degrees) * math.tan(angle)


def beyond_normal(degrees: float) -> float:
    """Return how many times wider than the normal distribution's Student's interval of 95 % is, at least 1."""
    return student_quantile(max(degrees, 1.0), 0.975) / 1.96 if degrees < MANY else 1.0


def at_least(covariance: Array, variance: Array) -> Array:
    """Return a covariance (U, U) whose diagonal is no smaller than variances (U,), correlations kept."""
    size = np.sqrt(np.maximum(variance / np.maximum(np.diag(covariance), 1e-300), 1.0))
    return np.asarray(covariance * np.outer(size, size))


NARROWEST = 8.0
"""Least width of the kernel, instants."""
TAKEN = 0.5
"""Largest part of a long-run covariance that fitted parameters are taken to have explained."""


class Persistence:
    """Sums that tell how long each of r scores remembers: first-order autocorrelation and what it leaves.

    Scores count alike, whatever their units.
    """

    def __init__(self, width: int) -> None:
        self.instants = 0
        self._power = np.zeros(width)
        self._cross = np.zeros(width)
        self._first: Array | None = None
        self._last = np.zeros(width)

    def feed(self, scores: Array) -> None:
        """Add the next scores, (r, m)."""
        if not scores.shape[1]:
            return
        if self._first is None:
            self._first = scores[:, 0].copy()
        else:
            self._cross += scores[:, 0] * self._last
        self._power += np.einsum("rm,rm->r", scores, scores)
        self._cross += np.einsum("rm,rm->r", scores[:, 1:], scores[:, :-1])
        self._last = scores[:, -1].copy()
        self.instants += scores.shape[1]

    @property
    def bandwidth(self) -> float:
        """Andrews' bandwidth of the Parzen kernel, instants, from first-order autoregressions of the scores."""
        if self._first is None or self.instants < 2:
            return NARROWEST
        before, after = self._power - self._last**2, self._power - self._first**2
        rho = np.clip(self._cross / np.where(before > 0, before, 1.0), -0.97, 0.97)
        innovation = np.maximum(after - 2 * rho * self._cross + rho**2 * before, 0.0)
        innovation /= np.where(self._power > 0, self._power, 1.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            top = np.nansum(4 * rho**2 * innovation**2 / (1 - rho) ** 8)
            bottom = np.nansum(innovation**2 / (1 - rho) ** 4)
        alpha = float(top / bottom) if bottom > 0 else 0.0
        wanted: float = 2.6614 * (alpha * self.instants) ** 0.2
        return min(max(wanted, NARROWEST), max(self.instants / 6, NARROWEST))


@lru_cache(maxsize=64)
def _triangle(half: int) -> LowPass:
    """Return the triangle of half width `half`, whose autocorrelation is Parzen's kernel."""
    return LowPass(1.0 - np.abs(np.arange(-half + 1, half)) / half, max(1, half // 4), 0.0)


class KernelSum:
    """Sum over pairs of instants of scores times scores, weighted by the Parzen kernel of their lag, (r, r).

    Instants of different stretches do not count as neighbours.

    Parameters
    ----------
    width
        Number of scores r.
    bandwidth
        Lag, in instants, from which scores count as independent.
    """

    def __init__(self, width: int, bandwidth: float) -> None:
        self._half = max(1, round((bandwidth + 1.0) / 2))
        self._smooth = _triangle(self._half)
        self._step = self._smooth.step
        self._scale = self._step / float(self._smooth.taps @ self._smooth.taps)
        self._total = np.zeros((width, width))
        self._tail = self._nothing
        self._segment: int | None = None

    @property
    def _nothing(self) -> Array:
        """Zeros before and after a segment, so that the whole triangle passes over each of its instants."""
        return np.zeros((len(self._total), 2 * self._half))

    def feed(self, scores: Array, segment: int) -> None:
        """Add the next scores (r, m), all of one segment; a segment's blocks follow each other.

        Scores in single precision are smoothed in it.
        """
        if segment != self._segment:
            self._close()
            self._segment = segment
        waiting = np.concatenate([self._tail.astype(scores.dtype, copy=False), scores], axis=1)
        smoothed = self._smooth.apply(waiting)
        self._add(smoothed)
        self._tail = waiting[:, smoothed.shape[1] * self._step :].copy()

    def total(self) -> Array:
        """Return the weighted sum over all that was fed."""
        self._close()
        return self._total * self._scale

    def _close(self) -> None:
        if self._segment is None:
            return
        after = np.zeros((len(self._total), 2 * self._half + self._step), dtype=self._tail.dtype)
        self._add(self._smooth.apply(np.concatenate([self._tail, after], axis=1)))
        self._tail, self._segment = self._nothing, None

    def _add(self, smoothed: Array) -> None:
        """Add products; in double precision, since the columns of weak directions nearly cancel in them."""
        exact = smoothed.astype(np.float64, copy=False)
        self._total += exact @ exact.T


def small_sample(instants: int, width: int, bandwidth: float, rows: int = 1, taken: float = TAKEN) -> float:
    """Return the factor for what `width` parameters fitted to `rows` equations at every instant take out of the sum.

    Each equation loses the share width / (rows instants) of its residual to the fit, and as much of its product with
    every other within reach of the kernel, whose integral is 3/4 of its bandwidth; but no more than the part `taken`.
    """
    lost = 0.75 * bandwidth * width / max(rows * instants, 1)
    return 1.0 / (1.0 - min(lost, taken))


def uncertain(instants: int, bandwidth: float) -> float:
    """Return the factor on a variance whose kernel sum is itself known from few independent pieces.

    The sum has the spread of chi-squared with n / (0.539 b) degrees of freedom (0.539: integral of the squared kernel;
    Priestley 1981, 6.2), so 95 % lie within Student's quantile instead of 1.96 standard errors.
    """
    return beyond_normal(pieces(instants, bandwidth)) ** 2


def pieces(instants: int, bandwidth: float) -> float:
    """Return the independent pieces from which a kernel sum is known: degrees of freedom of its chi-squared."""
    return instants / (0.539 * bandwidth)
