"""Logs of simulators whose steps are long enough to matter: what the motion says of them.

Semi-implicit Euler steps of length h move as smooth motion does whose drives act h/2 before they are told, and damp a
velocity that is h/2 late: motor inertia comes out too small by h/2 times kd less the joint's viscous friction. The lead
shows, as no robot acts before it is told; what is left beyond first order shows whether it is steps that make it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.result import Nuisance
from elid_cli.estimation.trajectory.changes import nearer_by
from elid_cli.estimation.trajectory.first_fits import FirstFit, first_fit
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.held_loops import (
    AT_NOISE,
    clearly_nearer,
    counting_other,
    loops_of,
    refitted,
    with_held_loops,
)
from elid_cli.estimation.trajectory.loop_periods import allowed_loops, can_delay
from elid_cli.estimation.trajectory.timing_doubts import as_doubtful, counting, step_of
from elid_cli.estimation.trajectory.unknowns import KINDS
from elid_cli.estimation.trajectory.velocity_filters import filters_in_doubt, velocity_filters
from elid_cli.model.drives import Stepped, parts_of_loops
from elid_cli.model.effects import effect_that, of_drives
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.of_drives import STEPS, declared_loops
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals
from elid_cli.signals.stepping_commands import commands_step

FAR = 10.0
"""Times the encoders' noise, at any joint, up to which steps are asked for."""
FINEST = 1.9e-4
"""Shortest step, s, that is simulated."""
NEAREST = 3
"""Steps that are tried where drives act before they are told: what else is missing moves by how much."""
HALF = 0.1
"""Part of a step by which a delay may be off a whole number of steps less a half."""
USUAL = 1, 2, 4, 5, 10
"""Steps per sample that are tried beside drives that act later than they are told: where more than noise is left, or
the delay is known well enough to be one of whole steps."""
SURE, LEAST = 3.0, 0.01
"""Standard errors, and part of a sample, by which drives act before they are told for that to count …"""
SLIGHT = 5e-5
"""… and s from which standard errors count it in any case."""
BESIDE, NEARBY = 2, 0.3
"""Steps per sample more or fewer, and part of its period, within which steps and loops are tried beside each other."""
LONGEST = 0.6
"""Part of a sample by which steps, of a whole one at most, can make drives act before they are told."""


def with_drives_in_time(fit: TrajectoryFit, signals: Signals) -> TrajectoryFit:
    """Return the fit with loops that hold their torque, or a simulator's steps, where the motion is clearly nearer so.

    Where drives act before they are told and neither explains it, standard errors count what steps would change.
    """
    recording = signals.recording
    if recording is None:
        return fit
    free = fit if fit.delays.any() else refitted(fit, [item.run for item in fit.tracked], fit.z)
    free = fit if free is None else free
    if (fit.above_noise(signals) > FAR).any():
        looped = with_held_loops(fit, signals, free)
        return fit if looped.tracked is fit.tracked else with_steps(looped, signals)
    if recording.changing:  # drives that are told more often than is logged act more often, too
        return with_held_loops(fit, signals, free)
    stepped = with_steps(free, signals)
    nearer = stepped is not free and clearly_nearer(stepped, fit)
    looped = with_held_loops(fit, signals, free)
    if nearer:  # a controller may run less often than its simulator steps
        beside = with_held_loops(stepped, signals)
        stepped = beside if beside.tracked is not stepped.tracked else replace(stepped, unseen=beside.unseen)
    if nearer or looped.tracked is not fit.tracked:
        # a filter of the velocity makes inertia and friction come out too small as well
        filtered = velocity_filters(free)
        if filtered is not None and all(nearer_by(filtered.fit, one) > 0 for one in (looped, stepped)):
            return filters_in_doubt(_in_doubt(fit, free, signals), filtered)
    if looped.tracked is fit.tracked:
        return _settled(stepped, step=commands_step(recording)) if nearer else _in_doubt(looped, free, signals)
    both = with_steps(looped, signals)
    both = both if both is looped else as_doubtful(both, looped)
    step = commands_step(recording)
    both, stepped = _settled(both, step=step), stepped if _alike(both, stepped) else _settled(stepped, step=step)
    if nearer and not clearly_nearer(both, stepped):
        return stepped if clearly_nearer(stepped, both) else counting_other(stepped, both)
    return both if both.tracked is not looped.tracked else _in_doubt(looped, looped, signals)


