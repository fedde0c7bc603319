"""Standard parameters as values: what is asked of one is its kind and its joint, never the letters of its name."""

from __future__ import annotations

import re
from typing import Any, NoReturn

LINK_PARAMETERS = ("m", "cx", "cy", "cz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Names of a body's ten inertial parameters, without the joint's number."""
MOTOR_PARAMETERS = ("Jm", "Ja", "fs", "fv")
"""Names of a motor's parameters; it has `Jm` where its gear ratio is known, `Ja` otherwise."""
JOINT_PARAMETERS = (*LINK_PARAMETERS, *MOTOR_PARAMETERS, "K")
"""Names of the 14 parameters of a joint, without its number, with the two names of its rotor's inertia."""
POSITIVE = ("K", *MOTOR_PARAMETERS)
"""Parameters that no physical joint has negative."""
PARAMETER_GROUPS: tuple[tuple[str, ...], ...] = (
    ("m",),
    ("cx", "cy", "cz"),
    ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"),
    ("Jm", "Ja"),
    ("fs",),
    ("fv",),
    ("K",),
)
"""Standard order, grouped by kind as eq. (14): every joint's m, then every joint's first moment, …"""


class StandardParameter(str):
    """A standard parameter: one of the 14 kinds, such as ``K``, of a joint (from 0); as text its name, ``K2``.

    It is the same as its name in comparisons, in dictionaries and in files.
    """

    kind: str
    joint: int

    def __new__(cls, kind: str, joint: int) -> StandardParameter:
        """Return the parameter of that kind of joint number `joint`, from 0."""
        known = _MADE.get((kind, joint))
        if known is None:  # a value: one of each will do
            known = super().__new__(cls, f"{kind}{joint + 1}")
            vars(known).update(kind=kind, joint=int(joint))
            _MADE[kind, joint] = known
        return known

    def __setattr__(self, name: str, value: object) -> NoReturn:
        """Refuse: it is a value."""
        raise AttributeError(f"{name} of {self} cannot be set")

    def __getnewargs__(self) -> Any:
        """Return what a copy in another process is made from."""
        return self.kind, self.joint


def place_in_order(name: str) -> tuple[int, int, int]:
    """Return a key that sorts names of standard parameters into standard order; of other names they come last."""
    parameter = parameter_named(name)
    for number, group in enumerate(PARAMETER_GROUPS):
        if parameter is not None and parameter.kind in group:
            return number, parameter.joint, group.index(parameter.kind)
    return len(PARAMETER_GROUPS), 0, 0


_MADE: dict[tuple[str, int], StandardParameter] = {}


def parameter_named(name: str) -> StandardParameter | None:
    """Return the parameter of a name that was read from a file, or None where it is none: ``K2``."""
    parts = re.fullmatch(r"([A-Za-z]+)([1-9]\d*)", name)
    return StandardParameter(parts[1], int(parts[2]) - 1) if parts else None
