"""A base that is not level: gravity in the direction in which the motion asks for it.

What weight in another direction does to a joint looks like a spring near one pose, at every joint that carries weight.
Two angles for the whole robot are simpler than a spring at each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.beside import SETTLED, Beside
from elid_cli.diagnosis.result import FoundEffect
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.fit import COARSE, TrajectoryFit, fitted
from elid_cli.estimation.trajectory.normal_equations import Tracked, columns_of_pushes
from elid_cli.estimation.trajectory.unknowns import PARAMETERS, Unknowns
from elid_cli.model.body_torques import gravity_torques
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.tilt import STEEPEST, tilted
from elid_cli.model.linearised import Linearised
from elid_cli.robot.robot import Robot

STEPS = 12
"""Most steps of the angles."""
SURE = 5.0
"""Standard errors by which an angle must be clear of 0."""
STILL = 1e-9
"""rad (m) per rad by which positions change with an angle that no joint feels."""
NUDGE = 1e-3
"""rad by which gravity is turned to see what it does."""


@dataclass(frozen=True)
class Tilt:
    """Gravity turned by two angles, and the fit with it."""

    angles: Array
    """rad, (2,), as the effect of the base's direction has them."""
    deviations: Array
    """Standard errors, rad, (2,); infinite of an angle that no joint of the robot feels."""
    level: Robot
    """The robot as it is described."""
    fit: TrajectoryFit

    @property
    def robot(self) -> Robot:
        """The robot in that gravity."""
        return self.fit.unknowns.robot

    def effect(self, before: TrajectoryFit) -> FoundEffect:
        """Return it as an effect, with what it takes from the error of a fit to level ground."""
        kind = effect_that(turns_gravity=True)
        names = [parameter.name for parameter in kind.amplitudes]
        bare, left = (fit.equations.lighter.sum(axis=0) / before.equations.size**2 for fit in (before, self.fit))
        angles, errors = self.angles.tolist(), self.deviations.tolist()
        spread = {name: s for name, s in zip(names, errors, strict=True) if np.isfinite(s)}
        share = float(1.0 - left.sum() / bare.sum())
        felt = {name: angle for name, angle in zip(names, angles, strict=True) if name in spread}
        return FoundEffect(kind.name, None, felt, spread, share, kind.summary)


def tilt_of(before: TrajectoryFit) -> Tilt | None:
    """Return the tilt that the motion asks for beside drives and delays; None where it asks for none."""
    level, fit = before.unknowns.robot, before
    if not any(level.gravity):
        return None
    angles = np.zeros(2)
    for number in range(STEPS):
        moved = moved_by_tilt(fit, level, angles)
        found = Beside.of(fit, moved)
        shown = np.any([np.abs(part).max(axis=(0, 1)) > STILL for part in moved], axis=0)
        deviations = np.where(shown, np.hypot(found.deviations, COARSE), np.inf)
        if number == STEPS - 1 or (np.abs(found.steps) <= SETTLED * deviations).all():
            break
        angles = np.clip(angles + found.steps, -STEEPEST, STEEPEST)
        turned = _refitted(fit, tilted(level, angles), fit.z + found.along)
        if turned is None:
            return None
        fit = turned
    if not (np.abs(angles) > SURE * deviations).any() or np.abs(angles).max() >= STEEPEST:
        return None
    return Tilt(angles, deviations, level, fit)


def _refitted(fit: TrajectoryFit, robot: Robot, z: Array) -> TrajectoryFit | None:
    """Return the fit of a robot in another gravity, started from z (U,); None where the simulated motion runs away."""
    own = fit.unknowns
    unknowns = Unknowns(robot, fit.effects, own.recordings, own.held)
    tracked = [replace(Tracked.of(item.run), usual=item.usual) for item in fit.tracked]
    try:
        return fitted(unknowns, tracked, z, prompt=not fit.delays.any())
    except DataError:
        return None


def moved_by_tilt(fit: TrajectoryFit, level: Robot, angles: Array) -> Sequence[Array]:
    """Return how the positions of a fit's stretches change with the angles, rad (m) per rad, (N, n, 2) each."""
    own, n = fit.unknowns, fit.unknowns.robot.n
    equations, parameters = Linearised(own.robot, without=PARAMETERS), own.robot.reference()
    sides = [tilted(level, angles + sign * NUDGE * unit) for unit in np.eye(2) for sign in (1, -1)]
    found = []
    for item in fit.tracked:
        held = [gravity_torques(side, item.x[:, :n]) for side in sides]
        pushes = np.stack([held[0] - held[1], held[2] - held[3]])
        moved = columns_of_pushes(equations, replace(item, local=None), own, fit.z, parameters, pushes)
        found.append(moved / (2.0 * NUDGE))
    return found
