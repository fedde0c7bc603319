"""Mass, centre and tensor of a body that is written to a URDF or MJCF, or why it cannot be."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.robot.inertia import about_centre, inertial_parameters, real_tensor

PHYSICAL = "write a .yaml, which holds any; or find physical parameters first: elid identify … --physical"


def inertial(body: Array, what: str) -> tuple[float, Array, Array]:
    """Return mass, centre and tensor of a body."""
    ten = inertial_parameters(body)
    if not ten[0] > 0:
        raise RobotError(f"{what} would have a mass of {ten[0]:.3g} kg", hint=PHYSICAL)
    return about_centre(ten)


def loaded(body: Array, before: Array, what: str) -> tuple[float, Array, Array]:
    """Return mass, centre and tensor of a body; refuse one that MuJoCo does where the file's own was real."""
    mass, centre, tensor = inertial(body, what)
    if not real_tensor(tensor) and is_real(before):
        a, b, c = np.linalg.eigvalsh(tensor)
        raise RobotError(
            f"{what} would have the principal moments of inertia {a:.3g}, {b:.3g} and {c:.3g} kg·m²",
            detail="of a real body they are positive and none exceeds the sum of the others; MuJoCo refuses others",
            hint=PHYSICAL,
        )
    return mass, centre, tensor


def is_real(body: Array) -> bool:
    """Return whether a 4x4 pseudo-inertia is that of a body with mass, whose moments MuJoCo takes."""
    ten = inertial_parameters(body)
    return bool(ten[0] > 0 and real_tensor(about_centre(ten)[2]))
