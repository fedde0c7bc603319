"""Identification: base parameters from logs, how sure they are, and how well they predict torque not used.

The linear least squares of the paper's section 5 (Zollo et al., doi:10.1155/2014/843186), with weights per row, rows
filtered in parallel, and standard errors that know of correlated residuals (docs/explanation/estimators.md).

`identify` takes signals that are at hand, `identify_logs` logs and triangle files; both come to the one fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from elid_cli.errors import UsageError, check_kind
from elid_cli.estimation.assembly import assemble, judged, with_pull_of_noise, with_scatter, with_unseen
from elid_cli.estimation.default_fit import DefaultFit, fit_log, reshaped, with_delays
from elid_cli.estimation.drive_law import law_warnings
from elid_cli.estimation.fit_in_time import fit_in_time
from elid_cli.estimation.identified import Identified
from elid_cli.estimation.judgement import JointError, Judgement
from elid_cli.estimation.known_load import with_load
from elid_cli.estimation.loops_of_torque import with_loop_words
from elid_cli.estimation.motor_side.door import asked_motor_side, asks, fitted_below, with_motor_side
from elid_cli.estimation.reading import read_signals
from elid_cli.estimation.regression.held_effects import beside_held
from elid_cli.estimation.regression.nuisances import SIGNIFICANT
from elid_cli.estimation.request import LogRequest, estimate_options
from elid_cli.estimation.result import EstimateOptions, FittedEffect, Identification, Nuisance, Verdict
from elid_cli.estimation.sanity import beyond_range, physics_warnings, rotor_warnings
from elid_cli.estimation.smooth_commands import as_told, noted
from elid_cli.estimation.trajectory.doubtful_joints import driven
from elid_cli.estimation.validation.prediction import errors_by_log
from elid_cli.estimation.validation.sufficiency import judge_model, judged_model
from elid_cli.model.effects import nuisance_of
from elid_cli.model.effects.declared import as_observed, resolve
from elid_cli.model.effects.of_drives import with_loops
from elid_cli.model.effects.posed import Pose
from elid_cli.model.effects.shifts import Shifts, delayed_joints, free_of_delays
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.signals import Signals, check_signals

__all__ = [
    "DefaultFit",
    "EstimateOptions",
    "FittedEffect",
    "Identification",
    "Identified",
    "JointError",
    "LogRequest",
    "Nuisance",
    "Verdict",
    "assemble",
    "fit_log",
    "identify",
    "identify_logs",
    "samples_needed",
]

LONG = 64 << 20
"""Bytes of filtered columns above which a log is reduced block by block."""
WORSE = 1.25
"""Ratio of held-out errors above which the collocation's answer is not kept.

Under noise the default's bias predicts noisy motion a little better than the truth does: up to 1.04 was seen where the
collocation was five times closer to it.
"""

NO_WORSE = 1.1
"""The same for an answer that lies further from the default estimate than its standard errors allow."""


def samples_needed(robot: Robot, options: EstimateOptions) -> str:
    """Return why triangles do not suffice for what was asked, as a clause, or nothing where they do."""
    if options.accurate:
        return "--accurate estimates the trajectory from the samples"
    if options.fit == "trajectory":
        return "--fit trajectory simulates the samples"
    if options.estimator != "default":
        return f"--estimator {options.estimator} starts from the samples"
    if robot.effects:
        return f"{robot.name} declares effects, whose shapes are fitted to the samples"
    return ""


def is_long(signals: Signals, robot: Robot) -> bool:
    """Return whether a log's filtered columns would take much memory."""
    return len(signals.outputs) * Regressor(robot).estimation.program.outputs * 8 > LONG


