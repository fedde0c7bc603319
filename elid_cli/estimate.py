"""Identification: base parameters from a log, how sure they are, and how well they predict torque not used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli.base import BaseParameters, find_base
from elid_cli.covariance import residuals, sandwich
from elid_cli.model import Model, Row
from elid_cli.nuisance import DELAY, delay_columns, offset_columns, significant
from elid_cli.observation import Observation, observe
from elid_cli.reduction import Extra, Triangles, folds_of, reduce
from elid_cli.robot import Robot
from elid_cli.signals import Signals
from elid_cli.solve import Solution, reweighted, solve

Array = NDArray[np.float64]
Verdict = Literal["supported", "weak", "refused"]

WEAK = 0.3
"""Relative standard deviation above which a parameter is only weakly excited."""
REFUSED = 1.0
"""Relative standard deviation above which a value says nothing."""
STICKING = 2.5
"""Residual rms at reversals over that elsewhere, above which a joint's reversals are left out."""
TORQUE_SHARE = 0.01
"""A parameter matters on the scale at which it makes this share of a row's torque."""


@dataclass(frozen=True)
class EstimateOptions:
    """How to estimate."""

    estimator: Literal["default", "paper"] = "default"
    accurate: bool = False
    folds: int = 6
    """Contiguous stretches; each in turn is predicted by a fit to the others."""
    delays: bool = True
    """Estimate one torque delay per torque channel."""
    offsets: bool = True
    """Estimate one torque offset per torque channel."""
    mask: bool | None = None
    """Leave out reversals of the motors; None: of those motors that do not follow Coulomb friction there."""


@dataclass(frozen=True)
class JointError:
    """Error of the predicted motor torque of one joint on data not used in the fit, N·m (N)."""

    rms: float
    """Motor torque minus prediction with the spring eliminated (sum row)."""
    relative: float
    """`rms` over the rms of the torque."""
    spring_rms: float | None
    """Motor row alone: spring torque from K (theta - q); None for a rigid joint."""
    spring_relative: float | None
    torque_rms: float
    floor: float | None = None
    """rms that the sensors' noise alone would leave in the sum row."""
    spring_floor: float | None = None


@dataclass(frozen=True)
class Nuisance:
    """Something of the measurement that was estimated along and corrected."""

    effect: str
    joint: str
    parameters: Mapping[str, float]
    std_error: Mapping[str, float]


@dataclass(frozen=True)
class Identification:
    """What a log says about a robot's parameters."""

    robot: Robot
    base: BaseParameters
    estimate: Array
    """Base parameters, (b,); NaN where refused."""
    std_error: Array
    reference: Array
    """Reference values of the base parameters, (b,); NaN where unknown."""
    verdict: tuple[Verdict, ...]
    this_log: Mapping[str, str]
    """Class of every standard parameter for this log: as structural, or weak, or not excited."""
    reasons: Mapping[str, str]
    """Why a parameter is weak, refused or not excited."""
    error: Mapping[str, JointError]
    condition: float
    rank_margin: float
    rank: int
    covariance: Array
    """Covariance of the base parameters, (b, b); NaN rows where refused."""
    standard: Array
    """A representative set of standard parameters (p,) that predicts as the base parameters do."""
    delays: Array
    """Torque delay per joint that was corrected, s, (n,)."""
    settings: Mapping[str, object] = field(default_factory=dict)
    nuisances: tuple[Nuisance, ...] = ()
    warnings: tuple[str, ...] = ()
    estimator: str = "default"
    triangles: Triangles | None = None
    """The reduced data, for those who fit again under further conditions (`physical`)."""
    weights: Mapping[Row, float] = field(default_factory=dict)
    """Weight of every row group in the fit: one over its residual rms."""

    def relative_error(self) -> Array:
        """Return |estimate - reference| / |reference|, (b,); NaN where there is no non-zero reference."""
        with np.errstate(divide="ignore", invalid="ignore"):
            error: Array = np.abs(self.estimate - self.reference) / np.abs(self.reference)
        return np.where(self.reference == 0, np.nan, error)


