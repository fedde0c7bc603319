"""Least-squares quintic splines on uniform samples: position, velocity and acceleration of a noisy channel.

Knots lie every `stride` samples, so the basis repeats from interval to interval: the normal equations are banded
(half-bandwidth 5) and their right-hand side is one matrix product. Cost is about 12 multiplications per sample.
Measured velocities join the fit as further observations of the same spline (fused spline, METHODS of the field:
the same optimum as a Rauch-Tung-Striebel smoother with that prior).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREE = 5
_ORDER = DEGREE + 1
_RIDGE = 1e-10
"""Weight of the third-difference penalty relative to the data: holds coefficients that no sample sees."""


@cache
def _polynomials() -> Array:
    """Return the six quintic pieces of the uniform B-spline as polynomials of u in [0, 1], shape (6, 6).

    Row l belongs to coefficient j + l of interval j; column k multiplies u**k (Cox-de Boor on integer knots).
    """
    pieces = np.zeros((1, 1))
    pieces[0, 0] = 1.0
    for degree in range(1, _ORDER):
        grown = np.zeros((degree + 1, degree + 1))
        for piece in range(degree + 1):
            # B_d on interval `piece` of its support [0, d+1): x = piece' + u, with piece' counted from the left
            left = degree - piece
            if left < degree:  # x * B_{d-1}(x) / d
                source = pieces[degree - 1 - left]
                grown[piece, :degree] += left * source / degree
                grown[piece, 1 : degree + 1] += source / degree
            if left > 0:  # (d + 1 - x) * B_{d-1}(x - 1) / d
                source = pieces[degree - left]
                grown[piece, :degree] += (degree + 1 - left) * source / degree
                grown[piece, 1 : degree + 1] -= source / degree
        pieces = grown
    return pieces


def basis(u: Array, derivative: int = 0) -> Array:
    """Return the six weights (or their derivatives by u) at local positions u in [0, 1], shape (len(u), 6)."""
    powers = np.zeros((len(u), _ORDER))
    for k in range(derivative, _ORDER):
        factor = float(np.prod(np.arange(k - derivative + 1, k + 1)))
        powers[:, k] = factor * u ** (k - derivative)
    weights: Array = powers @ _polynomials().T
    return weights


@dataclass(frozen=True)
class Spline:
    """Quintic splines of several channels on one segment.

    `coefficients` is (channels, intervals + 5); sample k lies at local position (k mod stride)/stride of interval
    k // stride.
    """

    coefficients: Array
    samples: int
    stride: int
    dt: float

    def evaluate(self, derivative: int = 0, shift: float = 0.0) -> Array:
        """Return a derivative (0, 1, 2…) at the sample instants moved by `shift` seconds, (channels, samples).

        Shifts beyond the segment's ends hold the end polynomial.
        """
        width = self.stride * self.dt
        intervals = self.coefficients.shape[1] - DEGREE
        if shift == 0.0:
            weights = basis(np.arange(self.stride) / self.stride, derivative) / width**derivative
            windows = np.lib.stride_tricks.sliding_window_view(self.coefficients, _ORDER, axis=1)
            body: Array = np.matmul(windows, weights.T).reshape(self.coefficients.shape[0], -1)
            if self.samples <= body.shape[1]:
                return body[:, : self.samples]
            end = windows[:, -1] @ basis(np.ones(1), derivative).T / width**derivative
            return np.concatenate([body, end], axis=1)
        position = (np.arange(self.samples) + shift / self.dt) / self.stride
        interval = np.clip(np.floor(position).astype(np.intp), 0, intervals - 1)
        weights = basis(position - interval, derivative) / width**derivative
        parts = np.stack([self.coefficients[:, interval + k] * weights[:, k] for k in range(_ORDER)])
        moved: Array = parts.sum(axis=0)
        return moved


@dataclass(frozen=True)
class Fit:
    """A spline with what it left over."""

    spline: Spline
    residual: Array
    """Samples minus spline, (channels, samples); NaN where there was no sample."""
    freedom: int
    """Number of coefficients per channel."""

    @property
    def rms(self) -> Array:
        """Residual rms per channel, corrected for the coefficients spent, (channels,)."""
        counted = np.sum(np.isfinite(self.residual), axis=1)
        spare = np.maximum(counted - self.freedom, 1)
        rms: Array = np.sqrt(np.nansum(self.residual**2, axis=1) / spare)
        return rms

    @property
    def aicc(self) -> Array:
        """Corrected Akaike criterion per channel, (channels,); infinite where samples do not suffice."""
        counted = np.sum(np.isfinite(self.residual), axis=1).astype(float)
        power = np.maximum(np.nansum(self.residual**2, axis=1) / counted, 1e-300)
        spare = counted - self.freedom - 2.0
        with np.errstate(divide="ignore"):
            criterion = counted * np.log(power) + 2.0 * (self.freedom + 1) * counted / spare
        return np.where(spare > 0, criterion, np.inf)


def fit_spline(values: Array, stride: int, dt: float, rates: Sequence[tuple[int, Array, Array]] = ()) -> Fit:
    """Fit quintic splines with knots every `stride` samples.

    Parameters
    ----------
    values
        Samples, (channels, N); NaN where missing.
    stride
        Samples per knot interval, at least 1.
    dt
        Sample time, s.
    rates
        Measured derivatives of the same channels: (derivative, samples (channels, N) with NaN where missing, standard
        deviation of position noise over that of this noise (channels,)).
    """
    channels, samples = values.shape
    intervals = max(1, -(-(samples - 1) // stride))
    padded = intervals * stride + 1
    local = np.arange(stride) / stride
    known = np.isfinite(values)
    shared = bool(known.all()) and not rates
    band = np.zeros((channels if not shared else 1, _ORDER, intervals + DEGREE))
    right = np.zeros((channels, intervals + DEGREE))
    observed: list[tuple[int, Array, Array]] = [(0, values, np.ones(channels)), *rates]
    for derivative, data, ratio in observed:
        weight = np.isfinite(data) * (ratio**2)[:, None]
        width = (stride * dt) ** derivative
        design, end = basis(local, derivative) / width, basis(np.ones(1), derivative) / width
        _accumulate(band, right, data, weight[:1] if shared else weight, design, end, stride, padded)
    coefficients = _solve(band, right)
    spline = Spline(coefficients, samples, stride, dt)
    residual = values - spline.evaluate()
    return Fit(spline, residual, min(intervals + DEGREE, samples))


def _accumulate(
    band: Array, right: Array, data: Array, weight: Array, design: Array, end: Array, stride: int, padded: int
) -> None:
    """Add one kind of observation to the banded normal equations (upper form: band[:, a] is diagonal a)."""
    channels, samples = data.shape
    body = padded - 1
    weights = np.zeros((weight.shape[0], padded))
    weights[:, :samples] = weight
    loads = np.zeros((channels, padded))
    loads[:, :samples] = np.where(weight > 0, np.nan_to_num(data) * weight, 0.0)
    intervals = body // stride
    moments = loads[:, :body].reshape(channels, intervals, stride) @ design
    blocks = weights[:, :body].reshape(weights.shape[0], intervals, stride)
    for a in range(_ORDER):
        right[:, a : a + intervals] += moments[:, :, a]
        right[:, intervals - 1 + a] += loads[:, body] * end[0, a]
        for b in range(a, _ORDER):
            band[:, b - a, a : a + intervals] += blocks @ (design[:, a] * design[:, b])
            band[:, b - a, intervals - 1 + a] += weights[:, body] * end[0, a] * end[0, b]


def _solve(band: Array, right: Array) -> Array:
    from scipy.linalg import cho_solve_banded, cholesky_banded

    size = right.shape[1]
    solved = np.empty_like(right)
    for k in range(band.shape[0]):
        lower = band[k].copy()
        ridge = _RIDGE * max(float(lower[0].max()), 1e-300)
        if size > 3:
            for position, value in enumerate(np.convolve([1.0, -3, 3, -1], [-1.0, 3, -3, 1])[3:]):
                lower[position, : size - position] += ridge * abs(value) * (-1) ** position
        for offset in range(1, _ORDER):
            lower[offset, size - offset :] = 0.0
        factor: Any = cholesky_banded(lower, lower=True, check_finite=False, overwrite_ab=True)
        rows = slice(None) if band.shape[0] == 1 else slice(k, k + 1)
        solved[rows] = cho_solve_banded((factor, True), right[rows].T, check_finite=False).T
    return solved
