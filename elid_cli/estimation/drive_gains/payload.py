"""A payload of known mass: where it is carried, and what is known of its ten inertial parameters."""

from __future__ import annotations

import math
import re

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import UsageError, did_you_mean
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Payload, Robot

EXAMPLE = "--payload 2.805@joint6, or with its centre of mass in the joint's frame: --payload 2.805@joint6:0,0,0.04"


DECLARED = "declared"
"""What stands for the payload that the robot's file declares."""


def effect_of(payload: Payload, robot: Robot, base: BaseParameters) -> tuple[Array, Array]:
    """Return what a payload adds to the base parameters: the known part (b,), and one column per unknown (b, u).

    Raises
    ------
    UsageError
        The robot has no such joint.
    """
    if payload.joint not in robot.joint_names:
        hint = did_you_mean(payload.joint, robot.joint_names)
        raise UsageError(f"--payload: {robot.name} has no joint {payload.joint!r}", hint=hint)
    number = robot.joint_names.index(payload.joint) + 1
    places = [base.parameters.index(name) for name in base.parameters if _is_of(str(name), number)]
    columns = base.transform[:, places]
    known = np.array([payload.mass, *(payload.mass * np.array(payload.centre or (0.0, 0.0, 0.0)))])
    count = 1 if payload.centre is None else 4
    return columns[:, :count] @ known[:count], columns[:, count:]


def _is_of(name: str, number: int) -> bool:
    return name in {f"{kind}{number}" for kind in LINK_PARAMETERS}


def declared(robot: Robot) -> Payload:
    """Return the payload that the robot's file declares (UsageError: none)."""
    if robot.payload is None:
        raise UsageError(
            f"--payload {DECLARED}: {robot.name} declares none",
            hint=f"payload: {{mass: 2.805, joint: {robot.joint_names[-1]}}} {robot.place_to_say}",
        )
    return robot.payload


def parse_payload(text: str) -> Payload | None:
    """Return what ``--payload MASS@JOINT`` or ``MASS@JOINT:X,Y,Z`` says (UsageError); None: what is declared."""
    if text.strip() == DECLARED:
        return None
    found = re.fullmatch(r"\s*([^@]+)@([^:]+)(?::([^,]+),([^,]+),([^,]+))?", text)
    try:
        if found is None:
            raise ValueError
        mass = float(found[1])
        centre = None if found[3] is None else (float(found[3]), float(found[4]), float(found[5]))
    except ValueError:
        raise UsageError(f"--payload: {text!r} is no payload; kg and m", hint=EXAMPLE) from None
    if not (math.isfinite(mass) and mass > 0 and all(map(math.isfinite, centre or ()))):
        raise UsageError(f"--payload: {text!r}: its mass is a number of kg above 0", hint=EXAMPLE)
    return Payload(mass, found[2].strip(), centre)
