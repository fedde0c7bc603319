"""The robot: a tree of joints on a fixed base, each with a motor behind an elastic or a rigid transmission.

Frozen dataclasses only. Reading and writing them as YAML is `files.py`; `urdf/` and `mjcf/` have their own formats.
Joints are numbered from 1, base to tips, in names; from 0 in arrays. Units are SI. A joint is carried by the one
before it unless `Joint.parent` names another one, which must stand before it.

Geometry: frame i follows from the frame of its parent by ``before_i · motion(q_i) · after_i``, where the motion turns
about (or, for a prismatic joint, slides along) the z axis. Distal (standard) DH has ``before = 1``, proximal
(modified) DH and URDF have everything in `before` (URDF axes other than z also need `after`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.robot.built import check_joint, check_whole
from elid_cli.robot.frames import by_axis, by_dh, to_quarter
from elid_cli.robot.parameter import JOINT_PARAMETERS, PARAMETER_GROUPS, StandardParameter
from elid_cli.tables import Shown

JointType = Literal["revolute", "prismatic"]
Transmission = Literal["elastic", "rigid", "auto"]
Convention = Literal["standard", "modified", "urdf"]

BASE = "base"
"""What `Joint.parent` calls the base."""


def _empty() -> Mapping[str, Any]:
    return {}  # a plain dict, so that robots can be sent to worker processes


MOST_JOINTS = 60
"""Joints of a robot that is identified; memory and time grow with their cube."""
MOST_READ = 200
"""Joints of a file of which the log or the user leaves fewer."""


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
    gear_ratio: float | None = None
    """k_m: rotor turns per joint turn (rad per m for a prismatic joint); None: unknown. The rotor is then known by its
    reflected inertia Ja (kg·m² at the joint, k_m² Jm) only, and does not couple to the body that carries it."""
    motor_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """z_m: unit vector of the rotor's axis in the frame of the parent."""
    transmission: Transmission = "elastic"
    """``auto``: as the log shows it (`logs.robot_as_logged`); without a log elastic where K is known, else rigid."""
    torque_at: Literal["motor", "link"] = "motor"
    """Where the torque of its equation is read; ``link``: behind the motor, whose inertia and friction it lacks."""
    parameters: Mapping[str, float] = field(default_factory=_empty)
    """Reference values by the names of `JOINT_PARAMETERS`; those not named are unknown, not zero."""
    limits: Limits = field(default_factory=Limits)
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Origin of the joint in the parent frame, m (convention ``urdf`` only)."""
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Fixed-axis roll, pitch, yaw of the joint in the parent frame, rad (convention ``urdf`` only)."""
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit axis in the joint's own frame (convention ``urdf`` only)."""
    parent: str = ""
    """The joint that carries this one: its name, `BASE`, or empty for the joint before."""

    def __post_init__(self) -> None:
        check_joint(self)

    @property
    def revolute(self) -> bool:
        """Whether the joint turns (True) or slides (False)."""
        return self.type == "revolute"

    @property
    def units(self) -> tuple[str, str]:
        """Units of its position and of its torque (or force)."""
        return ("rad", "N·m") if self.revolute else ("m", "N")

    @property
    def elastic(self) -> bool:
        """Whether motor and link positions differ."""
        return self.transmission == "elastic" or (self.transmission == "auto" and "K" in self.parameters)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of this joint's standard parameters, without its number."""
        absent = ("Ja" if self.gear_ratio is not None else "Jm", "" if self.elastic else "K")
        return tuple(kind for kind in JOINT_PARAMETERS if kind not in absent)

    def geared(self, ratio: float) -> Joint:
        """Return the joint with a gear ratio; a reflected inertia becomes the rotor's own."""
        values = dict(self.parameters)
        if "Ja" in values:
            values.setdefault("Jm", values.pop("Ja") / ratio**2)
        return replace(self, gear_ratio=ratio, parameters=values)


@dataclass(frozen=True)
class EffectSpec:
    """An effect declared in a robot file: its name, its joint (None: the whole robot) and its parameters."""

    effect: str
    joint: str | None = None
    parameters: Mapping[str, float] = field(default_factory=_empty)
    where: str = field(default="", compare=False)
    """Where it was declared, for errors: ``file:line: effect 1``; empty for one that no file declares."""


@dataclass(frozen=True)
class Payload:
    """A body of known mass, fixed to the body of a joint, with which a log may be recorded."""

    mass: float
    """kg."""
    joint: str
    centre: tuple[float, float, float] | None = None
    """Centre of mass in the frame of the joint's body, m; None: not known."""


