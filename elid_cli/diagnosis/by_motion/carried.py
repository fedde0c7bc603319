"""A load at a body, from the first instant to the last, that the robot file does not have: a tool, a gripper.

Where the last body has none, the masses of another one may be off, which is the same. Its mass, first moments and
inertias act as their columns of the regressor, as far as the joints feel each of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.together import Kind
from elid_cli.diagnosis.by_motion.torque_gains import CHECK, gain_name
from elid_cli.diagnosis.result import Rival
from elid_cli.estimation.trajectory.beside import Beside
from elid_cli.estimation.trajectory.changes import SURE, Change, Changed, changed, nearer_by
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.estimation.trajectory.pushes import columns_of_pushes
from elid_cli.estimation.trajectory.unknowns import PARAMETERS
from elid_cli.model.base_parameters import leftmost
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.bodies import NEW, body_columns, end_bodies
from elid_cli.model.linearised import Linearised
from elid_cli.robot.inertia import ten_of
from elid_cli.robot.nearest_body import is_body, nearest_body
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion, random_motion

TOLD = 4
"""Parameters of a load that are told, the first of `LINK_PARAMETERS`: its mass and first moments."""
ARM = 0.1
"""m; first moments and inertias count in the size of those of a mass at this distance."""
LEAST_ARM = 0.03
"""m; a load is at least as far from the joint's axis, and taken to be where no joint feels its mass."""
ALONE = 1e-6
"""Part of a parameter's torques that no other can make, from which it is told."""
ROUNDED = 1e-12
"""Part of the largest torque of a parameter below which another's are none."""
FREELY = 1e3
"""Times that drives rather than the load's inertia make up for what is its mass's at a distance."""
STRENGTH = 0.05
"""Torque by which loads are varied, in parts of the usual Coulomb friction …"""
LEAST = 1e-6
"""… and at least, N·m (N)."""


