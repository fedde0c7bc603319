"""A trajectory fit as an identification: base parameters, torque offsets, and what is held at the file's values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError
from elid_cli.estimation.judgement import ModelWord
from elid_cli.estimation.result import Identification, Nuisance
from elid_cli.estimation.trajectory.acting import can_act, declared, scene_along
from elid_cli.estimation.trajectory.at_noise import NOISE, is_at_noise
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.beside import Beside
from elid_cli.estimation.trajectory.bodies import other_bodies
from elid_cli.estimation.trajectory.changes import CLEARLY, nearer_by
from elid_cli.estimation.trajectory.decided import fit_with_columns
from elid_cli.estimation.trajectory.differing import as_last, differing
from elid_cli.estimation.trajectory.doubted_commands import with_doubted_commands
from elid_cli.estimation.trajectory.doubtful_joints import with_doubtful_joints
from elid_cli.estimation.trajectory.first_fits import first_fit
from elid_cli.estimation.trajectory.fit import ABOVE, TrajectoryFit
from elid_cli.estimation.trajectory.found_effects import (
    delay_name,
    fitted_effects,
    offset_name,
    robot_of,
    settled,
)
from elid_cli.estimation.trajectory.held_loops import negative
from elid_cli.estimation.trajectory.held_out import by_simulated_motion, held_out_errors, with_late_commands
from elid_cli.estimation.trajectory.late_joints import declared_late, late_joints, of_every, with_doubts
from elid_cli.estimation.trajectory.normal_equations import SETTLING, Tracked
from elid_cli.estimation.trajectory.settings import settings_of
from elid_cli.estimation.trajectory.simulator_steps import (
    ahead_by_steps,
    as_timed,
    faults_of_time,
    like_these,
    with_drives_in_time,
)
from elid_cli.estimation.trajectory.softening import columns_of, is_unsure
from elid_cli.estimation.trajectory.timing_doubts import as_doubtful
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS
from elid_cli.estimation.trajectory.velocity_filters import with_filters_in_doubt, with_open_filters
from elid_cli.estimation.trajectory.words import (
    bodies_words,
    command_words,
    difference_words,
    doubt_words,
    filter_words,
    late_words,
    loop_words,
    own_value_words,
    softness_words,
    step_words,
    sum_words,
    time_words,
)
from elid_cli.model.effects.declared import resolve
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.of_drives import (
    LOOPS,
    as_acting,
    declared_filters,
    declared_gains,
    declared_integrals,
    declared_loop_gains,
    declared_steps,
    holding,
)  # fmt: skip
from elid_cli.model.effects.posed import posed
from elid_cli.model.effects.shifts import declared_shifts
from elid_cli.model.linearised import Linearised
from elid_cli.model.runs import Run, runs_of
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.position_words import mean_words
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

SURE = 3.0
"""Standard errors by which a friction is below 0 that is called negative."""
GAINS = {"q_des", "kp", "kd"}
"""What a log must hold for its commands to drive a robot."""


def by_trajectory(
    found: Identification, signals: Signals, *, delays: bool = True, start: Array | None = None
) -> Identification:
    """Return the identification by the simulated motion, started from the log's torques.

    Parameters
    ----------
    found
        What least squares say of the same log.
    signals
        The log, with its recording.
    delays
        Whether a delay between commands and motion is an unknown, and friction may be found to fade in over a speed;
        False: the fit is for a format that holds neither.
    start
        Drive parameters to start from, (n, 4); None: those of the log's torques.

    Raises
    ------
    UsageError
        A robot that this fit does not know: elastic joints, joints with a gear ratio, effects that the motion alone
        does not determine.
    LogError
        The log holds no commands.
    RobotError
        Parameters of bodies are unknown.
    """
    robot = found.robot
    recording = signals.recording
    if recording is None:
        raise LogError("--fit trajectory: it simulates the samples of a log", hint="name the log itself")
    driven = recording.commands.keys() >= GAINS
    why = unsuited(robot) if driven else "the log holds no commands with gains"
    if why and not recording.commanded.any():
        from elid_cli.estimation.output_error.identification import by_output_error

        return by_output_error(found, signals)
    if why:
        raise UsageError(f"--fit trajectory: {why}", hint="leave --fit out: the torque is fitted")
    signals = as_acting(robot, signals)
    fit, bodies = fit_of(robot, signals, recording, delays=delays, start=start)
    return identification_of(found, fit, signals, bodies)


def fit_of(
    robot: Robot, signals: Signals, recording: Recording, *, delays: bool = True, start: Array | None = None
) -> tuple[TrajectoryFit, dict[str, float]]:
    """Return the fit to a log with commands, of a robot that it knows, and what other bodies would take off it.

    See `by_trajectory` and `bodies.other_bodies`.
    """
    robot = posed(robot)
    runs = commanded_runs(recording, robot)
    effects, amplitudes = declared_along(robot, runs[0])
    start = started_from(robot, signals) if start is None else start
    if delays:
        fit, columns = first_fit(robot, runs, start, (effects, amplitudes), signals.first).with_columns
    else:
        fit, columns = fit_with_columns(robot, runs, start, effects, amplitudes, late=False, soft=False)
    if delays:
        errors = np.zeros(robot.n)
        known = declared_late(fit, robot)
        if known is not None:
            errors[list(known.by.joints)] = known.deviations
            fit, columns = known.aware(), columns_of(known.fit)
        alone: Beside | None = of_every(fit)
        apart, common = late_joints(fit, alone), fit
        if apart is not None and apart.is_nearer(fit):
            if is_unsure(apart.fit):  # what delays of their own bring looked like friction that fades in
                hard = fit_with_columns(robot, runs, start, effects, amplitudes, late=delays, soft=False)[0]
                again = late_joints(hard, of_every(hard))
                apart = again if again is not None and nearer_by(apart.fit, again.fit) <= CLEARLY else apart
            alone = None
            errors[list(apart.by.joints)] = apart.deviations
            fit, columns = apart.aware(), columns_of(apart.fit)
        fit = replace(with_doubts(fit, alone), apart=errors)
        timed = with_drives_in_time(fit, signals)
        if timed.tracked is not fit.tracked and (timed.above_noise(signals) > NOISE).any():
            # friction that fades in was looked for without the loops, or steps, that the drives have
            anew = fit_with_columns(robot, like_these(runs, timed), timed.values, effects, amplitudes)[0]
            timed = as_doubtful(anew, timed) if nearer_by(anew, timed) > CLEARLY else timed
        timed = with_doubted_commands(timed, signals)
        columns = columns if timed.tracked is fit.tracked else columns_of(timed)
        fit = with_open_filters(timed, None if alone else common)
        columns = columns if fit is timed else columns_of(fit)
        fit = with_filters_in_doubt(fit, signals, None if alone or fit is not timed else common)
    # what filters of velocity explain asks for no other bodies
    return as_last(fit, differing(fit)), {} if np.any(fit.filters) else other_bodies(fit, columns)


def unsuited(robot: Robot) -> str:
    """Return why the trajectory fit does not know a robot, as a clause; empty where it does."""
    for joint in robot.joints:
        if joint.elastic:
            return f"{joint.name} is elastic"
        if joint.gear_ratio is not None:
            return f"{joint.name} has a gear_ratio: this fit finds the reflected inertia Ja"
    for spec in robot.effects:
        kind, _ = resolve(robot, spec)
        known = kind.nuisance in ("offset", "delay") or kind.of_drive in ("gain", *LOOPS)
        if not (can_act(kind) or known or kind.turns_gravity or kind.moves_zero):
            return f"it does not hold the effect {spec.effect} that the robot file declares"
    return ""


def commanded_runs(recording: Recording, robot: Robot) -> list[Run]:
    """Return the stretches of a log that its commands drive.

    Raises
    ------
    LogError
        The log has none that is long enough.
    """
    every = runs_of(recording, robot, None, np.zeros(robot.n), commanded=True)
    declared_late = declared_shifts(robot).torque
    if np.ptp(declared_late) > 0:  # what all have in common is each recording's own
        every = [run.later(declared_late - np.median(declared_late)) for run in every]
    gains, rates, times = declared_gains(robot), declared_integrals(robot), declared_filters(robot)
    if rates.any():
        every = [run.integrating(rates) for run in every]
    if times.any():
        every = [run.filtered(times) for run in every]
    if (steps := declared_steps(robot, recording.dt)) is not None:
        every = [run.stepping(*steps) for run in every]
    if (often := holding(robot, recording.dt)).any():
        every = [run.holding(often) for run in every]
    if np.any(gains != 1.0):
        every = [run.delivering(gains) for run in every]
    if np.any((tuned := declared_loop_gains(robot)) != 1.0):
        every = [run.tuned(*tuned) for run in every]
    # the first moments of a stretch do not count (`Tracked.counts`): as much again must be left
    runs = [run for run in every if run.t[-1] - run.t[0] > 2 * SETTLING]
    if not runs:
        raise LogError("no stretch of the log is long enough to be simulated under its commands")
    return runs


def declared_along(robot: Robot, run: Run) -> tuple[list[Effect], list[float]]:
    """Return the effects that a robot declares and a motion can hold, with their amplitudes."""
    if not robot.effects:
        return [], []
    item = Tracked.of(run)
    local = item.equations(Linearised(robot, without=PARAMETERS))
    scene = scene_along(robot, item.x, item.v, local, run.dt, robot.reference(), len(item.x))
    known = [own for spec in robot.effects if (own := declared(robot, spec, scene)) is not None]
    return [effect for effect, _ in known], [
        float(a) for effect, amplitudes in known if not effect.softens for a in amplitudes
    ]


def identification_of(
    found: Identification, fit: TrajectoryFit, signals: Signals, bodies: Mapping[str, float] = MappingProxyType({})
) -> Identification:
    """Return a trajectory fit as an identification.

    Parameters
    ----------
    found
        What least squares say of the same log.
    fit
        The fit.
    signals
        The log.
    bodies
        What other bodies take off the squared error of joints' motion (`bodies.other_bodies`).
    """
    robot, signals = found.robot, as_timed(found.robot, fit, signals)
    base, names = found.base, list(found.base.parameters)
    places = np.array([[names.index(StandardParameter(kind, k)) for kind in PARAMETERS] for k in range(robot.n)])
    covariance = np.zeros((len(names), len(names)))
    kept = np.flatnonzero(np.arange(fit.unknowns.drives) % len(KINDS) < len(PARAMETERS))
    moves = fit.shown & ~signals.still[:, None]
    shown = moves[:, : len(PARAMETERS)]
    both = np.outer(shown.ravel(), shown.ravel())
    covariance[np.ix_(places.ravel(), places.ravel())] = np.where(both, fit.covariance[np.ix_(kept, kept)], 0.0)
    standard = np.nan_to_num(robot.reference())
    standard[places[shown]] = fit.values[:, : len(PARAMETERS)][shown]
    estimate = base.transform @ standard
    spread = base.transform @ covariance @ base.transform.T
    apart = [*softness_words(robot, fit), *(difference_words(item) for item in differing(fit)), *own_value_words(fit)]
    if fit.unknowns.recordings == 1:
        wider = float(np.median(fit.another[: fit.unknowns.drives] / fit.deviation[: fit.unknowns.drives]))
        apart.append(
            f"what another recording would give differs from these values by {wider:.2g} standard errors "
            "(the median over parameters; each is another_recording in --json)"
        )
    after, before = (dict(zip(robot.joint_names, rms.tolist(), strict=True)) for rms in (fit.rms, fit.rms_before))
    note = (
        f"--fit trajectory: {fit.steps} steps; simulated positions are off by {mean_words(robot, after, 3)} (rms) on "
        f"average, {mean_words(robot, before, 3, bare=True)} with the values of least squares; "
        f"{late_words(robot, fit)}; bodies are held at the file's"
    )
    left_out = [robot_of(fit, z) for z in fit.left_out]
    acting = fit.joint_delays - ahead_by_steps(fit)
    error = held_out_errors(left_out, fit.spans, with_late_commands(signals, acting), found)
    # a torque whose drive the motion does not show is not predicted
    error = {name: error[name] for k, name in enumerate(robot.joint_names) if name in error and moves[k].any()}
    above = dict(zip(robot.joint_names, fit.above_noise(signals).tolist(), strict=True))
    beyond = {name: ratio for name, ratio in above.items() if ratio >= ABOVE}
    # that the residual of least squares, whose bodies are free, holds noise alone says nothing of the simulated motion
    model: ModelWord = "not judged" if found.model == "sufficient" and beyond else found.model
    times = np.broadcast_to(fit.filters, robot.n).tolist()
    slow = {name: time for name, time in zip(robot.joint_names, times, strict=True) if time}
    explained = not bodies and not slow and is_at_noise(above, fit)
    driving = {name: float(fit.values[k, 2]) for k, name in enumerate(robot.joint_names) if negative(fit, SURE)[k]}
    known = {"noise_ratio": above, "beyond_noise": beyond, "other_bodies": dict(bodies), "velocity_filters": slow,
             "negative_friction": driving}  # fmt: skip
    loops, warned = loop_words(robot, fit, signals, moves)
    told = by_simulated_motion(
        found, estimate, spread, base.values(robot.reference()),
        error=error,
        standard=standard,
        delays=np.zeros(robot.n),
        nuisances=(*channel_faults(robot, fit, moves[:, 3]), *faults_of_time(robot, fit)),
        effects=fitted_effects(robot, fit),
        notes=(note, *apart, *doubt_words(robot, fit), *loops, *command_words(fit), *step_words(robot, fit),
               *sum_words(robot, fit)),
        settings={**settings_of(found, fit, moves), **known},
        warnings=(*bodies_words(robot, bodies), *filter_words(robot, fit), *time_words(robot, fit), *warned),
        model="sufficient" if explained else "insufficient" if slow else model,
        insufficient=() if explained else found.insufficient,
        noise=() if explained else found.noise,
        not_excluded=(),
        still=np.any(base.transform[:, places[~shown]] != 0, axis=1),
    )  # fmt: skip
    return with_doubtful_joints(told, signals.recording, above)


def channel_faults(robot: Robot, fit: TrajectoryFit, shown: NDArray[np.bool_]) -> tuple[Nuisance, ...]:
    """Return the torque offset of every joint that shows one, (n,), and the delay of all: mean of the recordings.

    The other values are those beside the delay, however unsure it is: a robot without it does not move so.
    """
    values, errors = fit.unknowns.joint_values(settled(fit)), fit.unknowns.joint_values(fit.deviation)
    late, unsure = fit.joint_delays.mean(axis=0).tolist(), np.sqrt(np.mean(fit.deviation[fit.unknowns.delays] ** 2))
    scatter = float(np.std(fit.delays, ddof=1)) if len(fit.delays) > 1 else 0.0
    names = robot.joint_names
    alike = scatter**2 + np.broadcast_to(fit.apart, robot.n) ** 2 + fit.smoother**2
    unsure_of = np.sqrt(unsure**2 + alike).tolist()
    late_ones = [one for one in zip(names, late, unsure_of, strict=True) if fit.delays.any() or one[1]]
    return (
        *(Nuisance(offset_name(), name, {"offset": float(values[k, 3])}, {"offset": float(errors[k, 3])})
          for k, name in enumerate(names) if shown[k]),
        *(Nuisance(delay_name(), name, {"delay": delay}, {"delay": error}, kept=True)
          for name, delay, error in late_ones),
    )  # fmt: skip