def identify(robot: Robot, signals: Signals, options: EstimateOptions | None = None) -> Identification:
    """Estimate the base parameters of a robot from the signals of one log, or of several that were read together.

    Several logs, and one that is long, are reduced one by one and identified as `identify_logs` does, unless something
    was asked that needs all samples at once (`samples_needed`).

    Parameters
    ----------
    robot
        The robot as described; its parameters are the reference.
    signals
        What `prepare` makes of a recording; joint side, SI.
    options
        How to estimate.

    Raises
    ------
    DataError
        If the log excites no parameter at all.
    UsageError, LogError
        An argument of another kind, or signals of other joints.
    """
    check_signals(signals, robot)
    options = estimate_options("identify", options, robot)
    if options.estimator == "paper":
        from elid_cli.estimation.classical import identify_paper

        return identify_paper(robot, signals, options)
    signals = as_told(robot, signals)
    found = noted(_identify(robot, signals, options), signals.recording)
    return found if found.estimator == "trajectory" else with_loop_words(found, signals.recording)


def _identify(robot: Robot, signals: Signals, options: EstimateOptions) -> Identification:
    if signals.recording is not None and not samples_needed(robot, options):
        several = len({segment.source for segment in signals.segments}) > 1
        if several or is_long(signals, robot):
            from elid_cli.estimation.streaming.merge import identify_reduced
            from elid_cli.estimation.streaming.reduce import reduce_each

            side = asked_motor_side(robot, signals, options)
            found, _ = identify_reduced(robot, reduce_each(robot, signals, {}), options)
            return with_motor_side(with_load(found, driven(robot, signals.recording) & ~signals.still), side)
    side = asked_motor_side(robot, signals, options)
    if side is not None and options.fit == "auto":
        options = replace(options, fit="torque")
    found, corrected = fitted_below(signals, side, options, lambda used, how: _identified(robot, used, how))
    if signals.recording is not None and options.guards:
        found = with_load(found, driven(robot, signals.recording) & ~signals.still)
    found = with_motor_side(found, side, corrected=corrected)
    return found if signals.recording is None else replace(found, log_warnings=signals.recording.warnings)


def _identified(robot: Robot, signals: Signals, options: EstimateOptions) -> Identification:
    """Return what the samples say of the robot as they show it."""
    whole, described, logged = robot, as_observed(robot, signals), signals
    plain = free_of_delays(described) if options.delays else described
    if options.delays:
        options = replace(options, declared_late=delayed_joints(described))
    robot, signals = with_loops(plain, signals)
    fit, pose, late = fit_in_time(robot, signals, options)
    if options.held is not None:
        fit = replace(fit, covariance=beside_held(fit, fit.covariance, options.held))
    fit, refused, answer = judged(fit, options)
    judgement = judge_model(fit) if options.guards else None
    fit = with_pull_of_noise(with_scatter(fit, judgement), [judgement])
    if fit.doubted:
        answer = assemble(fit, options, refused)
    found = with_unseen(_as_described(answer, robot, pose, late), whole)
    doubtful, wrong = False, tuple[str, ...]()
    if options.guards:
        found = replace(found, warnings=(*found.warnings, *rotor_warnings(found)))
        wrong = (*physics_warnings(fit, found), *law_warnings(logged, found))
        doubtful = bool(wrong) or beyond_range(fit.signals, fit.model.robot)
    found = judged_model(found, judgement)
    if doubtful:  # of channels that are of others, in other units or turned round no value is left as it was
        doubted = tuple(replace(item, bias_possible=True) for item in found.parameters)
        found = replace(found, parameters=doubted, warnings=(*found.warnings, *wrong))
    if options.fit == "trajectory":
        from elid_cli.estimation.trajectory.identification import by_trajectory

        return by_trajectory(replace(found, robot=described), logged, delays=options.delays)
    if options.accurate:
        answer = _accurate(fit, found, options, refused, judgement)
        return _as_described(answer, robot, pose, late) if answer.estimator == "accurate" else answer
    if options.chooses and signals.recording is not None and signals.recording.commanded.all():
        from elid_cli.estimation.trajectory.unasked import or_by_motion

        answer = or_by_motion(replace(found, robot=described), logged, delays=options.delays)
        if answer.estimator == "trajectory":
            return answer
        found = replace(answer, robot=found.robot)
    return found if robot is plain else replace(found, robot=plain)


