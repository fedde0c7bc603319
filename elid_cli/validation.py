"""Validation: how well a described robot predicts a log that it was not fitted to. Nothing is estimated here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from elid_cli.base import BaseParameters, find_base
from elid_cli.effects import declared_effects, extra_of, scene_of
from elid_cli.errors import RobotError
from elid_cli.estimate import EstimateOptions, JointError, joint_errors, masked_as_needed
from elid_cli.model import Model
from elid_cli.observation import observe
from elid_cli.reduction import reduce
from elid_cli.robot import Robot
from elid_cli.signals import Signals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Validation:
    """How well a robot description predicts a log."""

    robot: Robot
    error: Mapping[str, JointError]
    """Error of the predicted motor torque per joint, over the whole log."""
    settings: Mapping[str, object] = field(default_factory=dict)


def validate(robot: Robot, signals: Signals) -> Validation:
    """Predict a log's motor torques with the robot file's own parameters and effects.

    Raises
    ------
    RobotError
        The file lacks a value that the prediction needs.
    """
    model = Model(robot)
    base = find_base(model)
    standard = representative(robot, base)
    observation = masked_as_needed(observe(model, signals), base, EstimateOptions())
    scene = scene_of(model, signals, standard)
    extras, amplitudes = [], []
    for declared in declared_effects(robot, scene):
        kind, joint = type(declared.effect), declared.effect.joint
        missing = [p.name for p in (*kind.amplitudes, *kind.shapes) if p.name not in declared.spec.parameters]
        if missing:
            raise RobotError(f"{robot.name}: effect {kind.name} of {robot.joints[joint].name}: no {missing[0]}")
        extras.append(extra_of(declared.effect, scene, signals))
        amplitudes.append(kind.coefficients(scene, joint, declared.spec.parameters)[0])
    triangles = reduce(observation, extras)
    values = np.concatenate([standard, *amplitudes])
    squares = {row: sum(t.squares(values) for t in triangles.of(row)) for row in triangles.rows}
    settings = {"cutoff": signals.filter.cutoff, "rate": signals.rate, "instants": observation.instants}
    return Validation(robot, joint_errors(robot, triangles, squares), settings)


def representative(robot: Robot, base: BaseParameters) -> Array:
    """Return standard parameters (p,) that predict as the robot file's do: base parameters at their leaders.

    Raises
    ------
    RobotError
        A base parameter contains a parameter that the file does not give.
    """
    values = base.values(robot.reference())
    unknown = [base.parameters[k] for k in base.leaders[~np.isfinite(values)]]
    if unknown:
        more = f" and {len(unknown) - 8} more" if len(unknown) > 8 else ""
        raise RobotError(
            f"{robot.name}: the robot file does not give {len(unknown)} of {base.count} base parameters",
            detail=f"not known: those led by {', '.join(unknown[:8])}{more}",
            hint=f"elid identify LOG --robot {robot.name} --write-robot {robot.name}-identified.yaml",
        )
    standard = np.zeros(len(base.parameters))
    standard[base.leaders] = values
    return standard