def identify(robot: Robot, signals: Signals, options: EstimateOptions | None = None) -> Identification:
    """Estimate the base parameters of a robot from one log (or several, joined).

    Raises
    ------
    DataError
        If the log excites no parameter at all.
    """
    options = options or EstimateOptions()
    model = Model(robot)
    base = find_base(model)
    observation = masked_as_needed(observe(model, signals), base, options)
    fold = folds_of(observation, options.folds)
    extras: list[Extra] = []
    if options.delays:
        extras += delay_columns(observation)
    if options.offsets:
        extras += offset_columns(observation)
    triangles = reduce(observation, extras, fold)
    solution = reweighted(triangles, base.count + triangles.extras)
    if extras:
        extras = significant(observation, solution, extras, signals)
        triangles = reduce(observation, extras, fold)
        solution = reweighted(triangles, base.count + triangles.extras)
    covariance = sandwich(observation, solution, extras)
    return _assemble(robot, base, signals, observation, triangles, solution, covariance, extras, options)


def masked_as_needed(observation: Observation, base: BaseParameters, options: EstimateOptions) -> Observation:
    """Return the observation with reversals counted for the joints whose residual there is no larger than elsewhere.

    A motor that sticks has no defined friction while it does; one that glides through zero tells most about its
    Coulomb friction just there.
    """
    if options.mask is not None:
        return observation if options.mask else observation.unmasked(np.ones(observation.robot.n, dtype=bool))
    extras = [*delay_columns(observation), *offset_columns(observation)]
    values = reweighted(reduce(observation, extras), base.count + len(extras)).values
    residual = residuals(observation, values, extras)
    glides = np.zeros(observation.robot.n, dtype=bool)
    for k in range(observation.robot.n):
        trace = residual.get(("sum", k))
        inside = observation.known[k] & observation.reversing[k]
        outside = observation.known[k] & ~observation.reversing[k]
        if trace is None or not inside.any() or not outside.any():
            continue
        glides[k] = np.sqrt(np.mean(trace[inside] ** 2)) < STICKING * np.sqrt(np.mean(trace[outside] ** 2))
    return observation.unmasked(glides)


def _assemble(
    robot: Robot,
    base: BaseParameters,
    signals: Signals,
    observation: Observation,
    triangles: Triangles,
    solution: Solution,
    covariance: Array,
    extras: Sequence[Extra],
    options: EstimateOptions,
) -> Identification:
    p = len(base.parameters)
    transform = np.concatenate([base.transform, np.zeros((base.count, triangles.extras))], axis=1)
    known = solution.estimable(transform)
    estimate = transform @ solution.values
    spread = transform[:, solution.basis] @ covariance @ transform[:, solution.basis].T
    deviation = np.sqrt(np.diag(spread))
    scale = torque_scale(base, triangles, solution)
    verdict, reasons = judge(base, estimate, deviation, scale, known, signals)
    refused = np.array([v == "refused" for v in verdict])
    spread = np.where(refused[:, None] | refused[None], np.nan, spread)
    this_log = classes_in_log(base, verdict, signals, reasons)
    nuisances, delays = _nuisances(extras, solution, covariance, robot, p)
    return Identification(
        robot=robot,
        base=base,
        estimate=np.where(refused, np.nan, estimate),
        std_error=np.where(refused, np.nan, deviation),
        reference=base.values(robot.reference()),
        verdict=verdict,
        this_log=this_log,
        reasons=reasons,
        error=held_out(robot, triangles, solution),
        condition=solution.condition,
        rank_margin=solution.margin,
        rank=int(known.sum()),
        covariance=spread,
        standard=solution.values[:p],
        delays=delays,
        settings=_settings(signals, observation, options),
        nuisances=nuisances,
        warnings=_suspicious(base, estimate, deviation, known),
        estimator=options.estimator,
        triangles=triangles,
        weights=solution.weights,
    )


