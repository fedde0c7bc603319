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
from elid_cli.diagnosis.summary import channel_specs
from elid_cli.errors import DataError, UsageError
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.refined_robot import representative
from elid_cli.estimation.regression.effect_columns import extra_of, scene_of, with_effects
from elid_cli.estimation.regression.triangles import full_columns
from elid_cli.estimation.stretches import STRETCHES, spans, stretch_of
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.declared import as_observed
from elid_cli.model.effects.effect import Effect, Member
from elid_cli.model.effects.scene import Scene
from elid_cli.model.regressor import EstimationRow
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
START = 0.1
"""Stribeck velocity of members that have none, as a part of the joint's top speed."""
SLOWEST, FASTEST, PLACES = 0.015, 0.6, 12
"""Stribeck velocities that are tried first, as parts of the top speed, and how many."""
EVEN = 0.5
"""Last shape to start from: as much of the motor's torque as of the load."""
AGREED, AGREEING = 3e-4, 8
"""Change of the friction, as a part of it, below which its columns and the fit agree, and most rounds until they do."""
RESHAPED = 3
"""Times that a shape is looked for again with the torques of the fit in it."""
APART = 0.02
"""The same, above which they have not agreed in the end: such a member is not offered."""
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
    skipped: Mapping[str, str] = field(default_factory=dict)
    """Joints without a friction curve, with the reason."""

    @property
    def members(self) -> Mapping[str, Member]:
        """The members by name, with their formulas."""
        return members_of(family())


def family() -> type[Effect]:
    """Return the effect that is a family of friction models."""
    return next(kind for kind in effect_classes().values() if kind.members)


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
    effects: list[Effect] = []
    supported: dict[str, str] = {}
    for number, (joint, speed) in enumerate(top.items()):
        if progress is not None:
            progress(f"comparing friction of {joint}", number / (len(top) + 1))
        k = robot.joint_names.index(joint)
        own = {PLAIN: _judged(plain, k, PLAIN)}
        shaped = {name: _settled(plain, k, member, speed) for name, member in kind.members.items()}
        own |= {name: _judged(state, k, name, agrees=agrees) for name, (state, agrees) in shaped.items()}
        fits[joint], supported[joint] = own, _supported(list(own.values()))
        if supported[joint] != PLAIN:
            effects.append(shaped[supported[joint]][0].effects[-1])
    if progress is not None:
        progress("fitting the whole log", len(top) / (len(top) + 1))
    refined, errors = _whole(log, (*plain.effects, *effects))
    unseen = spans(log.observation.t, log.fold < 0)
    return FrictionFamily(robot, fits, supported, unseen, refined, errors, skipped)


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


def _settled(plain: State, joint: int, member: Member, speed: float) -> tuple[State, bool]:
    """Return the model with a member at one joint, and whether its friction and its torques agree."""
    scene = _scene(plain)
    state = fit(plain.log, (*plain.effects, _shaped(plain, scene, joint, member, speed)), scene)
    for _ in range(RESHAPED if member.forms else 0):  # with the friction in the torque
        scene, lean = _scene(state), _grown(state)[-1].shape[-1]
        state = fit(plain.log, (*plain.effects, _shaped(plain, scene, joint, member, speed, lean)), scene)
    return agreed(state)


def _shaped(plain: State, scene: Scene, joint: int, member: Member, speed: float, lean: float = EVEN) -> Effect:
    """Return the member in the shape that explains most of what the plain model leaves of the search's stretches."""
    from scipy.optimize import minimize_scalar

    kind = family()

    def effect(logarithm: float, form: float) -> Effect:
        return kind(joint, (member.shape, float(np.exp(logarithm)), form, lean))

    def loss(logarithm: float, form: float) -> float:
        gain = plain.projected.gain(extra_of(effect(logarithm, form), scene, plain.log.signals).rows)
        return 0.0 if gain is None else -gain.whole

    if not member.forms:
        return effect(np.log(START * speed), 1.0)
    grid = np.log(speed) + np.linspace(np.log(SLOWEST), np.log(FASTEST), PLACES)
    _, form, place = min((loss(x, form), form, x) for form in member.forms for x in grid.tolist())
    step = float(grid[1] - grid[0])
    found = minimize_scalar(
        lambda x: loss(x, form), bounds=(place - step, place + step), method="bounded", options={"xatol": 1e-3}
    )
    return effect(float(found.x), form)


