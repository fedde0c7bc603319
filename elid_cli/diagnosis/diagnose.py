"""The door of diagnosis: by torque or by motion, as the log says; and the diagnosis by torque from log to findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from elid_cli._types import Progress
from elid_cli.checks import check_fields, flag, names, options_given, whole, word
from elid_cli.diagnosis.by_motion.able import by_motion
from elid_cli.diagnosis.evidence.driving_friction import impossible_with
from elid_cli.diagnosis.evidence.held_out import held_out_gain, still_helping
from elid_cli.diagnosis.evidence.leftover import only_helps, silences
from elid_cli.diagnosis.evidence.moments import friction_at_rest, one_of_many
from elid_cli.diagnosis.evidence.quarters import Survival, judged
from elid_cli.diagnosis.evidence.usual_cutoff import helpful_there
from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.quieter_log import AGAIN, quieter
from elid_cli.diagnosis.fit.state import State, fit
from elid_cli.diagnosis.held_below import held_below, where_declared_hold
from elid_cli.diagnosis.lower_cutoff import looked_closer, names_of
from elid_cli.diagnosis.result import Diagnosis
from elid_cli.diagnosis.search.absorbed import with_absorbed
from elid_cli.diagnosis.search.at_all_joints import at_all_joints
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.channel_faults import with_channel_faults
from elid_cli.diagnosis.search.event_times import retimed
from elid_cli.diagnosis.search.forward import beside, search, with_refined_shapes
from elid_cli.diagnosis.search.friction_curves import with_whole_curves
from elid_cli.diagnosis.search.one_for_two import with_one_for_two
from elid_cli.diagnosis.search.other_forms import other_forms, with_usual_forms
from elid_cli.diagnosis.search.rounded_friction import with_rounding_that_fits
from elid_cli.diagnosis.search.screening import sensible
from elid_cli.diagnosis.search.steps import Found, dropped
from elid_cli.diagnosis.search.ties import by_known_values
from elid_cli.diagnosis.summary import result
from elid_cli.diagnosis.unexplained import HELD_OUT
from elid_cli.errors import UsageError, check_word
from elid_cli.estimation.motor_side.hidden import hidden_joints
from elid_cli.estimation.regression.observation import observe
from elid_cli.estimation.smooth_commands import as_told
from elid_cli.estimation.stretches import search_folds
from elid_cli.model.base_parameters import find_base
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.declared import as_observed
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.posed import declared_pose
from elid_cli.model.effects.shifts import corrected, declared_shifts
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.fitting_robot import check_joints
from elid_cli.signals.repeating import repeats_every
from elid_cli.signals.signals import Signals, prepare

if TYPE_CHECKING:
    from elid_cli.diagnosis.by_motion.result import MotionDiagnosis


ENOUGH = 0.5
"""Part of what was unexplained, in times the noise, to which an effect on other stretches must bring it down."""
HARM = 0.01
"""Part of the held-out error by which a limit of the torque may make it larger."""


# keywords, as an effect has the name of a field, and no file but its own names an effect
_RULES = dict(lookup=flag, only=names, accurate=flag, jobs=whole(1), by=word("auto", "torque", "motion"))


@dataclass(frozen=True)
class DiagnoseOptions:
    """How to diagnose."""

    lookup: bool = False
    """Add a smooth curve over the best variable where structure remains that no named effect explains."""
    only: tuple[str, ...] = ()
    """Names of effects to try; empty: all."""
    accurate: bool = False
    """Complete friction curves by collocation however long it takes; else only where it is quick."""
    jobs: int = 1
    """Processes that try effects side by side; the findings are the same, byte by byte, for any number."""
    by: Literal["auto", "torque", "motion"] = "auto"
    """What judges an effect: the torque of the rows, or the motion simulated under logged commands. ``auto``: motion
    where the log is one of commands without torque and `by_motion` can judge it, and no curve is asked for. `accurate`
    and `jobs` are of the search by torque alone."""

    def __post_init__(self) -> None:
        """Refuse words that say nothing, and names of no effect (UsageError)."""
        check_fields(self, _RULES)
        for name in self.only:
            check_word("DiagnoseOptions: only", name, tuple(effect_classes()))


def divided(robot: Robot, signals: Signals, *, others: bool = False) -> Log:
    """Return a log with its stretches divided into training folds and held-out ones; `others`: than the usual ones."""
    pose = declared_pose(robot)
    model = Regressor(pose.robot(robot))
    shifts = declared_shifts(model.robot)
    moved_signals = corrected(signals, shifts)
    observation = observe(model, moved_signals)
    return Log(
        model=model,
        base=find_base(model),
        signals=moved_signals,
        observation=observation,
        fold=search_folds(observation.instants, others=others),
        others=others,
        raw=signals,
        shifts=shifts,
        seen=shifts,
        level=robot,
        pose=pose,
    )


def as_usual(robot: Robot, signals: Signals) -> Signals:
    """Return a log as identification takes it; as it is where the recording behind it is not at hand."""
    return signals if signals.recording is None else prepare(signals.recording, replace(robot, effects=()))


def _check_only(robot: Robot, names: Sequence[str]) -> None:
    """Refuse an effect to search for that can act at no joint: finding nothing would say that the model suffices."""
    for name in names:
        reasons = [effect_classes()[name].unfit(robot, joint) for joint in range(robot.n)]
        if all(reasons):
            told = "; ".join(dict.fromkeys(reasons))
            raise UsageError(f"--only: {name} applies to no joint of {robot.name!r} in this log", detail=told)


def diagnose(
    robot: Robot,
    signals: Signals,
    options: DiagnoseOptions | None = None,
    progress: Progress | None = None,
    usual: Signals | None = None,
) -> Diagnosis | MotionDiagnosis:
    """Find the effects that a robot's model lacks, as the log and the options say: by torque, or by motion.

    Parameters
    ----------
    robot
        The robot; its declared effects are part of the model before.
    signals
        The log.
    options
        See `DiagnoseOptions`.
    progress
        Called with a label and the finished part, 0 to 1.
    usual
        The log as identification takes it, at whose cut-off effects are judged as well; None: prepared from the
        recording with the usual options.

    Returns
    -------
    A `MotionDiagnosis` where the motion judged, as `diagnose_motion` does; else a `Diagnosis`.

    Raises
    ------
    UsageError
        An effect that can act at no joint, or a motion that cannot judge this log.
    """
    check_joints(signals.joints, robot)
    options, signals = options_given("diagnose", options, DiagnoseOptions), as_told(robot, signals)
    able = options.by != "torque" and signals.recording is not None and by_motion(robot, signals.recording)
    if options.by == "motion" and not able:
        raise UsageError("the motion cannot judge this log", detail="it must hold commands, of a robot of known bodies")
    if able and (options.by == "motion" or not options.lookup):
        from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion

        return diagnose_motion(robot, signals, None, options.only, progress)
    return diagnose_torque(robot, signals, options, progress, usual)


def diagnose_torque(
    robot: Robot,
    signals: Signals,
    options: DiagnoseOptions | None = None,
    progress: Progress | None = None,
    usual: Signals | None = None,
) -> Diagnosis:
    """Find the effects that a robot's model lacks in the residual of its torques.

    Parameters
    ----------
    robot
        The robot; its declared effects are part of the model before.
    signals
        The log.
    options
        See `DiagnoseOptions`.
    progress
        Called with a label and the finished part, 0 to 1.
    usual
        See `diagnose`.

    Ctrl-C during the search ends it: the diagnosis is `partial` then and holds what was found so far.

    Where nothing is found at the log's cut-off, or identification sees more than noise at a lower one, effects are
    looked for there as well (`looked_closer`). Where something happened on held-out stretches alone, they are looked
    for once more with others held out.
    """
    chosen = options_given("diagnose", options, DiagnoseOptions)
    signals = where_declared_hold(robot, signals)
    told = _by_torque(robot, signals, chosen, progress, usual)
    if not told.partial and any(item.variable == HELD_OUT for item in told.unexplained):
        seen = _by_torque(robot, signals, chosen, progress, usual, others=True)
        left, before = (max((item.ratio for item in one.unexplained), default=0.0) for one in (seen, told))
        if left < ENOUGH * before and names_of(told) < names_of(seen):
            told = seen
    told = looked_closer(told, signals, lambda lower: _by_torque(robot, lower, chosen, progress, usual))

    def below(lower: Signals, only: tuple[str, ...]) -> Diagnosis:
        return _by_torque(robot, lower, replace(chosen, only=only or chosen.only), progress, lower)

    return held_below(told, signals, below, chosen.only)


def _by_torque(
    robot: Robot, signals: Signals, options: DiagnoseOptions, progress: Progress | None, usual: Signals | None,
    *, others: bool = False,
) -> Diagnosis:  # fmt: skip
    yielding = (
        ()
        if signals.recording is None
        else tuple(robot.joint_names[k] for k in hidden_joints(robot, signals.recording))
    )
    robot = as_observed(robot, signals)
    _check_only(robot, options.only)
    log = divided(robot, signals, others=others)
    library = {
        name: kind
        for name, kind in effect_classes().items()
        if kind.searched and kind.nuisance != "offset" and (not options.only or name in options.only)
    }
    declared = log.declared
    log, searched = _searched(log, declared, library, progress, options.jobs)
    if not searched.partial:
        searched = at_all_joints(searched, len(declared) + searched.kept)
    if searched.partial and progress is not None:
        progress("finishing; Ctrl-C again stops at once", 0.0)
    searched = with_rounding_that_fits(retimed(searched, len(declared)), len(declared))
    found, refuted = _surviving(searched, len(declared))
    known, survived = len(declared) + found.kept, found.after
    if not found.partial:
        found = with_one_for_two(found, known, library)
        found, harmful = helpful_there(found, known, lambda: usual or as_usual(robot, signals))
        refuted = (*refuted, *harmful)
        found = with_absorbed(found, library)
    found = by_known_values(found, known)
    found = with_channel_faults(found, options.only or effect_classes())
    found = still_helping(found, known, survived)
    if not found.partial:
        try:
            found = with_whole_curves(found, known, progress, asked=options.accurate)
        except KeyboardInterrupt:
            found = replace(found, partial=True)
    found = with_usual_forms(found, known)
    forms = other_forms(found, known)
    named, curves = found.after, list[Effect]()
    if options.lookup and not found.partial:
        found, curves = _with_curves(found)
    told = result(robot, log, found, known, curves, named, forms)
    return replace(told, refuted=refuted, repeats=repeats_every(log.signals), usual=usual, yielding=yielding)


def _searched(
    log: Log, declared: list[Effect], library: Mapping[str, type[Effect]], progress: Progress | None, jobs: int
) -> tuple[Log, Found]:
    """Search a log; where its torques' noise is far too large, with what is left in its place."""
    quiet = quieter(fit(log, declared))
    found = search(quiet, declared, library, progress, jobs)
    if quiet is log or found.partial:
        return quiet, found
    still = quieter(found.after, AGAIN)
    if still is found.after.log:
        return quiet, found
    quiet = quiet.with_noise(still.signals.noise.tau)
    return quiet, search(quiet, declared, library, progress, jobs)


