"""Drives whose loops compute their torque now and then, and hold it until the next time: what the motion says of it.

Their period may be a sample of the log, a part of it, or longer.

To first order half a period's delay of positions and velocities is viscous friction and inertia: kp times that less of
the one, kd times that less of the other. What is left of it beyond that, of second order, shows in fast motion where
nothing else is missing: the squared error is a parabola in the square of the period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.result import Nuisance
from elid_cli.estimation.trajectory.changes import CLEARLY, least_of, nearer_by, nearer_throughout
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fitted
from elid_cli.estimation.trajectory.loop_periods import WHOLE, allowed_loops, can_delay, late_commands
from elid_cli.estimation.trajectory.memory import has_memory
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.estimation.trajectory.timing_doubts import counting, step_of
from elid_cli.estimation.trajectory.unknowns import KINDS
from elid_cli.estimation.trajectory.unseen_loops import LITTLE, by_delay, by_motion
from elid_cli.model.drives import lost_to_holding, parts_of_loops
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.of_drives import declared_loops
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals
from elid_cli.signals.stepping_commands import commands_step

NEAR = 2.0
"""Times the encoders' noise, at any joint, up to which nothing else is missing."""
FARTHEST, PART = 300.0, 0.3
"""Times the noise up to which loops are asked for that take away much: this of the logarithm of the error's size, per
joint."""
NONE = 1e-3
"""Part of what holding may take from viscous friction up to which that is none."""
AT_NOISE = 1.03
"""Times the encoders' noise up to which nothing but that is left."""
ALWAYS = 0
"""Said of loops that act all the time."""
NEARLY = 0.1
"""What `WHOLE` is where commands change all the time: how late loops take them is well known then."""
ELSEWHERE = 1.0
"""Sum over the joints of the logarithm by which loops are farther that take commands at another time."""
PROBED = 2.5e-3, 5e-3
"""Periods, s, of which the first loops that are tried have at least one: of fast logs a sample is too short."""
PERHAPS = 0.02
"""Probability by which chance makes the nearest of several fits so much nearer, over the course of the log, at most,
that errors count it though it is not clearly so …"""
THROUGHOUT = 4.0
"""… and standard errors from which it is clearly so, where the errors have a memory."""
FIRMLY = 5.0
"""Times what counts as clear by which loops that act all the time must be nearer for the others to be ruled out."""
BENT = 0.3
"""Part of a value that loops which may hold must change for a warning."""
SHOWN, SMALL = 3.0, 0.03
"""Standard errors, and part of a value, beyond which a change is worth asking for."""


def less_by_holding(fit: TrajectoryFit, recording: Recording) -> Array:
    """Return by how much inertia and viscous friction come out too small beside loops that may hold, (n, 2)."""
    gains = np.stack([np.nanmean(recording.commands[name], axis=0) for name in ("kd", "kp")], axis=1)
    return lost_to_holding(recording.dt if fit.unseen is None else fit.unseen, gains)


def matters(fit: TrajectoryFit, recording: Recording) -> NDArray[np.bool_]:
    """Return of which inertia and viscous friction that would be worth a word, (n, 2)."""
    errors = fit.unknowns.joint_values(fit.deviation)[:, [0, 2]]
    least = np.maximum(SHOWN * errors, SMALL * fit.values[:, [0, 2]])
    found: NDArray[np.bool_] = fit.shown[:, [0, 2]] & (less_by_holding(fit, recording) > least)
    return found


def loops_bend(fit: TrajectoryFit, recording: Recording) -> bool:
    """Whether loops that hold, which the motion says nothing of, would bend inertia or viscous friction much."""
    if any(not _plain(item.run) for item in fit.tracked):
        return False
    values = fit.values[:, [0, 2]]
    return bool((matters(fit, recording) & (less_by_holding(fit, recording) > BENT * values)).any())


def _plain(run: Run) -> bool:
    return run.drives.held is None and run.drives.stepped is None


