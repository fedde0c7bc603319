"""The search by motion, again where one fault of the whole explains more than what it found: gains, a tilted base.

Springs and other effects of single joints imitate both. A search that knows the fault finds what else is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array, Progress
from elid_cli.diagnosis.by_motion.beside import Beside
from elid_cli.diagnosis.by_motion.search import Searched, search
from elid_cli.diagnosis.by_motion.tilt import Tilt, moved_by_tilt, tilt_of
from elid_cli.diagnosis.by_motion.torque_gains import Gains, gain_name, moved_by_gains, nearer
from elid_cli.estimation.known_load import LoadScale
from elid_cli.estimation.trajectory.fit import ABOVE, TrajectoryFit
from elid_cli.estimation.trajectory.identification import started_from
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals


@dataclass(frozen=True)
class Found:
    """What a search came to, with what acts on the whole."""

    done: Searched
    """`before` is the fit of the robot as it is described."""
    plain: TrajectoryFit
    """The fit without effects beside what acts on the whole."""
    robot: Robot
    """The robot in the gravity that was found."""
    ratio: Array
    """What the computed torque of every joint is over the one that acts, (n,)."""
    scaled: NDArray[np.bool_]
    """Joints where that is named, (n,)."""
    tilt: Tilt | None
    gains: Gains | None
    """The fit by drives of another torque at the other joints that are doubted."""


def searched(
    robot: Robot, signals: Signals, runs: Sequence[Run], declared: tuple[Sequence[Effect], Sequence[float]],
    off: Sequence[LoadScale], only: Sequence[str] = (), progress: Progress | None = None,
) -> Found:  # fmt: skip
    """Search for effects, for gains of the drives in their place, for a base that is not level.

    Parameters
    ----------
    robot, signals, runs
        The robot, the log, and its stretches that commands drive.
    declared
        Effects that the robot declares, and their amplitudes.
    off
        What multiplies the torque that the bodies need, of the joints where that is surely not 1.
    only, progress
        As `search` has them.
    """
    done = search(robot, runs, started_from(robot, signals), *declared, only, progress)
    first, plain = done.before, done.before
    ratio, right = np.ones(robot.n), signals
    gains = Gains.of(plain, done.after, off, signals)
    scaled = nearer(done.after, gains) & (not only or gain_name() in only) & (not done.partial)
    if gains is not None and scaled.any():
        ratio = np.where(scaled, gains.ratio, 1.0)
        right, runs = replace(signals, tau=signals.tau / ratio), [run.delivering(ratio) for run in runs]
        done = search(robot, runs, started_from(robot, right), *declared, only, progress)
        plain = done.before
        gains = Gains.of(plain, done.after, [scale for scale in off if not scaled[scale.joint]], right)
    tilt = _tilt(done, right, only)
    if tilt is not None:
        robot, gains = tilt.robot, None
        done = search(robot, runs, tilt.fit.values, *declared, only, progress)
        plain = done.before
    return Found(replace(done, before=first, after=_aware(done.after, scaled, tilt)), plain, robot, ratio, scaled, tilt,
                 gains)  # fmt: skip


def _aware(fit: TrajectoryFit, scaled: NDArray[np.bool_], tilt: Tilt | None) -> TrajectoryFit:
    """Return the fit with errors that know those of gains and tilt."""
    moved = [] if tilt is None else [moved_by_tilt(fit, tilt.level, tilt.angles)]
    moved += [moved_by_gains(fit, np.flatnonzero(scaled).tolist())] if scaled.any() else []
    if not moved:
        return fit
    beside = Beside.of(fit, [np.concatenate(parts, axis=2) for parts in zip(*moved, strict=True)])
    return replace(fit, covariance=fit.covariance + beside.added)


def _tilt(done: Searched, signals: Signals, only: Sequence[str]) -> Tilt | None:
    """Return the tilt of the base that brings the motion clearly nearer than what a search found; mostly none."""
    kind = effect_that(turns_gravity=True)
    if done.partial or (only and kind.name not in only) or done.before.unknowns.effects:
        return None
    if (done.before.above_noise(signals) < ABOVE).all():
        return None
    found = tilt_of(done.before)
    return found if found is not None and found.is_nearer(done.after) else None
