"""The fit of a robot whose declared effects are positions that were read at another instant than the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.fit_in_pose import fit_in_pose
from elid_cli.estimation.result import EstimateOptions
from elid_cli.model.effects.posed import Pose
from elid_cli.model.effects.shifts import Shifts, corrected, declared_shifts, unvalued
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

ROUNDS = 5
"""Most times that positions are moved by what their columns still hold."""
LATE = 1e-4
"""Phase, rad at the cut-off, up to which what is left of a shift is left to its column, which is of first order."""


def fit_in_time(robot: Robot, signals: Signals, options: EstimateOptions) -> tuple[DefaultFit, Pose, Shifts]:
    """Return the fit with late positions moved to where they belong, the model's pose, and by how much they are moved.

    The first order alone of a shift leaves K skew²/2 q'' in the spring's torque: at 3 ms it bent inertias by a third.
    """
    late = replace(declared_shifts(robot), torque=np.zeros(robot.n))
    plain = unvalued(robot)
    if options.hold or plain is robot:
        return *fit_in_pose(robot, signals, options), Shifts.none(robot.n)
    fit, pose = fit_in_pose(plain, corrected(signals, late), options)
    for _ in range(ROUNDS):
        more = _left(fit)
        if more.largest * 2.0 * np.pi * signals.filter.cutoff <= LATE or not late.plus(more).possible:
            break
        late = late.plus(more)
        fit, pose = fit_in_pose(plain, corrected(signals, late), options)
    return fit, pose, late


def _left(fit: DefaultFit) -> Shifts:
    """Return the shifts that a fit's columns of late positions hold."""
    left = Shifts.none(fit.model.robot.n)
    if fit.effects is None:
        return left
    for item, values in zip(fit.effects.effects, fit.amplitudes(), strict=True):
        effect = item.effect
        if effect.corrects in ("link", "position"):
            age = effect.named(fit.effects.scene, values)[effect.amplitudes[0].name]
            left = left.moved(effect.corrects, effect.joint, float(np.nan_to_num(age)))
    return left
