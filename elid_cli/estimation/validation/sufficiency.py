"""Whether a model suffices: residual over noise, whether what is left follows the motion, and whom that may move.

Noise alone, white or with a memory, leaves a residual that has nothing to do with the motion (`following`).
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.data import sampled, sum_row
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.judgement import (
    Insufficient,
    JointError,
    Judgement,
    RowNoise,
    joined_bounds,
    joined_noise,
    without_chance,
)
from elid_cli.estimation.regression.covariance import residuals
from elid_cli.estimation.regression.nuisances import delay_columns, offset_columns
from elid_cli.estimation.regression.observation import Observation, RowGroup
from elid_cli.estimation.regression.triangles import full_columns
from elid_cli.estimation.result import BaseEstimate, Identification
from elid_cli.estimation.stiffness.noise import LARGEST_SHARE, floor_of_pulled, shares_of_noise
from elid_cli.estimation.validation.column_noise import columns_of
from elid_cli.estimation.validation.cross_validation import floored
from elid_cli.estimation.validation.following import (
    APART,
    DEFLECTION,
    OTHERS,
    PACE,
    TIME,
    WEIGHT,
    apart,
    followed,
    memory,
    motion_curves,
    slow_part,
)
from elid_cli.estimation.validation.movable import Missing, movable
from elid_cli.estimation.validation.noise_floor import Floor, propagated
from elid_cli.estimation.validation.one_moment import moment_of
from elid_cli.estimation.validation.other_positions import moved_by_other_positions
from elid_cli.estimation.validation.prediction import Validation, validate
from elid_cli.estimation.validation.taken_up import taken_up
from elid_cli.estimation.validation.too_quiet import too_quiet
from elid_cli.estimation.validation.unpredicted import unpredicted
from elid_cli.estimation.validation.verdicts import hidden_by_rest
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.robot import Robot
from elid_cli.signals.excerpts import excerpts
from elid_cli.signals.signals import Signals

JUDGED = 24_000
"""Samples of a long log that are judged."""
ABOVE = 1.4
"""Residual over noise from which a row is looked at: encoder noise in the columns is part of that noise."""
UNCLEAR = 2.5
"""Times the sensors' white noise from which what is left is not called nothing: torque noise with a memory may leave
that much, and so may what follows no variable alone."""
FAR_OFF, OF_TORQUE = 10.0, 0.01
"""The same, and held-out error over the torque, from which a joint's parameters may be biased where nothing says which.
Measured: arms with springs taken as rigid 14 to 680, with values up to 13 of their errors off; torque noise with a
memory leaves more than ten times its white part, but less of the torque."""
HARDLY = 0.1
"""Held-out error over the torque of a joint that lacks something from which none of its values can be trusted."""
FAR_ABOVE, OWN = 3.0, 2.0
"""Residual of a motor's own row over its noise, and over the whole joint's, from which it is no noise of the torque:
both rows hold that."""
VISIBLE = 0.4
"""Size of what follows the motion, in the size of noise, from which it counts."""
MATTERS = 2e-5
"""The same as a part of the torque: below it splines and rounding are seen."""
QUIET, OF_ALL = 0.5, 1e-3
"""Residual over the sensors' noise at any joint below which that noise is none: a drive's torque that chatters, as it
does on a coarse encoder, is a torque. What is left of every row is then asked by its own size, from this part of the
torque on."""
_LEAST = 60
"""Instants that a row needs to be judged."""


def judged_model(found: Identification, *said: Judgement | None) -> Identification:
    """Return an identification with what its residual says of the model, in one log or in several."""
    told = without_chance([one for one in said if one is not None and len(one.biased) == found.base.count])
    if not told or not any(one.noise for one in told):
        return found
    noise = told[0].noise if len(said) == 1 else joined_noise(told)
    insufficient = {(i.joint, i.rows): i for one in told for i in sorted(one.insufficient, key=lambda i: i.ratio)}
    error = above_noise(found.error, found.robot, noise)
    shares = {name: item.relative for name, item in error.items() if item.relative is not None}
    large, poor = ({name for name, share in shares.items() if share > least} for least in (OF_TORQUE, HARDLY))
    unknown = (far_off(noise, tuple(insufficient.values())) & large) | (poor & {joint for joint, _ in insufficient})
    own = [found.robot.joint_names[item.leader.joint] in unknown for item in found.parameters]
    biased = np.any([one.biased for one in told], axis=0) | np.array(own, dtype=bool)
    far = {item.joint for item in noise if item.ratio > UNCLEAR}
    records = zip((_hidden(item, found.robot, far) for item in found.parameters), biased.tolist(), strict=True)
    return replace(
        found,
        error=error,
        parameters=tuple(replace(item, bias_possible=item.bias_possible or marked) for item, marked in records),
        noise=noise,
        insufficient=tuple(insufficient.values()),
        model="insufficient" if insufficient else "sufficient",
        nuisances=tuple(item.doubted for item in found.nuisances) if insufficient or far else found.nuisances,
        not_excluded=joined_bounds(told) if len(told) == len(said) else (),
        warnings=(*found.warnings, *too_quiet(found, noise), *unpredicted(error)),
        notes=(*found.notes, *{n.partition(" (")[0]: n for one in told for n in one.notes}.values()),
    )


def far_off(noise: Sequence[RowNoise], insufficient: Sequence[Insufficient]) -> set[str]:
    """Return the joints at which many times the noise follows no variable of theirs.

    It may be anything: nothing says in which direction it moves their parameters.
    """
    own = {item.joint for item in insufficient if item.follows not in (TIME, OTHERS)}
    rest = {item.joint: (1.0 - item.share) ** 0.5 for item in insufficient}
    return {item.joint for item in noise if item.ratio * rest.get(item.joint, 1.0) > FAR_OFF} - own


def _hidden(item: BaseEstimate, robot: Robot, far: Container[str]) -> BaseEstimate:
    """Return a parameter with its reason; `far` are joints with far more than noise left, which makes its error."""
    label = robot.joint_names[item.leader.joint]
    return replace(item, reason=hidden_by_rest(item.reason, label)) if label in far else item


def above_noise(error: Mapping[str, JointError], robot: Robot, noise: Sequence[RowNoise]) -> dict[str, JointError]:
    """Return errors with what the sensors' noise alone would leave in every row filled in, where that is known."""
    if any(n.joint in error and _quiet(n.ratio * n.floor, n.floor, error[n.joint].torque_rms) for n in noise):
        return dict(error)
    numbers = {name: k for k, name in enumerate(robot.joint_names)}
    return floored(error, robot.joint_names, {EstimationRow(n.rows, numbers[n.joint]): n.floor for n in noise})