def _alike(one: TrajectoryFit, other: TrajectoryFit) -> bool:
    """Whether two fits have the same loops in the same steps."""
    mine, its = (fit.tracked[0].run.drives for fit in (one, other))
    loops = [np.zeros(1) if drives.held is None else drives.held for drives in (mine, its)]
    return mine.stepped == its.stepped and mine.told.shape == its.told.shape and np.array_equal(loops[0], loops[1])


def _settled(fit: TrajectoryFit, *, step: bool) -> TrajectoryFit:
    """Return a fit of loops in steps, or one of other periods and steps near by, if that is nearer.

    One was found where the other was missing, and makes up for a part of it. `step` says that commands do.
    """
    run = fit.tracked[0].run
    if run.drives.stepped is None or run.drives.held is None:
        return fit
    steps, often = round(run.dt / step_of(run)), float(run.drives.held.max())
    pairs = [
        (each, other) for each in range(max(steps - BESIDE, 1), steps + BESIDE + 1) for other in allowed_loops(run.dt)
        if run.dt / each >= FINEST and not each % parts_of_loops(np.array(other)) and (each, other) != (steps, often)
        and abs(often / other - 1.0) <= NEARBY and (not step or can_delay(fit, run.dt / other))
    ]  # fmt: skip
    found = [one for each, other in pairs if (one := _moved(fit, each, other)) is not None]
    best = max((fit, *found), key=lambda one: nearer_by(one, fit))
    return best if best is fit else as_doubtful(best, fit)


def _moved(fit: TrajectoryFit, steps: int, often: float) -> TrajectoryFit | None:
    """Return a fit of loops in steps with so many steps per sample, and loops so often in one, as much held."""
    run, z, own = fit.tracked[0].run, fit.z.copy(), fit.unknowns
    assert run.drives.stepped is not None
    assert run.drives.held is not None
    step, before = run.dt / steps, float(run.drives.held.max())
    held = np.where(run.drives.held > 0, often, 0.0)
    longer = 0.5 * run.dt * (1.0 / often - 1.0 / before)
    for kind, gains in (("inertia", run.drives.kd), ("viscous", run.drives.kp)):
        z[KINDS.index(kind) : own.drives : len(KINDS)] += longer * np.where(held > 0, gains, 0.0)
    how = run.drives.stepped
    return refitted(fit, [item.run.stepping(how, step).holding(held) for item in fit.tracked], z)


def with_steps(fit: TrajectoryFit, signals: Signals) -> TrajectoryFit:
    """Return the fit to a simulator's steps where the motion is clearly nearer so, else the given one."""
    recording = signals.recording
    declared = of_drives.has_steps(fit.unknowns.robot)
    if recording is None or recording.changing or declared or (fit.above_noise(signals) > FAR).any():
        return fit
    every = [in_steps(fit, "explicit", recording.dt / each) for each in _asked(fit, signals)]
    found = [one for one in every if one is not None]
    best = min(found, key=lambda one: float(np.log(one.equations.size).sum()), default=None)
    return fit if best is None or not clearly_nearer(best, fit) else _damped(best)