def negative(fit: TrajectoryFit, errors: float = 0.0) -> NDArray[np.bool_]:
    """Return the joints whose viscous friction comes out as none, or as less, where loops that hold take it, (n,).

    Where standard errors are asked for: the ones at which it is less by more of them.
    """
    run, viscous = fit.tracked[0].run, fit.values[:, KINDS.index("viscous")]
    lost, error = lost_to_holding(run.dt, run.drives.kp), fit.unknowns.joint_values(fit.deviation)[:, 2]
    most = -errors * error if errors else NONE * lost
    found: NDArray[np.bool_] = fit.shown[:, 2] & (viscous <= most) & (lost > 0)
    return found


def with_held_loops(fit: TrajectoryFit, signals: Signals, free: TrajectoryFit | None = None) -> TrajectoryFit:
    """Return the fit under drives that hold their torque for a period of their own, where that is clearly nearer.

    A fit of loops that act all the time, which is clearly nearer and leaves the encoders' noise, says so
    (`TrajectoryFit.at_once`). One of a robot that declares its loops, and one that leaves more than noise, is returned.
    `free` is the fit with a delay, as loops that hold have one, where the given one has none.
    """
    free = free or fit
    recording = signals.recording
    above = fit.above_noise(signals)
    declared = declared_loops(fit.unknowns.robot).any() or any(item.run.drives.held is not None for item in fit.tracked)
    if recording is None or declared or (above > FARTHEST).any():
        return fit
    # where something else is missing loops must take away much
    much = PART * fit.unknowns.robot.n if (above > NEAR).any() else 0.0
    if recording.changing:  # what passes between samples is not logged well enough
        return replace(fit, unseen=by_delay(free, recording))
    step = commands_step(recording)
    if not negative(fit).any() and not matters(fit, recording).any():
        return fit
    tried = _foreseen(free, recording.dt, much, step=step)
    told = step or not recording.doubted  # loops that are told commands between samples are not simulated
    longest = by_motion(free, _near(free, tried), recording.dt) if told else by_delay(free, recording)
    if not tried:
        return replace(fit, unseen=longest)
    if much and max(nearer_by(one, free) for one in tried.values()) < much:
        return fit
    once, near = tried.get(1.0), max(nearer_by(one, free) for one in tried.values())
    # of those that are as near the one that runs least often: at the log's rate, if it may be
    alike = {often: one for often, one in tried.items() if nearer_by(one, free) > near - LITTLE}
    often, best = min(alike.items(), key=lambda item: item[0])
    least = 0.0 if best is once else LITTLE
    clear = all(clearly_nearer(best, one) and nearer_by(best, one) > least for one in (fit, free))
    if not clear and negative(free).any() and nearer_by(best, free) > 0:  # no joint drives itself
        clear, alike[ALWAYS] = True, free
    if clear:
        return _counting_others(best, alike, often)
    by = -np.inf if once is None else nearer_by(once, free)
    at_once = bool(best is once and by < -FIRMLY * least_of(fit) and (above <= AT_NOISE).all())
    fit = replace(fit, at_once=at_once, unseen=longest)
    perhaps = nearer_by(best, fit) > 0 and nearer_throughout(best, fit) > _by_chance(len(tried))
    return counting_other(fit, best) if perhaps else fit


def _by_chance(count: int) -> float:
    """Return the standard errors by which the nearest of so many fits is nearer by chance alone, rarely."""
    from scipy.special import ndtri

    return -float(ndtri(PERHAPS / count))


def counting_other(fit: TrajectoryFit, other: TrajectoryFit) -> TrajectoryFit:
    """Return a fit whose errors count what another one, of drives that act otherwise, has for its drive parameters."""
    drives = fit.unknowns.drives
    return counting(fit, [other.z[:drives] - fit.z[:drives]])


def _counting_others(best: TrajectoryFit, alike: dict[float, TrajectoryFit], often: float) -> TrajectoryFit:
    """Return a fit whose errors count the farthest of those that are as near, by how often their loops run."""
    drives, others = best.unknowns.drives, tuple(sorted(alike.keys() - {often}))
    moved = [one.z[:drives] - best.z[:drives] for one in alike.values()]
    return replace(counting(best, [max(moved, key=lambda by: float(np.abs(by).max()))]), loops=others)


