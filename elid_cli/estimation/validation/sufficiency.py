"""Whether a model suffices: residual over noise, whether what is left follows the motion, and whom that may move.

Noise alone, white or with a memory, leaves a residual that has nothing to do with the motion. A residual that follows
it is predicted, stretch by stretch, from what the other stretches show of smooth curves over the motion: a joint's
speed, position, load, deflection, the other joints' speeds, and the course of the log. How much of it chance would
predict is told by the same residual moved round in time against the motion: that keeps its memory and breaks the tie.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.data import sampled, sum_row
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.regression.covariance import residuals
from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.observation import RowGroup
from elid_cli.estimation.regression.triangles import ExtraColumns, full_columns
from elid_cli.estimation.result import Identification, Insufficient, Judgement, RowNoise
from elid_cli.estimation.stretches import STRETCHES, stretch_of
from elid_cli.estimation.validation.cross_validation import with_floor
from elid_cli.estimation.validation.noise_floor import propagated
from elid_cli.model.regressor import EstimationRow, Kind
from elid_cli.robot.robot import Robot
from elid_cli.signals.excerpts import excerpts
from elid_cli.signals.signals import Signals

JUDGED = 24_000
"""Samples of a long log that are judged."""
ROUNDS = 60
"""Times that a residual is moved round against the motion."""
BEYOND, LEAST = 4.0, 0.1
"""Deviations of what chance predicts, and part of the residual, beyond which it follows the motion."""
ABOVE = 1.4
"""Residual over noise from which a row is looked at: encoder noise in the columns is part of that noise."""
PIECES = 4
"""Pieces per fold: what changes in the course of a log is predicted from before and after."""
VISIBLE = 0.4
"""Size of what follows the motion, in the size of noise, from which it counts."""
MATTERS = 2e-5
"""The same as a part of the torque: below it splines and rounding are seen."""
ALSO = 0.7
"""Part of the best group's prediction from which another group of curves is taken as possible, too."""
RIDGE = 1e-4
"""Damping of the curves' coefficients, of the strongest direction."""
HIDDEN = 30.0
"""How many times larger than what is seen of it a missing torque may be: the rest hides in the parameters."""
MOVED, WIDER = 2.0, 3.0
"""Shift in standard errors, or growth of these, with the missing curves as unknowns, from which a bias is possible."""
_LEAST = 60
"""Instants that a row needs to be judged."""


def judged_model(found: Identification, *said: Judgement | None) -> Identification:
    """Return an identification with what its residual says of the model, in one log or in several."""
    told = [one for one in said if one is not None and len(one.biased) == found.base.count]
    if not told or not any(one.noise for one in told):
        return found
    noise = _joined(told)
    insufficient = {(i.joint, i.rows): i for one in told for i in sorted(one.insufficient, key=lambda i: i.ratio)}
    biased = np.any([one.biased for one in told], axis=0)
    records = zip(found.parameters, biased.tolist(), strict=True)
    numbers = {name: k for k, name in enumerate(found.robot.joint_names)}
    floors = {EstimationRow(item.rows, numbers[item.joint]): item.floor for item in noise}
    return replace(
        with_floor(found, floors),
        parameters=tuple(replace(item, bias_possible=marked) for item, marked in records),
        noise=noise,
        insufficient=tuple(insufficient.values()),
        model="insufficient" if insufficient else "sufficient",
    )


def _joined(said: Sequence[Judgement]) -> tuple[RowNoise, ...]:
    """Return the noise of every row in all logs together."""
    rows: dict[tuple[str, Kind], list[RowNoise]] = {}
    for one in said:
        for item in one.noise:
            rows.setdefault((item.joint, item.rows), []).append(item)
    return tuple(
        items[0] if len(items) == 1 else
        RowNoise(*row, *(float(np.sqrt(np.mean(np.square([getattr(item, name) for item in items]))))
                         for name in ("floor", "ratio", "correlation")))
        for row, items in rows.items()
    )  # fmt: skip


