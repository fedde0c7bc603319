"""What a trajectory fit makes small: errors of positions, large ones, where a joint sticks, counted less (Cauchy).

An error e counts as s² log(1 + (e/s)²) beside its usual size s. The slope of that is 2 e w with the weight w = 1 / (1 +
(e/s)²): weighted least squares descend. But it bends less than the weights say, by 2 (1 - (e/s)²) w²: of noise of a
normal distribution by half. Newton's steps, and standard errors, follow that (Huber, Robust Statistics, 1981).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array

FLATTEST = 0.5
"""Least part of its weights by which the loss is taken to bend: steps are twice as long at most."""


@dataclass(frozen=True)
class Weighed:
    """The errors of a stretch, rad (m), and what they count, (N, n) each; 0 of samples that do not count."""

    error: Array
    light: Array
    """Square root of the weight."""
    loss: Array
    """rad² (m²)."""
    bend: Array
    """Half of its second derivative."""


def usual_size(error: Array, counts: NDArray[np.bool_]) -> Array:
    """Return the usual size of errors (N, n) over the samples that count, (n,)."""
    found: Array = np.maximum(np.sqrt(np.mean(error[counts] ** 2, axis=0)), 1e-9)
    return found


def weighed(error: Array, usual: Array | float, counts: NDArray[np.bool_]) -> Weighed:
    """Return errors (N, n) with what they count beside their usual size (n,)."""
    square = (error / usual) ** 2
    light = np.where(counts[:, None], (1.0 + square) ** -0.5, 0.0)
    return Weighed(error, light, np.where(light > 0, usual**2 * np.log1p(square), 0.0), (1.0 - square) * light**4)


def size_of(seen: Sequence[Weighed]) -> Array:
    """Return the size of the errors of all stretches, large ones counted less, rad (m), (n,)."""
    found: Array = np.sqrt(
        np.sum([item.loss.sum(axis=0) for item in seen], axis=0) / sum(len(item.loss) for item in seen)
    )
    return found


def bent(seen: Sequence[Weighed]) -> Array:
    """Return by how much the loss of every joint bends, as a part of its weights, (n,)."""
    bend = np.sum([item.bend.sum(axis=0) for item in seen], axis=0)
    weight = np.sum([(item.light**2).sum(axis=0) for item in seen], axis=0)
    found: Array = np.maximum(bend / np.maximum(weight, 1e-12), FLATTEST)
    return found
