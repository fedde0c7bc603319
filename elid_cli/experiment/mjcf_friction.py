"""Friction that fades in over a speed as MuJoCo has it: the softness of a joint's friction constraint.

The constraint's force is at most the friction loss F, and below that it is ``(v / lead + v') d / ((1 - d) A)``, with
the impedance d of ``solimpfriction``, the lead ``d timeconst / 2`` of ``solreffriction``, and A the inverse of the
inertia that the joint has in the pose of zeros with all others free (``dof_invweight0``). So it is whole from a speed
of ``F lead A (1 - d) / d``.
"""

from __future__ import annotations

import numpy as np

from elid_cli.model.dynamics import Dynamics
from elid_cli.model.effects.declared import is_soft_in_mjcf, resolve
from elid_cli.robot.robot import Robot
from elid_cli.robot.xml_text import xml_number

SHORTEST = 1e-3
"""s; lead of friction that has none: MuJoCo's constraints always have one, of a step at least."""
SOFTEST, STIFFEST = 1e-3, 0.9999
"""Impedances that MuJoCo takes."""


def soft_attributes(robot: Robot) -> dict[str, dict[str, str]]:
    """Return the attributes of the friction constraint of joints whose friction fades in, by their names.

    Raises
    ------
    RobotError
        Parameters that the robot's inertia depends on are unknown.
    """
    specs = [spec for spec in robot.effects if is_soft_in_mjcf(robot, spec)]
    if not specs:
        return {}
    mobility = np.diag(np.linalg.inv(Dynamics(robot).mass_matrix([0.0] * robot.n)))
    found = {}
    for spec in specs:
        kind, joint = resolve(robot, spec)
        width, least = (float(spec.parameters.get(p.name, p.default or 0.0)) for p in kind.shapes)
        lead, friction = max(least, SHORTEST), float(spec.parameters[kind.amplitudes[0].name])
        part = 1.0 / (1.0 + width / max(friction * lead * float(mobility[joint]), 1e-300))
        part = min(max(part, SOFTEST), STIFFEST)
        impedance = xml_number(part)
        found[robot.joints[joint].name] = {
            "solreffriction": f"{xml_number(2.0 * lead / part)} 1",
            "solimpfriction": f"{impedance} {impedance} 0.001 0.5 2",
        }
    return found