def judge_model(fit: DefaultFit) -> Judgement:
    """Judge a fit whose samples are at hand by its residual.

    Parameters
    ----------
    fit
        The fit. Of a long log, stretches are judged.
    """
    nobody = np.zeros(fit.base.count, dtype=bool)
    part = _excerpt(fit)
    observation, signals = part.observation, part.signals
    standard = part.solution.values[: fit.model.parameters]
    floor = propagated(fit.model, signals, observation, replicates=1).floor(standard)
    left = residuals(observation, part.solution.values, part.extras)
    noise, insufficient, missing = [], [], list[_Missing]()
    curves: dict[int, Mapping[str, Array]] = {}
    for group in observation.independent:
        row = group.row
        if row.kind == "link" or group.count < _LEAST:
            continue
        residual = left[(row.kind, row.joint)]
        size = float(np.sqrt(np.mean(residual[group.use] ** 2)))
        torque = max(float(np.sqrt(np.mean(observation.tau[row.joint][group.use] ** 2))), 1e-300)
        least = max(floor.rms[row], MATTERS * torque)
        name = fit.model.robot.joint_names[row.joint]
        ratio = size / max(floor.rms[row], 1e-9 * torque)
        noise.append(RowNoise(name, row.kind, floor.rms[row], ratio, memory(residual, group.use, observation.rate)))
        if size < ABOVE * least:
            continue
        if row.joint not in curves:
            curves[row.joint] = motion_curves(signals, row.joint, fit.model.robot, group.target - residual)
        own = full_columns(group, part.extras, observation.parameters)[1]
        seen_in = followed(residual, group, own, curves[row.joint])
        seen = size * float(np.sqrt(max(seen_in.share, 0.0)))
        if seen_in.beyond and seen > VISIBLE * least:
            insufficient.append(Insufficient(name, row.kind, ratio, seen_in.groups[0], seen_in.share))
            missing.append(_Missing(row, seen_in.groups, seen))
    biased = _movable(part, missing, curves) if missing else nobody
    return Judgement(tuple(noise), tuple(insufficient), biased)


