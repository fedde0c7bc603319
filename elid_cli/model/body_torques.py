"""Torques that described bodies need, by their masses, first moments and inertias (Newton and Euler)."""

from __future__ import annotations

import math

import numpy as np

from elid_cli._types import Array
from elid_cli.memory import Recent
from elid_cli.model.kinematics import JointState, chain
from elid_cli.model.program import Program, compile_program
from elid_cli.model.terms.rigid_body import wrench_of
from elid_cli.model.towards_base import Wrench, joint_torques
from elid_cli.model.tracing import Graph
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot

MASSES = 4
"""Link parameters that weight depends on: mass and first moment."""
ROUNDING = 1e-9
"""Share of the largest torque below which one is rounding."""


def gravity_torques(robot: Robot, q: Array) -> Array:
    """Return the torques, N·m (N), that hold the described bodies at rest at positions (N, n), rad (m); same shape.

    NaN at joints whose load depends on a mass or first moment that is unknown.
    """
    return _known(robot, (q,), MASSES)


def inertial_torques(robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the torques, N·m (N), that move the described bodies without gravity, rotors and friction; (N, n).

    NaN at joints whose load depends on a parameter that is unknown.
    """
    return _known(robot, (q, dq, ddq), len(LINK_PARAMETERS))


def _known(robot: Robot, motion: tuple[Array, ...], used: int) -> Array:
    """Return the torques of a motion or at rest; NaN where they depend on an unknown one of the `used` kinds."""
    _, programs = _PROGRAMS.of((id(robot), used), lambda: (robot, _traced(robot, used)))
    q = motion[0]
    if not programs:
        return np.full_like(q, math.nan)
    rows = np.concatenate([np.sin(q), np.cos(q), *motion], axis=1).T.copy()
    torques = np.empty((len(programs), robot.n, len(q)))
    for program, out in zip(programs, torques, strict=True):
        program.run(rows, out)
    found, other = torques[0], torques[-1]
    least = ROUNDING * float(np.nanmax(np.abs(other), initial=0.0))
    found[(np.abs(found - other) > least).any(axis=1)] = math.nan
    return np.asarray(found.T)


_PROGRAMS: Recent[tuple[Robot, list[Program]]] = Recent(8)
"""Programs by robot, which is kept with them so that its identity stands for it, and by the parameters used."""


def _traced(robot: Robot, used: int) -> list[Program]:
    """Return programs with 0 for unknown parameters, and with 1 if any is not known; none where no mass is.

    Inputs are sin q, cos q and q of all joints; with all parameters used, velocities and accelerations as well.
    """
    kinds = LINK_PARAMETERS[:used]
    known = np.array([[joint.parameters.get(kind, math.nan) for kind in kinds] for joint in robot.joints])
    if np.isnan(known[:, 0]).all():
        return []
    moving = used == len(LINK_PARAMETERS)
    found = []
    for unknown in (0.0, 1.0) if np.isnan(known).any() else (0.0,):
        blocks = 5 if moving else 3
        graph = Graph(blocks * robot.n)
        inputs = [[graph.input(block * robot.n + k) for k in range(robot.n)] for block in range(blocks)]
        rates = inputs[3:] if moving else [[0.0] * robot.n] * 2
        states = [JointState(*values) for values in zip(*inputs[:3], *rates, strict=True)]
        _, *bodies = chain(robot, states, gravity=not moving, twists=False)
        ten = np.pad(np.nan_to_num(known, nan=unknown), ((0, 0), (0, len(LINK_PARAMETERS) - used))).tolist()
        wrenches = [Wrench(), *map(wrench_of, bodies, ten)]
        found.append(compile_program(graph, joint_torques(robot, states, wrenches)))
    return found
