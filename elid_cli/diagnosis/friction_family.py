"""Which member of the published family of servo friction models a log supports (M1 to M6).

Every member is fitted to the stretches that a search may see, all base parameters with it. Joint by joint, a larger
member is taken in place of a smaller one where it predicts folds that it was not fitted to better, beyond the scatter
between folds, and bears that out on the held-out stretches. Motor torque and load in its columns are the model's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import stdtrit

from elid_cli._types import Array, Progress
from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.state import State, fit
from elid_cli.diagnosis.friction_shapes import (
    agreed,
    family,
    in_other_form,
    polished,
    scene_of_fit,
    settled_at,
    standard_of,
)
from elid_cli.diagnosis.summary import channel_specs
from elid_cli.errors import DataError, UsageError
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.regression.other_shapes import REACH
from elid_cli.estimation.regression.triangles import full_columns
from elid_cli.estimation.stretches import STRETCHES, spans, stretch_of
from elid_cli.model.effects.declared import as_observed
from elid_cli.model.effects.effect import Effect, Member
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals
from elid_cli.tables import Shown

PLAIN = "M1"
"""The member that every joint has: Coulomb and viscous friction."""
LEAST = 0.03
"""Part of the squared error of unseen torque that a larger member has to take away: below it, what the smoothing of the
motion leaves imitates anything."""
FEWEST = 3
"""Folds that have to say something."""
CERTAIN = 0.975
"""Probability that the gain is one, by Student's t over the folds."""
FRICTION = ("fs", "fv")
"""Coulomb and viscous friction among a joint's parameters."""
TURNS = 2
"""Times that every joint's members are compared, the second time beside the friction of all others."""
POOR = 2.0
"""Times what the sensors' noise would leave from which a member is not the whole of a joint's friction."""
SURE = 2.0
"""Standard errors by which Coulomb friction must be below 0 to be negative."""
MOVES = 1e-3
"""rad/s or m/s; a joint slower than that has no friction curve."""


@dataclass(frozen=True)
class MemberFit:
    """One member at one joint."""

    member: str
    error: JointError
    """On the held-out stretches."""
    folds: Array
    """Mean squared error of every fold, predicted by a fit to the others, (N·m)² (N²), (6,)."""
    parameters: Mapping[str, float]
    """Of the effect that it is; empty for M1."""
    possible: bool = True
    """Whether no friction is negative."""


@dataclass(frozen=True, repr=False)
class FrictionFamily(Shown):
    """The members side by side, and those that the log supports."""

    robot: Robot
    """As described; what it declares is part of every member."""
    fits: Mapping[str, Mapping[str, MemberFit]]
    """Joint -> member -> fit."""
    supported: Mapping[str, str]
    """Joint -> member."""
    held_out: tuple[tuple[float, float], ...]
    """Stretches, s, that no fit saw."""
    refined: Robot
    """The robot with the supported members, fitted to the whole log."""
    std_error: Mapping[str, Mapping[str, float]]
    """Joint -> amplitude -> its standard error, in that fit."""
    plain: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    """Joint -> ``fs``, ``fv`` -> Coulomb and viscous friction beside the member, with standard errors, in that fit."""
    skipped: Mapping[str, str] = field(default_factory=dict)
    """Joints without a friction curve, with the reason."""

    @property
    def poor(self) -> Mapping[str, float]:
        """Joints at which the supported member leaves more than noise: its error over what noise would leave."""
        errors = {joint: fits[self.supported[joint]].error for joint, fits in self.fits.items()}
        return {joint: e.rms / e.floor for joint, e in errors.items() if e.floor and e.rms > POOR * e.floor}

    @property
    def members(self) -> Mapping[str, Member]:
        """The members by name, with their formulas."""
        return members_of(family())


def members_of(kind: type[Effect]) -> dict[str, Member]:
    """Return all members, the one that every joint has among them."""
    return {PLAIN: Member("Coulomb, viscous", "Kc + Kv |v|", 1.0), **kind.members}