def in_bursts(residual: Array, use: NDArray[np.bool_]) -> bool:
    """Whether most of a residual lies in few instants: something that happened, and no noise."""
    power = np.sort(residual[use] ** 2)[::-1]
    return bool(power[: max(1, len(power) // 20)].sum() > 0.5 * power.sum())


def memory(residual: Array, use: NDArray[np.bool_], rate: float) -> float:
    """Return how long a residual remembers, s: the lag at which its correlation falls below 1/e."""
    values = np.where(use, residual - residual[use].mean(), 0.0)
    spectrum = np.abs(np.fft.rfft(values, 2 * len(values))) ** 2
    correlation = np.fft.irfft(spectrum)[: len(values) // 2]
    if correlation[0] <= 0:
        return 0.0
    correlation = correlation / correlation[0]
    below = np.flatnonzero(correlation < np.exp(-1.0))
    if not len(below):
        return len(correlation) / rate
    last = int(below[0])
    before, after = correlation[last - 1], correlation[last]
    return float((last - 1 + (before - np.exp(-1.0)) / (before - after)) / rate)


class _Missing(NamedTuple):
    """A row that lacks something: the groups of curves that it follows, and the size of what is seen, N·m."""

    row: EstimationRow
    groups: tuple[str, ...]
    seen: float


@dataclass(frozen=True)
class Followed:
    """How much of a residual follows the motion."""

    share: float
    """Part of the residual's variance that the other stretches predict."""
    beyond: bool
    """Whether chance would not."""
    groups: tuple[str, ...]
    """Groups of curves that predict it, best first."""


def _excerpt(fit: DefaultFit) -> DefaultFit:
    """Return the fit over stretches of a long log: the same solution, fewer instants."""
    signals = fit.signals
    segments = excerpts(signals.segments, signals.dt, JUDGED)
    if sum(map(len, segments)) == sum(map(len, signals.segments)) or fit.effects is not None:
        return fit
    data = sampled(fit.model, replace(signals, segments=segments))
    data = data.counting(fit.observation.gliding)
    of_channel = {(e.name, sum_row(e).joint): e for e in (*data.delays(), *data.offsets())}
    wanted = [(e.name, sum_row(e).joint) for e in fit.nuisances]
    if any(key not in of_channel for key in wanted):
        return fit
    nuisances = tuple(of_channel[key] for key in wanted)
    return replace(fit, data=data, nuisances=nuisances, triangles=data.triangles(nuisances))


def motion_curves(signals: Signals, joint: int, robot: Robot, load: Array) -> dict[str, Array]:
    """Return groups of curves over the motion at the fit's instants, (d, M) each, every curve of size 1 or so.

    `load` is the torque that the model predicts, (M,): the measured one holds the noise that is to be told apart.
    """
    motion = signals.motion
    channels = np.nan_to_num(np.stack([motion.theta, motion.q, motion.dtheta, motion.dq, motion.ddtheta]))
    theta, q, dtheta, dq, ddtheta = signals.decimate(np.ascontiguousarray(channels.transpose(0, 2, 1)))

    def unit(values: Array) -> Array:
        return values / max(float(np.quantile(np.abs(values), 0.98)), 1e-12)

    def bends(values: Array) -> list[Array]:
        """Return curves through 0, the first three of which bend near it."""
        values = unit(values)
        low = [max(float(np.quantile(np.abs(values), share)), 1e-3) for share in (0.03, 0.1, 0.3)]
        return [*(np.tanh(values / at) for at in low), values, np.abs(values) * values, values**3]

    speed, place = dtheta[joint], theta[joint]
    turn = np.pi * (place - place.min()) / max(float(np.ptp(place)), 1e-12)
    sign, size, ones = bends(speed)[0], unit(load), np.ones_like(speed)
    groups = {
        "motor speed": [*bends(speed), ones],
        "position": [np.cos(k * turn) for k in range(1, 9)] + [np.cos(k * turn) * sign for k in range(1, 4)],
        "load": [np.abs(size) * sign, size, np.abs(size), np.abs(size) * unit(speed)],
        "acceleration": bends(ddtheta[joint])[3:],
    }
    if robot.joints[joint].elastic:
        deflection = place - q[joint]
        groups["deflection"] = [*bends(deflection - deflection.mean()), unit(speed - dq[joint]), ones]
        groups["link speed"] = bends(dq[joint])
    course = np.pi * np.linspace(0.0, 1.0, len(speed))
    groups["time"] = [np.cos(k * course) * v for k in range(1, 5) for v in (ones, sign, size)]
    others = [k for k in range(robot.n) if k != joint and not signals.still[k]]
    if others:
        groups["other joints' speed"] = [unit(dtheta[k]) for k in others]
    return {name: np.array(values) for name, values in groups.items()}


def followed(residual: Array, group: RowGroup, columns: Array, curves: Mapping[str, Array]) -> Followed:
    """Return how much of a residual follows the motion, by curves at whose cost the model's columns come first."""
    use = group.use
    own = _orthonormal(columns[:, use])
    r = residual[use] - (own @ residual[use]) @ own  # rows share parameters: each alone would fit better
    fold = stretch_of(len(r), PIECES * STRETCHES) % STRETCHES
    names = list(curves)
    parts = [_free(curves[name][:, use], own) for name in names]
    shares = np.array([_predicted(part, r, fold) for part in parts])
    everything = np.concatenate(parts)
    share = max(_predicted(everything, r, fold), float(shares.max()))
    best = int(np.argmax(shares))
    moved = [_moved_round(part, r, fold) for part in (everything, parts[best])]
    beyond = any(
        value > LEAST and chance.beyond(value) for value, chance in zip((share, shares[best]), moved, strict=True)
    )
    order = np.argsort(-shares)
    also = [k for k in order.tolist() if shares[k] > ALSO * max(shares[best], 1e-12)]
    return Followed(float(share), bool(beyond), tuple(names[k] for k in also) or (names[best],))


def _orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis of rows (d, M), (r, M)."""
    size = np.linalg.norm(columns, axis=1)
    scaled = columns[size > 0] / size[size > 0, None]
    _, values, basis = np.linalg.svd(scaled, full_matrices=False)
    if not len(values):
        return np.zeros((0, columns.shape[1]))
    found: Array = basis[values > 1e-9 * values[0]]
    return found


def _free(curves: Array, own: Array) -> Array:
    """Return curves without what the model's own columns explain of them, those that nothing is left of dropped."""
    left = curves - (curves @ own.T) @ own
    kept: Array = left[np.linalg.norm(left, axis=1) > 1e-3 * np.linalg.norm(curves, axis=1)]
    return kept


def _predicted(curves: Array, residual: Array, fold: NDArray[np.intp]) -> float:
    """Return the part of a residual's variance that curves predict from the other stretches."""
    if not len(curves):
        return 0.0
    return float(_shares(curves, residual[:, None], fold)[0])


def _shares(curves: Array, values: Array, fold: NDArray[np.intp]) -> Array:
    """Return the part that curves (d, M) predict of each column of `values` (M, k), stretch by stretch, (k,)."""
    gram, moment = curves @ curves.T, curves @ values
    damping = RIDGE * float(np.linalg.norm(gram, 2)) * np.eye(len(gram))
    error = np.zeros(values.shape[1])
    for number in range(STRETCHES):
        out = fold == number
        part = curves[:, out]
        fitted = np.linalg.solve(gram - part @ part.T + damping, moment - part @ values[out])
        error += np.sum((values[out] - part.T @ fitted) ** 2, axis=0)
    total = np.maximum(np.sum(values**2, axis=0), 1e-300)
    shares: Array = 1.0 - error / total
    return shares


@dataclass(frozen=True)
class _Chance:
    """What chance predicts, as logarithms of what is left: mean, deviation and least."""

    mean: float
    deviation: float
    least: float

    def beyond(self, share: float) -> bool:
        left = float(np.log(max(1.0 - share, 1e-12)))
        return left < self.mean - BEYOND * self.deviation and left < self.least


def _moved_round(curves: Array, residual: Array, fold: NDArray[np.intp]) -> _Chance:
    """Return what chance predicts of a residual: what is predicted of it moved round against the motion."""
    if not len(curves):
        return _Chance(0.0, 0.0, 0.0)
    count = len(residual)
    lags = np.unique(np.linspace(0.08 * count, 0.92 * count, ROUNDS).astype(int))
    moved = np.stack([np.roll(residual, lag) for lag in lags.tolist()], axis=1)
    left = np.log(1.0 - _shares(curves, moved, fold))
    return _Chance(float(left.mean()), float(left.std()), float(left.min()))


def _movable(
    fit: DefaultFit,
    missing: Sequence[tuple[EstimationRow, tuple[str, ...], float]],
    curves: Mapping[int, Mapping[str, Array]],
) -> NDArray[np.bool_]:
    """Return the base parameters that the missing torque can move, (b,): those that its curves, as unknowns, do."""
    extras, sizes = [], list[float]()
    for joint in sorted({row.joint for row, _, _ in missing}):
        rows = [row for row, _, _ in missing if row.joint == joint]
        names = dict.fromkeys(name for row, groups, _ in missing if row.joint == joint for name in groups)
        values = np.concatenate([curves[joint][name] for name in names])
        side = {EstimationRow("motor", joint), EstimationRow("drive", joint)}
        acted = [g.row for g in fit.observation.groups if g.row.joint == joint and g.row.kind != "link"]
        if not any(row in side for row in rows):  # the sum row alone: the link's side
            acted = [row for row in acted if row not in side]
        elif EstimationRow("sum", joint) not in rows:  # the motor row alone: in the spring, which the sum does not hold
            acted = [row for row in acted if row.kind != "sum"]
        extras.append(ExtraColumns("missing", dict.fromkeys(acted, values), ("",) * len(values)))
        size = max(seen for row, _, seen in missing if row.joint == joint)
        sizes += [HIDDEN * size / max(float(np.sqrt(np.mean(v**2))), 1e-12) for v in values]
    triangles = fit.data.triangles((*fit.nuisances, *(fit.effects.extras if fit.effects else ()), *extras))
    first = triangles.width - len(sizes)
    prior = np.zeros((len(sizes), triangles.width + 1))
    prior[np.arange(len(sizes)), first + np.arange(len(sizes))] = 1.0 / np.array(sizes)
    known = replace(triangles, prior=prior)
    solution = reweighted(known, fit.base.count + triangles.extras)
    transform = np.pad(fit.base.transform, ((0, 0), (0, triangles.extras)))
    old = fit.transform[:, fit.solution.basis]
    before = np.sqrt(np.maximum(np.diag(old @ fit.covariance @ old.T), 0.0))
    used = transform[:, solution.basis] @ solution.inverse
    # the noise is as large as before: what its inverse weights say of the wrong model's residual would hide the change
    after = np.sqrt(np.sum(used**2, axis=1))
    plain = fit.transform[:, fit.solution.basis] @ fit.solution.inverse
    ratio = after / np.maximum(np.sqrt(np.sum(plain**2, axis=1)), 1e-300)
    shift = np.abs(transform @ solution.values - fit.transform @ fit.solution.values)
    marked: NDArray[np.bool_] = (shift > MOVED * before) | (ratio > WIDER)
    return marked
