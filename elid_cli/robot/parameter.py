"""Standard parameters as values: what is asked of one is its kind and its joint, never the letters of its name."""

from __future__ import annotations

import re
from typing import Any, NoReturn


class StandardParameter(str):
    """A standard parameter: one of the 14 kinds, such as ``K``, of a joint (from 0); as text its name, ``K2``.

    It is the same as its name in comparisons, in dictionaries and in files.
    """

    kind: str
    joint: int

    def __new__(cls, kind: str, joint: int) -> StandardParameter:
        """Return the parameter of that kind of joint number `joint`, from 0."""
        made = super().__new__(cls, f"{kind}{joint + 1}")
        vars(made).update(kind=kind, joint=joint)
        return made

    def __setattr__(self, name: str, value: object) -> NoReturn:
        """Refuse: it is a value."""
        raise AttributeError(f"{name} of {self} cannot be set")

    def __getnewargs__(self) -> Any:
        """Return what a copy in another process is made from."""
        return self.kind, self.joint


def parameter_named(name: str) -> StandardParameter | None:
    """Return the parameter of a name that was read from a file, or None where it is none: ``K2``."""
    parts = re.fullmatch(r"([A-Za-z]+)([1-9]\d*)", name)
    return StandardParameter(parts[1], int(parts[2]) - 1) if parts else None
