"""A robot as text: the YAML that reads back to exactly the same robot, and the fingerprint of its model."""

from __future__ import annotations

import hashlib
import json
import math
import textwrap
from collections.abc import Mapping, Sequence

from elid_cli.robot.parameter import JOINT_PARAMETERS
from elid_cli.robot.robot import Joint, Limits, Robot
from elid_cli.robot.yaml import emit, quoted

COMMENT = 110
"""Characters of a line of comment."""
_ANGLES = {"pi/2": math.pi / 2, "-pi/2": -math.pi / 2, "pi": math.pi, "-pi": -math.pi}


def text_of(robot: Robot, remarks: Sequence[str] = ()) -> str:
    """Return the YAML description of a robot: deterministic, every number exact; `remarks` as comments above it."""
    lines = [f"# {line}" for remark in remarks for line in textwrap.wrap(remark, COMMENT, subsequent_indent="  ")]
    lines.append(f"name: {quoted(robot.name)}")
    if robot.description:
        lines.append(f"description: {quoted(robot.description)}")
    lines += [f"gravity: {_list(robot.gravity)}", f"dh: {robot.dh}", "joints:"]
    for joint in robot.joints:
        first, *rest = _joint(joint, robot.dh == "urdf")
        lines += [f"  - {first}", *(f"    {line}" for line in rest)]
    if robot.effects:
        lines.append("effects:")
        for effect in robot.effects:
            where = f", joint: {quoted(effect.joint)}" if effect.joint is not None else ""
            values = f", parameters: {_map(effect.parameters)}" if effect.parameters else ""
            lines.append(f"  - {{effect: {effect.effect}{where}{values}}}")
    if robot.control:
        lines += ["control:", *(f"  {gain}: {_map(values)}" for gain, values in robot.control.items())]
    if robot.payload is not None:
        centre = f", centre: {_list(robot.payload.centre)}" if robot.payload.centre is not None else ""
        carrier = quoted(robot.payload.joint)
        lines.append(f"payload: {{mass: {_number(robot.payload.mass)}, joint: {carrier}{centre}}}")
    if robot.log:
        lines += ["log:", *emit(_thawed(robot.log), 1)]
    return "\n".join(lines) + "\n"


def _joint(joint: Joint, urdf: bool) -> list[str]:
    lines = [f"name: {quoted(joint.name)}", f"type: {joint.type}"]
    if joint.parent:
        lines.append(f"parent: {quoted(joint.parent)}")
    if urdf:
        lines += [f"xyz: {_list(joint.xyz)}", f"rpy: {_list(joint.rpy)}", f"axis: {_list(joint.axis)}"]
    else:
        lines += [f"{key}: {_number(getattr(joint, key))}" for key in ("a", "alpha", "d", "theta")]
    if joint.gear_ratio is not None:
        lines.append(f"gear_ratio: {_number(joint.gear_ratio)}")
    if joint.gear_ratio is not None or joint.motor_axis != (0.0, 0.0, 1.0):
        lines.append(f"motor_axis: {_list(joint.motor_axis)}")
    lines.append(f"transmission: {joint.transmission}")
    if joint.limits != Limits():
        lines.append(f"limits: {_limits(joint.limits)}")
    if joint.parameters:
        ordered = {name: joint.parameters[name] for name in JOINT_PARAMETERS if name in joint.parameters}
        lines.append(f"parameters: {_map(ordered)}")
    return lines


def _limits(limits: Limits) -> str:
    parts = [f"position: {_list(limits.position)}"] if limits.position is not None else []
    for name in ("velocity", "acceleration", "torque"):
        value = getattr(limits, name)
        if value is not None:
            parts.append(f"{name}: {_number(value)}")
    return "{" + ", ".join(parts) + "}"


def _map(values: Mapping[str, float]) -> str:
    return "{" + ", ".join(f"{quoted(name)}: {_number(value)}" for name, value in values.items()) + "}"


def _list(values: tuple[float, ...]) -> str:
    return "[" + ", ".join(_number(value) for value in values) + "]"


def _number(value: float) -> str:
    """Return the shortest text that reads back to the same number; quarter turns as people write them."""
    value = float(value)
    for text, angle in _ANGLES.items():
        if value == angle:
            return text
    text = repr(value)
    return text.removesuffix(".0") if text != "-0.0" else text


def _thawed(data: object) -> object:
    """Return nested data with plain dicts and lists in place of read-only views and tuples."""
    if isinstance(data, Mapping):
        return {str(key): _thawed(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_thawed(value) for value in data]
    return data


def fingerprint(robot: Robot) -> str:
    """Return the sha256 of what decides the model's equations.

    Joints, geometry, gravity, gears, transmissions and declared effects count; the name, the description, reference
    parameters, limits and the log mapping do not.
    """
    geometry = ("xyz", "rpy", "axis") if robot.dh == "urdf" else ("a", "alpha", "d", "theta")
    keys = ("name", "type", *geometry, "gear_ratio", "motor_axis", "transmission")
    model = {
        "gravity": _plus_zero(robot.gravity),
        "dh": robot.dh,
        "joints": [
            {key: _plus_zero(getattr(joint, key)) for key in keys}
            | ({"parent": joint.parent} if joint.parent else {})
            | ({"transmission": "elastic" if joint.elastic else "rigid"} if joint.transmission == "auto" else {})
            for joint in robot.joints
        ],
        "effects": [[effect.effect, effect.joint, dict(effect.parameters)] for effect in robot.effects],
    }
    return hashlib.sha256(json.dumps(model, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _plus_zero(value: object) -> object:
    """Return numbers as floats without a signed zero, so that 0 and -0.0 describe one robot."""
    if isinstance(value, tuple):
        return [_plus_zero(item) for item in value]
    return float(value) + 0.0 if isinstance(value, int | float) else value
