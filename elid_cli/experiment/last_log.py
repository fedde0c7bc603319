"""What the last log could not show, and how well it was predicted: what the next trajectory is for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from elid_cli.errors import UsageError
from elid_cli.estimation.result import Identification
from elid_cli.estimation.saved_results import AGAIN, check_joints, saved_object
from elid_cli.robot.robot import Robot

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


def read_last(path: str | Path, robot: Robot) -> LastLog:
    """Read a saved result of ``elid identify`` or ``elid diagnose``.

    Raises
    ------
    UsageError
        The file is no such result, or one of a robot with other joints.
    """
    saved = saved_object(path)
    try:
        classes, errors = dict(saved["this_log"]), dict(saved["error"])
        fit = saved.get("settings", {}).get("trajectory") or {}
        drives = {str(joint): {kind: dict(v) for kind, v in own.items()}
                  for joint, own in dict(fit.get("joint_parameters") or {}).items()}  # fmt: skip
        rms = {str(joint): (float(e["rms"]), float(e.get("spring_rms") or e["rms"])) for joint, e in errors.items()}
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        raise UsageError(f"{path}: not a result of elid identify", hint=AGAIN) from None
    check_joints(saved, robot, path)
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
