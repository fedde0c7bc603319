"""Several logs of one machine on the motor side: each is asked by itself, and what they show is put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.motor_side.result import LinkSensor, MotorSide, MotorSideJoint
from elid_cli.estimation.motor_side.verdict import REACH
from elid_cli.robot.robot import Robot
from elid_cli.signals.moving_joints import constant, held
from elid_cli.signals.recording import Recording, Segment

if TYPE_CHECKING:
    from elid_cli.estimation.request import LogRequest
    from elid_cli.estimation.streaming.reduced_log import ReducedLog

MOST = 4
"""Logs that are asked: some seconds of processor time each."""
DOUBT = 1e-3
"""Probability with which logs that agree are said to disagree."""
CONTRARY = frozenset({"sign", "gain"})
"""Gates that a rigid joint does not pass."""


def motor_side_of_files(robot: Robot, recording: Recording, still: NDArray[np.bool_]) -> MotorSide | None:
    """Return what the logs in one recording say, each by itself; None where there is no joint to ask for.

    `still` are the joints that rest in all of them, (n,).
    """
    from elid_cli.estimation.motor_side.estimate import motor_side

    found = []
    for number, name in list(enumerate(recording.files))[:MOST]:
        log = _of_file(recording, number)
        rests = still | constant(log.theta, log.segments) | held(log.q, log.theta, robot, log.segments)
        if (side := motor_side(robot, log, rests)) is not None:
            found.append((name, side))
    return put_together(found, len(recording.files)) if found else None


def motor_side_of_logs(request: LogRequest, logs: Sequence[ReducedLog]) -> MotorSide | None:
    """Return what logs that were reduced one by one say: their samples are read again.

    None where there is no joint to ask for. Stored triangles and standard input have no samples.
    """
    from elid_cli.estimation.motor_side.estimate import motor_side
    from elid_cli.logs import read_recording

    robot = request.robot
    hidden = np.flatnonzero(robot.elastic & logs[0].facts.unlinked)
    if not len(hidden):
        return None
    still = {file: log.facts.still for log in logs for file in log.recording.files if not log.origin}
    files = [log for log in request.logs if log in still and log != "-"]
    if not files:
        reason = "stored triangles hold no samples: identify the log itself"
        return MotorSide(tuple(MotorSideJoint(robot.joint_names[k], int(k), "refused", reason=reason) for k in hidden))
    found = []
    for log in files[:MOST]:
        recording = read_recording(
            [log], robot, request.mapping, strict=request.strict, rate=request.signals.rate, time_source=request.time
        )
        if (side := motor_side(robot, recording, still[log])) is not None:
            found.append((log, side))
    return put_together(found, len(request.logs)) if found else None


def put_together(found: Sequence[tuple[str, MotorSide]], logs: int) -> MotorSide:
    """Return what several logs say together.

    Parameters
    ----------
    found
        Names and answers of the logs that were asked, at least one.
    logs
        How many there are.
    """
    if logs == 1:
        return found[0][1]
    numbers = sorted({joint.number for _, side in found for joint in side.joints})
    joints = tuple(
        _joint([(name, joint) for name, side in found if (joint := side.of(number))], logs) for number in numbers
    )
    seconds = [side.seconds for _, side in found if np.isfinite(side.seconds)]
    misfits = [side.misfit for _, side in found if np.isfinite(side.misfit)]
    return MotorSide(
        joints, max(misfits, default=float("nan")), sum(seconds) if seconds else float("nan"), _sensors(found)
    )


def _sensors(found: Sequence[tuple[str, MotorSide]]) -> tuple[LinkSensor, ...]:
    """Return the sensors on links: where a log used one, as that found it, and beside it the logs that did not."""
    told: list[LinkSensor] = []
    for kind, joint in dict.fromkeys((sensor.kind, sensor.joint) for _, side in found for sensor in side.sensors):
        own = [(log, s) for log, side in found for s in side.sensors if (s.kind, s.joint) == (kind, joint)]
        told += [sensor for _, sensor in own if not sensor.reason][:1]
        left = [(log, sensor) for log, sensor in own if sensor.reason]
        told += [replace(sensor, reason=f"{log}: {sensor.reason}") for log, sensor in left]
    return tuple(told)


def _joint(said: Sequence[tuple[str, MotorSideJoint]], logs: int) -> MotorSideJoint:
    """Return what logs say together of a joint: a mean of those that are surest of it, or a refusal."""
    showing = _showing([joint for _, joint in said])
    count = f"{len(said)} logs that were asked, of {logs}," if len(said) < logs else f"{logs} logs"
    if not showing:
        nearest = max((joint for _, joint in said), key=lambda joint: np.nan_to_num(joint.band))
        return replace(nearest, reason=f"none of {count} shows it; {nearest.reason}", by_log=tuple(said))
    best = min(showing, key=lambda joint: joint.std_error)
    rigid = [name for name, joint in said if _rigid_beyond(joint, best.antiresonance)]
    if rigid:
        return _refused(best, f"logs disagree: {rigid[0]} passes the antiresonance and shows a rigid joint", said)
    value, error, common, disagree = _mean(showing)
    together = f"shown by {len(showing)} of {count}".rstrip(",")
    if disagree:
        together += ", which disagree by more than their errors: the difference counts as an error"
    return replace(
        best, stiffness=value, std_error=error, systematic=common, together=together, by_log=tuple(said),
        rigid_to=min(joint.rigid_to for joint in showing),
    )  # fmt: skip


def _showing(joints: Sequence[MotorSideJoint]) -> list[MotorSideJoint]:
    """Return the joints with the best verdict that any log gives, none where all refuse."""
    for verdict in ("supported", "weak"):
        if found := [joint for joint in joints if joint.verdict == verdict]:
            return found
    return []


def _rigid_beyond(joint: MotorSideJoint, antiresonance: float) -> bool:
    return joint.verdict == "refused" and joint.band >= REACH * antiresonance and bool(CONTRARY & set(joint.failed))


def _refused(joint: MotorSideJoint, reason: str, said: Sequence[tuple[str, MotorSideJoint]]) -> MotorSideJoint:
    bare = MotorSideJoint(joint.joint, joint.number, "refused", reference=joint.reference, band=joint.band)
    return replace(bare, reason=reason, motion=joint.motion, by_log=tuple(said))


def _mean(joints: Sequence[MotorSideJoint]) -> tuple[float, float, float, bool]:
    """Return the weighted mean of stiffnesses, its standard error, the part that logs share, and whether they disagree.

    What the curvature of each fit says is independent from log to log; the rest of an error is common to all. Where
    they scatter by more than their errors, these grow by the ratio (Birge 1932, Physical Review 40).
    """
    from scipy.special import chdtri

    values, errors = np.array([joint.stiffness for joint in joints]), np.array([joint.std_error for joint in joints])
    own = np.minimum(values * np.array([joint.gates.get("error", 1.0) for joint in joints]), errors)
    weights = errors**-2 / np.sum(errors**-2)
    value = float(weights @ values)
    common = float(weights @ np.sqrt(errors**2 - own**2))
    error = float(np.hypot(np.sqrt(np.sum((weights * own) ** 2)), common))
    scatter, freedom = float(np.sum(((values - value) / errors) ** 2)), len(joints) - 1
    disagree = freedom > 0 and scatter > float(chdtri(freedom, DOUBT))
    if disagree:
        error *= float(np.sqrt(scatter / freedom))
    return value, error, common, disagree


def _of_file(recording: Recording, number: int) -> Recording:
    """Return one log of a recording of several."""
    segments = [segment for segment in recording.segments if segment.source == number]
    rows = slice(segments[0].start, segments[-1].stop)
    moved = tuple(Segment(s.start - rows.start, s.stop - rows.start) for s in segments)
    return Recording(
        recording.joints, recording.dt, recording.t[rows], recording.q[rows], recording.theta[rows],
        recording.tau[rows], tau_link=None if recording.tau_link is None else recording.tau_link[rows],
        gyro={axis: values[rows] for axis, values in recording.gyro.items()},
        accel={axis: values[rows] for axis, values in recording.accel.items()}, segments=moved,
        files=(recording.files[number],),
    )  # fmt: skip
