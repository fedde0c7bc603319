"""Row triage: which side of the transmission a residual sits on, in words, and what it organises against."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.state import State
from elid_cli.estimation.regression.covariance import residuals
from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.triangles import full_columns, to_triangles
from elid_cli.estimation.validation.following import Followed, followed, in_bursts, motion_curves, slow_part
from elid_cli.model.regressor import SENSOR_KINDS, EstimationRow, Kind

HIGH = 1.3
"""Residual over floor above which a row counts as high."""
BETWEEN = 3.0
"""Times the whole joint's residual, each over its noise, from which the motor side's is made between the encoders: what
is wrong with the motor or its torque is in both alike, and what is wrong between them bends the rest of the fit."""
MATTERS = 5e-4
"""Residual beyond the floor, as a part of the torque, below which smoothing's own errors are seen, and no physics."""
STANDSTILL = 0.05
"""Part of the top speed below which a motor counts as near standstill."""
REVERSALS = "reversals"
_BINS = 24


@dataclass(frozen=True)
class RowState:
    """Residual of one row group against its floor (training stretches)."""

    joint: str
    rows: Kind
    rms: float
    share: float
    """rms over the rms of the torque."""
    ratio: float
    """rms over the noise floor."""
    away: float = np.inf
    """The same away from the motor's reversals, in a fit without them: what is left there only is the motor's sticking,
    in no model exact."""

    @property
    def high(self) -> bool:
        """Whether more is left than noise: above the floor by a part of it and by a part of the torque that matters."""
        if self.away <= HIGH:
            return False
        beyond = self.share * float(np.sqrt(max(1.0 - 1.0 / max(self.ratio, 1.0) ** 2, 0.0)))
        return self.ratio > HIGH and beyond > MATTERS


@dataclass(frozen=True)
class Organised:
    """How much of a row's residual variance follows one variable."""

    variable: str
    share: float


def rows_of(state: State) -> tuple[RowState, ...]:
    """Return residual, share of torque and ratio to the floor of every row group that is no sum of others."""
    ratios = state.ratios()
    names = state.log.model.robot.joint_names
    return tuple(
        RowState(
            names[row.joint],
            row.kind,
            state.rms(row),
            state.rms(row) / state.triangles.torque_rms(row),
            ratios[row],
            _away(state, row),
        )
        for row in judged_rows(state)
    )


def judged_rows(state: State) -> tuple[EstimationRow, ...]:
    """Return the row groups that have data and are no sums of others."""
    kept = {group.row for group in state.log.observation.independent}
    return tuple(row for row in state.triangles.rows if row in kept)


def words(rows: tuple[RowState, ...]) -> tuple[str, ...]:
    """Return one sentence per joint whose residual is above the floor (METHODS: row triage)."""
    ratio, sides = _ratios(rows), suspects(rows)
    joints = list(dict.fromkeys(r.joint for r in rows))
    sentences = []
    high_sum = [j for j in joints if max(ratio.get((j, "sum"), 0), ratio.get((j, "load"), 0)) > HIGH]
    for joint in joints:
        total, motor = ratio.get((joint, "sum"), 0.0), ratio.get((joint, "motor"))
        if joint in sides:
            sizes = _sizes(total, motor) if motor is not None else _sensor_sizes(joint, ratio)
            sentences.append(f"{joint}: look at the {sides[joint]}; {sizes}")
        elif motor is None and total > HIGH:
            sentences.append(f"{joint}: the residual is {_digits(total)} times the sensors' noise")
    if len(high_sum) > 1:
        named = f"{len(high_sum)} joints at once ({', '.join(high_sum)})"
        could = "a payload, gravity, a contact or the base can be the cause"
        if all(ratio.get((j, "motor"), 0.0) > HIGH for j in high_sum):
            could += ", but these leave only noise on the motor sides: look at the motors first"
        sentences.append(f"{named}: {could}")
    return tuple(sentences)


def _ratios(rows: tuple[RowState, ...]) -> dict[tuple[str, str], float]:
    """Return what every row holds over its noise, at most `HIGH` of a row that is not high."""
    return {(r.joint, r.rows): r.ratio if r.high else min(r.ratio, HIGH) for r in rows}


def suspects(rows: tuple[RowState, ...]) -> dict[str, str]:
    """Return where to look at the joints whose rows tell a joint's sides apart, and hold more than noise."""
    ratio = _ratios(rows)
    found = {}
    for joint in dict.fromkeys(r.joint for r in rows):
        total, motor = ratio.get((joint, "sum"), 0.0), ratio.get((joint, "motor"))
        if (joint, "spring") in ratio:
            side = _sensed_side([kind for kind in SENSOR_KINDS if ratio.get((joint, kind), 0.0) > HIGH])
        else:
            between = motor is not None and motor > max(HIGH, BETWEEN * total)
            side = "" if motor is None else _side(total > HIGH and not between, motor > HIGH)
        if side:
            found[joint] = side
    return found


