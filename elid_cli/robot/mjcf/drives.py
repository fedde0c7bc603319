"""Actuators of an MJCF as a robot's drives: the largest torques, and gains of position loops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from elid_cli.robot.mjcf.attributes import ACTUATORS, MAIN, Conventions
from elid_cli.robot.mjcf.elements import first_number
from elid_cli.robot.urdf.xml import Element

LIMITED = {"forcerange": "forcelimited", "ctrlrange": "ctrllimited"}
"""Range of an actuator -> what says whether it counts."""


@dataclass(frozen=True)
class Motor:
    """What drives a joint: the joint element that actuators act on, and its turns per turn of the robot's joint."""

    name: str
    element: Element
    """With the attributes of its class."""
    turns: float = 1.0
    """1 where it is the robot's joint itself; else rotor turns per joint turn."""


@dataclass(frozen=True)
class Drives:
    """The actuators of a whole model."""

    root: Element
    conventions: Conventions

    def of(self, joint: str) -> Iterator[Element]:
        """Yield the actuators of a joint of the file, with the attributes of their classes."""
        for holder in self.root.all("actuator"):
            for element in holder.children:
                if element.tag in ACTUATORS and element.attributes.get("joint") == joint:
                    yield self.conventions.effective(element, MAIN)

    def torque_limit(self, motor: Motor) -> float | None:
        """Return the largest torque, N·m (N), seen at the robot's joint; None where there is no limit."""
        element = motor.element
        torques = [_torque(actuator) for actuator in self.of(motor.name)]
        if "actuatorfrcrange" in element.attributes and element.attributes.get("actuatorfrclimited") != "false":
            torques.append(max(map(abs, element.numbers("actuatorfrcrange", (0.0, 0.0)))))
        torque = min((value for value in torques if value > 0), default=None)
        return None if torque is None else torque * abs(motor.turns)

    def gains(self, motors: Mapping[str, Motor]) -> dict[str, dict[str, float]]:
        """Return gains of the position actuators, empty unless every joint has one of which both are told.

        A damping ratio is none: it depends on the inertia that the compiler sees. Commands of one are positions of
        the joint only where its gear undoes the turns of the rotor that it acts on.
        """
        gains: dict[str, dict[str, float]] = {"kp": {}, "kd": {}}
        for joint, motor in motors.items():
            for actuator in self.of(motor.name):
                told = {"kp", "kv"} <= set(actuator.attributes) and "dampratio" not in actuator.attributes
                gear = first_number(actuator, "gear") if "gear" in actuator.attributes else 1.0
                if actuator.tag == "position" and told and abs(gear * motor.turns - 1.0) < 1e-9:
                    gains["kp"][joint] = actuator.number("kp", 0.0)
                    gains["kd"][joint] = actuator.number("kv", 0.0)
        return gains if set(gains["kp"]) == set(motors) else {}


def without_limits_below(actuator: Element, limit: float) -> dict[str, str]:
    """Return the attributes that lift the limits of an actuator that are below a torque at its joint, N·m (N)."""
    return {LIMITED[key]: "false" for key, size in _torques(actuator).items() if size < limit}


def _torque(actuator: Element) -> float:
    """Return the largest torque of an actuator at its joint, 0 where it has no limit."""
    return min(_torques(actuator).values(), default=0.0)


def _torques(actuator: Element) -> dict[str, float]:
    """Return the torques at its joint that an actuator's ranges hold it to, N·m (N)."""
    gear = abs(first_number(actuator, "gear")) if "gear" in actuator.attributes else 1.0
    sizes = {}
    for key in ("forcerange", *(("ctrlrange",) if actuator.tag == "motor" else ())):
        if key in actuator.attributes and actuator.attributes.get(LIMITED[key]) != "false":
            sizes[key] = gear * max(map(abs, actuator.numbers(key, (0.0, 0.0))))
    return {key: size for key, size in sizes.items() if size > 0}