def identify_logs(
    request: LogRequest, options: EstimateOptions | None = None, *, keep_signals: bool = False
) -> Identified:
    """Identify from logs and triangle files, in any mixture: the one door of Python and the command line.

    Several logs, and triangle files, are reduced one by one and merged; what needs all samples at once
    (`samples_needed`) is read together.

    Parameters
    ----------
    request
        The logs and how to read them.
    options
        How to estimate.
    keep_signals
        Whether the signals of a long log are wanted afterwards, for figures.

    Raises
    ------
    LogError
        A log that cannot be used.
    UsageError
        A triangle file where the samples are needed, logs that do not belong together, or an argument of another kind.
    DataError
        If the logs excite no parameter at all.
    """
    check_kind("request", request, LogRequest, "LogRequest([LOG], robot)")
    options = estimate_options("identify_logs", options, request.robot)
    if any(joint.transmission == "auto" for joint in request.robot.joints):
        from elid_cli.logs import robot_as_logged

        request = replace(request, robot=robot_as_logged(request.robot, request.logs, request.mapping))
    if _merges(request, options):
        from elid_cli.estimation.motor_side.several import motor_side_of_logs
        from elid_cli.estimation.streaming.alike import told_alike
        from elid_cli.estimation.streaming.fleet import reduced_logs
        from elid_cli.estimation.streaming.merge import identify_reduced, joined_recording
        from elid_cli.estimation.trajectory.several import by_motion, moved_unasked

        request, logs, said = told_alike(request, reduced_logs(request))
        moving = all(log.facts.computed.all() for log in logs) and moved_unasked(request.robot, logs, options)
        asked = replace(options, fit="torque") if moving else options
        found, apart = identify_reduced(request.robot, logs, asked)  # refuses logs that do not belong together
        found = replace(found, notes=(*found.notes, *said))
        computed = np.all([log.facts.computed & ~log.facts.still for log in logs], axis=0)
        if moving:
            answer, recording, apart, signals = by_motion(request, found, apart, delays=options.delays)
            return Identified(with_load(answer, computed), recording, apart, signals)
        side = motor_side_of_logs(request, logs) if asks(options) else None
        return Identified(with_motor_side(with_load(found, computed), side), joined_recording(logs), apart, None)
    recording, signals = read_signals(request)
    signals = as_told(request.robot, signals)
    recording = signals.recording or recording
    if is_long(signals, request.robot) and not samples_needed(request.robot, options):
        from elid_cli.estimation.streaming.merge import identify_reduced
        from elid_cli.estimation.streaming.reduce import asked_of, reduce_each
        from elid_cli.estimation.streaming.reduced_log import without_positions

        side = asked_motor_side(request.robot, signals, options)
        if not keep_signals:
            recording = without_positions(recording)
            signals = replace(signals, recording=recording)
        logs = reduce_each(request.robot, signals, asked_of(request.signals), request.progress)
        found, _ = identify_reduced(request.robot, logs, options)
        found = with_motor_side(with_load(found, logs[0].facts.computed & ~logs[0].facts.still), side)
        return Identified(found, logs[0].recording, (), signals if keep_signals else None)
    from elid_cli.estimation.refined_robot import identified_robot

    found = identify(request.robot, signals, options)
    apart = errors_by_log(identified_robot(found), signals, recording.files)
    return Identified(found, recording, apart, signals)


