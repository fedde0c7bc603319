"""Diagnosis of logs that hold commands, from the log to what is said of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from elid_cli._types import Array, Progress
from elid_cli.checks import names
from elid_cli.diagnosis.by_motion.candidates import View, tried_of, untried_of
from elid_cli.diagnosis.by_motion.carried import may_carry
from elid_cli.diagnosis.by_motion.each_alone import beyond, each_alone
from elid_cli.diagnosis.by_motion.effects_of_fit import effects_of_fit
from elid_cli.diagnosis.by_motion.free_bodies import with_free_bodies
from elid_cli.diagnosis.by_motion.other_forms import Forms, other_forms
from elid_cli.diagnosis.by_motion.poses import effects_of
from elid_cli.diagnosis.by_motion.raised_limits import raised_limits
from elid_cli.diagnosis.by_motion.result import MotionDiagnosis, PositionBeforeAfter
from elid_cli.diagnosis.by_motion.search import ALIKE
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.diagnosis.by_motion.timed_again import timed_again
from elid_cli.diagnosis.by_motion.told_again import told_otherwise
from elid_cli.diagnosis.by_motion.torque_gains import CHECK, found_gains, gain_rivals
from elid_cli.diagnosis.by_motion.torque_limits import with_limits
from elid_cli.diagnosis.by_motion.views import views_of
from elid_cli.diagnosis.by_motion.whole_robot import searched
from elid_cli.diagnosis.result import FoundEffect, Rival, Unexplained
from elid_cli.errors import UsageError, in_words
from elid_cli.estimation.identify import identify
from elid_cli.estimation.known_load import off_scales, scale_warnings
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.result import EstimateOptions, FittedEffect, Identification
from elid_cli.estimation.smooth_commands import as_told
from elid_cli.estimation.trajectory.at_noise import NOISE
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.block_sums import BLOCKS
from elid_cli.estimation.trajectory.bodies import other_bodies
from elid_cli.estimation.trajectory.changes import nearer_by
from elid_cli.estimation.trajectory.differing import as_last, differing
from elid_cli.estimation.trajectory.fit import ABOVE, TrajectoryFit
from elid_cli.estimation.trajectory.found_effects import scene_of_fit
from elid_cli.estimation.trajectory.identification import commanded_runs, declared_along, identification_of
from elid_cli.estimation.trajectory.late_joints import believed
from elid_cli.estimation.trajectory.simulator_steps import is_timed, runs_in_time
from elid_cli.estimation.trajectory.softening import columns_of
from elid_cli.estimation.trajectory.timing_doubts import as_doubtful, counting
from elid_cli.model.effects import effect_classes, effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.of_drives import as_acting, with_drives, with_filters, with_loop_gains
from elid_cli.model.effects.posed import posed
from elid_cli.model.effects.scene import Scene
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals, check_signals

BINS = 16
ONE_CURVE = 0.98
"""Part of an effect's torque that other first moments of the links would make as well, from which both are named."""
AT_NOISE, AS_LITTLE = 1.2, 4.0
"""Times the encoders' noise up to which effects explain all, and times the squared error that they leave which other
bodies may leave then."""
LIKE = 0.5
"""Part of what effects take off a joint's squared error that other bodies must take for a word."""
MOMENTS = ("cx", "cy", "cz")
MOMENT = "first_moment"
"""What other masses of bodies are called among rivals."""


def least_squares(robot: Robot, signals: Signals) -> Identification:
    """Return what least squares say of a robot without effects: where a trajectory fit starts."""
    plain = identify(replace(robot, effects=()), signals, EstimateOptions(fit="torque", guards=False))
    return replace(plain, robot=robot)