def _asked(fit: TrajectoryFit, signals: Signals) -> list[int]:
    """Return how many steps a sample may have: those by which drives act at whole steps less a half."""
    recording = signals.recording
    assert recording is not None
    dt, late = recording.dt, _late(fit)
    few = [each for each in range(1, STEPS + 1) if dt / each >= FINEST]
    places = {each: late * each / dt + 0.5 for each in few}
    near = {each: np.abs(place - np.round(place)).max() for each, place in places.items()}
    if _lead(fit, LEAST * dt):
        ahead = [each for each in few if near[each] < HALF and not np.round(places[each]).any()]
        return sorted(ahead, key=lambda each: float(near[each]))[:NEAREST]
    known = fit.deviation[fit.unknowns.delays].max()
    left = bool((fit.above_noise(signals) > AT_NOISE).any())
    return [each for each in USUAL if each in few and near[each] < HALF and np.round(places[each]).min() >= 0
            and (left or (fit.delays.any() and known < HALF * dt / each))]  # fmt: skip


def _late(fit: TrajectoryFit) -> Array:
    """Return by how much drives act later than they are told, or than they compute what they hold, s, (R,)."""
    parts = max((float(parts_of_loops(item.run.drives.held).max()) for item in fit.tracked
                 if item.run.drives.held is not None), default=0.0)  # fmt: skip
    period = fit.tracked[0].run.dt / parts if parts else np.inf
    whole = np.round(fit.delays / period) * period if parts else 0.0
    found: Array = fit.delays - whole
    return found


def _lead(fit: TrajectoryFit, least: float) -> float:
    """Return by how much, of at least so many s, drives clearly act before they are told, s; 0 where they do not."""
    late, error = _late(fit), fit.deviation[fit.unknowns.delays]
    return float(-late.mean()) if np.all(late < -np.maximum(SURE * error, least)) else 0.0


def _gains(fit: TrajectoryFit) -> Array:
    """Return the mean damping gain of every drive, (n,)."""
    found: Array = np.mean([item.run.drives.kd for item in fit.tracked], axis=0)
    return found


def in_steps(fit: TrajectoryFit, how: Stepped, step: float) -> TrajectoryFit | None:
    """Return the fit to a simulator's steps, from where a fit to smooth motion puts their unknowns."""
    held = [item.run.drives.held for item in fit.tracked if item.run.drives.held is not None]
    each = round(fit.tracked[0].run.dt / step)
    if any(each % parts_of_loops(often).max() for often in held):
        return None
    own, z = fit.unknowns, fit.z.copy()
    z[own.delays] += 0.5 * step
    inertia = slice(0, own.drives, len(KINDS))
    z[inertia] += 0.5 * step * (_gains(fit) - own.joint_values(fit.z)[:, KINDS.index("viscous")])
    return refitted(fit, [item.run.stepping(how, step) for item in fit.tracked], z)


def _damped(fit: TrajectoryFit) -> TrajectoryFit:
    """Return a fit to steps with explicit damping of drives, or the one with implicit damping if clearly nearer.

    But for friction that fades in at joints that are coupled both are the same but for the inertia: `either`.
    """
    run, z = fit.tracked[0].run, fit.z.copy()
    step = step_of(run)
    z[0 : fit.unknowns.drives : len(KINDS)] -= step * _gains(fit)
    if not np.all(fit.unknowns.joint_values(z)[:, 0] > 0):
        return fit
    other = refitted(fit, [item.run.stepping("implicit", step) for item in fit.tracked], z)
    if other is None or clearly_nearer(fit, other):
        return fit
    if clearly_nearer(other, fit):
        return other
    less = np.zeros(fit.unknowns.drives)
    less[:: len(KINDS)] = step * _gains(fit)
    return replace(counting(fit, (less,)), either=True)


