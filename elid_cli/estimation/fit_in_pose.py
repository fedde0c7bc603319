"""The fit of a robot whose declared effects turn its model: a base that leans, encoders that read another zero."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.cutoff import fit_best
from elid_cli.estimation.data import sampled
from elid_cli.estimation.default_fit import DefaultFit, fit_log
from elid_cli.estimation.other_zeros import misfit, valleys
from elid_cli.estimation.result import EstimateOptions
from elid_cli.model.base_parameters import find_base
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.posed import Pose, declared_pose, settled, turns_model
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.excerpts import excerpts
from elid_cli.signals.signals import Signals


def fit_in_pose(robot: Robot, signals: Signals, options: EstimateOptions) -> tuple[DefaultFit, Pose]:
    """Return the fit with the model turned by what declared effects stand for, and by how much it is turned.

    Where the file gives a zero no value, the whole circle is looked around for it.
    """
    pose = _begun(robot, signals, declared_pose(robot))
    model = Regressor(pose.robot(robot))

    def left(fit: DefaultFit) -> list[tuple[Effect, Array]]:
        declared = zip(fit.effects.effects if fit.effects else (), fit.amplitudes(), strict=True)
        return [(item.effect, values) for item, values in declared if turns_model(type(item.effect))]

    def again(fit: DefaultFit, pose: Pose) -> DefaultFit:
        turned = Regressor(pose.robot(robot))
        return fit_log(turned, find_base(turned), fit.signals, options)

    return settled(fit_best(model, find_base(model), signals, options), pose, left, again)


def _begun(robot: Robot, signals: Signals, pose: Pose) -> Pose:
    """Return a pose with the zeros that declared effects give no value where the log is fitted best, one by one."""
    kinds = [(*resolve(robot, spec), spec) for spec in robot.effects]
    unknown = [kind(joint) for kind, joint, spec in kinds if kind.moves_zero and not spec.parameters]
    shown = replace(signals, segments=excerpts(signals.segments, signals.dt))

    def cost(pose: Pose) -> float:
        model = Regressor(pose.robot(robot))
        data = sampled(model, shown)
        return misfit(data.triangles(data.offsets), find_base(model).count + len(data.offsets))

    for effect in unknown if len(unknown) < 2 else (*unknown, *unknown):
        if robot.joints[effect.joint].revolute:
            here, at = cost(pose), partial(pose.moved, effect)
            found = valleys([effect.joint], here, lambda _, more, at=at: cost(at(np.array([more]))))  # type: ignore[misc]
            if found and found[0].misfit < here:
                pose = at(np.array([found[0].offset]))
    return pose
