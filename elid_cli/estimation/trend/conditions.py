"""What recordings differ in beside their parameters, and which of it a change goes with.

Two explanations are told apart by the difference of their correlations with what is to be explained, in the same
recordings (Williams 1959; Steiger 1980): few recordings seldom tell time from a temperature that rose with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.comparison import SavedResult
from elid_cli.estimation.trend.series import two_sided

LEAST = 4
"""Fewest recordings by which explanations are compared."""
LEVEL = 0.05
"""Most that an explanation, or its lead before another, may be due to chance."""
DELAY = "torque_delay of "


@dataclass(frozen=True)
class Explanation:
    """A condition that a change goes with."""

    by: str
    """``time``, ``temperature`` or ``delay``."""
    share: float
    """Part of the variance between recordings that a line in it takes away."""
    p: float
    """Chance that an unrelated one takes away as much."""
    ruled_out: bool
    """Whether the best one explains more than this one, beyond chance."""


def conditions_of(results: Sequence[SavedResult]) -> dict[str, Array]:
    """Return the conditions that all recordings tell: mean temperature, °C, and mean delay of joints, s, (R,) each."""
    found = {}
    temperatures = [result.temperature for result in results]
    if all(value is not None for value in temperatures):
        found["temperature"] = np.array(temperatures, dtype=float)
    told = [{name for name, e in result.beside.items() if name.startswith(DELAY) and e.value is not None}
            for result in results]  # fmt: skip
    names = sorted(set.intersection(*told)) if told else []
    if names:
        found["delay"] = np.array([np.mean([result.beside[name].value for name in names]) for result in results])
    return {name: values for name, values in found.items() if np.ptp(values) > 1e-9 * np.max(np.abs(values))}


def explanations(values: Array, conditions: Mapping[str, Array]) -> tuple[Explanation, ...]:
    """Return what `values` (R,) go with, best first; none where the best may be chance."""
    count = len(values)
    if count < LEAST or np.ptp(values) == 0:
        return ()
    found = {name: float(np.corrcoef(values, own)[0, 1]) for name, own in conditions.items() if np.ptp(own) > 0}
    order = sorted(found, key=lambda name: -abs(found[name]))
    chances = {name: _chance(found[name], count) for name in order}
    if not order or chances[order[0]] > LEVEL:
        return ()
    best = order[0]
    told = []
    for name in order:
        mutual = float(np.corrcoef(conditions[best], conditions[name])[0, 1]) * math.copysign(
            1, found[best] * found[name]
        )
        behind = name != best and _lead(abs(found[best]), abs(found[name]), mutual, count) < LEVEL
        told.append(Explanation(name, found[name] ** 2, chances[name], behind))
    return tuple(told)


def _chance(r: float, count: int) -> float:
    return two_sided(r * math.sqrt((count - 2) / max(1.0 - r * r, 1e-15)), count - 2)


def _lead(r1: float, r2: float, r12: float, count: int) -> float:
    """Return the p-value of the difference of two correlations with the same variable (Williams's t)."""
    rest = max(1.0 - r1**2 - r2**2 - r12**2 + 2.0 * r1 * r2 * r12, 0.0)
    mean = (r1 + r2) / 2.0
    size = 2.0 * (count - 1) / (count - 3) * rest + mean**2 * (1.0 - r12) ** 3
    if size <= 0:
        return 1.0
    return two_sided((r1 - r2) * math.sqrt((count - 1) * (1.0 + r12) / size), count - 3)