def _quiet(size: float, floor: float, torque: float) -> bool:
    """Whether what a row leaves is too little for its noise, and more than splines and rounding leave."""
    return MATTERS * torque < size < QUIET * floor


def judge_model(fit: DefaultFit) -> Judgement:
    """Judge a fit whose samples are at hand by its residual.

    Parameters
    ----------
    fit
        The fit. Of a long log, stretches are judged.
    """
    part = _excerpt(fit)
    observation = part.observation
    standard = part.solution.values[: fit.model.parameters]
    noise = propagated(fit.model, part.signals, observation, replicates=1)
    rows = residuals(observation, part.solution.values, part.extras)
    left = {g.row: rows[g.row] for g in observation.independent}
    floor = _of_pulled_stiffness(part, noise.floor(standard), left)

    def own(group: RowGroup) -> Array:
        return full_columns(group, part.extras, observation.parameters)[1]

    seen = _judged_rows(part.signals, observation, left, floor, own, fitted=True)
    biased = movable(part, seen.missing, seen.curves) if seen.missing else np.zeros(fit.base.count, dtype=bool)
    still = {row: ABOVE * rms for row, rms in floor.rms.items() if row in left}
    lacking = {item.row for item in seen.missing}
    quiet = not seen.insufficient and all(item.ratio <= UNCLEAR for item in seen.noise)
    hidden = taken_up(part, still, lacking, quiet=quiet)
    biased |= hidden.moved | moved_by_other_positions(part)
    names = observation.robot.joint_names
    absorbed = [
        Insufficient(n.joint, n.rows, n.ratio, word, 0.0)  # of one row's words the surest is the last
        for word, joints in hidden.off
        for n in seen.noise
        if n.rows in (("sum", "load") if word == WEIGHT else ("sum",)) and n.joint in [names[k] for k in joints]
    ]
    said = (*seen.insufficient, *absorbed)
    bounds = None if said or not quiet else hidden.bounds
    return Judgement(
        tuple(seen.noise), said, biased, columns_of(noise), hidden.notes if quiet else (), not_excluded=bounds
    )