def _in_doubt(fit: TrajectoryFit, free: TrajectoryFit, signals: Signals) -> TrajectoryFit:
    """Return a fit with errors that know of steps of a simulator which are too short to show.

    `free` is the fit with a delay, where the given one has none: what that moves counts, too.
    """
    recording = signals.recording
    lead = 0.0 if recording is None or recording.changing else _lead(free, min(LEAST * recording.dt, SLIGHT))
    if not lead or of_drives.has_steps(fit.unknowns.robot):
        return fit
    if recording is not None and lead > LONGEST * recording.dt:  # no steps are longer than a sample
        return replace(free, ahead=lead)
    moved = (free.z - fit.z)[: fit.unknowns.drives]
    moved[:: len(KINDS)] += lead * _gains(fit)
    return replace(counting(fit, (moved,)), ahead=lead)


def runs_in_time(
    robot: Robot, signals: Signals, runs: Sequence[Run], start: Array,
    declared: tuple[Sequence[Effect], Sequence[float]],
) -> tuple[list[Run], TrajectoryFit | None, FirstFit | None]:  # fmt: skip
    """Return stretches with loops that hold their torque, or a simulator's steps, where a fit is clearly nearer so.

    With the fit, which knows what is in doubt, and the one without either; None where the simulated motion runs away.

    Parameters
    ----------
    robot, signals, runs
        The robot, the log, and its stretches that commands drive.
    start, declared
        Drive parameters to start from, (n, 4), and effects that the robot declares, with their amplitudes.
    """
    try:
        first = first_fit(robot, runs, start, declared, signals.first)
        fit = with_drives_in_time(first.fit, signals)
    except DataError:
        return list(runs), None, None
    return like_these(runs, fit), fit, first


def like_these(runs: Sequence[Run], fit: TrajectoryFit) -> list[Run]:
    """Return stretches with the loops, or in the steps, that those of a fit have."""
    return [_like(run, item.run) for run, item in zip(runs, fit.tracked, strict=True)]


def is_timed(fit: TrajectoryFit | None, signals: Signals) -> bool:
    """Whether a fit left little enough for its loops and steps to be judged."""
    return fit is not None and not (fit.above_noise(signals) > FAR).any()


def retimed(runs: Sequence[Run], fit: TrajectoryFit, signals: Signals) -> tuple[list[Run], TrajectoryFit]:
    """Return stretches as `runs_in_time` does, by a fit with what was missing when that could not be judged."""
    found = with_drives_in_time(fit, signals)
    return like_these(runs, found), found


def _like(run: Run, other: Run) -> Run:
    drives = other.drives
    run = run if drives.stepped is None else run.stepping(drives.stepped, step_of(other))
    return run if drives.held is None else run.holding(drives.held)


def as_timed(robot: Robot, fit: TrajectoryFit, signals: Signals) -> Signals:
    """Return the signals with torques of drives, or in steps, that a fit found; declared ones were before."""
    run, times = fit.tracked[0].run, np.zeros(robot.n)
    for joint, time, _ in fit.open_filters:
        times[joint] = time
    signals = of_drives.with_filters(signals, times)
    if run.drives.held is not None and not declared_loops(robot).any():
        signals = of_drives.with_held_loops(signals, run.drives.held)
    if run.drives.stepped is not None and not of_drives.has_steps(robot):
        signals = of_drives.with_steps(signals, (run.drives.stepped, step_of(run)))
    return signals


def ahead_by_steps(fit: TrajectoryFit) -> float:
    """Return by how much a simulator's steps make commands act before they are told, s."""
    run = fit.tracked[0].run
    return 0.0 if run.drives.stepped is None else 0.5 * step_of(run)


def faults_of_time(robot: Robot, fit: TrajectoryFit) -> tuple[Nuisance, ...]:
    """Return loops that hold their torque and a simulator's steps, as channels' faults are told."""
    run, kind = fit.tracked[0].run, effect_that(of_drive="step")
    step, implicit = (one.name for one in kind.amplitudes)
    values = {step: step_of(run), implicit: float(run.drives.stepped == "implicit")}
    steps = () if run.drives.stepped is None else robot.joint_names
    return (*loops_of(robot, fit), *(Nuisance(kind.name, name, dict(values), {}) for name in steps))
