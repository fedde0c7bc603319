"""Inertia of a body from its geoms: MuJoCo's rule where a body has no ``<inertial>``."""

from __future__ import annotations

import math

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.inertia import about_origin, moved, pseudo_inertia
from elid_cli.robot.mjcf.attributes import Conventions, from_z
from elid_cli.robot.urdf.xml import Element

MASSLESS = ("plane", "hfield")
SHAPES = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
WATER = 1000.0
"""kg/m³: MuJoCo's default density."""


def geom_inertia(geom: Element, conventions: Conventions) -> Array | None:
    """Return a geom's 4x4 pseudo-inertia in its body's frame; None of a mesh, whose shape stands in another file."""
    kind = geom.attributes.get("type", "mesh" if "mesh" in geom.attributes else "sphere")
    low, high = conventions.groups
    if kind in MASSLESS or not low <= geom.number("group", 0.0) <= high:
        return np.zeros((4, 4))
    mass = geom.number("mass", math.nan)
    if mass == 0.0 or geom.number("density", WATER) == 0.0:
        return np.zeros((4, 4))
    if kind not in SHAPES:
        return None
    given = geom.attributes.get("size", "0")
    size = np.array([*geom.parsed(given, len(given.split()), "size"), 0.0, 0.0, 0.0])[:3]
    pose = conventions.pose(geom)
    if "fromto" in geom.attributes:
        ends = np.array(geom.numbers("fromto", (0.0,) * 6))
        along = ends[:3] - ends[3:]
        half = float(np.linalg.norm(along)) / 2
        pose[:3, :3], pose[:3, 3] = (
            from_z(along / (2 * half) if half > 0 else np.array([0, 0, 1.0])),
            ends.reshape(2, 3).mean(0),
        )
        size = (
            np.array([size[0], half, half]) if kind in ("capsule", "cylinder") else np.array([size[0], size[0], half])
        )
    volume, moments = _solid(kind, size)
    if math.isnan(mass):
        mass = volume * geom.number("density", WATER)
    return moved(pseudo_inertia(about_origin(mass, np.zeros(3), np.diag(mass * moments))), pose)


def _solid(kind: str, size: Array) -> tuple[float, Array]:
    """Return the volume, m³, and the moments of inertia per mass about the centre, m², (3,)."""
    r, h, d = (float(value) for value in size)
    if kind == "sphere":
        return 4 / 3 * math.pi * r**3, np.full(3, 0.4 * r**2)
    if kind == "box":
        return 8 * r * h * d, np.array([h * h + d * d, r * r + d * d, r * r + h * h]) / 3
    if kind == "ellipsoid":
        return 4 / 3 * math.pi * r * h * d, np.array([h * h + d * d, r * r + d * d, r * r + h * h]) / 5
    cylinder, ends = 2 * math.pi * r**2 * h, 4 / 3 * math.pi * r**3
    across, along = r * r / 4 + h * h / 3, r * r / 2
    if kind == "cylinder":
        return cylinder, np.array([across, across, along])
    # the half spheres at the ends, moved out from their common centre
    out = 0.4 * r**2 + h * h + 0.75 * r * h
    total = cylinder + ends
    across, along = (cylinder * across + ends * out) / total, (cylinder * along + ends * 0.4 * r**2) / total
    return total, np.array([across, across, along])
