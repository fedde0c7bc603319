"""The robot: a serial chain of joints, each with a motor behind an elastic or a rigid transmission.

Frozen dataclasses only. Reading and writing them as YAML is `robot_file.py`, URDF is `urdf.py`.
Joints are numbered from 1, base to tip, in names; from 0 in arrays. Units are SI.

Geometry: frame i follows from frame i-1 by ``before_i · motion(q_i) · after_i``, where the motion turns about
(or, for a prismatic joint, slides along) the z axis. Distal (standard) DH has ``before = 1``, proximal
(modified) DH and URDF have everything in `before` (URDF axes other than z also need `after`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array

JointType = Literal["revolute", "prismatic"]
Transmission = Literal["elastic", "rigid"]
Convention = Literal["standard", "modified", "urdf"]

LINK_PARAMETERS = ("m", "cx", "cy", "cz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Names of a body's ten inertial parameters, without the joint's number."""
JOINT_PARAMETERS = (*LINK_PARAMETERS, "Jm", "fs", "fv", "K")
"""Names of the 14 parameters of a joint, without its number."""
PARAMETER_GROUPS: tuple[tuple[str, ...], ...] = (
    ("m",),
    ("cx", "cy", "cz"),
    ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"),
    ("Jm",),
    ("fs",),
    ("fv",),
    ("K",),
)
"""Standard order, grouped by kind as eq. (14): every joint's m, then every joint's first moment, …"""

SNAP = 1e-6
"""Angles this near (rad) to a multiple of pi/2 are taken as that multiple, or base counts go wrong."""


def _empty() -> Mapping[str, Any]:
    return {}  # a plain dict, so that robots can be sent to worker processes


def exact_sin_cos(angle: float) -> tuple[float, float]:
    """Return (sin, cos) of an angle in rad, exact where it is within `SNAP` of a multiple of pi/2."""
    quarter = round(angle / (math.pi / 2))
    if abs(angle - quarter * math.pi / 2) < SNAP:
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
    (sr, cr), (sp, cp), (sy, cy) = (exact_sin_cos(angle) for angle in angles)
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


@dataclass(frozen=True)
class Limits:
    """Limits of a joint, joint side: position (low, high) in rad or m, the others as magnitudes; None: unknown."""

    position: tuple[float, float] | None = None
    velocity: float | None = None
    acceleration: float | None = None
    torque: float | None = None


@dataclass(frozen=True)
class Joint:
    """One joint with its body, motor and transmission (docs/reference/formats.md, robot files)."""

    name: str
    type: JointType = "revolute"
    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    gear_ratio: float = 1.0
    """k_m: rotor turns per joint turn (rad per m for a prismatic joint)."""
    motor_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """z_m: unit vector of the rotor's axis in frame i-1."""
    transmission: Transmission = "elastic"
    parameters: Mapping[str, float] = field(default_factory=_empty)
    """Reference values by the names of `JOINT_PARAMETERS`; those not named are unknown, not zero."""
    limits: Limits = field(default_factory=Limits)
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Origin of the joint in the parent frame, m (convention ``urdf`` only)."""
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Fixed-axis roll, pitch, yaw of the joint in the parent frame, rad (convention ``urdf`` only)."""
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit axis in the joint's own frame (convention ``urdf`` only)."""

    @property
    def revolute(self) -> bool:
        """Whether the joint turns (True) or slides (False)."""
        return self.type == "revolute"

    @property
    def elastic(self) -> bool:
        """Whether motor and link positions differ."""
        return self.transmission == "elastic"


@dataclass(frozen=True)
class EffectSpec:
    """An effect declared in a robot file: its name, its joint (None: the whole robot) and its parameters."""

    effect: str
    joint: str | None = None
    parameters: Mapping[str, float] = field(default_factory=_empty)
    where: str = field(default="", compare=False)
    """Where it was declared, for errors: ``file:line: effect 1``; empty for one that no file declares."""


