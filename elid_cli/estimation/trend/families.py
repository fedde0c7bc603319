"""Parameters of one kind over all joints: whether they differ together between recordings, and along a line.

Joints are witnesses of what all of them share. Where their values differ between recordings alike, by more than joints
that scatter independently would (two-way analysis of variance, Fisher), recordings differ in something of the whole
machine. That is not yet a trend: a session's own delay, torque scale or temperature moves all joints, too. So a line is
tested on the mean over joints, one value per recording, whose scatter holds whatever the joints of a recording share.
What one joint does alone moves the mean as well, so both must be nearly as clear without any one of them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import fdtrc

from elid_cli._types import Array
from elid_cli.estimation.regression.long_run import student_quantile
from elid_cli.estimation.trend.conditions import Explanation, explanations
from elid_cli.estimation.trend.series import LEAST, Series, line_of, two_sided

LEADER = re.compile(r"([A-Za-z]+)(\d+)(?: |$)")
"""Kind and joint of a base parameter's leading term."""
JOINTS = 3
"""Fewest joints of a family: without any one of them two must still agree."""
NEARLY = 0.1
"""Part of the p-value without one joint that counts: fewer joints tell less."""
CLEAR = 5.0
"""Least mean over its standard error of a parameter whose relative change counts."""

FamilyWord = Literal["steady", "trend", "together"]


@dataclass(frozen=True)
class Family:
    """One kind of parameters of several joints; changes are parts of each joint's own mean."""

    kind: str
    """Such as ``fv``."""
    names: tuple[str, ...]
    places: Array
    """Places of recordings, (R,)."""
    means: Array
    """Mean over joints in each recording, about 1, (R,)."""
    slope: float
    """Of the mean over joints, per unit of the axis."""
    std_error: float
    """Of it, from the scatter of the joints' slopes alone: what it would be if joints shared nothing but it."""
    interval: tuple[float, float]
    """95 % interval of the slope, which holds what the joints of a recording share."""
    slope_p: float
    """Chance that recordings scatter about no line and the slope is as large, and nearly so without any one joint."""
    together_p: float
    """Chance that independent joints differ as alike between recordings, and nearly so without any one."""
    word: FamilyWord = "steady"
    explained: tuple[Explanation, ...] = ()
    """What the mean over joints goes with, best first; empty where nothing is as clear, or nothing differs."""


def families(series: Sequence[Series], recordings: int) -> list[Family]:
    """Return the kinds that enough joints have in all recordings, not yet judged."""
    kinds: dict[str, list[Series]] = {}
    for item in series:
        leader = LEADER.match(item.name)
        clear = abs(item.mean) > CLEAR * item.within / math.sqrt(len(item.values))
        if leader and clear and len(item.values) == recordings:
            kinds.setdefault(leader.group(1), []).append(item)
    return [_family(kind, members) for kind, members in kinds.items() if len(members) >= JOINTS]


def _family(kind: str, members: Sequence[Series]) -> Family:
    places = members[0].place
    values = np.array([item.values / item.mean for item in members])
    joints, count = values.shape
    means = values.mean(axis=0)
    slopes = np.array([item.slope / item.mean for item in members])
    error = float(slopes.std(ddof=1) / math.sqrt(joints))
    slope, deviation = line_of(places, means, np.zeros(count))
    known = count >= LEAST and math.isfinite(deviation) and deviation > 0
    reach = student_quantile(count - 2, 0.975) * deviation if known else math.inf
    p = _without_one(values, lambda some: _slope_p(places, some.mean(axis=0)))
    together = _without_one(values, _together)
    names = tuple(item.name for item in members)
    return Family(kind, names, places, means, slope, error, (slope - reach, slope + reach), p, together)


def _without_one(values: Array, p_of: Callable[[Array], float]) -> float:
    """Return the p-value of joints (J, R), or a part of that without the one that it hangs on most."""
    rest = max(p_of(np.delete(values, joint, axis=0)) for joint in range(len(values)))
    return max(p_of(values), NEARLY * rest)


def _slope_p(places: Array, means: Array) -> float:
    """Return the p-value of a line through means over joints, 1 where too few recordings tell."""
    slope, deviation = line_of(places, means, np.zeros(len(means)))
    known = len(means) >= LEAST and math.isfinite(deviation) and deviation > 0
    return two_sided(slope / deviation, len(means) - 2) if known else 1.0


def _together(values: Array) -> float:
    """Return the p-value of differences between recordings that all joints share; `values`: (J, R)."""
    joints, count = values.shape
    centred = values - values.mean(axis=1, keepdims=True)
    shared = centred.mean(axis=0)
    own = float(np.sum((centred - shared) ** 2)) / ((joints - 1) * (count - 1))
    between = joints * float(np.sum(shared**2)) / (count - 1)
    if own <= 0:
        return 0.0 if between > 0 else 1.0
    return float(fdtrc(count - 1, (joints - 1) * (count - 1), between / own))


def explained(family: Family, conditions: Mapping[str, Array]) -> tuple[Explanation, ...]:
    """Return what a family's mean goes with: time, or a condition of its recordings."""
    return explanations(family.means, {"time": family.places, **conditions})
