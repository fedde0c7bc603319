"""What the link side asks of the transmissions, with the positions of links and motors apart.

Of every joint: s = Y(q, q', q'') p + sum over later rotors j of J_j (E1 θ_j' + E2 θ_j''), the torque through its
transmission, and a = what the motion of the carrying body adds to its rotor's acceleration (eq. 13; terms/rotor.py).
J is a rotor's inertia as the joint sees it, k² Jm or Ja. The columns come from elid's own terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import KINDS, Sensed
from elid_cli.model.base_parameters import find_base
from elid_cli.model.duals import Dual
from elid_cli.model.kinematics import Body, JointState, chain
from elid_cli.model.program import Program, compile_program
from elid_cli.model.regressor import Regressor
from elid_cli.model.terms.base_term import ChainMotion, MotorState
from elid_cli.model.terms.rigid_body import RigidBody
from elid_cli.model.terms.rotor import Rotor
from elid_cli.model.tracing import Graph, Scalar
from elid_cli.robot.robot import Robot
from elid_cli.signals.trigonometry import sine_and_cosine

_INPUTS = 5
"""Inputs of a joint: sin q, cos q, q, q', q''."""
_MOTOR_KINDS = ("fs", "fv", "K")
"""Kinds of parameters that have no place in the link side."""


@dataclass(frozen=True)
class LinkTerms:
    """The link side at N instants."""

    columns: Array
    """Y, (N, n, p)."""
    by_speed: Array
    """E1: torque at joint i per J_j θ_j', (N, n, n); empty without coupling."""
    by_acceleration: Array
    """E2: torque at joint i per J_j θ_j'', (N, n, n); empty without coupling."""
    carried: Array
    """a, rad/s² (m/s²), (N, n)."""


@dataclass(frozen=True)
class LinkSlopes:
    """Derivatives by q, q' and q'' of joint j: [derivative, instant, row, j], (3, N, n, n) each."""

    torque: Array
    """Of the torque through the transmissions, the motors' motion held."""
    carried: Array
    """Of `LinkTerms.carried`."""


