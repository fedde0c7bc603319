"""Whether a recording that a program made fits a robot: `read_recording` and `recording_of` make only such."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elid_cli.errors import LogError, RobotError, UsageError, check_kind
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import MEASURED, Recording

UNEVEN = 0.01
"""Part of the sample time by which that of `t` may differ."""
HINT = "recording_of makes a recording from arrays: in the robot's order, aligned and checked"


def check_robot(robot: object, where: str = "robot") -> None:
    """Refuse a file's name or anything else in place of a robot (UsageError), and one without joints (RobotError)."""
    made = f"read_robot({str(robot)!r})" if isinstance(robot, str | Path) else "read_robot(file)"
    check_kind(where, robot, Robot, f"{made} reads one")
    assert isinstance(robot, Robot)
    if not robot.joints:
        raise RobotError(f"{where} {robot.name!r}: it has no joints", hint='Robot("arm", (Joint("shoulder"),))')


def is_robot(where: str, value: object) -> None:
    """Refuse anything in place of a robot, as a rule of an option (UsageError)."""
    check_robot(value, where)


def check_joints(joints: Sequence[str], robot: Robot, name: str = "signals") -> None:
    """Refuse what has the columns of other joints than the robot's, or in another order (LogError)."""
    check_robot(robot)
    if tuple(joints) != robot.joint_names:
        raise LogError(
            f"{name}: the joints are {', '.join(joints)}",
            detail=f"{robot.name!r} has {', '.join(robot.joint_names)}, and columns are taken in that order",
            hint=HINT,
        )


def check_fits(recording: Recording, robot: Robot) -> None:
    """Refuse a recording of other joints, with arrays of other shapes or with times of another rate (LogError)."""
    check_robot(robot)
    check_recording(recording)
    name = ", ".join(recording.files) or "recording"
    check_joints(recording.joints, robot, name)
    check_shapes(recording)
    if not recording.segments:
        raise LogError(f"{name}: it has no segments", detail="nothing says which samples belong together", hint=HINT)
    longest = max(recording.segments, key=len)
    times = recording.t[longest.start : longest.stop]
    step = float(np.median(np.diff(times))) if len(times) > 1 else recording.dt
    if not abs(step - recording.dt) <= UNEVEN * recording.dt:
        raise LogError(
            f"{name}: its times are {step:.6g} s apart and dt says {recording.dt:.6g} s",
            hint=HINT,
        )


def check_recording(recording: object) -> None:
    """Refuse what is no recording (UsageError)."""
    check_kind("recording", recording, Recording, "read_recording reads one, recording_of makes one of arrays")


def check_shapes(recording: Recording) -> None:
    """Refuse what is no recording (UsageError), and one whose arrays are of different shapes (LogError)."""
    check_recording(recording)
    name = ", ".join(recording.files) or "recording"
    wanted = (recording.samples, recording.n)
    for signal in (*MEASURED, *recording.commands, *recording.gyro, *recording.accel):
        values = recording.signal(signal)
        if values is not None and values.shape != wanted:
            raise LogError(
                f"{name}: {signal} has the shape {values.shape}",
                detail=f"{recording.samples} times and {recording.n} joints want {wanted}",
                hint=HINT,
            )


def check_accelerations(accelerations: object, recording: Recording) -> None:
    """Refuse what are not accelerations of links and of motors, an array (N, n) each (UsageError)."""
    if accelerations is None:
        return
    wanted = (recording.samples, recording.n)
    pair = accelerations if isinstance(accelerations, tuple | list | np.ndarray) else ()
    if len(pair) != 2 or any(np.shape(values) != wanted for values in pair):
        given = f"a value of type {type(accelerations).__name__}"
        shapes = [str(np.shape(values)) for values in pair[:2]]
        raise UsageError(
            f"prepare: accelerations: {' and '.join(shapes) or given}",
            hint=f"a pair of arrays, of links and of motors, of shape {wanted} each",
        )
