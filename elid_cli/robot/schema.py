"""What a robot description may hold: YAML values in, `Robot` out, every fault with file, line, joint and key.

The keys are those of docs/reference/formats.md, robot files. With ``dh: urdf``, the keys ``xyz``, ``rpy`` and ``axis``
stand in place of ``a alpha d theta``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from elid_cli.errors import did_you_mean
from elid_cli.robot.parameter import JOINT_PARAMETERS
from elid_cli.robot.robot import BASE, MOST_JOINTS, Convention, EffectSpec, Joint, Limits, Payload, Robot
from elid_cli.robot.yaml import Value, parse_yaml

MOST_EFFECTS, MOST_AT_A_JOINT = 200, 20
LEAST_LIMIT, LEAST_GEAR = 1e-9, 1e-9
"""Sizes below which a limit, or a gear ratio, is none."""
UNIT = 1e-6
"""How far the length of a written axis may be from 1; it is then normalised."""

_TOP = ("name", "gravity", "dh", "joints")
_TOP_OPTIONAL = ("description", "effects", "log", "control", "payload")
_GEOMETRY = {"standard": ("a", "alpha", "d", "theta"), "urdf": ("xyz", "rpy", "axis")}
TRANSMISSIONS = ("elastic", "rigid", "auto")
MOTOR_KEYS = ("gear_ratio", "motor_axis", "transmission", "parameters", "limits")
"""What a joint may say of its motor, transmission, parameters and limits."""
_JOINT_OPTIONAL = ("type", "parent", *MOTOR_KEYS)


def robot_of_yaml(text: str, file: str) -> Robot:
    """Return the robot that a YAML text describes; `file` names it in errors.

    Raises
    ------
    RobotError
        Naming file, line, joint and key, with the nearest valid key.
    """
    top = parse_yaml(text, file).fields(_TOP, _TOP_OPTIONAL)
    convention = cast(Convention, top["dh"].choice(("standard", "modified", "urdf")))
    joints = _joints(top["joints"], convention)
    return Robot(
        name=top["name"].name(),
        joints=joints,
        gravity=read_vector(top["gravity"]),
        dh=convention,
        log=read_log(top["log"]) if "log" in top else {},
        **read_further(top, joints),
    )


def read_further(top: Mapping[str, Value], joints: Sequence[Joint]) -> dict[str, Any]:
    """Return what a file says beyond joints, gravity and log, as `Robot` has it, for the keys that it has."""
    names = [joint.name for joint in joints]
    readers: dict[str, Callable[[Value], Any]] = {
        "description": Value.text,
        "effects": lambda value: read_effects(value, joints),
        "control": lambda value: read_control(value, names),
        "payload": lambda value: read_payload(value, names),
    }
    return {key: read(top[key]) for key, read in readers.items() if key in top}


def _joints(value: Value, convention: Convention) -> tuple[Joint, ...]:
    items = value.items()
    if not 1 <= len(items) <= MOST_JOINTS:
        raise value.error(f"{len(items)} joints; 1 to {MOST_JOINTS} are read")
    joints: list[Joint] = []
    for number, item in enumerate(items, start=1):
        joint = _joint(item, number, convention, [other.name for other in joints])
        if joint.name in [other.name for other in joints]:
            raise item.within(joint.name).error("a second joint of this name", hint="every joint needs its own name")
        joints.append(joint)
    return tuple(joints)


def _joint(value: Value, number: int, convention: Convention, before: Sequence[str]) -> Joint:
    geometry = _GEOMETRY.get(convention, _GEOMETRY["standard"])
    value = value.within(_label(value, number))
    keys = value.fields(("name", *geometry), _JOINT_OPTIONAL)
    parent = keys["parent"].text() if "parent" in keys else ""
    if "parent" in keys and parent not in (BASE, *before):
        what = f"{parent!r} is no joint above this one" if parent else "expected the name of a joint, found nothing"
        hint = did_you_mean(parent, (BASE, *before)) or f"parents stand before what they carry; {BASE!r}: the base"
        raise keys["parent"].error(what, hint=hint)
    if parent == BASE and BASE in before:
        raise keys["parent"].error(
            f"{BASE!r} is what the base is called, and a joint above: give the joint another name"
        )
    placement: dict[str, Any] = {
        key: keys[key].number() if convention != "urdf" else read_vector(keys[key], unit=key == "axis")
        for key in geometry
    }
    joint = Joint(
        name=keys["name"].name(),
        type=_choice(keys, "type", ("revolute", "prismatic")),
        parent="" if parent == (before[-1] if before else BASE) else parent,
        **placement,
    )
    return with_motor(joint, keys)


def with_motor(joint: Joint, keys: Mapping[str, Value]) -> Joint:
    """Return the joint with what the keys say of its motor, transmission, parameters and limits, the rest as it is."""
    if "parameters" in keys:
        joint = replace(joint, parameters=dict(joint.parameters) | read_parameters(keys["parameters"]))
    if "gear_ratio" in keys:
        ratio = keys["gear_ratio"].number()
        if abs(ratio) < LEAST_GEAR:
            raise keys["gear_ratio"].error("0; the rotor turns per joint turn, 1 for a direct drive")
        joint = joint.geared(ratio)
    if joint.gear_ratio is None and "Jm" in joint.parameters and "parameters" in keys:
        raise keys["parameters"].error(
            "Jm is the rotor's own inertia, and the gear ratio is not given",
            hint="give gear_ratio, or the inertia at the joint: Ja",
        )
    if "motor_axis" in keys:
        joint = replace(joint, motor_axis=read_vector(keys["motor_axis"], unit=True))
    if "transmission" in keys:
        joint = replace(joint, transmission=_choice(keys, "transmission", TRANSMISSIONS))
    return replace(joint, limits=read_limits(keys["limits"])) if "limits" in keys else joint


def _label(value: Value, number: int) -> str:
    """Return how errors call a joint: by its name where it can be read, by its number otherwise."""
    for key, name in value.within(f"joint {number}").entries():
        if key.text() == "name":
            return name.within(f"joint {number}").name()
    return f"joint {number}"


def read_parameters(value: Value) -> dict[str, float]:
    """Return a joint's reference parameters from a mapping of name to number (an empty value: none).

    Raises
    ------
    RobotError
        An unknown name, no number, or both inertias of the rotor.
    """
    if value.node.value == "":
        return {}
    found = {name: entry.number() for name, entry in value.fields((), JOINT_PARAMETERS).items()}
    if {"Ja", "Jm"} <= set(found):
        raise value.error(
            "Ja and Jm are the same inertia, at the joint and at the rotor", hint="give Jm and gear_ratio, or Ja alone"
        )
    return found


def read_limits(value: Value) -> Limits:
    """Return a joint's limits: position [low, high], the others positive magnitudes."""
    keys = value.fields((), ("position", "velocity", "acceleration", "torque"))
    position = None
    if "position" in keys:
        low, high = keys["position"].numbers(2)
        if not low < high:
            raise keys["position"].error(f"[{low:g}, {high:g}] is not [low, high]")
        position = (low, high)
    magnitudes: dict[str, float] = {}
    for name in ("velocity", "acceleration", "torque"):
        if name in keys:
            magnitudes[name] = keys[name].number()
            if magnitudes[name] < LEAST_LIMIT:
                raise keys[name].error(f"{magnitudes[name]:g} is not a positive magnitude")
    return Limits(position=position, **magnitudes)