def _surviving(found: Found, declared: int) -> tuple[Found, tuple[Survival, ...]]:
    """Drop effects that held-out stretches do not support or that some quarter of the log, left out, refutes."""
    refuted: list[Survival] = []
    while True:
        known = declared + found.kept
        found, failed = judged(_supported(found, known), known)
        if failed is None:
            return found, tuple(refuted)
        refuted.append(failed)


def _supported(found: Found, declared: int) -> Found:
    """Drop effects that held-out stretches do not support, that only help, or whose values others have made impossible.

    Those that help least go first, and what is left is judged anew. What is dropped may still be the nearest to what
    is missing.
    """
    state, steps, gone = found.after, list(found.steps), list[Candidate]()
    while True:
        gains = [_unsupported(state, declared + k, step.candidate.effect) for k, step in enumerate(steps)]
        failing = [(gain, k) for k, gain in enumerate(gains) if gain is not None]
        if not failing:
            return replace(found, after=state, steps=tuple(steps), remaining=(*gone, *found.remaining))
        worst = min(failing)[1]
        gone.append(steps[worst].candidate)
        beside_it = any(e.shape and e.joint == gone[-1].effect.joint for e in state.effects[declared:])
        state, steps = dropped(state, steps, declared, worst)
        if beside_it:  # what has gone had bent the others' shapes
            state = with_refined_shapes(state, declared)
        steps = [beside(left, gone[-1]) for left in steps]