class LinkSide:
    """The link side of a robot whose elastic joints have hidden link positions.

    Columns of p: the base parameters' leaders among bodies and rotors of rigid joints, and a viscous friction of the
    link of every elastic joint.

    Parameters
    ----------
    robot
        As the log shows it: no joint that rests, no transmission ``auto``.
    sensors
        Joints whose links carry sensors, of every kind of these; default: none.
    """

    def __init__(self, robot: Robot, sensors: Sequence[Sequence[int]] = ((), ())) -> None:
        self.robot = robot
        self.sensed = tuple(Sensed(kind, robot, joints) for kind, joints in zip(KINDS, sensors, strict=True))
        self.n = robot.n
        self.elastic: NDArray[np.bool_] = np.array([joint.elastic for joint in robot.joints])
        self.ratio = np.array([joint.gear_ratio or 1.0 for joint in robot.joints])
        base = find_base(Regressor(robot))
        rotors = {name for k, name in enumerate(robot.rotor_names) if self.elastic[k]}
        led = [base.parameters[k] for k in base.leaders]
        self.bodies = tuple(name for name in led if name.kind not in _MOTOR_KINDS and name not in rotors)
        self.viscous = tuple(int(k) for k in np.flatnonzero(self.elastic))
        self.names = (*(str(name) for name in self.bodies), *(f"viscous{k + 1}" for k in self.viscous))
        self.count = len(self.names)

    @property
    def told_compliance(self) -> Array | None:
        """1/K by the robot file, 0 for rigid joints, (n,); None where it has not all of them."""
        told = np.array([joint.parameters.get("K", np.nan) if joint.elastic else np.inf for joint in self.robot.joints])
        return 1 / told if np.all(told > 0) else None

    @cached_property
    def coupled(self) -> bool:
        """Whether a rotor's own motion loads links that carry it, or theirs it."""
        return bool(self._places[1] or self._places[2])

    @cached_property
    def behind(self) -> tuple[tuple[int, ...], ...]:
        """Of every joint, the joints whose rotors load it."""
        pairs = {(i, j) for _, i, j in self._places[1]}
        return tuple(tuple(j for j in range(self.n) if (i, j) in pairs) for i in range(self.n))

    @cached_property
    def levels(self) -> int:
        """How many rotors follow each other of which each loads a link of the next one."""
        depth = [0] * self.n
        for i in reversed(range(self.n)):
            depth[i] = 1 + max((depth[j] for j in self.behind[i]), default=-1)
        return max(depth)

    def terms(self, q: Array, dq: Array, ddq: Array) -> LinkTerms:
        """Return columns and coupling at N instants of links' motion, (N, n) each."""
        program, (bodies, rotors, carried) = self._program, self._places
        out = np.empty((program.outputs, len(q)))
        program.run(_inputs(q, dq, ddq), out)
        columns = np.zeros((len(q), self.n, self.count))
        for place, row, column in bodies:
            columns[:, row, column] = out[place]
        for number, k in enumerate(self.viscous):
            columns[:, k, len(self.bodies) + number] = dq[:, k]
        speed, acceleration = np.zeros((2, len(q), self.n, self.n) if rotors else (2, 0, 0, 0))
        for place, i, j in rotors:
            speed[:, i, j], acceleration[:, i, j] = out[place], out[place + 1]
        added = np.zeros_like(q)
        for place, k in carried:
            added[:, k] = out[place]
        return LinkTerms(columns, speed, acceleration, added)

    def loads(self, terms: LinkTerms, J: Array, dtheta: Array, ddtheta: Array) -> Array:
        """Return what the rotors' own motion adds to the torque through every transmission, (N, n)."""
        if not len(terms.by_speed):
            return np.zeros_like(dtheta)
        found: Array = np.einsum("nij,nj->ni", terms.by_speed, J * dtheta)
        found += np.einsum("nij,nj->ni", terms.by_acceleration, J * ddtheta)
        return found

    def slopes(self, state: Sequence[Array], p: Array, J: Array, motors: tuple[Array, Array]) -> LinkSlopes:
        """Return derivatives by the links' motion.

        Parameters
        ----------
        state
            q, q', q'', (N, n) each.
        p, J
            Parameters and the rotors' inertias.
        motors
            θ' and θ'', (N, n) each.
        """
        program, places = self._differentiated
        fixed = np.concatenate([p, J])
        rows = np.empty((program.inputs, len(state[0])))
        rows[: _INPUTS * self.n] = _inputs(*state)
        rows[_INPUTS * self.n : -len(fixed)] = np.concatenate(motors, axis=1).T
        rows[-len(fixed) :] = fixed[:, None]
        out = np.empty((program.outputs, len(state[0])))
        program.run(rows, out)
        found = LinkSlopes(*np.zeros((2, 3, len(state[0]), self.n, self.n)))
        for place, (which, row, number) in enumerate(places):
            derivative, joint = number % 3, number // 3
            (found.torque, found.carried)[which][derivative, :, row, joint] = out[place]
        return found

    def mass(self, q: Array, p: Array) -> Array:
        """Return the links' mass matrix of the parameters p, (N, n, n)."""
        zero, M = np.zeros_like(q), np.empty((len(q), self.n, self.n))
        rest = self.terms(q, zero, zero).columns @ p
        for j in range(self.n):
            unit = zero.copy()
            unit[:, j] = 1.0
            M[:, :, j] = self.terms(q, zero, unit).columns @ p - rest
        return M

    @property
    def _program(self) -> Program:
        return self._traced[0]

    @property
    def _places(self) -> tuple[list[tuple[int, int, int]], list[tuple[int, int, int]], list[tuple[int, int]]]:
        return self._traced[1]

    @cached_property
    def _traced(
        self,
    ) -> tuple[Program, tuple[list[tuple[int, int, int]], list[tuple[int, int, int]], list[tuple[int, int]]]]:
        """Return the program and what its outputs are: (place, row, column), (place, i, j) of E1 and E2, (place, k)."""
        graph = Graph(_INPUTS * self.n)
        joints = [[graph.input(_INPUTS * k + d) for d in range(_INPUTS)] for k in range(self.n)]
        bodies = chain(self.robot, [JointState(*five) for five in joints])
        outputs: list[Scalar] = []
        columns = []
        for (row, column), value in self._columns(bodies, joints).items():
            columns.append((len(outputs), row, column))
            outputs.append(value)
        rotors = []
        speed, acceleration = self._rotors(bodies, joints, 1.0, 0.0), self._rotors(bodies, joints, 0.0, 1.0)
        for i, j in sorted({*speed[0], *acceleration[0]}):
            rotors.append((len(outputs), i, j))
            outputs += [speed[0].get((i, j), 0.0), acceleration[0].get((i, j), 0.0)]
        carried = []
        for k, value in self._rotors(bodies, joints, 0.0, 0.0)[1].items():
            carried.append((len(outputs), k))
            outputs.append(value)
        return compile_program(graph, outputs), (columns, rotors, carried)

    @cached_property
    def _differentiated(self) -> tuple[Program, list[tuple[int, int, int]]]:
        """Return the derivatives' program and what its outputs are: (0: torque or 1: carried, row, 3 joint + order).

        Inputs: those of the links' motion, θ' and θ'' of all joints, p, J.
        """
        n, count = self.n, self.count
        graph = Graph((_INPUTS + 3) * n + count)
        node = [Dual(graph.input(k)) for k in range(graph.inputs)]  # a traced scalar knows nothing of derivatives
        joints = [_dual(node[_INPUTS * k : _INPUTS * (k + 1)], 3 * k) for k in range(n)]
        speed, acceleration = node[_INPUTS * n :][:n], node[(_INPUTS + 1) * n :][:n]
        p, J = node[(_INPUTS + 2) * n :][:count], node[-n:]
        torque, carried = self._loaded(joints, speed, acceleration, p, J)
        places: list[tuple[int, int, int]] = []
        outputs: list[Scalar] = []
        for which, rows in enumerate((torque, carried)):
            for row, value in rows.items():
                for number, slope in value.slopes.items():
                    places.append((which, row, number))
                    outputs.append(slope)
        return compile_program(graph, outputs), places

    def _loaded(
        self, joints: Sequence[Any], speed: Sequence[Any], acceleration: Sequence[Any], p: Sequence[Any],
        J: Sequence[Any],
    ) -> tuple[dict[int, Dual], dict[int, Dual]]:  # fmt: skip
        """Return the torque through every transmission and what carries the rotors, with their derivatives."""
        bodies, place = (
            chain(self.robot, [JointState(*five) for five in joints]),
            {n: k for k, n in enumerate(self.bodies)},
        )
        torque = {k: Dual(0.0) for k in range(self.n)}
        for number, k in enumerate(self.viscous):
            torque[k] = torque[k] + joints[k][3] * p[len(self.bodies) + number]
        still = ChainMotion(bodies, self._motors(joints, 0.0, 0.0))
        for term in (RigidBody(), Rotor()):
            for _, row, name, value in term.entries(self.robot, still):
                if name in place:
                    torque[row] = torque[row] + value * p[place[name]]
        carried = {k: value + Dual(0.0) for k, value in self._rotors(bodies, joints, 0.0, 0.0)[1].items()}
        turning: list[MotorState] = [
            MotorState(speed[k], acceleration[k], 0.0, 0.0) if self.elastic[k] else MotorState(0.0, 0.0, 0.0, 0.0)
            for k in range(self.n)
        ]
        for side, row, name, value in Rotor().entries(self.robot, ChainMotion(bodies, turning)):
            j = name.joint
            if side == "link" and self.elastic[j]:
                torque[row] = torque[row] + value * J[j] * (1.0 / self.ratio[j] ** 2)
        return torque, carried

    def _columns(self, bodies: Sequence[Body], joints: Sequence[Sequence[Scalar]]) -> dict[tuple[int, int], Scalar]:
        """Return the coefficients of bodies and of rotors of rigid joints, by (row, column)."""
        place = {name: k for k, name in enumerate(self.bodies)}
        found: dict[tuple[int, int], Scalar] = {}
        motion = ChainMotion(bodies, self._motors(joints, 0.0, 0.0))
        for term in (RigidBody(), Rotor()):
            for _, row, name, value in term.entries(self.robot, motion):
                if name in place:
                    key = row, place[name]
                    found[key] = found.get(key, 0.0) + value
        return {key: value for key, value in found.items() if not (isinstance(value, float) and value == 0)}

    def _rotors(
        self, bodies: Sequence[Body], joints: Sequence[Sequence[Scalar]], speed: float, acceleration: float
    ) -> tuple[dict[tuple[int, int], Scalar], dict[int, Scalar]]:
        """Return what elastic joints' rotors load links with, by (link, rotor), and what carries them, per unit J."""
        loads: dict[tuple[int, int], Scalar] = {}
        carried: dict[int, Scalar] = {}
        motion = ChainMotion(bodies, self._motors(joints, speed, acceleration))
        for side, row, name, value in Rotor().entries(self.robot, motion):
            j = name.joint
            if not self.elastic[j] or (isinstance(value, float) and value == 0):
                continue
            share = value * (1.0 / self.ratio[j] ** 2)
            if side == "link":
                loads[row, j] = loads.get((row, j), 0.0) + share
            else:
                carried[j] = share
        return loads, carried

    def _motors(self, joints: Sequence[Sequence[Scalar]], speed: float, acceleration: float) -> list[MotorState]:
        return [
            MotorState(speed, acceleration, 0.0, 0.0) if self.elastic[k] else MotorState(dq, ddq, 0.0, 0.0)
            for k, (_, _, _, dq, ddq) in enumerate(joints)
        ]


