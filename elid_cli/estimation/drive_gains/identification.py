"""Identification from a pair of logs, the second with a known payload: gains of the drives, then the parameters."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import options_given
from elid_cli.errors import DataError, UsageError
from elid_cli.estimation.drive_gains.gain_errors import with_gain_errors
from elid_cli.estimation.drive_gains.payload import declared, effect_of
from elid_cli.estimation.drive_gains.solve import DriveRows, PairFit, fit_pair
from elid_cli.estimation.identified import Identified
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.reading import read_signals
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.request import LogRequest
from elid_cli.estimation.result import DriveGain, Verdict
from elid_cli.estimation.streaming.stored import is_triangle_file
from elid_cli.logs.checks.known_masses import BESIDE_WEIGHT
from elid_cli.logs.checks.limits import beyond_limits
from elid_cli.logs.checks.units_and_signs import NOT_TORQUE
from elid_cli.model.base_parameters import BaseParameters, find_base
from elid_cli.model.effects.declared import as_observed
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.robot import Payload, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare

NORMAL = 1.96
"""Standard errors to either side that hold 95 %."""
ZERO_INSIDE = 1 / NORMAL
"""Relative standard error beyond which 0 lies in the interval of one over the gain: it is not known at all."""
TORQUE_SIZE = ("tau reaches", "tau looks like", NOT_TORQUE, BESIDE_WEIGHT)
"""What warnings say that doubt the size of a logged torque; the first one compares it with the robot's limits."""
WEAK = 0.3
"""Relative standard error beyond which it is known only roughly."""


def identify_with_payload(
    request: LogRequest, options: EstimateOptions, payload: Payload | None, *, keep_signals: bool = False
) -> Identified:
    """Find the drives' gains from two logs, without and with the payload, and the parameters from the first.

    Parameters
    ----------
    request
        The two logs, in this order, and how to read them; `tau` in any unit.
    options
        How the parameters are estimated, once the torque is in N·m (N).
    payload
        What the second log was recorded with; None: what the robot's file declares.
    keep_signals
        As for `identify_logs`.

    Raises
    ------
    UsageError
        Not two logs of samples, a robot with effects, a joint that the robot does not have.
    DataError
        The logs tell no gain, or tell that they are in the other order.
    """
    _check(request)
    robot = request.robot
    payload = payload or declared(robot)
    recording, signals = read_signals(_unwarned(request))
    seen = as_observed(robot, signals)
    model = Regressor(seen)
    base = find_base(model)
    sources = np.array([segment.source for segment in signals.segments])
    observation = observe(model, signals)
    rows = [_rows_of(observation, base, model, joint) for joint in range(robot.n)]
    known, unknown = effect_of(payload, seen, base)
    fit = fit_pair(rows, sources[observation.segment] == 1, observation.segment, known, unknown)
    gains = _judged(seen, fit, payload, request)
    first = _of_source(recording, 0)
    scale = np.array([np.nan if item.gain is None else item.gain for item in gains])
    first = _in_torque(replace(first, tau=first.tau * scale))
    over = (line for line in beyond_limits(first.theta, first.tau, first.dt, robot) if TORQUE_SIZE[0] in line)
    first = replace(first, warnings=(*first.warnings, *over))
    signals = prepare(first, robot, request.signals)
    options = replace(options_given("identify", options, EstimateOptions), fit="torque")  # the gains are about it
    found = with_gain_errors(identify(robot, signals, options), fit.relative)
    whole = all(item.gain is not None for item in gains)
    line = _mapping(request, first, gains) if whole else ""
    said = [f"with the gains the torque is mapped by {line}"] if whole else []
    said.append("standard errors of parameters contain those of the gains")
    found = replace(found, drive_gains=gains, gain_map=line, notes=(*found.notes, *said))
    return Identified(found, first, (), signals if keep_signals else None)


def _in_torque(recording: Recording) -> Recording:
    """Return a recording without warnings of how large its torques are, which the gains turn into N·m (N)."""
    kept = (line for line in recording.warnings if not any(words in line for words in TORQUE_SIZE))
    return replace(recording, warnings=tuple(kept))


def _unwarned(request: LogRequest) -> LogRequest:
    """Return the request with those warnings kept from whoever is told of what was read."""
    told = request.on_read
    if told is None:
        return request
    return replace(request, on_read=lambda read, every: told([_in_torque(part) for part in read], every))


def _check(request: LogRequest) -> None:
    if len(request.logs) != 2:
        raise UsageError(
            f"--payload needs two logs, without and with it; {len(request.logs)} named",
            hint="elid identify empty.mcap loaded.mcap --robot R --payload 2.805@joint6",
        )
    stored = next((log for log in request.logs if is_triangle_file(log)), None)
    if stored is not None:
        raise UsageError(f"{stored}: a reduced log does not suffice for --payload", hint="name the logs themselves")
    if request.robot.effects:
        raise UsageError(
            f"--payload: {request.robot.name} declares effects, which are in units of the torque",
            hint="leave them out until the gains are known",
        )