def agreed(state: State) -> tuple[State, bool]:
    """Return the model fitted with columns from its own torques until both agree, and whether they do."""
    if not any(effect.from_model for effect in state.effects):
        return state, True
    change = np.inf
    for _ in range(AGREEING):
        before = _torque(state)
        state = fit(state.log, _grown(state), _scene(state))
        after = _torque(state)
        change = float(np.linalg.norm(after - before) / np.linalg.norm(after))
        if change <= AGREED:
            break
    return state, change <= APART


def _grown(state: State) -> tuple[Effect, ...]:
    """Return a model's effects with what their shapes take from their amplitudes."""
    return tuple(effect.grown(state.coefficients(k)) for k, effect in enumerate(state.effects))


def _scene(state: State) -> Scene:
    """Return what a model's effects are computed from: its own torques, those of the effects among them."""
    scene = scene_of(state.log.model, state.log.signals, _standard(state), state.solved.rotors())
    return with_effects(scene, [(effect, state.coefficients(k)) for k, effect in enumerate(state.effects)])


def _standard(state: State) -> Array:
    """Return the standard parameters (p,) of a fit, nearest to the robot file's.

    A rotor's inertia often shows only in a sum with its body's, and its share decides what passes the gear: any other
    representative would change the load from one round to the next.
    """
    base = state.log.base
    return representative(base, base.transform @ state.standard, state.log.model.robot.reference())


def _torque(state: State) -> Array:
    """Return the torque of all effects in all rows, one after the other, with a last value that is never 0."""
    parts = [
        state.coefficients(k) @ columns for k, extra in enumerate(state.columns) for columns in extra.rows.values()
    ]
    return np.concatenate([*parts, [1e-9]])


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
    return MemberFit(name, JointError(rms, rms / torque, None, None, torque), folds, parameters,
                     agrees and _possible(parameters))  # fmt: skip


def _whole(log: Log, effects: Sequence[Effect]) -> tuple[Robot, dict[str, dict[str, float]]]:
    """Return the robot with effects, fitted to the whole log, and the errors of the family's amplitudes by joint."""
    state, _ = agreed(fit(replace(log, fold=stretch_of(log.observation.instants)), effects))
    names = log.model.robot.joint_names
    own = {name.joint: dict[str, float]() for name in log.model.names}
    for name, value in zip(log.model.names, _standard(state).tolist(), strict=True):
        own[name.joint][name.kind] = float(value)
    joints = tuple(replace(joint, parameters=own[k]) for k, joint in enumerate(log.model.robot.joints))
    declared = log.model.robot.effects
    specs = state.specs
    channels = channel_specs(state)
    kept = [spec for spec in declared if spec.effect not in {item.effect for item in (*specs, *channels)}]
    errors = {names[e.joint]: _errors(state, k) for k, e in enumerate(state.effects) if e.members}
    return replace(log.model.robot, joints=joints, effects=(*kept, *specs, *channels)), errors


def _errors(state: State, number: int) -> dict[str, float]:
    """Return the standard errors of an effect's amplitudes that are in the solution's basis, and of its free shapes."""
    covariance, shapes = state.covariance_with_shapes
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = dict(zip(state.solution.basis.tolist(), deviation.tolist(), strict=False))
    columns = range(*state.place(number).indices(len(state.solution.values)))
    effect = state.effects[number]
    names = (p.name for p in effect.amplitudes)
    errors = {name: known[column] for name, column in zip(names, columns, strict=True) if column in known}
    logarithms = {place: deviation[k] for (which, place), k in shapes.items() if which == number}
    return errors | {effect.shapes[k].name: effect.shape[k] * float(error) for k, error in logarithms.items()}


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
