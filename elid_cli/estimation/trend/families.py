"""Parameters of one kind over all joints, and whether they change together.

What a drive does with every joint alike (grease that warms up) is one hypothesis with as many witnesses as joints,
where each joint alone would have to stand out from all parameters of the machine.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli.estimation.trend.series import LEAST, Series, line_of, two_sided

LEADER = re.compile(r"([A-Za-z]+)(\d+)(?: |$)")
"""Kind and joint of a base parameter's leading term."""
JOINTS = 4
"""Fewest joints of a family."""
CLEAR = 5.0
"""Least mean over its standard error of a parameter whose relative change counts."""
STEADY = 0.05
"""Most that the line through the joints' common mean may be due to the scatter of recordings: else all joints wander
together, which is no trend."""


@dataclass(frozen=True)
class Family:
    """One kind of parameters of several joints."""

    kind: str
    """Such as ``fv``."""
    names: tuple[str, ...]
    slope: float
    """Mean of the joints' slopes, each over its own mean, per unit of the axis."""
    std_error: float
    """Of it, from the scatter of joints."""
    p: float
    """Chance of such a mean slope where joints change independently about none; 1 where their mean only wanders."""
    named: bool = False
    """Whether it holds among all that was asked of the machine."""


def families(series: Sequence[Series]) -> list[Family]:
    """Return the kinds that enough joints have, with what their slopes say together (Student's t over joints)."""
    kinds: dict[str, list[Series]] = {}
    for item in series:
        leader = LEADER.match(item.name)
        if leader and abs(item.mean) > CLEAR * item.within / np.sqrt(len(item.values)):
            kinds.setdefault(leader.group(1), []).append(item)
    return [_family(kind, members) for kind, members in kinds.items() if len(members) >= JOINTS]


def _family(kind: str, members: Sequence[Series]) -> Family:
    slopes = np.array([item.slope / abs(item.mean) for item in members])
    error = float(slopes.std(ddof=1) / np.sqrt(len(slopes)))
    p = two_sided(float(slopes.mean()) / error, len(slopes) - 1) if error > 0 else 1.0
    together = _common_line(members)
    return Family(kind, tuple(item.name for item in members), float(slopes.mean()), error, p if together else 1.0)


def _common_line(members: Sequence[Series]) -> bool:
    """Return whether the mean over joints follows a line rather than the scatter of its recordings."""
    place = np.unique(np.concatenate([item.place for item in members]))
    whole = [item for item in members if len(item.place) == len(place)]
    if len(place) < LEAST or len(whole) < JOINTS:
        return False
    mean = np.mean([item.values / abs(item.mean) for item in whole], axis=0)
    slope, deviation = line_of(place, mean, np.zeros(len(place)))
    return deviation > 0 and two_sided(slope / deviation, len(place) - 2) < STEADY