def torque_scale(base: BaseParameters, triangles: Triangles, solution: Solution) -> Array:
    """Return per base parameter the value that makes `TORQUE_SHARE` of the torque of the row it acts on most, (b,)."""
    strongest = np.zeros(len(base.parameters))
    for row in triangles.rows:
        chosen = triangles.of(row)
        torque = triangles.torque_rms(row)
        count = sum(t.count for t in chosen)
        for triangle in chosen[:1]:
            standard = triangle.index < len(base.parameters)
            squares = sum((t.factor[:, :-1] ** 2).sum(axis=0) for t in chosen)
            share = np.sqrt(squares[standard] / count) / max(torque, 1e-300)
            index = triangle.index[standard]
            strongest[index] = np.maximum(strongest[index], share)
    with np.errstate(divide="ignore"):
        return TORQUE_SHARE / strongest[base.leaders]


def judge(
    base: BaseParameters,
    estimate: Array,
    deviation: Array,
    scale: Array,
    known: NDArray[np.bool_],
    signals: Signals,
) -> tuple[tuple[Verdict, ...], dict[str, str]]:
    """Return the verdict on every base parameter and the reasons, by the leading parameter's name."""
    verdicts: list[Verdict] = []
    reasons: dict[str, str] = {}
    for k, leader in enumerate(base.leaders):
        name = base.parameters[leader]
        size = max(abs(estimate[k]), scale[k] if np.isfinite(scale[k]) else 0.0)
        if not known[k] or not np.isfinite(deviation[k]):
            verdicts.append("refused")
            reasons[name] = _why(name, signals)
        elif deviation[k] > REFUSED * size or (name.startswith("K") and estimate[k] < 2 * deviation[k]):
            verdicts.append("refused")
            spread = f"standard deviation {deviation[k]:.2g} against a value of {estimate[k]:.2g}"
            reasons[name] = f"{spread}: {_why(name, signals)}"
        elif deviation[k] > WEAK * size:
            verdicts.append("weak")
            reasons[name] = f"known to {deviation[k] / size:.0%} only: {_why(name, signals)}"
        else:
            verdicts.append("supported")
    return tuple(verdicts), reasons


def _why(name: str, signals: Signals) -> str:
    """Return in words what the log lacks for a parameter."""
    kind = name.rstrip("0123456789")
    joint = int(name[len(kind) :]) - 1
    label = signals.joints[joint]
    if signals.still[joint] and kind in ("Jm", "fs", "fv", "K"):
        return f"{label} does not move"
    still = [signals.joints[k] for k in np.flatnonzero(signals.still)]
    if not np.isfinite(signals.tau[:, joint]).any():
        return f"{label} has no torque in this log"
    if still:
        return f"{', '.join(still)} {'does' if len(still) == 1 else 'do'} not move"
    if kind == "K":
        return f"too little torque that varies passes through the transmission of {label}"
    return "the motion excites it too little"


def classes_in_log(
    base: BaseParameters, verdict: Sequence[Verdict], signals: Signals, reasons: dict[str, str]
) -> dict[str, str]:
    """Return the class of every standard parameter for this log, and add the followers' reasons."""
    result: dict[str, str] = dict(base.classes)
    for k, leader in enumerate(base.leaders):
        members = [base.parameters[j] for j in np.flatnonzero(base.transform[k])]
        name = base.parameters[leader]
        if verdict[k] == "supported":
            continue
        label = "weak" if verdict[k] == "weak" else "not excited"
        result[name] = label
        for member in members[1:]:
            seen = [v for row, v in zip(base.transform, verdict, strict=True) if row[base.parameters.index(member)]]
            if all(v == "refused" for v in seen):
                result[member] = "not excited"
                reasons.setdefault(member, reasons.get(name, ""))
            elif all(v != "supported" for v in seen):
                result[member] = "weak"
                reasons.setdefault(member, reasons.get(name, ""))
    return result