@dataclass(frozen=True)
class Carried(Change):
    """Parameters of a load at a body, in parts of the robot's mass."""

    kept: tuple[int, ...] = ()
    """Which of them the joints feel."""
    size: float = 1.0
    """The robot's mass, kg."""
    alone: tuple[bool, ...] = ()
    """Which of the kept ones no other parameter of the body, nor a rotor, can stand for."""
    body: int = -1
    """At which body; -1: the last one."""
    kind = effect_that(carried=True)
    most = 3.0
    whole = True

    @property
    def count(self) -> int:
        """How many they are."""
        return len(self.kept)

    @property
    def at(self) -> int | None:
        """The joint that moves the body, where that is not the last one."""
        return None if self.body < 0 else self.body

    @property
    def summary(self) -> str:  # type: ignore[override]
        """What it is, in words."""
        which = "the last body" if self.body < 0 else "this body"
        return (
            f"{which} carries a load that the file does not have, or its masses are off by it; what inertia it has of "
            "its own may stand in the motor inertia of joints that carry it"
        )

    @property
    def _scale(self) -> Array:
        arms = np.array([0.0] + 3 * [1.0] + 6 * [2.0])[list(self.kept)]
        found: Array = self.size * ARM**arms
        return found

    def robot(self, level: Robot, values: Array) -> Robot:
        """Return the robot whose body has the load as well."""
        last, added = level.joints[self.body], real_load(level, self.load(values), self.body).tolist()
        own = {**last.parameters}
        for name, more in zip(LINK_PARAMETERS, added, strict=True):
            own[name] = own.get(name, 0.0) + more
        return _with_body(level, self.body, own)

    def written(self, robot: Robot, level: Robot) -> Robot:
        """Return the robot whose body is one that there may be: errors of its inertias can make it none.

        One whose body was none before, and one of no mass that is left, stays.
        """
        last = robot.joints[self.body]
        own, was = ten_of(last.parameters), ten_of(level.joints[self.body].parameters)
        if not own[0] > 0 or not is_body(was):
            return robot
        real = dict(zip(LINK_PARAMETERS, nearest_body(own, _of_body(robot, self.body)).tolist(), strict=True))
        return _with_body(robot, self.body, {**last.parameters, **real})

    def load(self, values: Array) -> Array:
        """Return the parameters of the load about the frame of its body, (10,)."""
        found = np.zeros(len(LINK_PARAMETERS))
        found[list(self.kept)] = self._scale * values
        return found

    def named(self, fit: TrajectoryFit, values: Array) -> Array:
        """Return the load as the effect's amplitudes."""
        return self.load(values)

    def spread(self, fit: TrajectoryFit, deviations: Array) -> Array:
        """Return the standard errors of mass and first moments; infinite of what is not told."""
        found = self.load(deviations)
        told = [k for k, own in zip(self.kept, self.alone, strict=True) if own and k < TOLD]
        found[[k for k in range(len(found)) if k not in told]] = np.inf
        return found

    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return how the positions change by what the load needs."""
        own, turns = fit.unknowns, self._scale[:, None] * np.eye(len(LINK_PARAMETERS))[list(self.kept)]
        equations, parameters = Linearised(own.robot, without=PARAMETERS), own.robot.reference()
        strength = max(STRENGTH * float(np.median(fit.values[:, 1])), LEAST)
        found = []
        for item in fit.tracked:
            pushes = np.einsum("nap,da->dpn", _columns(level, item, self.body), turns)
            size = np.sqrt(np.mean(pushes**2, axis=1).max(axis=1))
            by = strength / np.maximum(size, 1e-300)
            even = pushes * by[:, None, None]
            moved = columns_of_pushes(equations, replace(item, local=None), own, fit.z, parameters, even)
            found.append(moved / by)
        return found


def kinds_of_loads(robot: Robot) -> list[Kind]:
    """Return loads of the last body of every branch as kinds of changes; the first finds which of them there is."""
    return [
        Kind(load_of if k == 0 else None, lambda _, body=body: load_by(robot, body), local=False)  # type: ignore[misc]
        for k, body in enumerate(last_bodies(robot) if may_carry(robot) else ())
    ]


def load_of(before: TrajectoryFit) -> Changed | None:
    """Return the load of a last body that the motion asks for beside drives and delays; None where it asks for none.

    Of several branches, that with which the motion comes nearest. A mass on the joint's own axis is no load: those of
    the bodies before look the same.
    """
    bodies = last_bodies(before.unknowns.robot)
    return _nearest(before, bodies if len(bodies) == 1 else _best_by_a_step(before, bodies))


def other_load_of(before: TrajectoryFit) -> Changed | None:
    """Return that of the other body with which the motion comes nearest; None where it asks for none."""
    robot = before.unknowns.robot
    last = {body % robot.n for body in last_bodies(robot)}
    others = [body for body in reversed(range(robot.n)) if body not in last]
    if len(last) > 1:  # of robots with branches, those of one
        roots = {robot.ancestors[best][0] for best in _best_by_a_step(before, others)}
        others = [body for body in others if robot.ancestors[body][0] in roots]
    return _nearest(before, others)


def last_bodies(robot: Robot) -> list[int]:
    """Return the last body of every branch, by its joint; -1 where there is one branch."""
    ends = end_bodies(robot)
    return ends if len(ends) > 1 else [-1]


def may_carry(robot: Robot) -> bool:
    """Whether loads of a robot are looked at: it has weight."""
    return any(robot.gravity)


def _best_by_a_step(before: TrajectoryFit, bodies: Sequence[int]) -> list[int]:
    """Return the body whose load lowers the error most in a first step; none where no load is felt.

    Branches do not move each other: it tells which one it is.
    """
    loads = {body: load_by(before.unknowns.robot, body) for body in bodies}
    steps = {body: _first_step(before, by) for body, by in loads.items() if by.kept and by.size > 0}
    return [max(steps, key=lambda body: steps[body])] if steps else []


def _first_step(before: TrajectoryFit, by: Carried) -> float:
    """Return the sum over the joints of the logarithm by which a first step of a load lowers the error's size."""
    moved = by.moved(before, before.unknowns.robot, np.zeros(by.count))
    return float(-0.5 * np.log(Beside.of(before, moved).left).sum())


def _nearest(before: TrajectoryFit, bodies: Sequence[int]) -> Changed | None:
    found = (_load_at(before, body) for body in bodies)
    return max((one for one in found if one is not None), key=lambda one: nearer_by(one.fit, before), default=None)


def _load_at(before: TrajectoryFit, body: int) -> Changed | None:
    robot = before.unknowns.robot
    if not may_carry(robot):
        return None
    by = load_by(robot, body)
    found = changed(before, by) if by.kept and by.size > 0 else None
    if found is None:
        return None
    load, first = by.load(found.values), [0 < k < TOLD for k in by.kept]
    off_axis = np.linalg.norm(load[1:TOLD]) > LEAST_ARM * abs(load[0])
    return found if off_axis and found.sure[first].any() else None


def load_by(robot: Robot, body: int = -1) -> Carried:
    """Return a load of a body as its numbers, those that the joints of a robot feel."""
    kept, alone = _felt(robot, body)
    return Carried(kept, sum(max(float(joint.parameters.get("m", 0.0)), 0.0) for joint in robot.joints), alone, body)


