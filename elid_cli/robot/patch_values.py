"""What changes in a robot's own file, and which of its numbers are other ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from elid_cli._types import Array
from elid_cli.robot.robot import Joint
from elid_cli.robot.urdf.xml import Element
from elid_cli.robot.xml_text import xml_number

SAME = 1e-12
"""Relative change below which a number is left as the file has it."""


class Change(NamedTuple):
    """What changed of a joint."""

    joint: Joint
    """Itself, as it is to be."""
    body: Array | None
    """What its body's inertia changed by."""
    said: dict[str, str]
    """What of its motor only elid's own element can say."""
    limit: float | None
    """A torque limit other than the file's, N·m (N); infinite where there is none any more."""
    zero: float
    """By how much its positions are read larger than by the file, rad (m)."""


Changes = dict[str, Change]


def other(element: Element, values: dict[str, str]) -> dict[str, str]:
    """Return the attributes that have another value."""
    return {
        key: value
        for key, value in values.items()
        if key not in element.attributes or not alike(element.attributes[key], value)
    }


def alike(before: str, after: str) -> bool:
    """Whether two attributes hold the same words, or numbers that are nearly equal."""
    if before.split() == after.split():
        return True
    try:
        numbers = [[float(word) for word in text.split()] for text in (before, after)]
    except ValueError:
        return False
    return len(numbers[0]) == len(numbers[1]) and all(map(near, *numbers))


def near(a: float, b: float) -> bool:
    """Whether two numbers differ by rounding only."""
    return abs(a - b) <= SAME * max(abs(a), abs(b))


def named(joint: Joint, keys: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Return those of a joint's parameters that are known, by the names of attributes."""
    return {attribute: xml_number(joint.parameters[key]) for attribute, key in keys if key in joint.parameters}