def _unsupported(state: State, number: int, tried: Effect) -> float | None:
    """Return an effect's gain on the held-out stretches, 0 where it is impossible, or None where it is supported.

    What acts for a moment need not show in the held-out stretches, but it must stand out from all other moments, and
    not be a motor's sticking; a limit of the torque, which acts at every peak, must not spoil them.
    """
    if not sensible(state.effects[number], state.scene, state.named(number)) or impossible_with(state, number):
        return 0.0
    if tried.local:
        unlike = one_of_many(state, number) or friction_at_rest(state, number) or only_helps(state, number, 0.0)
        spoils = tried.of_drive == "limit" and held_out_gain(state, number) < -HARM
        return 0.0 if unlike or spoils else None
    gain = held_out_gain(state, number)
    poor = gain < tried.least_gain or only_helps(state, number, gain) or silences(state, number)
    return gain if poor else None


def _with_curves(found: Found) -> tuple[Found, list[Effect]]:
    """Add smooth curves over what the remaining residual follows most, as long as held-out stretches support them."""
    from elid_cli.diagnosis.search.smooth_curves import MOST, best_curve

    curves: list[Effect] = []
    while len(curves) < MOST:
        curve = best_curve(found.after)
        if curve is None:
            break
        grown = fit(found.after.log, (*found.after.effects, curve), found.after.scene)
        if held_out_gain(grown, len(grown.effects) - 1) <= 0:
            break
        found = replace(found, after=grown)
        curves.append(curve)
    return found, curves
