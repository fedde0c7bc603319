"""Least-squares quintic splines on uniform samples: position, velocity and acceleration of a noisy channel.

Knots lie every `stride` samples, so the basis repeats from interval to interval: the normal equations are banded
(half-bandwidth 5) and their right-hand side is one matrix product. Cost is about 12 multiplications per sample.
Measured velocities join the fit as further observations of the same spline (fused spline, METHODS of the field:
the same optimum as a Rauch-Tung-Striebel smoother with that prior).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.lapack import lapack
from elid_cli.signals.splines import DEGREE, ORDER, UniformSpline, interval_basis

_STRETCH = 32768
"""Samples taken at a time."""
_REFINED = 2
"""Refinements of splines seen through rates."""
_KEPT = 1 << 16
"""Samples up to which factors of normal equations are kept for the next channels of this length."""
_RIDGE = 1e-10
"""Weight of the third-difference penalty relative to the positions: holds coefficients that no sample sees."""
_THIRD = (-1.0, 3.0, -3.0, 1.0)


@dataclass(frozen=True)
class SplineFit:
    """A spline with what it left over."""

    spline: UniformSpline
    squares: Array
    """Sum of squares of samples minus spline, (channels,)."""
    counted: NDArray[np.intp]
    """Samples that there were, (channels,)."""
    freedom: int
    """Number of coefficients per channel."""
    own: Array | None = None
    """Part of them that the samples decide and not the measured rates, (channels,); None: all."""

    @property
    def rms(self) -> Array:
        """Residual rms per channel, corrected for the coefficients spent, (channels,)."""
        spent = self.freedom if self.own is None else self.freedom * self.own
        spare = np.maximum(self.counted - spent, 1)
        return np.asarray(np.sqrt(self.squares / spare))

    @property
    def aicc(self) -> Array:
        """Corrected Akaike criterion per channel, (channels,); infinite where samples do not suffice."""
        counted = self.counted.astype(float)
        power = np.maximum(self.squares / np.maximum(counted, 1.0), 1e-300)
        spare = counted - self.freedom - 2.0
        with np.errstate(divide="ignore"):
            criterion = counted * np.log(power) + 2.0 * (self.freedom + 1) * counted / spare
        return np.where(spare > 0, criterion, np.inf)


def fit_spline(
    values: Array,
    stride: int,
    dt: float,
    rates: Sequence[tuple[int, Array, Array]] = (),
    channels: NDArray[np.intp] | None = None,
) -> SplineFit:
    """Fit quintic splines with knots every `stride` samples.

    Samples are taken a stretch at a time, so that no further array of their length is made.

    Parameters
    ----------
    values
        Samples, (channels, N), of any layout in memory; NaN where missing.
    stride
        Samples per knot interval, at least 1.
    dt
        Sample time, s.
    rates
        Measured derivatives of the same channels: (derivative, samples (channels, N) with NaN where missing, standard
        deviation of position noise over that of this noise (channels,)).
    channels
        Rows of `values` to fit, default all.
    """
    channels = np.arange(len(values)) if channels is None else channels
    complete = np.isfinite(values.sum(axis=1)[channels]) if not rates else np.zeros(len(channels), dtype=bool)
    if complete.any() and not complete.all():
        return _merged(complete, *(fit_spline(values, stride, dt, (), channels[c]) for c in (complete, ~complete)))
    whole = bool(complete.all())
    samples = values.shape[1]
    intervals = max(1, -(-(samples - 1) // stride))
    right = np.zeros((len(channels), intervals + DEGREE))
    observed: list[tuple[int, Array, Array]] = [(0, values, np.ones(len(channels))), *rates]
    if whole:
        for first, part in _stretches(values, channels, stride, intervals):
            _accumulate(None, right, part, observed[0][2], interval_basis(stride, 0), first, whole=True)
        factors = (_factors_kept if samples <= _KEPT else _factors_of_whole)(stride, samples)
    else:
        band = np.zeros((len(channels), ORDER, intervals + DEGREE))
        ridge = np.zeros(len(band))
        for derivative, data, ratio in observed:
            for first, part in _stretches(data, channels if derivative == 0 else None, stride, intervals):
                design = interval_basis(stride, derivative) / (stride * dt) ** derivative
                _accumulate(band, right, part, ratio, design, first, whole=False)
            if derivative == 0:
                ridge = _RIDGE * np.maximum(band[:, 0].max(axis=1), 1e-300)
        factors = _factors(band, ridge)
    spline = UniformSpline(_solve(factors, right), samples, stride, dt)
    for _ in range(_REFINED if rates else 0):
        spline = _refined(spline, factors, observed, channels, intervals)
    squares, counted = np.zeros(len(channels)), np.zeros(len(channels), dtype=np.intp)
    for first, part in _stretches(values, channels, stride, intervals):
        rest = part - spline.between(first * stride, first * stride + part.shape[1], 1)[0]
        if whole:
            squares += np.einsum("cn,cn->c", rest, rest)
            counted += part.shape[1]
        else:
            squares += np.nansum(rest**2, axis=1)
            counted += np.count_nonzero(np.isfinite(rest), axis=1)
    own = _own_part([(d, r) for d, _, r in rates], stride * dt) if rates else None
    return SplineFit(spline, squares, counted, min(intervals + DEGREE, samples), own)


def _factors_of_whole(stride: int, samples: int) -> list[Array]:
    """Return the one factor of channels without a missing sample, which do not depend on the samples' values."""
    intervals = max(1, -(-(samples - 1) // stride))
    band, right = np.zeros((1, ORDER, intervals + DEGREE)), np.zeros((1, intervals + DEGREE))
    for first, part in _stretches(np.broadcast_to(0.0, (1, samples)), None, stride, intervals):
        _accumulate(band, right, part, np.ones(1), interval_basis(stride, 0), first, whole=True)
    return _factors(band, _RIDGE * np.maximum(band[:, 0].max(axis=1), 1e-300))


_factors_kept = lru_cache(maxsize=64)(_factors_of_whole)
"""Of short logs, of which many of one length may come."""


def _own_part(rates: Sequence[tuple[int, Array]], width: float) -> Array:
    """Return which part of the coefficients samples decide beside rates of some noise ratios, (channels,).

    A coefficient's worth of a spline with knots `width` apart is a frequency up to pi / width, to which a derivative
    of order d with ratio r brings (r omega^d)^2 times what the sample brings.
    """
    omega = (np.arange(256) + 0.5) / 256 * np.pi / width
    brought = 1.0 + sum((ratio[:, None] * omega**order) ** 2 for order, ratio in rates)
    return np.asarray(np.mean(1.0 / brought, axis=1))


def _merged(first: NDArray[np.bool_], one: SplineFit, other: SplineFit) -> SplineFit:
    """Return the fits of the channels that are `first` and of the others as one."""
    coefficients = np.empty((len(first), one.spline.coefficients.shape[1]))
    squares, counted = np.empty(len(first)), np.empty(len(first), dtype=np.intp)
    for where, fit in ((first, one), (~first, other)):
        coefficients[where], squares[where], counted[where] = fit.spline.coefficients, fit.squares, fit.counted
    return SplineFit(replace(one.spline, coefficients=coefficients), squares, counted, one.freedom)


def _stretches(
    data: Array, channels: NDArray[np.intp] | None, stride: int, intervals: int
) -> Iterator[tuple[int, Array]]:
    """Yield (first interval, samples (channels, m)) of some intervals at a time; the last holds the end point too."""
    each = max(1, _STRETCH // stride)
    for first in range(0, intervals, each):
        last = min(first + each, intervals)
        stop = data.shape[1] if last == intervals else last * stride
        part = data[:, first * stride : stop]
        yield first, np.ascontiguousarray(part if channels is None or len(channels) == len(data) else part[channels])


def _accumulate(
    band: Array | None, right: Array, part: Array, ratio: Array, design: Array, first: int, *, whole: bool
) -> None:
    """Add some intervals' observations to the banded normal equations (upper form: band[:, a] is diagonal a).

    `design` holds the weights of a whole interval's samples and, last, those of its end. Without `band` only the
    right-hand side is added to.
    """
    stride = len(design) - 1
    channels, count = part.shape
    full = min(count // stride, right.shape[1] - DEGREE - first)
    rest = count - full * stride
    weight = np.ones((1, count))
    if not whole:
        weight = np.isfinite(part) * (ratio**2)[:, None]
        part = np.where(weight > 0, np.nan_to_num(part, posinf=0.0, neginf=0.0) * weight, 0.0)
    moments = part[:, : full * stride].reshape(channels, full, stride) @ design[:-1]
    for a in range(ORDER):
        right[:, first + a : first + a + full] += moments[:, :, a]
    # the end point closes the last interval; other samples that are left over begin one
    closes = rest == 1 and first + full == right.shape[1] - DEGREE
    rows = design[-1:] if closes else design[:rest]
    interval = first + full - closes
    if rest:
        right[:, interval : interval + ORDER] += part[:, full * stride :] @ rows
    if band is None:
        return
    products = (design[:-1, :, None] * design[:-1, None, :]).reshape(stride, -1)
    total = products.sum(axis=0)
    cross = None if whole else weight[:, : full * stride].reshape(channels, full, stride) @ products
    for a in range(ORDER):
        for b in range(a, ORDER):
            added = total[ORDER * a + b] if cross is None else cross[:, :, ORDER * a + b]
            band[:, b - a, first + a : first + a + full] += added
            if rest:
                band[:, b - a, interval + a] += weight[:, full * stride :] @ (rows[:, a] * rows[:, b])


def _refined(
    spline: UniformSpline,
    factors: Sequence[Array],
    observed: Sequence[tuple[int, Array, Array]],
    channels: NDArray[np.intp],
    intervals: int,
) -> UniformSpline:
    """Return the spline with what it leaves of its observations fitted again (iterative refinement).

    Accelerations weigh as the fourth power of one over the knot spacing: with 2 ms the normal equations' condition
    reaches 1e12, and one solution alone would be wrong in the fourth digit of the position.
    """
    stride, dt = spline.stride, spline.dt
    right = np.zeros_like(spline.coefficients)
    for derivative, data, ratio in observed:
        design = interval_basis(stride, derivative) / (stride * dt) ** derivative
        for first, part in _stretches(data, channels if derivative == 0 else None, stride, intervals):
            start = first * stride
            rest = part - spline.between(start, start + part.shape[1], derivative + 1, first=derivative)[0]
            _accumulate(None, right, rest, ratio, design, first, whole=False)
    return replace(spline, coefficients=spline.coefficients + _solve(factors, right))


def _factors(band: Array, ridge: Array) -> list[Array]:
    """Return the Cholesky factors of each channel's banded normal equations, (6, coefficients) each."""
    size = band.shape[2]
    factors = []
    for k in range(band.shape[0]):
        lower = band[k].copy()
        if size > 3:
            for a in range(4):  # differences within the spline only: one that reaches beyond pulls its ends to zero
                for b in range(a, 4):
                    lower[b - a, a : a + size - 3] += ridge[k] * _THIRD[a] * _THIRD[b]
        for offset in range(1, ORDER):
            lower[offset, size - offset :] = 0.0
        factor, failed = lapack().dpbtrf(lower, lower=1)
        if failed:  # fewer than three samples: no third difference holds a parabola
            lower[0] += ridge[k]
            factor, failed = lapack().dpbtrf(lower, lower=1)
            if failed:
                raise np.linalg.LinAlgError("the spline's equations are not positive definite")
        factors.append(factor)
    return factors


def _solve(factors: Sequence[Array], right: Array) -> Array:
    """Return the coefficients for right-hand sides (channels, coefficients); one factor serves all channels."""
    solved = np.empty_like(right)
    for k, factor in enumerate(factors):
        rows: Any = slice(None) if len(factors) == 1 else slice(k, k + 1)
        solved[rows] = lapack().dpbtrs(factor, right[rows].T, lower=1)[0].T
    return solved