def held_out(robot: Robot, triangles: Triangles, solution: Solution) -> dict[str, JointError]:
    """Return each joint's error on every fold, predicted by a fit to the other folds."""
    squares: dict[Row, float] = dict.fromkeys(triangles.rows, 0.0)
    for fold in range(triangles.folds):
        others = [f for f in range(triangles.folds) if f != fold]
        fitted = solve(triangles, solution.weights, others or None, len(solution.basis)).values
        for row in triangles.rows:
            squares[row] += sum(t.squares(fitted) for t in triangles.of(row, [fold]))
    return joint_errors(robot, triangles, squares)


def joint_errors(
    robot: Robot, triangles: Triangles, squares: Mapping[Row, float], folds: Sequence[int] | None = None
) -> dict[str, JointError]:
    """Return each joint's error from residual sums of squares per row group."""
    errors = {}
    for k, joint in enumerate(robot.joints):
        total, motor = Row("sum", k), Row("motor", k)
        if total not in squares:
            continue
        torque = triangles.torque_rms(total, folds)

        def rms(row: Row) -> float:
            count = sum(t.count for t in triangles.of(row, folds))
            return float(np.sqrt(squares[row] / count)) if count else float("nan")

        spring = rms(motor) if motor in squares else None
        share = None if spring is None else spring / torque
        errors[joint.name] = JointError(rms(total), rms(total) / torque, spring, share, torque)
    return errors


def _nuisances(
    extras: Sequence[Extra], solution: Solution, covariance: Array, robot: Robot, p: int
) -> tuple[tuple[Nuisance, ...], Array]:
    delays = np.zeros(robot.n)
    found = []
    for k, extra in enumerate(extras):
        joint = next(iter(extra.rows)).joint
        value = float(solution.values[p + k])
        where = np.flatnonzero(solution.basis == p + k)
        deviation = float(np.sqrt(covariance[where[0], where[0]])) if len(where) else float("nan")
        kind = "delay" if extra.name == DELAY else "offset"
        if extra.name == DELAY:
            delays[joint] = value
        found.append(Nuisance(extra.name, robot.joints[joint].name, {kind: value}, {kind: deviation}))
    return tuple(found), delays


def _suspicious(base: BaseParameters, estimate: Array, deviation: Array, known: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return a sentence for every stiffness, rotor inertia or friction that came out negative beyond doubt."""
    sentences = []
    for k, leader in enumerate(base.leaders):
        name = base.parameters[leader]
        positive = name.startswith(("K", "Jm", "fs", "fv")) and base.classes[name] == "independent"
        if positive and known[k] and estimate[k] < -3 * deviation[k]:
            sentences.append(f"{name} = {estimate[k]:.3g} is negative: check signs and units, or an effect is missing")
    return tuple(sentences)


def _settings(signals: Signals, observation: Observation, options: EstimateOptions) -> dict[str, object]:
    return {
        "cutoff": signals.filter.cutoff,
        "rate": signals.rate,
        "instants": observation.instants,
        "knots": [None if not np.isfinite(k) else float(k) for k in signals.knots],
        "min_velocity": [float(v) for v in signals.min_velocity],
        "masked": [float(v) for v in observation.masked],
        "noise_q": [float(v) for v in signals.noise.q],
        "noise_theta": [float(v) for v in signals.noise.theta],
        "noise_tau": [float(v) for v in signals.noise.tau],
        "velocity_used": bool(signals.velocity_used.any()),
        "estimator": options.estimator,
        "folds": options.folds,
    }


def with_floor(identification: Identification, floor: Mapping[Row, float]) -> Identification:
    """Return the identification with the noise floor of each row filled in."""
    names = {joint.name: k for k, joint in enumerate(identification.robot.joints)}
    errors = {
        name: replace(e, floor=floor.get(Row("sum", names[name])), spring_floor=floor.get(Row("motor", names[name])))
        for name, e in identification.error.items()
    }
    return replace(identification, error=errors)