def diagnose_motion(
    robot: Robot,
    signals: Signals,
    found: Identification | None = None,
    only: Sequence[str] = (),
    progress: Progress | None = None,
) -> MotionDiagnosis:
    """Find the effects that a robot's motion under its commands lacks.

    Parameters
    ----------
    robot
        The robot; its bodies' parameters must be known.
    signals
        One log or several, read together.
    found
        What least squares say of them; None: see `least_squares`.
    only
        Names of the effects to try; empty: all that a simulated motion can hold.
    progress
        Called with a label and the finished part, 0 to 1.

    Ctrl-C during the search ends it: the diagnosis is `partial` then.

    Raises
    ------
    UsageError
        None of the effects to try is one that a simulated motion is searched for.
    """
    check_signals(signals, robot)
    names("diagnose_motion: only", only)
    _check_only(robot, only)
    told = as_told(robot, signals)
    found, signals, recording = found if told is signals else None, told, told.recording
    assert recording is not None  # `by_motion` looked at it
    described, robot, acting = robot, posed(robot), as_acting(robot, signals)
    runs = commanded_runs(recording, robot)
    signals, found = acting, found if acting is signals and robot is described else None
    effects, amplitudes = declared_along(robot, runs[0])
    runs = believed(robot, runs, started_from(robot, signals), (effects, amplitudes))
    bare = runs
    runs, timed, first = runs_in_time(robot, signals, bare, started_from(robot, signals), (effects, amplitudes))
    higher = raised_limits(robot, signals, runs, (effects, amplitudes), first) if _may_raise(only) else None
    if higher is not None:
        robot, signals, runs, found = higher.robot, higher.signals, list(higher.runs), None
        bare = runs
    found = found or least_squares(robot, signals)
    off = off_scales(replace(found, robot=robot), recording.commanded & ~signals.still)
    whole = searched(robot, signals, runs, (effects, amplitudes), off, only, progress, first)
    otherwise = None if whole.done.partial else told_otherwise(told, runs, whole)
    if otherwise is not None:
        return diagnose_motion(described, otherwise, None, only, progress)
    if not whole.done.partial:
        other, judged = timed_again(signals, bare, runs, timed, whole)
        timed = timed if is_timed(timed, signals) else judged
        if any(run is not own for run, own in zip(other, runs, strict=True)):
            again = searched(robot, signals, other, (effects, amplitudes), off, only, progress)
            if not again.done.partial and nearer_by(again.done.after, whole.done.after) > 0:
                again = replace(again, done=replace(again.done, before=whole.done.before))
                whole, runs, timed = again, other, None
    if higher is not None and higher.before is not None:
        whole = replace(whole, done=replace(whole.done, before=higher.before))
    done = whole.done
    if timed is not None:
        done = replace(done, before=as_doubtful(done.before, timed), after=as_doubtful(done.after, timed))
    if progress is not None:
        finishing = "finishing; Ctrl-C again stops at once"
        progress(finishing if done.partial else "searching, judging what was found", 0.9)
    cut = {item.joint: item.limit for item in done.limits}
    bounded = {robot.joint_names[joint] for joint in cut}
    of_limits = () if higher is None else tuple(e for e in higher.effects if e.joint not in bounded)
    changes = differing(done.after)
    forms = Forms({}, ()) if done.partial else other_forms(done.after, done.named)
    after = as_last(counting(done.after, forms.shifts), changes)
    bound = np.array([cut.get(k, np.inf) for k in range(robot.n)])
    told = with_filters(with_loop_gains(signals, whole.loop_gains), whole.filters)
    told = with_drives(told, whole.rates, whole.acting)
    told = replace(told, tau=np.clip(told.tau, -bound, bound))
    refined = identification_of(replace(found, robot=with_limits(whole.written, cut)), after, told)
    of_changes = tuple(effect for change in whole.changes for effect in effects_of(change, done.before))
    of_gains = found_gains(robot, done.before, done.after, whole.taken, whole.scaled)
    of_drives = (*of_gains, *(effect for effect in of_changes if effect_classes()[effect.effect].of_drive))
    refined = replace(refined, effects=(*refined.effects, *(
        FittedEffect(e.effect, e.joint, e.parameters, e.std_error) for e in of_drives
    )))  # fmt: skip
    rivals = gain_rivals(whole.plain, done.after, whole.gains, done.named)
    # at a joint whose effect no gain imitates, the effect is why the torque is not what the bodies need
    ruled_out = {robot.joint_names[item.effect.joint] for item in done.named} - {rival.joint for rival in rivals}
    ruled_out |= set(robot.joint_names) if whole.changes else set()
    ruled_out |= {effect.joint or "" for effect in of_limits}
    ruled_out |= {robot.joint_names[joint] for joint in (*cut, *np.flatnonzero(whole.scaled).tolist())}
    scales = [scale for scale in off if robot.joint_names[scale.joint] not in ruled_out]
    refined = replace(refined, warnings=(*refined.warnings, *scale_warnings(robot, scales)))
    alone = each_alone(robot, runs, signals, whole)
    if (after.above_noise(told) >= NOISE).any():
        refined = replace(refined, model="insufficient")
    views, positions = views_of(done.after), _positions(robot, done.before, done.after)
    return MotionDiagnosis(
        described, recording,
        identification_of(found, done.before, signals), refined, done.before, after,
        (*of_limits, *of_changes, *of_gains, *effects_of_fit(described, after, done, len(effects), forms)),
        (*_rivals(robot, done.named, scene_of_fit(after)), *rivals,
         *(r for r in whole.rivals if (r.effect, r.joint) not in {(e.effect, e.joint) for e in of_changes}),
         *_bodies_for(of_gains, done.before)),
        _unexplained(robot, after, views, told),
        positions, (*changes, *beyond(changes, alone, whole)), identified_robot(refined),
        done.tried, told, done.partial,
        tuple((item.effect.name, robot.joint_names[item.effect.joint]) for item in done.waiting),
        tuple(name for name in untried_of(effect_classes(), robot, only) if name not in {e.effect for e in of_changes}),
        _bodies_beside(whole.plain, positions, after.above_noise(told)),
        None if done.partial or only else with_free_bodies(
            robot, found, runs, signals, [done.after, *([whole.gains.fit] if whole.gains and robot.n > 1 else [])]
        ),
        alone,
    )  # fmt: skip