def read_effects(value: Value, joints: Sequence[Joint]) -> tuple[EffectSpec, ...]:
    """Return the declared effects (an empty value: none).

    Which effects and parameters there are is the library's to know (`resolve` of declared effects).
    """
    if value.node.value == "":
        return ()
    names = [joint.name for joint in joints]
    if len(value.items()) > MOST_EFFECTS:
        raise value.error(f"{len(value.items())} effects; at most {MOST_EFFECTS} are read")
    effects = []
    for number, item in enumerate(value.items(), start=1):
        item = item.within(f"effect {number}")
        keys = item.fields(("effect",), ("joint", "parameters"))
        joint = keys["joint"].text() if "joint" in keys else None
        if joint is not None and joint not in names:
            raise keys["joint"].error(f"no joint {joint!r}", hint=did_you_mean(joint, names))
        effect = keys["effect"].text()
        place = f"{effect} of {joint}" if joint else effect
        parameters = dict(keys["parameters"].within(place).numbers_by_name()) if "parameters" in keys else {}
        effects.append(EffectSpec(effect, joint, parameters, item.where))
        # the time of a fit grows with the square of the columns at one joint
        if sum(spec.joint == joint for spec in effects) > MOST_AT_A_JOINT:
            raise item.error(f"more than {MOST_AT_A_JOINT} effects at {joint or 'the robot as a whole'}")
    return tuple(effects)


def read_log(value: Value) -> dict[str, Any]:
    """Return the log mapping uninterpreted, its keys with their places: what it means is the mapping's own business."""
    data = value.plain(placed=True)
    if data is None:
        data = {}
    if not isinstance(data, dict):
        raise value.error("not a mapping of signals", hint="log: {q: {from: …}, …}")
    return data


def read_control(value: Value, joints: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the gains ``kp`` and ``kd`` of every joint: one number, one per joint, or joints by name."""
    found: dict[str, dict[str, float]] = {}
    for gain, entry in value.fields((), ("kp", "kd")).items():
        plain = entry.plain()
        if isinstance(plain, list):
            given = dict(zip(joints, entry.numbers(len(joints)), strict=True))
        else:
            named = entry.numbers_by_name() if isinstance(plain, dict) else dict.fromkeys(joints, entry.number())
            given = dict(named)
        for joint, number in given.items():
            if joint not in joints:
                raise entry.error(f"no joint {joint!r}", hint=did_you_mean(joint, joints))
            if number < 0:
                raise entry.error(f"{number:g} of {joint}: gains are not negative")
        found[gain] = given
    return found


def read_payload(value: Value, joints: Sequence[str]) -> Payload:
    """Return a payload: its mass, the joint whose body carries it, and its centre of mass where that is known."""
    keys = value.fields(("mass", "joint"), ("centre",))
    mass, joint = keys["mass"].number(), keys["joint"].text()
    if not mass > 0:
        raise keys["mass"].error(f"{mass:g} kg is no payload")
    if joint not in joints:
        raise keys["joint"].error(f"no joint {joint!r}", hint=did_you_mean(joint, joints))
    return Payload(mass, joint, read_vector(keys["centre"]) if "centre" in keys else None)


def read_vector(value: Value, *, unit: bool = False) -> tuple[float, float, float]:
    """Return three numbers; with `unit`, of length 1 within `UNIT`, and normalised."""
    x, y, z = value.numbers(3)
    if not unit:
        return x, y, z
    length = math.hypot(x, y, z)
    if abs(length - 1) > UNIT:
        hint = f"[{x / length:.9g}, {y / length:.9g}, {z / length:.9g}]" if length > 0 else "[0, 0, 1]"
        raise value.error(f"length {length:g}; a unit vector is needed", hint=hint)
    if abs(length - 1) < 1e-14:  # already unit: left bit for bit as written, so that files round-trip
        return x, y, z
    return x / length, y / length, z / length


def _choice(keys: Mapping[str, Value], name: str, options: Sequence[str]) -> Any:
    return keys[name].choice(options) if name in keys else options[0]
