"""Elements of an MJCF as numbers: springs, axes, inertias, included files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.files import LARGEST, read_text
from elid_cli.robot.inertia import about_origin, moved, pseudo_inertia, symmetric
from elid_cli.robot.mjcf.attributes import Conventions
from elid_cli.robot.urdf.xml import Element, parse_xml, unit_axis

DEEPEST_INCLUDE = 10
SOFTEST = 1e-9
"""Stiffness per N·m of preload that stands for none."""


def stiffness_and_rest(spring: Mapping[str, float]) -> tuple[float, float]:
    """Return the stiffness, N·m/rad (N/m), and the position at rest, rad (m), of a `SPRING` with these parameters."""
    # a constant torque alone is a spring so soft, and so far from rest, that it is one
    stiffness = spring["stiffness"] or SOFTEST * max(abs(spring["preload"]), 1.0)
    return stiffness, -spring["preload"] / stiffness


def axis_of(element: Element) -> tuple[float, float, float]:
    """Return a joint's unit axis in its body's frame."""
    return unit_axis(element, element.numbers("axis", (0.0, 0.0, 1.0)))


def inertial_of(inertial: Element, conventions: Conventions) -> Array:
    """Return the 4x4 pseudo-inertia of an ``<inertial>`` in its body's frame."""
    if "fullinertia" in inertial.attributes:
        tensor = symmetric(inertial.numbers("fullinertia", (0.0,) * 6))
    else:
        tensor = np.diag(inertial.numbers("diaginertia", (0.0, 0.0, 0.0)))
    own = pseudo_inertia(about_origin(inertial.number("mass", 0.0), np.zeros(3), tensor))
    return moved(own, conventions.pose(inertial))


def first_number(element: Element, key: str) -> float:
    """Return the first number of an attribute; MuJoCo takes polynomials and six-dimensional gears there."""
    parts = element.attributes[key].split()
    return element.parsed(parts[0] if parts else "", 1, key)[0]


def placed_frames(holder: Element, conventions: Conventions) -> Iterator[tuple[Element, Array]]:
    """Yield the frames of an element, nested ones too, with their 4x4 poses in it."""
    for frame in holder.all("frame"):
        pose = conventions.pose(frame)
        yield frame, pose
        yield from ((inner, pose @ at) for inner, at in placed_frames(frame, conventions))


def included(holder: Element, folder: Path, depth: int) -> Iterator[Element]:
    """Yield an element's children, ``<include>`` replaced by what the files hold."""
    for child in holder.children:
        if child.tag != "include":
            child.children = list(included(child, folder, depth))
            yield child
            continue
        if depth >= DEEPEST_INCLUDE:
            raise child.error(f"includes nested deeper than {DEEPEST_INCLUDE}")
        path = folder / child.need("file")
        text = read_text(path, RobotError, suffixes=(".xml",), most=LARGEST * 20)
        inner = parse_xml(text, str(path))
        inner.faults = holder.faults
        yield from included(inner, folder, depth + 1)
