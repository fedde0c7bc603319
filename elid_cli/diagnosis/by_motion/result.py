"""What a diagnosis of a command log answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from elid_cli.diagnosis.by_motion.each_alone import Alone
from elid_cli.diagnosis.by_motion.held_out import MORE
from elid_cli.diagnosis.result import FoundEffect, Rival, Unexplained
from elid_cli.estimation.result import Identification
from elid_cli.estimation.trajectory.at_noise import NOISE
from elid_cli.estimation.trajectory.differing import Differing
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals
from elid_cli.tables import Shown


@dataclass(frozen=True)
class PositionBeforeAfter:
    """Error of a joint's simulated position, rad (m), in blocks of time that the values were not fitted to."""

    before: float
    after: float


@dataclass(frozen=True, repr=False)
class MotionDiagnosis(Shown):
    """Everything `elid diagnose` says of a log that holds commands."""

    robot: Robot
    recording: Recording
    before: Identification
    """Of the robot as described."""
    after: Identification
    """With what was found."""
    fit_before: TrajectoryFit
    fit_after: TrajectoryFit
    effects: tuple[FoundEffect, ...]
    also_possible: tuple[Rival, ...]
    unexplained: tuple[Unexplained, ...]
    position: Mapping[str, PositionBeforeAfter]
    differing: tuple[Differing, ...]
    refined: Robot
    """The robot with what was found; where a joint changed between recordings, as it was in the last ones."""
    tried: int
    delivered: Signals
    """The log with the torque that the drives delivered: within limits and of the size that were found."""
    partial: bool = False
    waiting: tuple[tuple[str, str], ...] = ()
    """Effects and joints that were chosen but not judged yet when the search was stopped."""
    untried: tuple[str, ...] = ()
    """Effects that the robot may have, but that no simulated motion is searched for."""
    other_bodies: Mapping[str, float] = field(default_factory=dict)
    """Part of its squared error, not fitted to, that other bodies than the file's take off a joint's motion."""
    free_bodies: TrajectoryFit | None = None
    """The fit with the bodies of least squares, where it comes clearly nearer than with all effects."""

    alone: tuple[Alone, ...] = ()
    """What each recording alone asks for, where they are simulated clearly nearer so."""

    @property
    def near(self) -> dict[str, float]:
        """Joints that are near the encoders' noise and not at it, with their error in times that noise."""
        told = self.after.settings.get("trajectory")
        ratios: Mapping[str, float] = told["noise_ratio"] if isinstance(told, dict) else {}
        left = {item.joint for item in self.unexplained}
        return {name: ratio for name, ratio in ratios.items() if ratio >= NOISE and name not in left}

    @property
    def sufficient(self) -> bool:
        """Whether nothing is missing: nothing was found, and nothing but noise is left."""
        return not self.effects and not self.unexplained and self.free_bodies is None and not self.near

    @property
    def nearer(self) -> tuple[Rival, ...]:
        """Rivals that leave clearly less of the motion than the effects that they would stand for."""
        left = {(found.effect, found.joint): 1.0 - found.gain for found in self.effects}
        return tuple(r for r in self.also_possible if MORE * (1.0 - r.gain) < left.get((r.instead_of, r.joint), 0.0))

    @property
    def mean_abs(self) -> tuple[float, float]:
        """Mean absolute error of the simulated positions over joints, before and after, rad (m)."""
        return mean_abs_of(self.fit_before), mean_abs_of(self.fit_after)


def mean_abs_of(fit: TrajectoryFit) -> float:
    """Return the mean absolute error of a fit's simulated positions over joints, rad (m)."""
    return float(np.mean(fit.mean_abs))
