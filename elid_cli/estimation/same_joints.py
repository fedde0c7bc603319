"""Which parameters of two results are of the same joints, and so may be compared.

Parameters are called by their joint's number: of two robots, K3 may be the stiffness of an elbow and of a lift.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

TERM = re.compile(r"[A-Za-z]+(\d+)(?![\w.])")
"""A standard parameter in the name of a base parameter, with its joint's number."""


def comparable(
    joints: tuple[Sequence[str], Sequence[str]], units: tuple[Mapping[str, str], Mapping[str, str]]
) -> list[str]:
    """Return the parameters that two results have of the same joints, in the first's order.

    A joint is the same where its name and the units of its parameters are. Where joints are called by other names, but
    all parameters and units are the same, the robots are of one type and all joints count as the same; so they do where
    a result does not name its joints.

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
    unlike = {k for name in shared if first[name] != other[name] and len(numbers[name]) == 1 for k in numbers[name]}
    if all(joints) and tuple(joints[0]) != tuple(joints[1]) and first != other:
        pairs = enumerate(zip(*joints, strict=False), start=1)
        same = {k for k, (one, two) in pairs if one == two}
        unlike |= {k for of in numbers.values() for k in of} - same
    return [name for name in shared if first[name] == other[name] and not numbers[name] & unlike]
