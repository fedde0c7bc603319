"""Diagnosis of a log: the missing effects, the error before and after, and what stays unexplained."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.base import find_base
from elid_cli.diagnosis.encoders import Skew
from elid_cli.diagnosis.quarters import Survival, judged
from elid_cli.diagnosis.screen import Candidate, sensible
from elid_cli.diagnosis.search import Found, Step, Term, beside, search, touched
from elid_cli.diagnosis.state import Log, State, fit, refreshed, without
from elid_cli.diagnosis.stretches import folds, spans
from elid_cli.diagnosis.triage import Organised, RowState, judged_rows, organise, rows_of, words
from elid_cli.diagnosis.whole_curves import with_whole_curves
from elid_cli.effects import declared_effects, scene_of
from elid_cli.estimate import JointError, Nuisance
from elid_cli.model import Model, Row
from elid_cli.observation import observe
from elid_cli.reduction import Triangles, reduce
from elid_cli.refined import refined_robot, representative
from elid_cli.robot import EffectSpec, Robot
from elid_cli.shifts import SKEW, corrected, declared_shifts
from elid_cli.signals import Signals
from elid_cli.solve import reweighted
from elid_cli.terms import effect_classes
from elid_cli.terms.effect import Effect
from elid_cli.tilt import declared_tilt, levelled
from elid_cli.validation import Validation, validate

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

_NEVER_SEARCHED = ("lookup",)
_SIDES = {"load": "link", "drive": "motor"}
"""What lies in a row of a joint with a torque sensor."""


@dataclass(frozen=True)
class DiagnoseOptions:
    """How to diagnose."""

    lookup: bool = False
    """Add a smooth curve over the best variable where structure remains that no named effect explains."""
    only: tuple[str, ...] = ()
    """Names of effects to try; empty: all."""
    accurate: bool = False
    """Complete friction curves by collocation however long it takes; else only where it is quick."""


@dataclass(frozen=True)
class Rival:
    """An effect that the data cannot tell apart from a named one."""

    effect: str
    joint: str | None
    instead_of: str
    gain: float
    parameters: Mapping[str, float]
    separate: str
    """What to record to tell them apart."""


@dataclass(frozen=True)
class FoundEffect:
    """An effect that held-out data support."""

    effect: str
    joint: str | None
    parameters: Mapping[str, float]
    std_error: Mapping[str, float]
    gain: float
    """Fraction of the held-out residual variance, in the rows it acts on, that it takes away."""
    net: float
    """Gain in log-likelihood on the training stretches, net of its price."""
    folds: tuple[bool, ...]
    """In which cross-validation folds it helps."""
    local: bool
    """Whether it lives in a part of the log only, which cross-validation over time cannot judge."""
    summary: str
    deflection: tuple[float, float] | None = None
    """Of an effect seen in the positions alone: held-out rms of the deflection without and with it, rad (m)."""
    collocated: bool = False
    """Whether it is a term of a friction curve that the collocation told: its gain is that of all such terms together,
    of what the held-out stretches show beyond noise."""
    quarters: tuple[float, ...] = ()
    """Part of the squared error that it takes from each quarter of the log, predicted from the others; NaN where the
    quarter cannot tell, empty for local effects and curves."""


@dataclass(frozen=True)
class Unexplained:
    """Structure that no effect of the library explains."""

    joint: str
    rows: str
    variable: str
    share: float
    """Part of the row's residual variance that follows the variable."""
    rms: float
    ratio: float
    """Residual over the noise floor."""
    nearest: tuple[tuple[str, str | None, float], ...]
    """Nearest candidates: effect, joint, part of the whitened residual variance they would take away."""


@dataclass(frozen=True)
class Moved:
    """A base parameter that the found effects moved."""

    name: str
    before: float
    after: float
    deviations: float
    """Shift in standard deviations of the estimate after."""


@dataclass(frozen=True)
class Diagnosis:
    """Everything `elid diagnose` says."""

    robot: Robot
    refined: Robot
    before: Mapping[str, JointError]
    after: Mapping[str, JointError]
    effects: tuple[FoundEffect, ...]
    also_possible: tuple[Rival, ...]
    nuisances: tuple[Nuisance, ...]
    unexplained: tuple[Unexplained, ...]
    rows_before: tuple[RowState, ...]
    rows_after: tuple[RowState, ...]
    triage: tuple[str, ...]
    organised: Mapping[tuple[str, str], tuple[Organised, ...]]
    """What the residual before follows, per (joint, rows)."""
    moved: tuple[Moved, ...]
    sufficient: bool
    """Whether the model before already left nothing but noise."""
    tried: int
    held_out: tuple[tuple[float, float], ...]
    """Held-out stretches, s."""
    validation_before: Validation
    validation_after: Validation
    chosen: NDArray[np.bool_]
    """Held-out instants, (M,)."""
    state_before: State
    state_after: State
    curves: tuple[FoundEffect, ...] = ()
    """Smooth curves added by request where no named effect explains the structure."""
    refuted: tuple[Survival, ...] = ()
    """Effects that the search found and that make some quarter of the log, predicted from the others, worse."""