@dataclass(frozen=True)
class Robot:
    """A serial robot; `log` is the default mapping of its logs (same shape as a --map file)."""

    name: str
    joints: tuple[Joint, ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    dh: Convention = "standard"
    description: str = ""
    effects: tuple[EffectSpec, ...] = ()
    log: Mapping[str, Any] = field(default_factory=_empty)
    control: Mapping[str, Mapping[str, float]] = field(default_factory=_empty)
    """Gains of the drives' position loops at the joint, by joint: ``kp`` in N·m/rad, ``kd`` in N·m·s/rad."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def structure(self) -> str:
        """Everything that the form of the equations depends on: all of the robot but the values of its parameters."""
        joints = tuple(replace(joint, parameters={}, limits=Limits()) for joint in self.joints)
        return repr((joints, self.gravity, self.dh))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, base to tip."""
        return tuple(joint.name for joint in self.joints)

    @property
    def elastic(self) -> NDArray[np.bool_]:
        """Which joints have an elastic transmission, shape (n,)."""
        return np.array([joint.elastic for joint in self.joints], dtype=bool)

    @property
    def gear_ratios(self) -> Array:
        """Gear ratios k_m, shape (n,)."""
        return np.array([joint.gear_ratio for joint in self.joints], dtype=float)

    def stiffened(self, joints: NDArray[np.bool_]) -> Robot:
        """Return the robot with rigid transmissions at some elastic joints (n,): all that a log without links shows.

        Its effects stay: which of them need the transmission is theirs to know (`effects.shown_by`).
        """
        made_rigid = joints & self.elastic
        if not made_rigid.any():
            return self
        changed = tuple(
            replace(j, transmission="rigid", parameters={k: v for k, v in j.parameters.items() if k != "K"}) if r else j
            for j, r in zip(self.joints, made_rigid, strict=True)
        )
        return replace(self, joints=changed)

    def placements(self) -> tuple[tuple[Array, Array], ...]:
        """Return (before, after) of every joint: constant 4x4 transforms around its motion about or along z."""
        return tuple(_placement(joint, self.dh) for joint in self.joints)

    def parameter_names(self) -> tuple[str, ...]:
        """Return the standard parameters' names in standard order (eq. 14); a rigid joint has no K."""
        return tuple(
            f"{kind}{i}"
            for group in PARAMETER_GROUPS
            for i, joint in enumerate(self.joints, start=1)
            for kind in group
            if kind != "K" or joint.elastic
        )

    def parameter_units(self) -> tuple[str, ...]:
        """Return the unit of every standard parameter, in standard order."""
        return tuple(self._unit(name) for name in self.parameter_names())

    def reference(self) -> Array:
        """Return the reference values in standard order, shape (p,); NaN where unknown."""
        values = {
            f"{kind}{i}": value
            for i, joint in enumerate(self.joints, start=1)
            for kind, value in joint.parameters.items()
        }
        return np.array([values.get(name, math.nan) for name in self.parameter_names()])

    def _unit(self, name: str) -> str:
        kind = name.rstrip("0123456789")
        joint = self.joints[int(name[len(kind) :]) - 1]
        if kind == "m":
            return "kg"
        if kind in ("cx", "cy", "cz"):
            return "kg·m"
        if kind.startswith("I") or kind == "Jm":
            return "kg·m²"
        if kind == "fs":
            return "N·m" if joint.revolute else "N"
        if kind == "fv":
            return "N·m·s/rad" if joint.revolute else "N·s/m"
        return "N·m/rad" if joint.revolute else "N/m"


def _placement(joint: Joint, convention: Convention) -> tuple[Array, Array]:
    offset = rotation_z(joint.theta) @ translation(0, 0, joint.d)
    if convention == "standard":
        return np.eye(4), offset @ translation(joint.a, 0, 0) @ rotation_x(joint.alpha)
    if convention == "modified":
        return rotation_x(joint.alpha) @ translation(joint.a, 0, 0) @ offset, np.eye(4)
    origin = translation(*joint.xyz) @ rotation_rpy(joint.rpy)
    align = _z_to(joint.axis)
    return origin @ align, align.T.copy()


def _z_to(axis: tuple[float, float, float]) -> Array:
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