def _merges(request: LogRequest, options: EstimateOptions) -> bool:
    """Return whether these logs are reduced one by one and merged: several of them, or triangle files among them.

    Raises
    ------
    UsageError
        A triangle file where the samples are needed.
    """
    from elid_cli.estimation.streaming.stored import is_triangle_file

    reason = samples_needed(request.robot, options)
    stored = [log for log in request.logs if is_triangle_file(log)]
    if stored and reason:
        raise UsageError(f"{stored[0]}: a reduced log does not suffice", detail=reason, hint="name the logs themselves")
    return not reason and (len(request.logs) > 1 or bool(stored))


def _as_described(found: Identification, robot: Robot, pose: Pose, late: Shifts) -> Identification:
    """Return the identification as one of the robot as described: what turns its model or is late as effects."""
    if not pose and not late:
        return found

    def whole(effect: FittedEffect) -> FittedEffect:
        kind, joint = resolve(robot, EffectSpec(effect.effect, effect.joint, {}))
        return replace(effect, parameters=late.whole(kind, joint, pose.whole(kind, joint, effect.parameters)))

    return replace(found, robot=robot, effects=tuple(map(whole, found.effects)))


def _accurate(
    fit: DefaultFit,
    found: Identification,
    options: EstimateOptions,
    refused: Mapping[str, str],
    judgement: Judgement | None,
) -> Identification:
    """Return the collocation's answer where it is accepted, else the default one with the reason."""
    from elid_cli.estimation.collocation.estimator import Refusal, collocate

    if fit.samples.rows_of_sensors():
        note = "--accurate: the default estimate stands: the collocation does not use the joint torque sensors"
        return replace(found, notes=(*found.notes, note))
    told = len(fit.nuisances)
    fit = with_delays(fit, options)
    answer = collocate(fit)
    if isinstance(answer, Refusal):
        note = f"--accurate: the default estimate stands: {answer.reason}"
        return replace(found, notes=(*found.notes, note))
    solution = replace(fit.solution, values=answer.values)
    # held-out stretches are judged with the columns of the shapes that were found
    own = fit if answer.effects is None else reshaped(fit, answer.effects)
    effects = replace(own.effects, others=answer.others) if own.effects else None
    better = replace(own, effects=effects, solution=solution, covariance=answer.covariance, pull=None)
    note = f"--accurate: spline collocation, {answer.steps} steps, knots every {answer.knots * 1e3:.0f} ms"
    if answer.widened > 1.05:
        note += f", standard errors widened by {answer.widened:.2g}"
    # the residual of the default fit's rows says of the model what it says of this one's
    better = with_scatter(better, judgement)
    result = judged_model(assemble(better, options, refused, before=own), judgement)
    worst, label = _worsening(found, result)
    if worst > (NO_WORSE if answer.far else WORSE):
        moved = f"{answer.far} and " if answer.far else ""
        note = (
            f"--accurate: the default estimate stands: {moved}held-out torque of {label} is predicted "
            f"{worst:.3g} times as badly"
        )
        return replace(found, notes=(*found.notes, note))
    every = [(n, *better.nuisance(k)) for k, n in enumerate(result.nuisances)]
    beyond = [abs(value) > SIGNIFICANT * deviation for _, value, deviation in every]
    late = any(sure and nuisance_of(n.effect) == "delay" for (n, _, _), sure in zip(every, beyond, strict=True))
    firm = [
        n for k, (n, _, _) in enumerate(every) if k < told or beyond[k] or (late and nuisance_of(n.effect) == "delay")
    ]
    return replace(
        result, nuisances=tuple(firm), estimator="accurate", notes=(*result.notes, note), warnings=found.warnings
    )


def _worsening(before: Identification, after: Identification) -> tuple[float, str]:
    """Return the largest ratio of held-out errors after and before over all joints' rows, and the joint's name."""
    ratios = []
    for name, error in after.error.items():
        other = before.error[name]
        for now, then in ((error.rms, other.rms), (error.spring_rms, other.spring_rms)):
            if now is not None and then:
                ratios.append((now / then, name))
    return max(ratios, default=(0.0, ""))