def _may_raise(only: Sequence[str]) -> bool:
    return not only or effect_that(of_drive="limit").name in only


def _bodies_beside(
    plain: TrajectoryFit, positions: Mapping[str, PositionBeforeAfter], above: Array
) -> dict[str, float]:
    """Return what other bodies take off joints' squared error where that is most of what effects found take, or all.

    Parameters
    ----------
    plain
        The fit without the effects.
    positions
        Errors of the joints without and with the effects.
    above
        The latter in times the encoders' noise, (n,): where all that is left is noise, bodies must leave as little.
    """
    asked = other_bodies(plain, columns_of(plain))
    takes = {name: 1.0 - (item.after / item.before) ** 2 for name, item in positions.items()}
    if (above < AT_NOISE).all():
        return {name: part for name, part in asked.items() if 1.0 - part < AS_LITTLE * (1.0 - takes[name])}
    return {name: part for name, part in asked.items() if part >= LIKE * takes[name]}


def _bodies_for(gains: Sequence[FoundEffect], before: TrajectoryFit) -> tuple[Rival, ...]:
    """Return other bodies as rivals of gains, where they bring a joint's motion as near."""
    asked = other_bodies(before, columns_of(before)) if gains else {}
    return tuple(
        Rival(MOMENT, e.joint, e.effect, asked[e.joint], {}, CHECK)
        for e in gains if e.joint is not None and asked.get(e.joint, 0.0) > ALIKE * e.gain
    )  # fmt: skip


def _check_only(robot: Robot, only: Sequence[str]) -> None:
    """Refuse to try nothing: that nothing is found would say that the model suffices."""
    library = effect_classes()
    load = may_carry(robot) and effect_that(carried=True).name in only
    if only and not load and not tried_of(library, only):
        listed = ", ".join(sorted(kind.name for kind in tried_of(library, ())))
        raise UsageError(
            f"--only: the simulated motion, which judges this log, is not searched for {in_words(list(only))}",
            detail=f"it is searched for {listed}",
            hint="--lookup judges by the computed torque, which is searched for all effects",
        )


def _rivals(robot: Robot, named: Sequence[Named], scene: Scene) -> tuple[Rival, ...]:
    found: dict[tuple[str, str], Rival] = {}
    taken = {(item.effect.name, item.effect.joint) for item in named}
    for item in named:
        joint = robot.joint_names[item.effect.joint]
        for c in item.rivals:
            if (c.effect.name, c.effect.joint) not in taken:
                values = c.effect.named(scene, c.amplitudes)
                rival = Rival(c.effect.name, joint, item.effect.name, c.gain, values, c.effect.record)
                found.setdefault((c.effect.name, joint), rival)
        if item.effect.place == "link" and _as_moments(robot, item.effect, scene) > ONE_CURVE:
            separate = "the joint's full range, with and without a known payload"
            found.setdefault((MOMENT, joint), Rival(MOMENT, joint, item.effect.name, item.gain, {}, separate))
    return tuple(found.values())


