"""One parameter over recordings: what its errors explain, and what a line or a step does.

Recordings of one machine scatter more than the standard errors of each say. That spread is estimated from the residual
about the line or the step itself, so a slope's interval holds it (Student's t; Knapp and Hartung 2003 for the pooled
mean). A step's p-value counts every place that it could have been at (Bonferroni).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import chdtrc, stdtr

from elid_cli._types import Array
from elid_cli.estimation.regression.long_run import student_quantile

Word = Literal["steady", "trend", "step", "disagrees"]
LEAST = 3
"""Recordings on each side of a step, and the least for a line with an error."""
DOUBTFUL = 0.05
"""Largest p-value of a line, by itself, from which it is not said that no line explains values."""


@dataclass(frozen=True)
class Step:
    """A change between two recordings."""

    after: int
    """Number of the last of the values before it, from 0."""
    size: float
    p: float


@dataclass(frozen=True)
class Series:
    """What recordings say of one parameter, in its unit."""

    name: str
    unit: str
    place: Array
    """Place of every recording that estimates it on the axis of the slope, (R,): its number, or hours."""
    values: Array
    """Estimates, SI of the unit, (R,)."""
    errors: Array
    """Standard errors, SI of the unit, (R,)."""
    mean: float
    within: float
    """Standard error of one recording, the root mean square."""
    between: float
    """Spread between recordings beyond their errors, as a standard deviation (DerSimonian and Laird 1986)."""
    slope: float
    interval: tuple[float, float]
    """95 % interval of the slope."""
    slope_p: float
    step: Step | None
    heterogeneity_p: float
    """Chance that the errors alone scatter values as far from their mean."""

    @property
    def widest(self) -> tuple[float, float, float]:
        """Return by how much values differ at most, the earlier value of the two, and the difference in its errors."""
        one, other = sorted((int(np.argmin(self.values)), int(np.argmax(self.values))))
        size = abs(float(self.values[other] - self.values[one]))
        error = math.hypot(float(self.errors[one]), float(self.errors[other]))
        return size, float(self.values[one]), size / max(error, 1e-300)

    @property
    def undecided(self) -> bool:
        """Whether values that differ may yet follow time: too few for a step, or along a line that is not certain."""
        return len(self.values) < 2 * LEAST or self.slope_p < DOUBTFUL


def series_of(name: str, unit: str, place: Array, values: Array, errors: Array) -> Series:
    """Return what R recordings say of one parameter.

    Parameters
    ----------
    name, unit
        Of the parameter.
    place, values, errors
        Places, estimates and standard errors, (R,).
    """
    count = len(values)
    weights = 1.0 / np.maximum(errors, 1e-300) ** 2
    plain = float(np.sum(weights * values) / np.sum(weights))
    q = float(np.sum(weights * (values - plain) ** 2))
    scale = float(np.sum(weights) - np.sum(weights**2) / np.sum(weights))
    variance = max((q - (count - 1)) / scale, 0.0) if count > 1 and scale > 0 else 0.0
    mixed = 1.0 / (errors**2 + variance + 1e-300)
    mean = float(np.sum(mixed * values) / np.sum(mixed))
    slope, deviation = line_of(place, values, errors)
    known = count >= LEAST and np.isfinite(deviation)
    reach = student_quantile(count - 2, 0.975) * deviation if known else math.inf
    p = two_sided(slope / deviation, count - 2) if known and deviation > 0 else 1.0
    return Series(
        name, unit, place, values, errors, mean, float(np.sqrt(np.mean(errors**2))), math.sqrt(variance), slope,
        (slope - reach, slope + reach), p, _step(values, errors),
        float(chdtrc(count - 1, q)) if count > 1 else 1.0,
    )  # fmt: skip


def line_of(place: Array, values: Array, errors: Array) -> tuple[float, float]:
    """Return slope and standard error, the spread between recordings taken from the residual about the line."""
    count = len(values)
    if count < LEAST or np.ptp(place) == 0:
        return 0.0, math.inf
    columns = np.stack([np.ones(count), place - place.mean()], axis=1)
    weights = np.ones(count)
    for _ in range(20):
        gram = columns.T @ (columns * weights[:, None])
        found = np.linalg.solve(gram, columns.T @ (weights * values))
        left = values - columns @ found
        extra = max(float(np.sum(left**2) / (count - 2) - np.mean(errors**2)), 0.0)
        now = 1.0 / (errors**2 + extra + 1e-300)
        if np.allclose(now, weights, rtol=1e-6):
            break
        weights = now
    size = max(float(np.sum(weights * left**2) / (count - 2)), 1.0)
    return float(found[1]), float(np.sqrt(size * np.linalg.inv(gram)[1, 1]))


def two_sided(t: float, freedom: int) -> float:
    """Return the chance that Student's t lies as far from zero."""
    return float(2.0 * stdtr(freedom, -abs(t)))


def _step(values: Array, errors: Array) -> Step | None:
    """Return the most likely step, its p-value over all places where one could be."""
    count = len(values)
    sizes = np.arange(LEAST, count - LEAST + 1)
    if not len(sizes):
        return None
    one, other = sizes, count - sizes
    centred = values - values.mean()
    sums = np.cumsum(centred)[sizes - 1]  # of the first side; the other side's is its negative
    within = (float(centred @ centred) - sums**2 / one - sums**2 / other) / (count - 2)
    # the scatter of a side is no smaller than the errors of its recordings say
    variance = np.maximum(within, float(np.mean(errors**2))) * (1 / one + 1 / other)
    jumps = -sums / other - sums / one
    t = jumps / np.sqrt(np.maximum(variance, 1e-300))
    best = int(np.argmax(np.abs(t)))
    p = min(1.0, len(sizes) * two_sided(float(t[best]), count - 2))
    return Step(int(sizes[best]) - 1, float(jumps[best]), p)
