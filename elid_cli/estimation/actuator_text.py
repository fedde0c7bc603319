"""Actuators as a file that simulators' configurations take: JSON, or YAML with the same keys."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

from elid_cli.estimation.actuators import UNITS, Actuators, Quantity, Value
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.declared import is_soft_in_mjcf
from elid_cli.model.effects.scene import direction_widths
from elid_cli.robot.mjcf.held import is_held
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.robot.yaml import emit

ABOUT = (
    "Actuators identified by elid, at the joint, SI. null: not shown by the log, see remarks. The values go with the "
    "URDF or MJCF of the same run, else with its YAML. friction is static, dynamic_friction is Coulomb's; an offset is "
    "torque commanded or logged beyond what acts. effects: torques beyond these; as friction they add to the dynamic "
    "one, but for what of them it holds already (in_dynamic_friction, N·m or N)."
)


def actuator_text(found: Actuators, *, yaml: bool) -> str:
    """Return the file's text; the same actuators give the same bytes."""
    data = _data(found)
    if yaml:
        return "\n".join(emit(data)) + "\n"
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _data(found: Actuators) -> dict[str, Any]:
    robot = found.robot
    of = [joint.name for joint in robot.joints]
    widths = direction_widths(robot).tolist()
    return {
        "about": ABOUT,
        "robot": robot.name,
        "actuators": _each(found, lambda value: value.value),
        "std_error": _each(found, lambda value: _finite(value.std_error)),
        "verdict": _each(found, lambda value: value.verdict),
        "remarks": _remarks(found),
        "units": {quantity: _units(quantity, robot) for quantity in found.values},
        "gear_ratio": {joint.name: joint.gear_ratio for joint in robot.joints if joint.gear_ratio is not None},
        **({"rotors": {name: list(rotor) for name, rotor in robot.rotors.items()}} if robot.rotors else {}),
        "direction_width": dict(zip(of, widths, strict=True)),
        "effects": [_effect(robot, spec, found.held_of(spec)) for spec in found.effects],
    }


def _finite(value: float | None) -> float | None:
    """Return a number; None for one that is not known."""
    return value if value is not None and math.isfinite(value) else None


def _each(found: Actuators, of: Callable[[Value], object]) -> dict[str, dict[str, object]]:
    return {key: {joint: of(value) for joint, value in values.items()} for key, values in found.values.items()}


def _remarks(found: Actuators) -> dict[str, dict[str, str]]:
    told = {q: {joint: v.why for joint, v in values.items() if v.why} for q, values in found.values.items()}
    return {quantity: words for quantity, words in told.items() if words}


def _units(quantity: Quantity, robot: Robot) -> str | dict[str, str]:
    """Return the unit of a quantity, joint by joint where some joints turn and others slide."""
    turning = UNITS[quantity]
    sliding = "kg" if turning == "kg·m²" else turning.replace("N·m", "N").replace("rad", "m")
    units = {joint.name: turning if joint.revolute else sliding for joint in robot.joints}
    return next(iter(units.values())) if len(set(units.values())) == 1 else units


def _effect(robot: Robot, spec: EffectSpec, held: float) -> dict[str, Any]:
    kind = effect_classes()[spec.effect]
    return {
        "effect": spec.effect,
        "joint": spec.joint,
        "parameters": {name: _finite(value) for name, value in spec.parameters.items()},
        "as": ("friction" if kind.acts_as == "friction" else "torque") if kind.acts_as else None,
        "at": kind.place,
        "in_mjcf": is_held(robot, spec) or is_soft_in_mjcf(robot, spec),
        "equation": kind.equation,
        **({"in_dynamic_friction": held} if held else {}),
    }