def _side(whole: bool, motor: bool) -> str:
    """Return where to look, from which residuals of a joint are above noise, or no small part of the other."""
    if not whole:
        return "transmission or its encoders" if motor else ""
    return "motor or its torque signal" if motor else "link side"


def _sizes(whole: float, motor: float) -> str:
    sizes = (f"{_digits(ratio)} times the sensors' noise" if ratio > HIGH else "noise only" for ratio in (whole, motor))
    return "residual of the whole joint: {}; of the motor side: {}".format(*sizes)


def _digits(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio < 10 else f"{ratio:.0f}"


def _sensed_side(high: list[Kind]) -> str:
    """Return where to look at a joint with a torque sensor, whose rows tell the sides apart by themselves."""
    if len(high) > 1:  # what the rows share is the reading
        return "joint torque sensor, or more than one side"
    where: dict[Kind, str] = {
        "load": "link side",
        "drive": "motor side, its torque signal or the torque sensor's gain",
        "spring": "transmission",
    }
    return where[high[0]] if high else ""


def _sensor_sizes(joint: str, ratio: Mapping[tuple[str, str], float]) -> str:
    named = {"load": "link side", "drive": "drive", "spring": "transmission"}
    sizes = ", ".join(f"{named[kind]} {_digits(ratio.get((joint, kind), 0.0))}" for kind in SENSOR_KINDS)
    return f"residuals over the sensors' noise: {sizes}"


def organise(state: State, row: EstimationRow) -> list[Organised]:
    """Return what a row's residual follows, strongest first: binned means, and the strongest spectral line.

    The share is the part of the variance between bins, corrected for the number of bins and the residual's own
    correlation, so that noise gives about 0.
    """
    training = state.log.training
    group = training.group(row)
    use = group.use
    residual = _residual(state, row)[use]
    total = float(np.sum(residual**2))
    if total <= 0 or len(residual) < 4 * _BINS:
        return []
    independent = max(len(residual) * _white_share(residual), 4.0 * _BINS)
    found = [
        Organised(name, _between(residual, values[use], total, independent))
        for name, values in variables(state, row.joint).items()
    ]
    found.append(_line(residual, state.log.signals.rate))
    found.append(_reversals(state, row.joint, residual, use))
    return sorted((o for o in found if o.share > 0), key=lambda o: -o.share)


def _away(state: State, row: EstimationRow) -> float:
    """Return residual over floor at the training instants at which the motor is not near standstill.

    Friction near standstill is no law of the speed: it bends the fit, and with it the residual everywhere else. Where
    that is above noise, it is taken from a fit without these instants, of every joint.
    """
    fast = state.log.training.group(row).use & ~_near_standstill(state, row.joint)
    if not fast.any():
        return np.inf
    floor = float(np.sqrt(np.mean(state.floor.series[row][:, fast] ** 2)))
    least = max(floor, 2e-4 * state.triangles.torque_rms(row))

    def ratio(values: Array) -> float:
        residual = residuals(state.log.observation, values, state.extras)[row]
        return float(np.sqrt(np.mean(residual[fast] ** 2))) / least

    whole = ratio(state.solution.values)
    return whole if whole <= HIGH else min(whole, ratio(_fitted_in_motion(state)))


def _fitted_in_motion(state: State) -> Array:
    """Return coefficients fitted without the instants at which a row's own motor is near standstill, (p + d,)."""
    training = state.log.training
    away = [~_near_standstill(state, joint) for joint in range(training.robot.n)]
    moving = replace(training, groups=tuple(replace(g, use=g.use & away[g.row.joint]) for g in training.groups))
    triangles = to_triangles(moving, state.extras, state.log.fold)
    return reweighted(triangles, len(state.solution.basis)).values


def _near_standstill(state: State, joint: int) -> NDArray[np.bool_]:
    """Return the instants whose period of the filter's cut-off touches a standstill of a joint's motor, (M,)."""
    known = state.log.observation.known[joint]
    reach = int(np.ceil(0.5 * state.log.signals.rate / state.log.signals.filter.cutoff))
    return np.asarray(np.convolve(standing(state, joint, known), np.ones(2 * reach + 1), mode="same") > 0.5)


def standing(state: State, joint: int, use: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the instants at which a motor is near standstill, (M,); none where no instant is of use."""
    speed = np.abs(state.log.signals.motion.dtheta[state.log.signals.outputs, joint])
    return np.asarray(speed < (STANDSTILL * float(np.quantile(speed[use], 0.98)) if use.any() else 0.0))


def _reversals(state: State, joint: int, residual: Array, use: NDArray[np.bool_]) -> Organised:
    """Return the part of the variance near standstill of the motor, beyond what as many other instants would hold."""
    slow = standing(state, joint, use)[use]
    part, share = float(np.mean(slow)), float(np.sum(residual[slow] ** 2) / max(np.sum(residual**2), 1e-300))
    return Organised(REVERSALS, (share - part) / (1.0 - part) if part < 0.5 else 0.0)


def variables(state: State, joint: int) -> dict[str, Array]:
    """Return what a residual may follow, at the observation's instants, each (M,)."""
    signals = state.log.signals
    motion, outputs = signals.motion, signals.outputs
    robot = state.log.model.robot
    result = {
        "dtheta": motion.dtheta[outputs, joint],
        "theta": motion.theta[outputs, joint],
        "ddtheta": motion.ddtheta[outputs, joint],
        "tau": state.log.observation.tau[joint],
        "t": state.log.observation.t,
    }
    if robot.joints[joint].elastic:
        result["deflection"] = motion.q[outputs, joint] - motion.theta[outputs, joint]
        result["deflection_rate"] = motion.dq[outputs, joint] - motion.dtheta[outputs, joint]
    for other in range(robot.n):
        if other != joint and not signals.still[other]:
            result[f"theta of {robot.joint_names[other]}"] = motion.theta[outputs, other]
            result[f"dtheta of {robot.joint_names[other]}"] = motion.dtheta[outputs, other]
    return result


def follows_motion(state: State, row: EstimationRow) -> bool:
    """Whether what a row leaves follows the motion, is as slow as it, or came in bursts: noise does none of these."""
    if came_in_bursts(state, row) or followed_by(state, row).beyond:
        return True
    group = state.log.training.group(row)
    return slow_part(_residual(state, row), group.target, group.use, group.columns[:0]) > 0


def came_in_bursts(state: State, row: EstimationRow) -> bool:
    """Whether most of what a row leaves lies in few instants."""
    return in_bursts(_residual(state, row), state.log.training.group(row).use)


def followed_by(state: State, row: EstimationRow, only: Container[str] = ()) -> Followed:
    """Return how what a row leaves follows the motion, by all groups of curves or only some."""
    return following(state, row, _residual(state, row), only)


def following(state: State, row: EstimationRow, torque: Array, only: Container[str] = ()) -> Followed:
    """Return how a torque in a row, N·m (N), (M,), follows the motion as far as the state's own columns do not."""
    group = state.log.training.group(row)
    load = group.target - _residual(state, row)
    curves = motion_curves(state.log.signals, row.joint, state.log.model.robot, load)
    own = full_columns(group, state.extras, state.log.observation.parameters)[1]
    return followed(torque, group.use, own, {name: part for name, part in curves.items() if not only or name in only})


def _residual(state: State, row: EstimationRow) -> Array:
    return residuals(state.log.observation, state.solution.values, state.extras)[row]


def _between(residual: Array, values: Array, total: float, independent: float) -> float:
    order = np.argsort(values, kind="stable")
    bins = np.array_split(residual[order], _BINS)
    between = sum(len(b) * float(np.mean(b)) ** 2 for b in bins) / total
    # under noise alone the between share is about bins / independent samples
    expected = _BINS / independent
    return (between - expected) / max(1.0 - expected, 1e-9)


def _white_share(residual: Array) -> float:
    centred = residual - residual.mean()
    power = float(centred @ centred)
    rho = [float(centred[k:] @ centred[:-k]) / power for k in range(1, 12)] if power > 0 else [0.0]
    return 1.0 / (1.0 + 2.0 * sum(max(r, 0.0) for r in rho))


def _line(residual: Array, rate: float) -> Organised:
    spectrum = np.abs(np.fft.rfft(residual * np.hanning(len(residual)))) ** 2
    frequency = np.fft.rfftfreq(len(residual), 1.0 / rate)
    spectrum[frequency < 0.5] = 0.0
    peak = int(np.argmax(spectrum))
    near = slice(max(peak - 3, 0), peak + 4)
    share = float(spectrum[near].sum() / max(spectrum.sum(), 1e-300))
    background = 7.0 / max(len(spectrum), 1)
    return Organised(f"frequency {frequency[peak]:.1f} Hz", max(share - 4 * background, 0.0))