def load_rivals(change: Changed, before: TrajectoryFit) -> tuple[Rival, ...]:
    """Return wrong gains as a rival of a load of a one-joint robot: one in line with the body's own centre is the same.

    `before` is the fit without.
    """
    by, level = change.by, change.level
    if not isinstance(by, Carried) or level.n > 1:
        return ()
    own = np.array([level.joints[0].parameters.get(name, 0.0) for name in LINK_PARAMETERS[1:TOLD]])
    felt = np.isin(np.arange(1, TOLD), by.kept)
    own, load, error = np.where(felt, own, 0.0), by.load(change.values)[1:TOLD], by.load(change.deviations)[1:TOLD]
    size = float(own @ own)
    share = float(own @ load) / size if size else 0.0
    if share <= -1.0 or np.linalg.norm(load - share * own) > SURE * np.linalg.norm(error):
        return ()
    name = level.joint_names[0]
    return (Rival(gain_name(), name, by.kind.name, change.gain(before), {"gain": share}, CHECK),)


def real_load(robot: Robot, load: Array, number: int = -1) -> Array:
    """Return parameters (10,) that act as those of a load at a body do, of a load that there may be.

    What no joint feels is that of a point of that mass where its centre is; a mass that none feels, or that rotors can
    stand for, is as far off as that of the body.
    """
    body = _of_body(robot, number)
    found, felt = np.zeros(len(load)), np.abs(body).max(axis=0) > 0
    first = np.where(felt[1:TOLD], load[1:TOLD], 0.0)
    own = robot.joints[number].parameters
    moment = np.array([own.get(name, 0.0) for name in LINK_PARAMETERS[1:TOLD]])
    centre = float(np.linalg.norm(moment)) / max(own.get("m", 0.0), 1e-9)
    # less mass where the file has too much
    sign = -1.0 if first @ moment < 0 else 1.0
    mass = float(load[0]) or sign * float(np.linalg.norm(first)) / max(centre, LEAST_ARM)
    found[0], found[1:TOLD] = mass, first
    if mass:
        inertia = (first @ first * np.eye(3) - np.outer(first, first)) / mass
        found[TOLD:] = [inertia["xyz".index(name[1]), "xyz".index(name[2])] for name in LINK_PARAMETERS[TOLD:]]
    # what drives can stand for is theirs: their inertias and offsets are found anew with the robot
    both = np.concatenate([body[:, TOLD:], FREELY * _of_drives(robot)], axis=1)
    found[TOLD:] += np.linalg.lstsq(both, body @ (load - found), rcond=1e-9)[0][: len(load) - TOLD]
    return found


def _with_body(robot: Robot, number: int, parameters: Mapping[str, float]) -> Robot:
    joints = list(robot.joints)
    joints[number] = replace(joints[number], parameters=MappingProxyType(dict(parameters)))
    return replace(robot, joints=tuple(joints))


def _felt(robot: Robot, number: int) -> tuple[tuple[int, ...], tuple[bool, ...]]:
    """Return the parameters of a body that neither what every drive has of its own nor those before them can stand for.

    A drive has a rotor's inertia and an offset: a sliding joint's weight is one.

    And which of them those after them cannot, either.
    """
    body, drives = _of_body(robot, number), _of_drives(robot)
    leaders = leftmost(np.concatenate([drives, body], axis=1), NEW, null=0.0).leaders
    kept = tuple(int(k) - drives.shape[1] for k in leaders if k >= drives.shape[1])
    alone = []
    for k in kept:
        others = np.concatenate([drives, np.delete(body, k, axis=1)], axis=1)
        left = body[:, k] - others @ np.linalg.lstsq(others, body[:, k], rcond=1e-10)[0]
        alone.append(bool(np.linalg.norm(left) > ALONE * np.linalg.norm(body[:, k])))
    return kept, tuple(alone)


def _of_drives(robot: Robot) -> Array:
    """Return the columns of rotors' inertias and torque offsets over all joints and `_of_body`'s instants, (R, 2 n)."""
    motion = random_motion(robot.n, robot.elastic, samples=24)
    own = np.eye(robot.n)[:, :, None]
    return np.concatenate([own * motion.ddq.T[None], own * np.ones_like(motion.ddq.T)[None]]).reshape(2 * robot.n, -1).T


def _of_body(robot: Robot, number: int) -> Array:
    """Return the columns of a body's parameters over all joints and some instants, (R, 10)."""
    columns = body_columns(robot, number % robot.n, random_motion(robot.n, robot.elastic, samples=24))
    found = columns.transpose(0, 2, 1).reshape(-1, len(LINK_PARAMETERS))
    size = np.abs(found).max(axis=0)
    return np.where(size > ROUNDED * size.max(), found, 0.0)  # what is left of rounding is nothing that joints feel


def _columns(robot: Robot, item: Tracked, number: int) -> Array:
    """Return the torques that the parameters of a body need along a stretch's motion, of 1 each, (n, 10, N)."""
    n = robot.n
    x, v = item.x[:, :n], item.v[:, :n]
    a = np.gradient(v, item.run.dt, axis=0)
    return body_columns(robot, number % n, Motion(item.run.t, x, v, a, x, v, a))
