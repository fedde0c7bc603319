"""Turns and shifts of frames, exact at quarter turns."""

from __future__ import annotations

import math

import numpy as np

from elid_cli._types import Array

SNAP = 1e-6
"""DH angles this near (rad) to a multiple of pi/2 are taken as that multiple, or base counts go wrong."""
EXACT = 1e-10
"""The same of the angles of a URDF or MJCF, which others read too: torques are to be theirs."""
QUARTER = 2e-5
"""The same where only the structure counts (`Robot.squared`): most files say 1.5708 or 3.1416."""


def exact_sin_cos(angle: float, near: float = SNAP) -> tuple[float, float]:
    """Return (sin, cos) of an angle in rad, exact where it is within `near` of a multiple of pi/2."""
    quarter = round(angle / (math.pi / 2))
    if abs(angle - quarter * math.pi / 2) < near:
        return ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[quarter % 4]
    return math.sin(angle), math.cos(angle)


def rotation_x(angle: float) -> Array:
    """Return the 4x4 transform that turns about x by an angle in rad."""
    s, c = exact_sin_cos(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def rotation_z(angle: float) -> Array:
    """Return the 4x4 transform that turns about z by an angle in rad."""
    s, c = exact_sin_cos(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def translation(x: float, y: float, z: float) -> Array:
    """Return the 4x4 transform that shifts by (x, y, z) in m."""
    transform = np.eye(4)
    transform[:3, 3] = (x, y, z)
    return transform


def rotation_rpy(angles: tuple[float, float, float]) -> Array:
    """Return the 4x4 transform that turns by roll, pitch, yaw about the fixed x, y, z axes, in rad."""
    (sr, cr), (sp, cp), (sy, cy) = (exact_sin_cos(angle, EXACT) for angle in angles)
    transform = np.eye(4)
    transform[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return transform


def rpy_of(transform: Array) -> tuple[float, float, float]:
    """Return the (roll, pitch, yaw) of a transform's rotation, accurate at pitch = ±pi/2 too."""
    r = transform[:3, :3]
    yaw = math.atan2(r[1, 0], r[0, 0]) if math.hypot(r[1, 0], r[0, 0]) > 1e-12 else 0.0
    # With yaw taken off, what is left is a turn about y after a turn about x, whatever the yaw was.
    rest = rotation_z(-yaw)[:3, :3] @ r
    return math.atan2(-rest[1, 2], rest[1, 1]), math.atan2(-rest[2, 0], rest[0, 0]), yaw


def to_quarter(angle: float) -> float:
    """Return an angle in rad, a multiple of pi/2 where it is within `QUARTER` of one."""
    exact = round(angle / (math.pi / 2)) * math.pi / 2
    return exact if abs(angle - exact) < QUARTER else angle


def z_to(axis: tuple[float, float, float]) -> Array:
    """Return a 4x4 rotation whose third column is `axis` (identity when the axis is z)."""
    z = np.asarray(axis, dtype=float)
    z = z / np.linalg.norm(z)
    transform = np.eye(4)
    if abs(z[2] - 1.0) < 1e-12:
        return transform
    seed = np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, 1.0, 0])
    x = seed - z * (seed @ z)
    x /= np.linalg.norm(x)
    transform[:3, 0], transform[:3, 1], transform[:3, 2] = x, np.cross(z, x), z
    return transform


def by_dh(a: float, alpha: float, d: float, theta: float, *, modified: bool) -> tuple[Array, Array]:
    """Return the 4x4 transforms before and after a joint's motion, of its Denavit-Hartenberg parameters, m and rad."""
    offset, link = rotation_z(theta) @ translation(0, 0, d), translation(a, 0, 0)
    if modified:
        return rotation_x(alpha) @ link @ offset, np.eye(4)
    return np.eye(4), offset @ link @ rotation_x(alpha)


def by_axis(
    xyz: tuple[float, float, float], rpy: tuple[float, float, float], axis: tuple[float, float, float]
) -> tuple[Array, Array]:
    """Return the 4x4 transforms before and after a joint's motion, of its origin, m and rad, and its axis."""
    align = z_to(axis)
    return translation(*xyz) @ rotation_rpy(rpy) @ align, align.T.copy()
