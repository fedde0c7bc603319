"""What the last log could not show, and how well it was predicted: what the next trajectory is for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from elid_cli.errors import UsageError
from elid_cli.estimation.result import Identification
from elid_cli.files import read_text
from elid_cli.robot.robot import Robot

LARGEST = 50_000_000
"""Bytes of the largest result that is read."""
HIDDEN = ("weak", "not excited")
"""Classes of parameters that a better log would show."""


@dataclass(frozen=True)
class LastLog:
    """One identification, as far as the next trajectory needs it."""

    hidden: tuple[str, ...]
    """Parameters that the robot could show and the log did not."""
    residual: tuple[tuple[float, float], ...]
    """Held-out error of each joint's sum and motor row, rms, N·m (N); 0 where unknown."""


def last_of(found: Identification) -> LastLog:
    """Return what an identification leaves to be done."""
    rms = {joint: (e.rms, e.spring_rms or e.rms) for joint, e in found.error.items()}
    return _last(found.robot, found.this_log, rms, found.drives)


def is_result(path: str | Path) -> bool:
    """Return whether a file looks like a result saved with ``--json``; a log never begins with a brace."""
    try:
        if not Path(path).is_file():  # a pipe would be waited for
            return False
        with Path(path).open("rb") as stream:
            return stream.read(64).lstrip().startswith(b"{")
    except OSError:
        return False  # whoever reads it as a log says what is wrong


def read_last(path: str | Path, robot: Robot) -> LastLog:
    """Read a saved result of ``elid identify`` or ``elid diagnose``.

    Raises
    ------
    UsageError
        The file is no such result, or one of a robot with other joints.
    """
    text = read_text(Path(path), UsageError, suffixes=(".json",), most=LARGEST)
    try:
        saved: Any = json.loads(text)
        classes, errors, joints = dict(saved["this_log"]), dict(saved["error"]), tuple(saved["joints"])
        fit = saved.get("settings", {}).get("trajectory") or {}
        drives = {str(joint): {kind: dict(v) for kind, v in own.items()}
                  for joint, own in dict(fit.get("joint_parameters") or {}).items()}  # fmt: skip
        rms = {str(joint): (float(e["rms"]), float(e.get("spring_rms") or e["rms"])) for joint, e in errors.items()}
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        raise UsageError(
            f"{path}: not a result of elid identify", hint="elid identify LOG --robot ROBOT --json > result.json"
        ) from None
    if joints != robot.joint_names:
        raise UsageError(
            f"{path}: is of a robot with joints {', '.join(joints)}",
            detail=f"{robot.name!r} has {', '.join(robot.joint_names)}",
        )
    return _last(robot, classes, rms, drives)


def _last(
    robot: Robot, classes: Mapping[str, str], rms: Mapping[str, tuple[float, float]],
    drives: Mapping[str, Mapping[str, Mapping[str, Any]]],
) -> LastLog:  # fmt: skip
    if drives:  # the bodies were held at the file's values, and not looked for
        weak = {(joint, kind) for joint, own in drives.items() for kind, value in own.items()
                if value.get("verdict", "supported") != "supported"}  # fmt: skip
        names = robot.joint_names
        hidden = tuple(name for name in robot.parameter_names() if (names[name.joint], name.kind) in weak)
    else:
        hidden = tuple(name for name in robot.parameter_names() if classes.get(name) in HIDDEN)
    return LastLog(hidden, tuple(rms.get(joint, (0.0, 0.0)) for joint in robot.joint_names))
