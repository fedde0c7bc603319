"""Quintic splines with uniform knots: basis, values and derivatives of several channels at sample instants."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from elid_cli._types import Array

DEGREE = 5
ORDER = DEGREE + 1
"""Splines that meet in a knot interval."""


@cache
def _polynomials() -> Array:
    """Return the six quintic pieces of the uniform B-spline as polynomials of u in [0, 1], shape (6, 6).

    Row l belongs to coefficient j + l of interval j; column k multiplies u**k (Cox-de Boor on integer knots).
    """
    pieces = np.zeros((1, 1))
    pieces[0, 0] = 1.0
    for degree in range(1, ORDER):
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
    powers = np.zeros((len(u), ORDER))
    for k in range(derivative, ORDER):
        factor = float(np.prod(np.arange(k - derivative + 1, k + 1)))
        powers[:, k] = factor * u ** (k - derivative)
    return np.asarray(powers @ _polynomials().T)


@lru_cache(maxsize=64)
def interval_basis(stride: int, derivative: int) -> Array:
    """Return the weights at the samples of one knot interval, both of its ends among them, (stride + 1, 6)."""
    weights = basis(np.arange(stride + 1) / stride, derivative)
    weights.setflags(write=False)
    return weights


@lru_cache(maxsize=64)
def _pattern(stride: int, step: int, phase: int, orders: tuple[int, ...], width: float) -> tuple[int, int, Array]:
    """Return what every `step`-th sample, from sample `phase` on, is made of, as far as it does not repeat.

    Returns
    -------
    tuple
        Knot intervals after which it repeats, p; instants in them, c; their weights by derivative (`orders`) and
        instant, (p + 5, len(orders) * c).

    """
    repeat = math.lcm(stride, step)
    intervals, count = repeat // stride, repeat // step
    instants = phase + step * np.arange(count)
    weights = np.zeros((len(orders), count, intervals + DEGREE))
    for row, order in enumerate(orders):
        here = basis(instants % stride / stride, order) / width**order
        for k in range(ORDER):
            weights[row, np.arange(count), instants // stride + k] = here[:, k]
    return intervals, count, np.ascontiguousarray(weights.reshape(len(orders) * count, -1).T)


@dataclass(frozen=True)
class UniformSpline:
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
            windows = np.lib.stride_tricks.sliding_window_view(self.coefficients, ORDER, axis=1)
            body: Array = np.matmul(windows, weights.T).reshape(self.coefficients.shape[0], -1)
            if self.samples <= body.shape[1]:
                return body[:, : self.samples]
            end = windows[:, -1] @ basis(np.ones(1), derivative).T / width**derivative
            return np.concatenate([body, end], axis=1)
        position = (np.arange(self.samples) + shift / self.dt) / self.stride
        interval = np.clip(np.floor(position).astype(np.intp), 0, intervals - 1)
        weights = basis(position - interval, derivative) / width**derivative
        parts = np.stack([self.coefficients[:, interval + k] * weights[:, k] for k in range(ORDER)])
        return np.asarray(parts.sum(axis=0))

    def between(self, start: int, stop: int, derivatives: int = 3, step: int = 1, first: int = 0) -> Array:
        """Return values and derivatives at samples start, start + step… before stop.

        Parameters
        ----------
        start, stop, step
            Samples.
        derivatives, first
            Derivatives `first` to ``derivatives - 1`` are returned.

        Returns
        -------
        Array
            (derivatives - first, channels, instants).

        """
        orders = tuple(range(first, derivatives))
        phase = start % step
        intervals, count, weights = _pattern(self.stride, step, phase, orders, self.stride * self.dt)
        begin, end = start // step, -((phase - stop) // step)  # numbers of the instants from `phase` on
        number, last = begin // count, max(-(-end // count), begin // count + 1)
        channels, size = self.coefficients.shape
        wanted = slice(number * intervals, last * intervals + DEGREE)
        coefficients = self.coefficients[:, wanted]
        if wanted.stop > size:  # the last sample closes the last interval: what lies beyond has no weight there
            coefficients = np.concatenate([coefficients, np.zeros((channels, wanted.stop - size))], axis=1)
        coefficients = np.ascontiguousarray(coefficients)
        row, column = coefficients.strides
        shape, strides = (channels, last - number, intervals + DEGREE), (row, intervals * column, column)
        # windows of the coefficients, at a tenth of the price of NumPy's own
        windows: Array = np.ndarray(shape, coefficients.dtype, coefficients, 0, strides)
        pieces = np.matmul(windows, weights).reshape(channels, last - number, len(orders), count)
        body: Array = pieces.transpose(2, 0, 1, 3).reshape(len(orders), channels, -1)
        return body[:, :, begin - number * count : end - number * count]
