"""Whether a robot that a program built can be one: words, names, numbers, which files are asked for as they are read.

Robots are made often, inside searches as well: a joint without a fault is known by a few sums and comparisons, and only
another one is looked at piece by piece.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any

from elid_cli.errors import RobotError, did_you_mean
from elid_cli.robot.parameter import JOINT_PARAMETERS

if TYPE_CHECKING:
    from elid_cli.robot.robot import Joint, Robot

JOINT_WORDS = {
    "type": ("revolute", "prismatic"),
    "transmission": ("elastic", "rigid", "auto"),
    "torque_at": ("motor", "link"),
}
"""What the words of a joint may be."""
CONVENTIONS = ("standard", "modified", "urdf")
_NUMBERS = ("a", "alpha", "d", "theta")
_AXES = ("motor_axis", "axis")
_VECTORS = (*_AXES, "xyz", "rpy")
UNIT = 1e-6
"""How far the length of an axis may be from 1."""
_KNOWN = frozenset(JOINT_PARAMETERS)
_TYPES, _TRANSMISSIONS, _SIDES = JOINT_WORDS.values()


def check_joint(joint: Joint) -> None:
    """Refuse what no joint can be: words, names of parameters, numbers (RobotError)."""
    try:
        sound = (
            joint.type in _TYPES
            and joint.transmission in _TRANSMISSIONS
            and joint.torque_at in _SIDES
            and joint.gear_ratio != 0
            and type(joint.name) is str
            and joint.parameters.keys() <= _KNOWN
            and math.isfinite(_total(joint))
            and _is_unit(joint.motor_axis)
            and _is_unit(joint.axis)
        )
    except (TypeError, ValueError, AttributeError):
        sound = False
    if not sound:
        _refuse(joint)


def _total(joint: Joint) -> float:
    """Return a sum that is finite only where every number is one (ValueError: a vector is not of three)."""
    (x, y, z), (u, v, w), (r, p, s), (k, m, n) = joint.motor_axis, joint.xyz, joint.rpy, joint.axis
    own = joint.a + joint.alpha + joint.d + joint.theta + (joint.gear_ratio or 0.0)
    return own + x + y + z + u + v + w + r + p + s + k + m + n + math.fsum(joint.parameters.values())


def _is_unit(axis: tuple[float, float, float]) -> bool:
    x, y, z = axis
    return abs(x * x + y * y + z * z - 1.0) <= UNIT


def _refuse(joint: Joint) -> None:
    """Say what is wrong with a joint (RobotError); nothing where it was a sum of large numbers alone."""
    if not isinstance(joint.name, str):
        raise RobotError(f"Joint: name: {joint.name!r} is no text", hint='Joint("shoulder", ...)')
    where = f"joint {joint.name!r}"
    for name, words in JOINT_WORDS.items():
        _check_word(f"{where}: {name}", getattr(joint, name), words)
    for name in _NUMBERS:
        _check_number(f"{where}: {name}", getattr(joint, name))
    for name in _VECTORS:
        if name == "motor_axis" and joint.motor_axis is None and joint.gear_ratio is None:
            continue  # a rotor that does not couple is not asked for its axis
        _check_vector(f"{where}: {name}", getattr(joint, name))
        if name in _AXES:
            _check_axis(f"{where}: {name}", getattr(joint, name))
    if joint.gear_ratio is not None:
        _check_number(f"{where}: gear_ratio", joint.gear_ratio)
        if joint.gear_ratio == 0:
            raise RobotError(f"{where}: gear_ratio 0", hint="the rotor turns per joint turn, 1 for a direct drive")
    _check_parameters(where, joint.parameters)


def _check_parameters(where: str, parameters: object) -> None:
    if not isinstance(parameters, Mapping):
        given = f"a value of type {type(parameters).__name__}"
        raise RobotError(f"{where}: parameters: {given} in place of a mapping", hint='parameters={"m": 1.5}')
    for name, value in parameters.items():
        if name not in _KNOWN:
            raise RobotError(
                f"{where}: parameters: no parameter is called {name!r}", hint=did_you_mean(str(name), JOINT_PARAMETERS)
            )
        _check_number(f"{where}: parameters: {name}", value, "leave it out where it is not known")


def _check_word(where: str, value: object, words: Sequence[str]) -> None:
    if value not in words:
        raise RobotError(f"{where}: {value!r} says nothing here", hint=did_you_mean(str(value), words))


def _check_number(where: str, value: object, hint: str = "give a finite number, in SI units") -> None:
    if not isinstance(value, Real):
        raise RobotError(f"{where}: {value!r} is no number", hint="give a finite number, in SI units")
    if not math.isfinite(value):
        raise RobotError(f"{where}: {float(value):g} is not finite", hint=hint)


def _check_vector(where: str, value: Any, hint: str = "such as (0.0, 0.0, 1.0)") -> None:
    try:
        numbers = tuple(value)
    except TypeError:
        numbers = ()
    if isinstance(value, str) or len(numbers) != 3:
        raise RobotError(f"{where}: {value!r} is no vector of three numbers", hint=hint)
    for number in numbers:
        _check_number(where, number)


def _check_axis(where: str, axis: tuple[float, float, float]) -> None:
    if not _is_unit(axis):
        length = math.hypot(*axis)
        unit = ", ".join(f"{x / length:.9g}" for x in axis) if length > 0 else "0.0, 0.0, 1.0"
        raise RobotError(f"{where}: of length {length:g}; a unit vector is needed", hint=f"({unit})")


def check_whole(robot: Robot) -> None:
    """Refuse what no robot can be: joints of one name, words, gravity (RobotError)."""
    try:
        x, y, z = robot.gravity
        names = {joint.name for joint in robot.joints}
        sound = (
            robot.dh in CONVENTIONS
            and type(robot.name) is str
            and type(robot.joints) is tuple
            and math.isfinite(x + y + z)
            and len(names) == len(robot.joints)
            and not any(joint.parent for joint in robot.joints)
        )
    except (TypeError, ValueError, AttributeError):
        sound = False
    if not sound:
        _refuse_whole(robot)


def _refuse_whole(robot: Robot) -> None:
    """Say what is wrong with a robot (RobotError); nothing where it was a sum of large numbers alone."""
    from elid_cli.robot.robot import BASE, Joint

    if not isinstance(robot.name, str):
        raise RobotError(f"Robot: name: {robot.name!r} is no text", hint='Robot("arm", (Joint("shoulder"),))')
    where = f"robot {robot.name!r}"
    if not isinstance(robot.joints, tuple) or not all(isinstance(joint, Joint) for joint in robot.joints):
        raise RobotError(f"{where}: joints: no tuple of Joint", hint='joints=(Joint("shoulder"), Joint("elbow"))')
    _check_word(f"{where}: dh", robot.dh, CONVENTIONS)
    _check_vector(f"{where}: gravity", robot.gravity, "such as (0.0, 0.0, -9.81)")
    names = [joint.name for joint in robot.joints]
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise RobotError(f"{where}: a second joint {twice!r}", hint="every joint needs its own name")
    for k, joint in enumerate(robot.joints):
        above = ("", BASE, *names[:k])
        if joint.parent not in above:
            raise RobotError(
                f"{where}: parent of {joint.name}: {joint.parent!r} is no joint above it",
                detail="parents stand before what they carry",
                hint=did_you_mean(str(joint.parent), above[1:]),
            )


def check_size(robot: Robot, source: str) -> None:
    """Refuse a robot, read from `source`, of more joints than are identified together (RobotError)."""
    from elid_cli.robot.robot import MOST_JOINTS

    if robot.n > MOST_JOINTS:
        raise RobotError(
            f"{source}: {robot.n} joints; at most {MOST_JOINTS} are identified together",
            hint="hold the others: --lock NAME=0, or keep one chain: --tip LINK",
        )