def nearest_loops(fit: TrajectoryFit) -> TrajectoryFit:
    """Return the fit under drives that hold their torque so often that it is nearest, or the given one if that is."""
    if any(item.run.drives.held is not None for item in fit.tracked):
        return fit
    return max([fit, *_every(fit, fit.tracked[0].run.dt).values()], key=lambda one: nearer_by(one, fit))


def _fits(fit: TrajectoryFit, dt: float, every: Sequence[float]) -> dict[float, TrajectoryFit]:
    found = {often: of_loops(fit, often, dt) for often in every}
    return {often: one for often, one in found.items() if one is not None}


def _every(fit: TrajectoryFit, dt: float) -> dict[float, TrajectoryFit]:
    """Return the fits under loops that run as often per sample as may be, by how often."""
    return _fits(fit, dt, [often for often in allowed_loops(dt) if often >= 1])


def _foreseen(fit: TrajectoryFit, dt: float, much: float, *, step: bool) -> dict[float, TrajectoryFit]:
    """Return the fits under loops of two periods, and of the one that these foresee.

    Of the allowed ones that is the nearest to the bottom of the parabola through the squared errors over the squared
    period: of loops that run always, and of both. Loops are of periods that have the delay of the commands, unless
    these change all the time and loops take each of them.
    """
    part = WHOLE if step else NEARLY
    allowed = [often for often in allowed_loops(dt)
               if (not step and often == round(often)) or can_delay(fit, dt / often, part)]  # fmt: skip
    found: dict[float, TrajectoryFit] = {}
    for often in _probes(allowed, dt):
        found |= {} if len(_near(fit, found)) > 1 else _fits(fit, dt, (often,))
    if much and max((nearer_by(one, fit) for one in found.values()), default=0.0) < 0.5 * much:
        return found
    often = _bottom(fit, _near(fit, found), allowed)
    found |= {} if often in (0, *found) else _fits(fit, dt, (often,))
    if not step:  # loops that run more seldom than commands change miss some: which ones, each period has its own
        found |= _fits(fit, dt, [often for often in allowed if often < 1 and often not in found])
    while (best := max(found, key=lambda each: nearer_by(found[each], fit), default=0.0)) and nearer_by(
        found[best], fit
    ) > 0:
        known = len(found)
        for way in (-1, 1):  # the parabola is one near its bottom alone
            found |= _beside(fit, found, allowed, allowed.index(best), way, dt)
        if len(found) == known:
            break
    return found


def _beside(
    fit: TrajectoryFit, found: dict[float, TrajectoryFit], allowed: Sequence[float], place: int, way: int, dt: float
) -> dict[float, TrajectoryFit]:
    """Return the fit of the next period on one side, and of the next but one where commands come at another time."""
    more: dict[float, TrajectoryFit] = {}
    for often in allowed[max(place - 2, 0) : place][::-1] if way < 0 else allowed[place + 1 : place + 3]:
        more |= {} if often in found else _fits(fit, dt, (often,))
        if _near(fit, {k: one for k, one in (found | more).items() if k == often}):
            break
    return more


def _near(fit: TrajectoryFit, found: dict[float, TrajectoryFit]) -> dict[float, TrajectoryFit]:
    """Return the fits that the squared error's parabola may go through: commands come at another time in the others."""
    return {often: one for often, one in found.items() if nearer_by(one, fit) > -ELSEWHERE}


def _probes(allowed: Sequence[float], dt: float) -> list[float]:
    """Return how often loops run that are tried until two are told: of usual periods, once and twice in a sample."""
    near = sorted({min(allowed, key=lambda often: abs(dt / often - period)) for period in PROBED if allowed})
    then = (1.0, 2.0, *sorted(allowed, key=lambda often: abs(dt / often - PROBED[0])))
    return list(dict.fromkeys([*near, *(often for often in then if often in allowed)]))


