"""Draws from a normal distribution some of whose components are positive, exactly as conditional on that."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array

NEAR = 6.0
"""Standard deviations from 0 within which a positive component is drawn as one that knows it."""
SWEEPS = 200
"""Gibbs sweeps of each set's own chain: correlations of 0.99 are forgotten to 2 %."""
RIDGE = 1e-9
"""Added to correlations that are inverted."""


def draw_sets(
    mean: Array, covariance: Array, positive: NDArray[np.bool_], count: int, generator: np.random.Generator
) -> Array:
    """Return sets, (count, b), of N(mean, covariance) given that some components are positive.

    Parameters
    ----------
    mean, covariance
        (b,) and (b, b), positive semidefinite; components of variance 0 keep their mean.
    positive
        Components without negative values, (b,).
    count
        Number of sets; they are independent.
    generator
        Of the random numbers.
    """
    deviation = np.sqrt(np.diag(covariance))
    unit = covariance / np.outer(*[np.where(deviation > 0, deviation, 1.0)] * 2)
    values, vectors = np.linalg.eigh((unit + unit.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    free = generator.standard_normal((count, len(mean))) @ root.T  # in standard deviations from the mean
    floor = -mean / np.where(deviation > 0, deviation, 1.0)
    near = np.flatnonzero(positive & (deviation > 0) & (floor > -NEAR))
    if len(near):
        among = unit[np.ix_(near, near)] + RIDGE * np.eye(len(near))
        inside = _gibbs(np.asarray(np.linalg.inv(among)), floor[near], count, generator)
        # the rest follows by its regression on these (Matheron): the exact conditional distribution
        free = free + (inside - free[:, near]) @ np.linalg.solve(among, unit[near])
        free[:, near] = inside
    found: Array = mean + deviation * free
    return np.where(positive & (deviation > 0), np.abs(found), found)  # beyond NEAR: one draw of a thousand million


def _gibbs(precision: Array, floor: Array, count: int, generator: np.random.Generator) -> Array:
    """Return sets, (count, k), of a normal distribution of mean 0 above a floor (k,), each from a chain of its own."""
    sets = _above(floor, generator.random((count, len(floor))))
    for _ in range(SWEEPS if len(floor) > 1 else 0):
        for j, own in enumerate(np.diag(precision)):
            others = sets @ precision[j] - own * sets[:, j]
            centre, spread = -others / own, 1.0 / np.sqrt(own)
            sets[:, j] = centre + spread * _above((floor[j] - centre) / spread, generator.random(count))
    return np.maximum(sets, floor)


def _above(floor: Array, uniform: Array) -> Array:
    """Return standard normal values above a floor for uniform numbers, exact in the far tail."""
    from scipy.special import log_ndtr, ndtri_exp

    tiny = np.finfo(float).tiny
    return np.asarray(-ndtri_exp(np.log(np.maximum(uniform, tiny)) + log_ndtr(-floor)))