def _as_moments(robot: Robot, effect: Effect, scene: Scene) -> float:
    """Return the part of an effect's torque that other first moments of the links would make as well."""
    from elid_cli.model.effects.scene import EquationRow

    model = Regressor(replace(robot, effects=()))
    still = np.zeros_like(scene.motion.q)
    rest = replace(scene.motion, dq=still, ddq=still, dtheta=still, ddtheta=still)
    item = next(i for i in model.estimation.rows if i.row.joint == effect.joint and i.row.kind == "sum")
    rows = model.rows(rest)[item.row]
    moments = [k for k, column in enumerate(item.columns) if model.names[column].kind in MOMENTS]
    column = effect.columns(scene)[EquationRow("link", effect.joint)][0]
    curves = np.concatenate([rows[moments], np.ones((1, scene.samples))])
    step = np.linalg.lstsq(curves.T, column, rcond=1e-10)[0]
    spread = float(np.var(column))
    return 1.0 - float(np.var(column - step @ curves)) / spread if spread > 0 else 0.0


def _positions(robot: Robot, before: TrajectoryFit, after: TrajectoryFit) -> Mapping[str, PositionBeforeAfter]:
    """Return the rms error of every joint, rad (m), in blocks that the values were not fitted to."""
    first, last = _held_out(before), _held_out(after)
    return {name: PositionBeforeAfter(float(first[k]), float(last[k])) for k, name in enumerate(robot.joint_names)}


def _held_out(fit: TrajectoryFit) -> Array:
    squares, count, place = np.zeros(fit.unknowns.robot.n), 0, 0
    for view in views_of(fit):
        use = view.weight.max(axis=1) > 0
        edges = np.linspace(0, len(view.error), BLOCKS + 1).astype(int)
        for a, b in pairwise(edges):
            weight = np.maximum(view.weight[a:b], 1e-300)
            error = (view.error[a:b] + view.columns[a:b] @ (fit.left_out[place] - fit.z)) / weight
            squares += np.sum(error[use[a:b]] ** 2, axis=0)
            count += int(np.count_nonzero(use[a:b]))
            place += 1
    found: Array = np.sqrt(squares / max(count, 1))
    return found


def _unexplained(robot: Robot, fit: TrajectoryFit, views: Sequence[View], signals: Signals) -> tuple[Unexplained, ...]:
    """Return the joints whose simulated position is off by more than the encoder's noise, and what that follows."""
    ratios = fit.above_noise(signals)
    found = []
    for k, name in enumerate(robot.joint_names):
        rms, ratio = float(fit.settled_rms[k]), float(ratios[k])
        if ratio < ABOVE:
            continue
        error = np.concatenate([view.error[:, k] for view in views])
        shares = {
            "theta": _follows(error, np.concatenate([view.scene.motion.theta[:, k] for view in views])),
            "dtheta": _follows(error, np.concatenate([view.scene.motion.dtheta[:, k] for view in views])),
            "t": _follows(error, np.concatenate([view.scene.motion.t for view in views])),
        }
        variable = max(shares, key=lambda v: shares[v])
        found.append(Unexplained(name, "sum", variable, shares[variable], rms, ratio, ()))
    return tuple(found)


def _follows(error: Array, variable: Array) -> float:
    """Return the part of an error's variance that a curve over a variable explains."""
    edges = np.quantile(variable, np.linspace(0, 1, BINS + 1)[1:-1])
    group = np.digitize(variable, edges)
    total = float(np.var(error))
    counts = np.bincount(group, minlength=BINS)
    means = np.bincount(group, weights=error, minlength=BINS) / np.maximum(counts, 1)
    between = float(np.sum(counts * (means - error.mean()) ** 2) / len(error))
    return between / total if total > 0 else 0.0