def _of_pulled_stiffness(fit: DefaultFit, floor: Floor, left: Mapping[EstimationRow, Array]) -> Floor:
    """Return the noise of every row, also of motors whose stiffness came out too small for the noise in deflections."""
    noise, rms, pulled = fit.data.facts.deflection_noise, dict(floor.rms), set[EstimationRow]()
    sizes = _sizes(fit.observation, left, None)
    for joint, share in shares_of_noise(fit.model, fit.triangles, fit.solution, noise).items():
        row = EstimationRow("motor", joint)
        if row in rms and row in sizes and np.isfinite(share):
            rms[row] = floor_of_pulled(share, rms[row], sizes[row].size)
            if share > LARGEST_SHARE:
                pulled.add(row)
    return replace(floor, rms=rms, pulled=frozenset(pulled))


def judge_prediction(found: Validation) -> Judgement:
    """Judge the residual of a described robot: against noise with its own values, for what it lacks with any values.

    Values are those of its parameters, and delay and offset of every torque channel.

    Parameters
    ----------
    found
        The prediction. Of a long log that is judged as a whole, stretches are looked at.
    """
    segments = excerpts(found.signals.segments, found.signals.dt, JUDGED)
    if found.chosen is None and sum(map(len, segments)) < sum(map(len, found.signals.segments)):
        found = validate(found.robot, replace(found.signals, segments=segments))
    observation, signals = found.observation, found.corrected
    floor = propagated(found.model, signals, observation, replicates=1).floor(found.standard)

    channels = (*delay_columns(observation), *offset_columns(observation))

    def own(group: RowGroup) -> Array:
        columns = full_columns(group, channels, observation.parameters)[1]
        return np.concatenate([columns, *found.effect_columns.get(group.row, ())])

    seen = _judged_rows(signals, observation, found.residual, floor, own, found.chosen)
    lacking = {(item.joint, item.rows) for item in seen.insufficient}
    loud = {(item.joint, item.rows) for item in seen.noise if item.ratio > ABOVE} - lacking
    names = observation.robot.joint_names
    kept = {row: residual for row, residual in found.residual.items() if (names[row.joint], row.kind) in loud}
    off = _judged_rows(signals, observation, kept, floor, lambda g: g.columns[:0], found.chosen)
    return Judgement(tuple(seen.noise), tuple(seen.insufficient), misfitted=tuple(off.insufficient))


class _Seen(NamedTuple):
    """What the rows of one log say."""

    noise: list[RowNoise]
    insufficient: list[Insufficient]
    missing: list[Missing]
    curves: dict[int, Mapping[str, Array]]


