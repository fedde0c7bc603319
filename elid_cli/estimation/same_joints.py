"""Which parameters of two results are of the same joints, and so may be compared.

Parameters are called by their joint's number: of two robots, K3 may be the stiffness of an elbow and of a lift.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import takewhile

TERM = re.compile(r"[A-Za-z]+(\d+)(?![\w.])")
"""A standard parameter in the name of a base parameter, with its joint's number."""

MOST = 0.6
"""Part of the joints of the robot of fewer that must have the other's names for both to be one robot, changed."""


def unlike(first: Sequence[str], other: Sequence[str]) -> bool:
    """Whether joints of these names, base first, are of different robots; not where one does not name them.

    Joints of one robot may be held, or its last ones changed, such as a hand: most are the other's then, in its order.
    Those of a second robot of one type may all have another word before or after their names, such as ``left_``.
    """
    if not first or not other:
        return False
    common = [name for name in first if name in other]
    if MOST * min(len(first), len(other)) <= len(common) and common == [name for name in other if name in common]:
        return False
    return _bare(first) != _bare(other)


def _bare(names: Sequence[str]) -> tuple[str, ...]:
    """Return names without what all of them begin and end with; of a single one there is no telling."""
    if len(names) < 2:
        return tuple(names)
    rest = [name[_alike(names) :] for name in names]
    after = _alike([name[::-1] for name in rest])
    return tuple(name[: len(name) - after] for name in rest)


def _alike(names: Sequence[str]) -> int:
    """Return with how many letters all names begin alike."""
    return sum(1 for _ in takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False)))


def comparable(
    joints: tuple[Sequence[str], Sequence[str]], units: tuple[Mapping[str, str], Mapping[str, str]]
) -> list[str]:
    """Return the parameters that two results have of the same joints, in the first's order.

    A joint is the same where its name and the units of its parameters are. Where joints have another word before or
    after their names, but all parameters and units are the same, the robots are of one type and all joints count as the
    same; so they do where a result does not name its joints.

    Parameters
    ----------
    joints
        Names of the joints of either result, base first.
    units
        Parameter: unit, of either result.
    """
    first, other = units
    shared = [name for name in first if name in other]
    numbers = {name: {int(number) for number in TERM.findall(name)} for name in shared}
    apart = {k for name in shared if first[name] != other[name] and len(numbers[name]) == 1 for k in numbers[name]}
    if all(joints) and tuple(joints[0]) != tuple(joints[1]) and first != other:
        pairs = enumerate(zip(*joints, strict=False), start=1)
        same = {k for k, (one, two) in pairs if one == two}
        apart |= {k for of in numbers.values() for k in of} - same
    return [name for name in shared if first[name] == other[name] and not numbers[name] & apart]
