"""Torques that were computed from commands and gains, beside what the described bodies need: they show a wrong kp.

Every parameter found from a computed torque scales with the gains, and a model of it fits as well whatever they are:
only something of known size shows it, as the bodies of a file do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.estimation.regression.triangles import Triangle, Triangles
from elid_cli.estimation.result import Identification
from elid_cli.model.effects.declared import resolve
from elid_cli.robot.robot import Robot

OFF = 0.05
"""Relative difference from which a gain is told: below, masses in files and what the model lacks are as far off."""
SURE = 4.0
"""Standard errors by which it must be off."""
CLEARLY = 2.0
"""Times what the rest of the torque could imitate by which it must be off: a spring leaves more than it changes."""
OWN = 0.15
"""Least part of the described bodies' torque, rms, that drive and channel must leave."""
BESIDE_BODIES = "times what the described bodies need"
"""What is said of a computed torque of another size."""
DRIVE = ("Ja", "Jm", "fs", "fv", "K")


class LoadScale(NamedTuple):
    """What multiplies the torque that the described bodies need to give the logged one, with its standard error."""

    joint: int
    ratio: float
    deviation: float
    imitated: float
    """By how much the ratio would be off if all that is left of the torque were load that the bodies do not have."""

    @property
    def is_off(self) -> bool:
        """Whether it is surely not 1."""
        return abs(self.ratio - 1.0) > max(OFF, SURE * self.deviation, CLEARLY * self.imitated)


def load_scales(robot: Robot, triangles: Triangles) -> list[LoadScale]:
    """Return how many times the torque that its described bodies need each joint's torque is, where that shows.

    The torque is fitted by that of the bodies, one column of all, beside friction and inertia of the joint's own drive
    and the torque channel's delay and offset, in the equations of the fit.

    Parameters
    ----------
    robot
        The description; a joint whose bodies are not described in full is not looked at.
    triangles
        The fit's equations, of p standard parameters and further columns.
    """
    if not any(robot.gravity):
        return []
    names, values = robot.parameter_names(), robot.reference()
    drive = np.array([name.kind in DRIVE for name in names])
    found = []
    for row in dict.fromkeys(item.row for item in triangles.items):
        parts = [item for item in triangles.of(row) if item.count]
        if row.kind == "sum" and len(parts) > 2:
            scale = _scale(parts, drive, values)
            if scale is not None:
                found.append(LoadScale(row.joint, *scale))
    return found


def _scale(parts: Sequence[Triangle], drive: NDArray[np.bool_], values: Array) -> tuple[float, float, float] | None:
    """Return a `LoadScale` without its joint, the error by leaving out one part after the other; None: not shown."""
    systems = []
    for part in parts:
        of_body = np.array([k < len(drive) and not drive[k] for k in part.index.tolist()])
        body = part.index[of_body]
        acting = np.any(part.factor[:, :-1][:, of_body] != 0, axis=0)
        if not np.isfinite(values[body[acting]]).all():
            return None
        load = part.factor[:, :-1][:, of_body][:, acting] @ values[body[acting]]
        own = np.zeros((len(part.factor), 0)) if of_body.all() else part.factor[:, :-1][:, ~of_body]
        systems.append(np.column_stack([load, own, part.factor[:, -1]]))
    if len({system.shape[1] for system in systems}) > 1:
        return None
    whole = np.concatenate(systems)
    left = whole[:, 0] - whole[:, 1:-1] @ np.linalg.lstsq(whole[:, 1:-1], whole[:, 0], rcond=None)[0]
    if not np.linalg.norm(left) > OWN * np.linalg.norm(whole[:, 0]) > 0:
        return None
    ratio = _slope(whole)
    others = [_slope(np.concatenate([*systems[:k], *systems[k + 1 :]])) for k in range(len(systems))]
    deviation = float(np.sqrt((len(others) - 1) / len(others) * np.sum((np.array(others) - np.mean(others)) ** 2)))
    return ratio, deviation, _left(whole) / float(np.linalg.norm(left))


def _left(system: Array) -> float:
    """Return the size of what the columns of [columns | target] leave of the target."""
    step = np.linalg.lstsq(system[:, :-1], system[:, -1], rcond=None)[0]
    return float(np.linalg.norm(system[:, -1] - system[:, :-1] @ step))


def _slope(system: Array) -> float:
    return float(np.linalg.lstsq(system[:, :-1], system[:, -1], rcond=None)[0][0])


def with_load(found: Identification, commanded: NDArray[np.bool_]) -> Identification:
    """Return an identification with a warning where torques that were computed, (n,), are not what the bodies need."""
    off = off_scales(found, commanded)
    return replace(found, warnings=(*found.warnings, *scale_warnings(found.robot, off)))


def off_scales(found: Identification, commanded: NDArray[np.bool_]) -> list[LoadScale]:
    """Return the scales that are surely not 1, of joints (n,) whose torques were computed from commands.

    An offset counts there though it does not show beside weights that are free: the load would be that much too small.
    A joint whose link the robot declares to carry more than bodies, as a spring, is not looked at.
    """
    triangles = found.with_nuisances or found.triangles
    if triangles is None:
        return []
    declared = (resolve(found.robot, spec) for spec in found.robot.effects)
    looked_at = commanded & ~np.isin(
        np.arange(found.robot.n), [joint for kind, joint in declared if kind.place == "link"]
    )
    return [scale for scale in load_scales(found.robot, triangles) if looked_at[scale.joint] and scale.is_off]


def scale_warnings(robot: Robot, off: Sequence[LoadScale]) -> tuple[str, ...]:
    """Return a sentence about computed torques that are not what the bodies need; none where all are."""
    if not off:
        return ()
    names = in_words([robot.joint_names[scale.joint] for scale in off])
    sizes = in_words([f"{scale.ratio:.3f} ± {max(scale.deviation, 0.001):.1g}" for scale in off])
    return (
        f"the computed torque of {names} is {sizes} {BESIDE_BODIES}, beside friction, motor inertia and an "
        f"offset: check kp and kd, or the masses of {robot.name}; what is found scales with them (or "
        "something is missing that imitates weight, such as a spring: elid diagnose)",
    )