def _judged_rows(
    signals: Signals,
    observation: Observation,
    left: Mapping[EstimationRow, Array],
    floor: Floor,
    own: Callable[[RowGroup], Array],
    chosen: NDArray[np.bool_] | None = None,
    *,
    fitted: bool = False,
) -> _Seen:
    """Judge the residual of every row; `own` returns the columns of a row that the model could take it with.

    What a model that is `fitted` could take and does not is what its rows do not agree on.
    """
    robot = observation.robot
    alone = signals.recording is None or signals.recording.parts == 1  # else times are of no log
    said = _Seen([], [], [], {})
    sizes = _sizes(observation, left, chosen)
    # what encoders leave of a deflection near their step is known to a factor of two: no sign of a torque that chatters
    asked = {row: item for row, item in sizes.items() if row not in floor.pulled}
    unknown = fitted and any(_quiet(item.size, floor.rms[row], item.torque) for row, item in asked.items())
    for group in observation.independent:
        row = group.row
        if row not in sizes:
            continue
        residual, (use, size, torque) = left[row], sizes[row]
        least = max(floor.rms[row], MATTERS * torque)
        name = robot.joint_names[row.joint]
        ratio = size / max(floor.rms[row], 1e-9 * torque)
        loud = size >= ABOVE * least
        moment = moment_of(residual, use, observation.t, floor.rms[row]) if loud and alone else None
        kept = memory(residual, use, observation.rate)
        said.noise.append(RowNoise(name, row.kind, floor.rms[row], ratio, kept, moment))
        if unknown and size < ABOVE * least:
            least, loud = size, size > OF_ALL * torque
        if not loud:
            continue
        if row.joint not in said.curves:
            # beside a joint torque sensor a drive's own row holds rotor and friction alone, not what loads them
            whole = observation.tau[row.joint] if row.kind == "drive" else group.target
            said.curves[row.joint] = motion_curves(signals, row.joint, robot, whole - residual)
        found = followed(residual, use, own(group), said.curves[row.joint])
        seen = size * float(np.sqrt(max(found.share, 0.0)))
        if found.beyond and seen > VISIBLE * least:
            said.insufficient.append(Insufficient(name, row.kind, ratio, found.groups[0], found.share))
            said.missing.append(Missing(row, found.groups, seen))
        elif (slow := slow_part(residual, group.target, use, own(group))) > ABOVE * least:
            said.insufficient.append(Insufficient(name, row.kind, ratio, PACE, 0.0))
            said.missing.append(Missing(row, found.groups, slow))
        elif fitted and (share := apart(residual, use, own(group))):
            said.insufficient.append(Insufficient(name, row.kind, ratio, APART, share))
            free = followed(residual, use, group.columns[:0], said.curves[row.joint])
            said.missing.append(Missing(row, free.groups, size * float(np.sqrt(share)), shared=True))
        elif size > FAR_ABOVE * least and row.kind == "motor" and size > OWN * _whole(left, observation, row):
            said.insufficient.append(Insufficient(name, row.kind, ratio, DEFLECTION, 0.0))
            said.missing.append(Missing(row, found.groups, size))
    return said


class _Size(NamedTuple):
    """What a row leaves: instants that count, rms of the residual and of the torque there, N·m (N)."""

    use: NDArray[np.bool_]
    size: float
    torque: float


def _sizes(
    observation: Observation, left: Mapping[EstimationRow, Array], chosen: NDArray[np.bool_] | None
) -> dict[EstimationRow, _Size]:
    """Return what every row that is judged leaves."""
    found = {}
    for group in observation.independent:
        row, use = group.row, group.use if chosen is None else group.use & chosen
        if row.kind == "link" or row not in left or np.count_nonzero(use) < _LEAST:
            continue
        size, torque = (float(np.sqrt(np.mean(y[use] ** 2))) for y in (left[row], observation.tau[row.joint]))
        found[row] = _Size(use, size, max(torque, 1e-300))
    return found


def _whole(left: Mapping[EstimationRow, Array], observation: Observation, row: EstimationRow) -> float:
    """Return the rms of the residual of a row's whole joint, N·m; infinite where there is none."""
    for group in observation.independent:
        if group.row == EstimationRow("sum", row.joint) and group.row in left and group.use.any():
            return float(np.sqrt(np.mean(left[group.row][group.use] ** 2)))
    return np.inf


def _excerpt(fit: DefaultFit) -> DefaultFit:
    """Return the fit over stretches of a long log: the same solution, fewer instants."""
    signals = fit.signals
    segments = excerpts(signals.segments, signals.dt, JUDGED)
    if sum(map(len, segments)) == sum(map(len, signals.segments)) or fit.effects is not None:
        return fit
    data = sampled(fit.model, replace(signals, segments=segments))
    data = data.counting(fit.observation.gliding)
    of_channel = {(e.name, sum_row(e).joint): e for e in (*data.delays, *data.offsets)}
    wanted = [(e.name, sum_row(e).joint) for e in fit.nuisances]
    if any(key not in of_channel for key in wanted):
        return fit
    nuisances = tuple(of_channel[key] for key in wanted)
    return replace(fit, data=data, nuisances=nuisances, triangles=data.triangles(nuisances))