def friction_family(robot: Robot, signals: Signals, progress: Progress | None = None) -> FrictionFamily:
    """Compare the members of the family on a log.

    Parameters
    ----------
    robot
        The robot; it may declare other effects.
    signals
        The log, as a diagnosis needs it (`SignalOptions.for_diagnosis`).
    progress
        Called with a label and the finished part, 0 to 1.

    Raises
    ------
    UsageError
        The robot file declares the family itself.
    DataError
        No joint has motor torque and moves.
    """
    kind = family()
    robot = as_observed(robot, signals)
    if any(spec.effect == kind.name for spec in robot.effects):
        raise UsageError(f"{robot.name}: declares {kind.name} itself", hint="leave it out: its members are compared")
    top, skipped = _tops(robot, signals, kind)
    if not top:
        raise DataError("no joint shows a friction curve", detail="; ".join(skipped.values()))
    log = divided(robot, signals)
    plain = _plain(log)
    fits: dict[str, dict[str, MemberFit]] = {}
    chosen: dict[str, Effect] = {}
    supported: dict[str, str] = {}
    # once more with the others' friction: without it the bodies' parameters, and so this joint's error, are bent
    turns = [*top] * (TURNS if len(top) > 1 else 1)
    for number, joint in enumerate(turns):
        if progress is not None:
            progress(f"comparing friction of {joint}", number / (len(turns) + 1))
        k = robot.joint_names.index(joint)
        beside = _beside(plain, [effect for name, effect in chosen.items() if name != joint])
        shaped = {name: settled_at(beside, k, member, top[joint]) for name, member in kind.members.items()}
        fits[joint] = {PLAIN: _judged(beside, k, PLAIN)} | {
            name: _judged(state, k, name, agrees=agrees) for name, (state, agrees) in shaped.items()
        }
        supported[joint] = _supported(list(fits[joint].values()))
        chosen.pop(joint, None)
        if supported[joint] != PLAIN:
            chosen[joint] = shaped[supported[joint]][0].effects[-1]
    if progress is not None:
        progress("fitting the whole log", len(turns) / (len(turns) + 1))
    speeds = {robot.joint_names.index(joint): speed for joint, speed in top.items()}
    refined, errors, own = _whole(log, (*plain.effects, *(chosen[joint] for joint in top if joint in chosen)), speeds)
    unseen = spans(log.observation.t, log.fold < 0)
    return FrictionFamily(robot, fits, supported, unseen, refined, errors, own, skipped)


def _beside(plain: State, others: Sequence[Effect]) -> State:
    """Return the plain model with the friction of other joints."""
    return agreed(fit(plain.log, (*plain.effects, *others), scene_of_fit(plain)))[0] if others else plain


def _tops(robot: Robot, signals: Signals, kind: type[Effect]) -> tuple[dict[str, float], dict[str, str]]:
    """Return the top speed of every joint with a friction curve, and why others have none."""
    top, skipped = {}, {}
    for k, joint in enumerate(robot.joints):
        speed = float(np.quantile(np.abs(signals.motion.dtheta[:, k]), 0.98))
        reason = kind.unfit(robot, k) or ("" if speed > MOVES else f"{joint.name} does not move")
        if reason:
            skipped[joint.name] = reason
        else:
            top[joint.name] = speed
    return top, skipped


def _plain(log: Log) -> State:
    """Return the model without the family, with the effects that the robot file declares."""
    return agreed(fit(log, log.declared))[0]


def _judged(state: State, joint: int, name: str, *, agrees: bool = True) -> MemberFit:
    """Return a fitted member with its errors on the folds and on the stretches that no fit saw."""
    row = EstimationRow("sum", joint)
    counts = np.array([sum(part.count for part in state.triangles.of(row, [f])) for f in range(STRETCHES)])
    folds = np.where(counts > 0, state.left_out[row] / np.maximum(counts, 1), np.nan)
    group = state.log.observation.group(row)
    index, columns = full_columns(group, state.extras, state.log.observation.parameters)
    unseen = group.use & (state.log.fold < 0)
    left = (group.target - state.solution.values[index] @ columns)[unseen]
    torque = float(np.sqrt(np.mean(state.log.observation.tau[joint][unseen] ** 2))) if unseen.any() else np.nan
    rms = float(np.sqrt(np.mean(left**2))) if unseen.any() else np.nan
    parameters = {} if name == PLAIN else state.named(len(state.effects) - 1)
    error = JointError(rms, rms / torque, None, None, torque, state.floor.rms[row])
    coulomb, uncertain = _coulomb_viscous(state, joint).get("fs", (0.0, 0.0))
    possible = agrees and _possible(parameters) and coulomb > -SURE * uncertain
    return MemberFit(name, error, folds, parameters, possible)


