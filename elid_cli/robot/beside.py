"""The YAML beside a URDF or MJCF: ``arm.elid.yaml`` holds what those formats cannot.

Its keys are ``joints: {NAME: {gear_ratio, transmission, motor_axis, limits, parameters}}``, ``gravity``,
``description``, ``effects``, ``log``, ``control`` and ``payload``, read and checked as those of a robot description,
and ``tip: LINK`` and ``lock: {NAME: VALUE}``, which hold joints as ``--tip`` and ``--lock`` do; ``log`` is of the
joints that remain. ``elid init`` writes it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from elid_cli.errors import RobotError, UsageError, did_you_mean
from elid_cli.files import read_text
from elid_cli.robot.robot import Robot
from elid_cli.robot.schema import MOTOR_KEYS, read_further, read_log, read_vector, with_motor
from elid_cli.robot.yaml import Value, parse_yaml

SUFFIX = ".elid.yaml"
KEYS = ("gravity", "description", "effects", "log", "joints", "control", "payload", "tip", "lock")


def beside_file(path: Path) -> Path:
    """Return where the YAML beside a robot's own file is: ``arm.elid.yaml`` for ``arm.urdf``."""
    return path.with_suffix(SUFFIX)


def robot_with(robot: Robot, path: Path) -> Robot:
    """Return the robot completed from the YAML beside its own file, unchanged where there is none.

    Raises
    ------
    RobotError
        With file, line and key, as for a robot description.
    """
    if not path.exists():
        other = path.with_name(path.name.replace(SUFFIX, ".yaml"))
        if not other.exists() or re.search(rb"^dh\s*:", other.read_bytes(), re.MULTILINE):  # a robot of its own
            return robot
        return replace(robot, notes=(*robot.notes, f"{other} is not read: what completes this robot is {path.name}"))
    return completed(robot, read_text(path, RobotError), str(path))


def completed(robot: Robot, text: str, file: str) -> Robot:
    """Return the robot completed from the text of such a YAML; `file` names it in errors (RobotError as above)."""
    top = parse_yaml(text, file).fields((), KEYS)
    joints = list(robot.joints)
    if "joints" in top:
        for key, value in top["joints"].entries():
            if key.text() not in robot.joint_names:
                raise key.error(f"no joint {key.text()!r}", hint=did_you_mean(key.text(), robot.joint_names))
            index = robot.joint_names.index(key.text())
            joints[index] = with_motor(joints[index], value.within(key.text()).fields((), MOTOR_KEYS))
    gravity = read_vector(top["gravity"]) if "gravity" in top else robot.gravity
    robot = replace(robot, joints=tuple(joints), gravity=gravity)
    robot = _held(replace(robot, **read_further(top, joints)), top, file)
    return replace(robot, log=read_log(top["log"])) if "log" in top else robot


def _held(robot: Robot, top: Mapping[str, Value], file: str) -> Robot:
    """Return the robot with the joints locked that ``tip`` and ``lock`` name, and a note that says so."""
    from elid_cli.robot.locking import beside_chain, beyond_limits, locked

    held: dict[str, float] = {}
    if "tip" in top:
        try:
            held = dict.fromkeys(beside_chain(robot, top["tip"].text()), 0.0)
        except UsageError as fault:
            raise top["tip"].error(fault.message.removeprefix("--tip "), hint=fault.hint) from None
    if "lock" in top:
        for name, value in top["lock"].numbers_by_name():
            if name not in robot.joint_names:
                raise top["lock"].error(f"no joint {name!r}", hint=did_you_mean(name, robot.joint_names))
            held[name] = value
    if not held:
        return robot
    told = ", ".join(f"{name} at {value:g}" for name, value in held.items())
    notes = (*robot.notes, f"locked as {Path(file).name} says: {told}", *beyond_limits(robot, held))
    return replace(locked(robot, held), notes=notes)