@dataclass(frozen=True)
class Robot(Shown):
    """A robot; `log` is the default mapping of its logs (same shape as a --map file)."""

    name: str
    joints: tuple[Joint, ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    dh: Convention = "standard"
    description: str = ""
    effects: tuple[EffectSpec, ...] = ()
    log: Mapping[str, Any] = field(default_factory=_empty)
    control: Mapping[str, Mapping[str, float]] = field(default_factory=_empty)
    """Gains of the drives' position loops at the joint, by joint: ``kp`` in N·m/rad, ``kd`` in N·m·s/rad."""
    payload: Payload | None = None
    """What ``identify --payload declared`` takes as carried in the second of two logs."""
    source: str = field(default="", compare=False)
    """The URDF or MJCF file it was read from; empty for one described by elid's own YAML."""
    given: str = field(default="", compare=False, repr=False)
    """What was asked for to get it: a path, or the name of a robot that comes with elid; empty: neither."""
    links: Mapping[str, str] = field(default_factory=_empty, compare=False)
    """Names of that file's links (bodies) with the joint that moves each, `BASE` where none does."""
    held: Mapping[str, float] = field(default_factory=_empty, compare=False)
    """That file's joints that are locked, with their values, rad or m."""
    order: tuple[str, ...] = field(default=(), compare=False)
    """Where joints are locked, the names of all of them, those that are locked in their places."""
    rotors: Mapping[str, tuple[str, float]] = field(default_factory=_empty, compare=False)
    """Joints with a rotor of its own in that file, an MJCF: the rotor's joint, and its turns per joint turn."""
    notes: tuple[str, ...] = field(default=(), compare=False)
    """What a reader of its results must know of how it was read: sentences."""

    def __post_init__(self) -> None:
        check_whole(self)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def structure(self) -> str:
        """Everything that the form of the equations depends on: all of the robot but the values of its parameters."""
        joints = tuple(
            replace(joint, parameters={}, limits=Limits(), transmission="elastic" if joint.elastic else "rigid")
            for joint in self.joints
        )
        return repr((joints, self.gravity, self.dh))

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """The joint that carries each one, -1 for the base: always an earlier joint."""
        found: list[int] = []
        for k, joint in enumerate(self.joints):
            before = self.joint_names.index(joint.parent) if joint.parent not in ("", BASE) else k - 1
            found.append(-1 if joint.parent == BASE else before)
            if found[-1] >= k:
                raise ValueError(f"{joint.name} stands before its parent {joint.parent}")
        return tuple(found)

    @cached_property
    def ancestors(self) -> tuple[tuple[int, ...], ...]:
        """The joints that move each body, from the base to its own one."""
        found: list[tuple[int, ...]] = []
        for k, parent in enumerate(self.parents):
            found.append((*(found[parent] if parent >= 0 else ()), k))
        return tuple(found)

    def squared(self) -> Robot:
        """Return the robot with the angles of its frames made the quarter turns that they are meant to be.

        For questions of structure: which parameters show at all.
        """
        if self.dh != "urdf":
            return self
        joints = (
            replace(j, rpy=(to_quarter(j.rpy[0]), to_quarter(j.rpy[1]), to_quarter(j.rpy[2]))) for j in self.joints
        )
        return replace(self, joints=tuple(joints))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, base to tip."""
        return tuple(joint.name for joint in self.joints)

    def joint(self, name: str) -> Joint:
        """Return the joint of that name (ValueError where there is none)."""
        return self.joints[self.joint_names.index(name)]

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the joints, from 1, base to tip: those that are locked are counted."""
        order = self.order or self.joint_names
        return tuple(order.index(name) + 1 for name in self.joint_names)

    @property
    def elastic(self) -> NDArray[np.bool_]:
        """Which joints have an elastic transmission, shape (n,)."""
        return np.array([joint.elastic for joint in self.joints], dtype=bool)

    @property
    def gear_ratios(self) -> Array:
        """Gear ratios k_m, shape (n,); NaN where unknown."""
        return np.array([joint.gear_ratio for joint in self.joints], dtype=float)

    @property
    def torque_limits(self) -> Array:
        """Largest torques of the drives, N·m (N), shape (n,); infinite where there is no limit."""
        return np.array([np.inf if j.limits.torque is None else j.limits.torque for j in self.joints])

    @property
    def place_to_say(self) -> str:
        """Where a user says what the robot's description lacks, in words: its own file, or the YAML beside a URDF."""
        if not self.source:
            return "in the robot file"
        return f"in {Path(self.source).with_suffix('.elid.yaml')} (elid init writes it)"

    def known_ratios(self, what: str, joints: Iterable[str] | None = None) -> Array:
        """Return `gear_ratios` where `what` needs those of some joints (None: of all).

        Those of rotors of their own are known where they do not couple, too; 1 may only mean that nobody knew.

        Raises
        ------
        RobotError
            One of them is unknown.
        """
        turns = {name: ratio for name, (_, ratio) in self.rotors.items() if abs(ratio) != 1.0}
        known = [turns.get(j.name) if j.gear_ratio is None else j.gear_ratio for j in self.joints]
        asked = self.joint_names if joints is None else joints
        unknown = [name for name, ratio in zip(self.joint_names, known, strict=True) if ratio is None and name in asked]
        if unknown:
            raise RobotError(
                f"{what} needs the gear ratio of {' '.join(unknown)}",
                detail=f"the description of {self.name!r} does not give it",
                hint=f"joints: {{{unknown[0]}: {{gear_ratio: 100}}}} {self.place_to_say}"
                if self.source
                else "gear_ratio: 100",
            )
        return np.array(known, dtype=float)

    @property
    def rotor_names(self) -> tuple[StandardParameter, ...]:
        """Names of the rotors' inertias, one per joint: Jm, or Ja where the gear ratio is unknown."""
        return tuple(StandardParameter("Ja" if j.gear_ratio is None else "Jm", k) for k, j in enumerate(self.joints))

    def stiffened(self, joints: NDArray[np.bool_]) -> Robot:
        """Return the robot with rigid transmissions at some elastic joints (n,): all that a log without links shows.

        Its effects stay: which of them need the transmission is theirs to know (`declared.as_observed`).
        """
        made_rigid = joints & self.elastic
        if not made_rigid.any():
            return self
        changed = tuple(
            replace(j, transmission="rigid", parameters={k: v for k, v in j.parameters.items() if k != "K"}) if r else j
            for j, r in zip(self.joints, made_rigid, strict=True)
        )
        return replace(self, joints=changed)

    def read_behind(self, joints: NDArray[np.bool_]) -> Robot:
        """Return the robot with the torque of some joints (n,) read in their transmissions: without their motors."""
        if not joints.any():
            return self
        seen = zip(self.joints, joints, strict=True)
        return replace(self, joints=tuple(replace(j, torque_at="link") if here else j for j, here in seen))

    def placements(self) -> tuple[tuple[Array, Array], ...]:
        """Return (before, after) of every joint: constant 4x4 transforms around its motion about or along z."""
        return self._placements

    @cached_property
    def _placements(self) -> tuple[tuple[Array, Array], ...]:
        if self.dh in ("standard", "modified"):
            modified = self.dh == "modified"
            return tuple(by_dh(j.a, j.alpha, j.d, j.theta, modified=modified) for j in self.joints)
        return tuple(by_axis(j.xyz, j.rpy, j.axis) for j in self.joints)

    def parameter_names(self) -> tuple[StandardParameter, ...]:
        """Return the standard parameters' names in standard order (eq. 14); a rigid joint has no K."""
        kinds = [joint.kinds for joint in self.joints]
        return tuple(
            StandardParameter(kind, k)
            for group in PARAMETER_GROUPS
            for k, own in enumerate(kinds)
            for kind in group
            if kind in own
        )

    def parameter_units(self) -> tuple[str, ...]:
        """Return the unit of every standard parameter, in standard order."""
        return tuple(self._unit(name) for name in self.parameter_names())

    def reference(self) -> Array:
        """Return the reference values in standard order, shape (p,); NaN where unknown."""
        values = {
            StandardParameter(kind, k): value
            for k, joint in enumerate(self.joints)
            for kind, value in joint.parameters.items()
        }
        return np.array([values.get(name, math.nan) for name in self.parameter_names()])

    def _unit(self, name: StandardParameter) -> str:
        alike = {"m": "kg", "cx": "kg·m", "cy": "kg·m", "cz": "kg·m", "Jm": "kg·m²"}
        turning = {"Ja": "kg·m²", "fs": "N·m", "fv": "N·m·s/rad", "K": "N·m/rad"}
        sliding = {"Ja": "kg", "fs": "N", "fv": "N·s/m", "K": "N/m"}
        units = alike | (turning if self.joints[name.joint].revolute else sliding)
        return units.get(name.kind, "kg·m²")  # an inertia