def _rows_of(observation: Observation, base: BaseParameters, model: Regressor, joint: int) -> DriveRows | None:
    """Return a joint's equations with the spring eliminated; None where its torque is not logged."""
    row = EstimationRow("sum", joint)
    group = next((item for item in observation.groups if item.row == row and item.count), None)
    if group is None:
        return None
    columns = np.zeros((base.count, observation.instants))
    place = np.full(model.parameters, -1)
    place[base.leaders] = np.arange(base.count)
    led = place[group.index] >= 0
    columns[place[group.index[led]]] = group.columns[led]
    nuisances = np.vstack([np.ones(observation.instants), observation.tau_rate[joint]])
    return DriveRows(columns, nuisances, group.target, group.use & np.isfinite(nuisances[1]))


def _judged(robot: Robot, fit: PairFit, payload: Payload, request: LogRequest) -> tuple[DriveGain, ...]:
    """Return the gains with their verdicts (DataError: none is told, or the logs are in the other order)."""
    found = []
    for name, gain, deviation in zip(robot.joint_names, fit.gain, fit.std_error, strict=True):
        if not deviation <= ZERO_INSIDE * abs(gain):  # NaN too
            found.append(DriveGain(name, None, None, None, "refused"))
        else:
            verdict: Verdict = "weak" if deviation > WEAK * abs(gain) else "supported"
            near, far = (gain / (1 + side * NORMAL * deviation / abs(gain)) for side in (1, -1))
            interval = (float(min(near, far)), float(max(near, far)))
            found.append(DriveGain(name, float(gain), float(deviation), interval, verdict))
    told = [item for item in found if item.gain is not None]
    if not told:
        centre = (
            "" if payload.centre else f", or say where its centre is: --payload {payload.mass:g}@{payload.joint}:X,Y,Z"
        )
        raise DataError(
            "no drive's gain can be found: the payload changes no torque by more than the error",
            detail="its share of each joint's torque, with unknown centre and inertia, must stand out of the noise",
            hint=f"move joints that lift the payload, or take a heavier one{centre}",
        )
    if all(item.gain is not None and item.gain < 0 for item in told):
        empty, loaded = request.logs
        raise DataError(
            "every drive's gain comes out negative: the logs are in the other order, or the torques' signs wrong",
            detail=f"{empty} is taken as the log without the payload, {loaded} as the one with it",
            hint=f"elid identify {shlex.join([loaded, empty])} … --payload {payload.mass:g}@{payload.joint}",
        )
    return tuple(found)


def _of_source(recording: Recording, source: int) -> Recording:
    """Return one log of a recording."""
    segments = [segment for segment in recording.segments if segment.source == source]
    start, stop = segments[0].start, segments[-1].stop
    part = slice(start, stop)

    def cut(values: Array | None) -> Array | None:
        return None if values is None else values[part]

    return replace(
        recording,
        t=recording.t[part] - recording.t[start],
        q=recording.q[part], theta=recording.theta[part], tau=recording.tau[part],
        dq=cut(recording.dq), dtheta=cut(recording.dtheta), tau_link=cut(recording.tau_link),
        temperature=cut(recording.temperature),
        gyro={axis: values[part] for axis, values in recording.gyro.items()},
        accel={axis: values[part] for axis, values in recording.accel.items()},
        commands={signal: values[part] for signal, values in recording.commands.items()},
        segments=tuple(replace(s, start=s.start - start, stop=s.stop - start, source=0) for s in segments),
    )  # fmt: skip


def _mapping(request: LogRequest, recording: Recording, gains: tuple[DriveGain, ...]) -> str:
    """Return the line of a mapping that has the gains in it, beside what was given for the torque."""
    from elid_cli.robot.yaml import quoted

    given = (request.mapping or {}).get("tau") or request.robot.log.get("tau")
    entry: dict[str, Any] = dict(given) if isinstance(given, Mapping) else {"from": given or recording.sources["tau"]}
    before = entry.pop("scale", 1.0)
    scale = [f"{_own(before, item.joint, k) * (item.gain or 1.0):.6g}" for k, item in enumerate(gains)]
    words = [f"{key}: {quoted(value) if isinstance(value, str) else value}" for key, value in entry.items()]
    return f"tau: {{{', '.join(words)}, scale: [{', '.join(scale)}]}}"


def _own(scale: Any, joint: str, k: int) -> float:
    """Return a joint's part of a scale as it was given."""
    return float(
        scale.get(joint, 1.0) if isinstance(scale, Mapping) else scale[k] if isinstance(scale, list) else scale
    )