def _coulomb_viscous(state: State, joint: int) -> dict[str, tuple[float, float]]:
    """Return Coulomb and viscous friction of a joint with standard errors, where the log shows them."""
    values, errors, known = state.base_values(state.log.base)
    names, own = state.log.base.names, {kind: StandardParameter(kind, joint) for kind in FRICTION}
    places = {kind: names.index(name) for kind, name in own.items() if name in names}
    return {kind: (float(values[k]), float(errors[k])) for kind, k in places.items() if known[k]}


def _whole(
    log: Log, effects: Sequence[Effect], top: Mapping[int, float]
) -> tuple[Robot, dict[str, dict[str, float]], dict[str, dict[str, tuple[float, float]]]]:
    """Return the robot with effects, fitted to the whole log; by joint the family's errors, and plain friction."""
    state, _ = agreed(fit(replace(log, fold=stretch_of(log.observation.instants)), effects))
    state, others = polished(state, top)
    names = log.model.robot.joint_names
    own = {name.joint: dict[str, float]() for name in log.model.names}
    standard = standard_of(state, state.scene.rotors)
    for name, value in zip(log.model.names, standard.tolist(), strict=True):
        own[name.joint][name.kind] = float(value)
    joints = tuple(replace(joint, parameters=own[k]) for k, joint in enumerate(log.model.robot.joints))
    declared = log.model.robot.effects
    specs = state.specs
    channels = channel_specs(state)
    kept = [spec for spec in declared if spec.effect not in {item.effect for item in (*specs, *channels)}]
    errors = {names[e.joint]: _errors(state, k, others) for k, e in enumerate(state.effects) if e.members}
    plain = {names[k]: _coulomb_viscous(state, k) for k in top}
    return replace(log.model.robot, joints=joints, effects=(*kept, *specs, *channels)), errors, plain


def _errors(state: State, number: int, others: Mapping[int, Effect]) -> dict[str, float]:
    """Return the standard errors of an effect's amplitudes that are in the solution's basis, and of its free shapes.

    They reach to what another form of it, that explains the log about as well, makes of them.
    """
    covariance, shapes = state.covariance_with_shapes
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = dict(zip(state.solution.basis.tolist(), deviation.tolist(), strict=False))
    columns = range(*state.place(number).indices(len(state.solution.values)))
    effect = state.effects[number]
    names = (p.name for p in effect.amplitudes)
    errors = {name: known[column] for name, column in zip(names, columns, strict=True) if column in known}
    logarithms = {place: deviation[k] for (which, place), k in shapes.items() if which == number}
    errors |= {effect.shapes[k].name: effect.shape[k] * float(error) for k, error in logarithms.items()}
    if number not in others:
        return errors
    here, there = state.named(number), in_other_form(state, number, others[number]).named(number)
    return {name: float(np.hypot(error, (there[name] - here[name]) / REACH)) for name, error in errors.items()}


def _possible(parameters: Mapping[str, float]) -> bool:
    """Whether the friction that a member adds is none below zero: the part at no speed, that of the load, their sum."""
    motor, external = parameters.get("motor", 0.0), parameters.get("external", 0.0)
    return motor + external >= 0.0 and parameters.get("static", 0.0) >= 0.0


def _supported(fits: Sequence[MemberFit]) -> str:
    """Return the member that a joint's log supports, the simplest first in `fits`."""
    best = fits[0]
    for item in fits[1:]:
        if item.possible and better(best.folds, item.folds) and item.error.rms < best.error.rms:
            best = item
    return best.member


def better(before: Array, after: Array) -> bool:
    """Whether the squared errors of folds (f,) became smaller: on average by more than `LEAST`, and beyond scatter.

    Judged by their ratios, so that the fold with most friction does not speak alone.
    """
    known = (before > 0) & (after > 0)
    if np.count_nonzero(known) < FEWEST:
        return False
    gain = np.log(before[known] / after[known])
    scatter = float(gain.std(ddof=1)) / np.sqrt(len(gain))
    return bool(gain.mean() > max(-np.log1p(-LEAST), float(stdtrit(len(gain) - 1, CERTAIN)) * scatter))
