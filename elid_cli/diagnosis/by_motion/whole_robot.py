"""The search by motion, and again where the drives' gains or a tilted base explain more than what it found.

Springs and other effects of single joints imitate both. A search that knows them finds what else is missing.
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
from elid_cli.diagnosis.by_motion.torque_gains import Gains, gain_name, given_up, moved_by_gains, nearer
from elid_cli.diagnosis.result import Rival
from elid_cli.estimation.known_load import LoadScale
from elid_cli.estimation.trajectory.fit import ABOVE, TrajectoryFit
from elid_cli.estimation.trajectory.identification import started_from
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

CLEARLY = 0.2
"""Sum over the joints of the logarithm of the error's size by which a fit is clearly nearer."""
PER_JOINT = 0.04
"""The same per joint that a tilt alone must reach before a search is made with it. Measured: a quadruped of twelve
joints on level ground 0.028, whose search takes minutes."""


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
    taken: Gains | None
    """The one whose gains are named."""
    rivals: tuple[Rival, ...] = ()
    """What does as well as these."""


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
    first = done.before
    plain = Found(done, first, robot, np.ones(robot.n), np.zeros(robot.n, dtype=bool), None, None, None)
    if done.partial:
        return plain
    found = plain
    try:
        found, right, runs = _by_gains(plain, signals, runs, declared, off, only, progress)
        if not found.done.partial:
            found = _by_tilt(found, right, runs, declared, only, progress)
        return replace(found, done=replace(found.done, before=first, after=_aware(found)))
    except KeyboardInterrupt:
        return replace(found, done=replace(found.done, before=first, partial=True))


def _by_gains(
    plain: Found, signals: Signals, runs: Sequence[Run], declared: tuple[Sequence[Effect], Sequence[float]],
    off: Sequence[LoadScale], only: Sequence[str], progress: Progress | None,
) -> tuple[Found, Signals, Sequence[Run]]:  # fmt: skip
    """Return what a search finds by drives of another torque, where these come clearly nearer; log and runs then."""
    done, robot = plain.done, plain.robot
    gains = Gains.of(plain.plain, done.after, off, signals)
    may = not only or gain_name() in only
    scaled = nearer(done.after, gains, done.named) & may
    plain = replace(plain, done=replace(done, tried=done.tried + (len(off) if may else 0)))
    if gains is None or not scaled.any():
        return replace(plain, gains=gains), signals, runs
    ratio = np.where(scaled, gains.ratio, 1.0)
    right, runs = replace(signals, tau=signals.tau / ratio), [run.delivering(ratio) for run in runs]
    rivals = given_up(done.after, gains, done.named, scaled)
    done = search(robot, runs, started_from(robot, right), *declared, only, progress)
    done = replace(done, tried=done.tried + plain.done.tried)
    others = Gains.of(done.before, done.after, [scale for scale in off if not scaled[scale.joint]], right)
    return Found(done, done.before, robot, ratio, scaled, None, others, gains, rivals), right, runs


def _by_tilt(
    found: Found, signals: Signals, runs: Sequence[Run], declared: tuple[Sequence[Effect], Sequence[float]],
    only: Sequence[str], progress: Progress | None,
) -> Found:  # fmt: skip
    """Return what a search finds with gravity turned as the motion asks, where that comes clearly nearer."""
    kind, done = effect_that(turns_gravity=True), found.done
    if (only and kind.name not in only) or (found.plain.above_noise(signals) < ABOVE).all():
        return found
    tilt = tilt_of(found.plain)
    found = replace(found, done=replace(done, tried=done.tried + 1))
    if tilt is None or not _gain(tilt.fit, found.plain) > max(CLEARLY, PER_JOINT * tilt.level.n):
        return found
    turned = search(tilt.robot, runs, tilt.fit.values, *declared, only, progress)
    if turned.partial:  # what was found before stands, and was not compared
        raise KeyboardInterrupt
    if not _nearer(turned.after, done.after):
        return found
    turned = replace(turned, tried=turned.tried + found.done.tried)
    return replace(found, done=turned, plain=turned.before, robot=tilt.robot, tilt=tilt, gains=None)


def _nearer(one: TrajectoryFit, other: TrajectoryFit) -> bool:
    """Whether the joints' motion is clearly nearer in one fit than in another, on the whole."""
    return _gain(one, other) > CLEARLY


def _gain(one: TrajectoryFit, other: TrajectoryFit) -> float:
    """Return the sum over the joints of the logarithm by which the error's size falls from another fit to one."""
    return float(np.log(other.equations.size / one.equations.size).sum())


def _aware(found: Found) -> TrajectoryFit:
    """Return the fit with errors that know those of gains and tilt."""
    fit, tilt, moved = found.done.after, found.tilt, []
    if tilt is not None:
        moved.append(moved_by_tilt(fit, tilt.level, tilt.angles))
    if found.scaled.any():
        moved.append(moved_by_gains(fit, np.flatnonzero(found.scaled).tolist()))
    if not moved:
        return fit
    beside = Beside.of(fit, [np.concatenate(parts, axis=2) for parts in zip(*moved, strict=True)])
    return replace(fit, covariance=fit.covariance + beside.added)