def divided(robot: Robot, signals: Signals) -> Log:
    """Return a log with its stretches divided into training folds and held-out ones."""
    level, model = robot, Model(levelled(robot))
    shifts = declared_shifts(model.robot)
    moved_signals = corrected(signals, shifts)
    observation = observe(model, moved_signals)
    return Log(
        model=model,
        base=find_base(model),
        signals=moved_signals,
        observation=observation,
        fold=folds(observation.instants),
        raw=signals,
        shifts=shifts,
        level=level,
        tilt=declared_tilt(level),
    )


def diagnose(
    robot: Robot, signals: Signals, options: DiagnoseOptions | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Find the effects that a robot's model lacks.

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
    """
    options = options or DiagnoseOptions()
    robot = robot.stiffened(signals.unlinked)
    log = divided(robot, signals)
    model = log.model
    library = {
        name: kind
        for name, kind in effect_classes().items()
        if name not in _NEVER_SEARCHED and (not options.only or name in options.only)
    }
    plain = reweighted(reduce(log.training, (), log.fold), log.base.count).values[: model.parameters]
    declared = [d.effect for d in declared_effects(model.robot, scene_of(model, signals, plain))]
    found, refuted = _surviving(search(log, declared, library, progress), len(declared))
    known = len(declared) + found.kept
    found = with_whole_curves(found, known, progress, asked=options.accurate)
    named, curves = found.after, list[Effect]()
    if options.lookup:
        found, curves = _with_curves(found)
    return replace(_result(robot, log, found, known, curves, named), refuted=refuted)


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
    """Drop effects that the held-out stretches do not support, or whose values the others have made impossible."""
    state, steps = found.after, list(found.steps)
    changed = True
    while changed and steps:
        changed = False
        for k, step in enumerate(steps):
            possible = sensible(state.effects[declared + k], state.scene, state.named(declared + k))
            if possible and step.candidate.effect.local:
                continue
            if not possible or held_out_gain(state, declared + k) < step.candidate.effect.least_gain:
                state = refreshed(without(state, declared + k))
                gone = steps.pop(k).candidate
                steps = [beside(left, gone) for left in steps]
                changed = True
                break
    return replace(found, after=state, steps=tuple(steps))


def held_out_triangles(state: State) -> Triangles:
    """Return the triangles of the held-out stretches with the state's columns."""
    log = state.log
    return reduce(log.observation.only(log.fold < 0), state.extras)


def held_out_gain(state: State, number: int) -> float:
    """Return the part of the held-out residual variance that effect `number` takes away in its rows."""
    lacking = without(state, number)
    rows = touched(lacking, state, state.columns[number].rows)
    outside, inside = held_out_triangles(lacking), held_out_triangles(state)
    # rows are compared in units of their noise floor, or the noisier row would hide what the quieter one shows
    weight = {r: max(state.floor.rms[r], 1e-4 * state.triangles.torque_rms(r)) ** -2 for r in rows}
    before = sum(weight[r] * t.squares(lacking.solution.values) for r in rows for t in outside.of(r))
    after = sum(weight[r] * t.squares(state.solution.values) for r in rows for t in inside.of(r))
    return 1.0 - after / before if before > 0 else 0.0


def _with_curves(found: Found) -> tuple[Found, list[Effect]]:
    """Add smooth curves over what the remaining residual follows most, as long as held-out stretches support them."""
    from elid_cli.diagnosis.curves import MOST, best_curve

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


def _result(robot: Robot, log: Log, found: Found, declared: int, curves: Sequence[Effect], named: State) -> Diagnosis:
    """Return what is said of a search; `named` is the model after without curves, which explain nothing."""
    before, after = found.before, found.after
    chosen = log.fold < 0
    first = described(robot, before)
    last = described(robot, after)
    validations = [validate(r, log.raw, chosen) for r in (first, last)]
    rows_before, rows_after = rows_of(before), rows_of(after)
    effects = tuple(_found(after, declared + k, step, found.terms) for k, step in enumerate(found.steps))
    known = declared + len(found.steps)
    terms = tuple(_term(after, k, term) for k, term in sorted(found.terms.items()) if k >= known)
    fitted = {e.joint for e in after.effects if e.name == SKEW}
    seen = tuple(_seen(robot, after, skew) for skew in found.skews if skew.joint not in fitted)
    extra = tuple(_curve(after, len(after.effects) - len(curves) + k) for k in range(len(curves)))
    unexplained = _unexplained(named, rows_of(named), found.remaining)
    return Diagnosis(
        robot=robot,
        refined=last,
        before=_floored(validations[0].error, before),
        after=_floored(validations[1].error, after),
        effects=(*seen, *effects, *terms),
        also_possible=_rivals(after, declared, found.steps, effects),
        nuisances=(*_nuisances(after), *(_kept(after, k) for k in range(declared - found.kept, declared))),
        unexplained=unexplained,
        rows_before=rows_before,
        rows_after=rows_after,
        triage=words(rows_before),
        organised={
            (robot.joint_names[row.joint], row.kind): tuple(organise(before, row)[:4]) for row in judged_rows(before)
        },
        moved=moved(before, after),
        sufficient=not effects and not seen and not unexplained,
        tried=found.tried,
        held_out=spans(log.observation.t, chosen),
        validation_before=validations[0],
        validation_after=validations[1],
        chosen=chosen,
        state_before=before,
        state_after=after,
        curves=extra,
    )


def described(robot: Robot, state: State) -> Robot:
    """Return the robot description that a state amounts to: parameters, effects, corrected torque delays."""
    base = state.log.base
    standard = representative(base, base.transform @ state.standard, robot.reference())
    names = robot.joint_names
    specs = [
        EffectSpec(e.name, None if e.whole_robot else names[e.joint], state.named(k))
        for k, e in enumerate(state.effects)
    ]
    specs += [EffectSpec("torque_delay", names[j], {"delay": d}) for j, d in state.delays.items()]
    moved_joints = {e.joint for e in state.effects if e.name == SKEW}
    specs += [
        EffectSpec(SKEW, names[j], {"skew": float(state.log.shifts.link[j])})
        for j in np.flatnonzero(state.log.shifts.link)
        if j not in moved_joints
    ]
    return refined_robot(robot, standard, specs)


def _found(state: State, number: int, step: Step, terms: Mapping[int, Term]) -> FoundEffect:
    effect = state.effects[number]
    return FoundEffect(
        effect=effect.name,
        joint=None if effect.whole_robot else state.log.model.robot.joint_names[effect.joint],
        parameters=state.named(number),
        std_error=_errors(state, number),
        gain=terms[number].gain if number in terms else held_out_gain(state, number),
        net=step.net,
        folds=tuple(bool(g > 0) for g in step.candidate.gain.folds),
        local=effect.local,
        summary=effect.summary,
        collocated=number in terms,
        quarters=step.quarters,
    )


def _term(state: State, number: int, term: Term) -> FoundEffect:
    """Return a further term of a friction curve, which the collocation told."""
    effect = state.effects[number]
    return FoundEffect(
        effect=effect.name,
        joint=state.log.model.robot.joint_names[effect.joint],
        parameters=state.named(number),
        std_error=_errors(state, number),
        gain=term.gain,
        net=term.net,
        folds=(),
        local=False,
        summary="term of a friction curve, told by collocation",
        collocated=True,
    )


def _seen(robot: Robot, state: State, skew: Skew) -> FoundEffect:
    """Return a skew that only the positions show; its gain is in the variance of the deflection."""
    return FoundEffect(
        effect=SKEW,
        joint=robot.joint_names[skew.joint],
        parameters={"skew": float(state.log.shifts.link[skew.joint])},
        std_error={"skew": skew.deviation},
        gain=skew.share,
        net=0.0,
        folds=(),
        local=False,
        summary="link encoder sampled at another instant than the motor encoder; seen in the positions alone",
        deflection=(skew.without, skew.with_it),
        quarters=skew.quarters,
    )


def _curve(state: State, number: int) -> FoundEffect:
    effect = state.effects[number]
    joint = state.log.model.robot.joint_names[effect.joint]
    gain = held_out_gain(state, number)
    return FoundEffect(effect.name, joint, state.named(number), {}, gain, 0.0, (), False, effect.summary)


def _errors(state: State, number: int) -> dict[str, float]:
    """Return standard errors of an effect's named parameters by first-order propagation of its coefficients."""
    place = state.place(number)
    where = [np.flatnonzero(state.solution.basis == c) for c in range(place.start, place.stop)]
    if any(not len(w) for w in where):
        return {}
    index = [int(w[0]) for w in where]
    covariance = state.covariance[np.ix_(index, index)]
    centre = state.coefficients(number)
    names = state.named(number)
    jacobian = np.zeros((len(names), len(centre)))
    for k in range(len(centre)):
        step = 1e-4 * max(abs(float(centre[k])), 1e-9)
        moved_ = state.renamed(number, centre + step * np.eye(len(centre))[k])
        jacobian[:, k] = [(moved_[n] - names[n]) / step for n in names]
    spread = np.sqrt(np.maximum(np.einsum("ak,kl,al->a", jacobian, covariance, jacobian), 0.0))
    return {name: float(s) for name, s in zip(names, spread, strict=True) if s > 0}


def _rivals(state: State, declared: int, steps: Sequence[Step], effects: Sequence[FoundEffect]) -> tuple[Rival, ...]:
    robot = state.log.model.robot
    named = {(e.effect, e.joint) for e in effects}
    rivals: dict[tuple[str, str | None], Rival] = {}
    for number, (step, effect) in enumerate(zip(steps, effects, strict=True), start=declared):
        own = state.effects[number]
        for twin in type(own).same_here(state.scene, own.joint):
            if (twin, effect.joint) not in named:
                record = effect_classes()[twin].record
                rivals[twin, effect.joint] = Rival(twin, effect.joint, effect.effect, effect.gain, {}, record)
        for candidate in step.rivals:
            joint = None if candidate.effect.whole_robot else robot.joint_names[candidate.effect.joint]
            key = (candidate.effect.name, joint)
            if key in named or key in rivals:
                continue
            ratio = candidate.gain.likelihood / max(step.candidate.gain.likelihood, 1e-9)
            rivals[key] = Rival(
                candidate.effect.name,
                joint,
                effect.effect,
                effect.gain * min(ratio, 1.0),
                candidate.values,
                candidate.effect.record,
            )
    return tuple(rivals.values())


def _nuisances(state: State) -> tuple[Nuisance, ...]:
    names = state.log.model.robot.joint_names
    found = []
    first = state.log.model.parameters
    for k, extra in enumerate(state.nuisances):
        where = np.flatnonzero(state.solution.basis == first + k)
        deviation = float(np.sqrt(state.covariance[where[0], where[0]])) if len(where) else float("nan")
        joint = names[next(iter(extra.rows)).joint]
        value = float(state.solution.values[first + k])
        found.append(Nuisance(extra.name, joint, {"delay": value}, {"delay": deviation}))
    return tuple(found)


def _kept(state: State, number: int) -> Nuisance:
    """Return an effect that stays in the model without being named."""
    effect = state.effects[number]
    joint = state.log.model.robot.joint_names[effect.joint]
    return Nuisance(effect.name, joint, state.named(number), _errors(state, number))


def _unexplained(state: State, rows: Sequence[RowState], remaining: Sequence[Candidate]) -> tuple[Unexplained, ...]:
    names = state.log.model.robot.joint_names
    found = []
    for item in rows:
        if not item.high:
            continue
        joint = names.index(item.joint)
        organised = organise(state, Row(item.rows, joint))
        best = organised[0] if organised else Organised("none", 0.0)
        near = tuple(
            (
                c.effect.name,
                None if c.effect.whole_robot else names[c.effect.joint],
                1.0 - float(np.exp(-2.0 * c.gain.whole * len(state.projected.places) / max(c.gain.count, 1))),
            )
            for c in remaining
            if c.effect.joint == joint or c.effect.whole_robot
        )[:3]
        side = "link" if item.rows == "sum" and _quiet(rows, item.joint) else _SIDES.get(item.rows, item.rows)
        found.append(Unexplained(item.joint, side, best.variable, best.share, item.rms, item.ratio, near))
    return tuple(found)


def _quiet(rows: Sequence[RowState], joint: str) -> bool:
    """Whether the motor row of a joint is at its floor (so that a high sum row means the link side)."""
    motor = [r.high for r in rows if r.joint == joint and r.rows == "motor"]
    return bool(motor) and not motor[0]


def moved(before: State, after: State) -> tuple[Moved, ...]:
    """Return the base parameters with their shift in standard deviations, largest first."""
    base = before.log.base
    transform = np.concatenate([base.transform, np.zeros((base.count, after.triangles.extras))], axis=1)
    part = transform[:, after.solution.basis]
    deviation = np.sqrt(np.maximum(np.diag(part @ after.covariance @ part.T), 0.0))
    old, new = base.transform @ before.standard, base.transform @ after.standard
    known = after.solution.estimable(transform)
    shifts = [
        Moved(name, float(a), float(b), float((b - a) / d))
        for name, a, b, d, k in zip(base.names, old, new, deviation, known, strict=True)
        if k and d > 0
    ]
    return tuple(sorted(shifts, key=lambda m: -abs(m.deviations)))


def _floored(errors: Mapping[str, JointError], state: State) -> dict[str, JointError]:
    names = state.log.model.robot.joint_names
    return {
        name: replace(
            e,
            floor=state.floor.rms.get(Row("sum", names.index(name))),
            spring_floor=state.floor.rms.get(Row("motor", names.index(name))),
        )
        for name, e in errors.items()
    }