def _bottom(fit: TrajectoryFit, found: dict[float, TrajectoryFit], allowed: Sequence[float]) -> float:
    """Return how often in a sample loops run by the squared errors of ones that run always and of two; 0: none."""
    if len(found) < 2:
        return allowed[0] if allowed and not found else 0.0
    (long, late), (short, soon) = sorted(found.items())[:2]
    start, middle, end = (float(np.sum((one.equations.size / fit.equations.size) ** 2)) for one in (fit, soon, late))
    x, y = long**-2.0, short**-2.0
    bend = ((end - start) / x - (middle - start) / y) / (x - y)
    slope = (middle - start) / y - bend * y
    if slope >= 0:
        return 0.0
    if bend <= 0:
        return allowed[-1]
    period = float(np.sqrt(-0.5 * slope / bend))
    return min((0.0, *allowed), key=lambda often: abs((1.0 / often if often else 0.0) - period))


def clearly_nearer(one: TrajectoryFit, other: TrajectoryFit) -> bool:
    """Return whether a fit is clearly nearer to the motion than another one of as many unknowns."""
    by = nearer_by(one, other)
    if not has_memory(one.equations):
        return by > least_of(other)
    return by > CLEARLY or (by > LITTLE and nearer_throughout(one, other) > THROUGHOUT)


def of_loops(fit: TrajectoryFit, often: float, dt: float) -> TrajectoryFit | None:
    """Return the fit under drives that compute their torque so many times per sample, and hold it.

    None where a sample's loops would have a delay of no whole number of periods, where a simulator's steps are no part
    of them, or the motion runs away.
    """
    parts = float(parts_of_loops(np.array(often)))
    periods = fit.delays * parts / dt
    if parts == often and (np.abs(periods - np.round(periods)) > WHOLE).any():
        return None
    if any(item.run.drives.stepped and round(item.run.dt / step_of(item.run)) % parts for item in fit.tracked):
        return None
    drives = [item.run.drives for item in fit.tracked]
    times = often * np.any([own.kp > 0 for own in drives], axis=0).astype(float)
    z = fit.z.copy()
    for kind, gains in (("inertia", [own.kd for own in drives]), ("viscous", [own.kp for own in drives])):
        # what holding takes from them: without, the motion may run away
        z[KINDS.index(kind) : fit.unknowns.drives : len(KINDS)] += lost_to_holding(dt / often, np.mean(gains, axis=0))
    z[fit.unknowns.delays] -= late_commands(fit, dt / often)
    return refitted(fit, [item.run.holding(times) for item in fit.tracked], z)


def at_all_times(fit: TrajectoryFit) -> TrajectoryFit | None:
    """Return the fit under the same drives with loops that act all the time; None where the motion runs away."""
    drives, dt = [item.run.drives for item in fit.tracked], fit.tracked[0].run.dt
    period, z = dt / float(max(np.max(own.held) for own in drives if own.held is not None)), fit.z.copy()
    for kind, gains in (("inertia", [own.kd for own in drives]), ("viscous", [own.kp for own in drives])):
        z[KINDS.index(kind) : fit.unknowns.drives : len(KINDS)] -= lost_to_holding(period, np.mean(gains, axis=0))
    z[fit.unknowns.delays] += late_commands(fit, period)
    never = np.zeros(fit.unknowns.robot.n)
    return refitted(fit, [item.run.holding(never) for item in fit.tracked], z)


def refitted(fit: TrajectoryFit, runs: Sequence[Run], z: Array) -> TrajectoryFit | None:
    """Return the fit to stretches that are driven otherwise, from unknowns z; None where the motion runs away."""
    tracked = [replace(Tracked.of(run), usual=item.usual) for run, item in zip(runs, fit.tracked, strict=True)]
    try:
        found = fitted(fit.unknowns, tracked, z, prompt=False)
    except DataError:
        return None
    return replace(found, apart=fit.apart, doubted=fit.doubted)


def loops_of(robot: Robot, fit: TrajectoryFit) -> tuple[Nuisance, ...]:
    """Return the drives of a fit that hold their torque, as channels' faults are told."""
    holds = [(item.run.drives.held, item.run.dt) for item in fit.tracked if item.run.drives.held is not None]
    if not holds:
        return ()
    kind = effect_that(of_drive="hold")
    often, dt = holds[0]
    return tuple(Nuisance(kind.name, robot.joint_names[k], {kind.amplitudes[0].name: dt / float(often[k])}, {})
                 for k in np.flatnonzero(often).tolist())  # fmt: skip