def _dual(five: Sequence[Dual], first: int) -> list[Any]:
    """Return sin q, cos q, q, q', q'' of a joint with their derivatives by q, q' and q'', numbered from `first`."""
    sin, cos, q, dq, ddq = (dual.value for dual in five)
    return [
        Dual(sin, {first: cos}), Dual(cos, {first: -sin}), Dual(q, {first: 1.0}), Dual(dq, {first + 1: 1.0}),
        Dual(ddq, {first + 2: 1.0}),
    ]  # fmt: skip


def reflected(robot: Robot) -> Array:
    """Return the rotors' inertias that a robot file gives, as their joints see them, kg·m², (n,); NaN where unknown."""
    values = robot.reference()
    index = {name: k for k, name in enumerate(robot.parameter_names())}
    found = np.array([values[index[name]] for name in robot.rotor_names], dtype=float)
    found *= [(joint.gear_ratio or 1.0) ** 2 for joint in robot.joints]
    return found


def _inputs(q: Array, dq: Array, ddq: Array) -> Array:
    rows = np.empty((_INPUTS * q.shape[1], len(q)))
    for k in range(q.shape[1]):
        five = rows[_INPUTS * k : _INPUTS * (k + 1)]
        five[2], five[3], five[4] = q[:, k], dq[:, k], ddq[:, k]
        sine_and_cosine(five[2], five[0], five[1])
    return rows
