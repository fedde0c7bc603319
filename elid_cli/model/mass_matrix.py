"""Equations of motion with parameters put in, motors eliminated; its small solver.

Every zero of the geometry and of the parameters shortens the programs. Unknowns are the link accelerations and
those of the motors behind elastic transmissions; a rigid joint has one row, the sum of its two. Motors couple to
each other through the links only, so their accelerations are eliminated inside the trace (Schur complement) and an
n x n system remains.

A simulator solves one such system some hundred thousand times; for a dozen unknowns a call into LAPACK costs more
than the arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from elid_cli.model.kinematics import JointState, chain
from elid_cli.model.program import Program, compile_program
from elid_cli.model.terms.base_term import BaseTerm, ChainMotion, MotorState
from elid_cli.model.tracing import Graph, Scalar
from elid_cli.robot.robot import Robot

BLOCKS = 9
"""Groups of n inputs: sin q, cos q, q, q', θ', sign θ', q - θ, link force, motor force."""


@dataclass(frozen=True)
class ReducedEquations:
    """Program of the reduced system S q'' = r, and what gives the motors' accelerations afterwards.

    Outputs: r (n), S's upper triangle by rows, the motors' own accelerations a (m), couplings c.
    θ''_row = a[row] - sum of c[place] q''[k] over `couplings[row]`, pairs (k, place among all outputs).
    """

    program: Program
    couplings: tuple[tuple[tuple[int, int], ...], ...]


@dataclass(frozen=True)
class NumericEquations:
    """A robot, its base terms and the values of all its standard parameters by name."""

    robot: Robot
    terms: Sequence[BaseTerm]
    values: Mapping[str, float]

    @property
    def elastic(self) -> tuple[int, ...]:
        """Joints with a motor state of their own."""
        return tuple(k for k, joint in enumerate(self.robot.joints) if joint.elastic)

    def motor_inertia(self) -> list[float]:
        """Return k_m² Jm, or Ja, of the elastic joints' motors, kg·m² at the joint."""
        joints, names = self.robot.joints, self.robot.rotor_names
        return [self.values[names[k]] * (joints[k].gear_ratio or 1.0) ** 2 for k in self.elastic]  # Ja has it in it

    def reduced(self) -> ReducedEquations:
        """Trace the reduced system; inputs are the `BLOCKS`."""
        n, elastic, inertia = self.robot.n, self.elastic, self.motor_inertia()
        graph, blocks = self._inputs()
        link_force, motor_force = blocks[7], blocks[8]
        link_bias, motor_bias = self._rows(*self._moving(blocks))
        B, C = self._mass_blocks(blocks)
        motor = [(motor_force[k] - motor_bias[k]) * (1.0 / d) for k, d in zip(elastic, inertia, strict=True)]
        right: list[Scalar] = []
        upper: list[Scalar] = []
        for i in range(n):
            value = link_force[i] - link_bias[i]
            if i not in elastic:
                value = value + motor_force[i]
            for row in range(len(elastic)):
                value = value - C[i][row] * motor[row]
            right.append(value)
            for j in range(i, n):
                entry = B[i][j]
                for row, d in enumerate(inertia):
                    entry = entry - C[i][row] * C[j][row] * (1.0 / d)
                upper.append(entry)
        outputs: list[Scalar] = [*right, *upper, *motor]
        couplings = []
        for row, d in enumerate(inertia):
            links = [k for k in range(n) if C[k][row] != 0.0]
            couplings.append(tuple((k, len(outputs) + p) for p, k in enumerate(links)))
            outputs += [C[k][row] * (1.0 / d) for k in links]
        return ReducedEquations(compile_program(graph, outputs), tuple(couplings))

    def mass(self) -> Program:
        """Trace the link rows of the mass matrix (eq. 8): n rows of q then θ of the elastic joints."""
        graph, blocks = self._inputs()
        B, C = self._mass_blocks(blocks)
        return compile_program(graph, [value for b, c in zip(B, C, strict=True) for value in (*b, *c)])

    def _inputs(self) -> tuple[Graph, list[list[Scalar]]]:
        n = self.robot.n
        graph = Graph(BLOCKS * n)
        return graph, [[graph.input(block * n + k) for k in range(n)] for block in range(BLOCKS)]

    @staticmethod
    def _moving(blocks: list[list[Scalar]]) -> tuple[list[JointState], list[MotorState]]:
        """Return the states at the given velocities, without acceleration."""
        sin, cos, q, dq, dtheta, direction, deflection, _, _ = blocks
        states = [JointState(s, c, x, v, 0.0) for s, c, x, v in zip(sin, cos, q, dq, strict=True)]
        motors = [MotorState(w, 0.0, s, e) for w, s, e in zip(dtheta, direction, deflection, strict=True)]
        return states, motors

    def _mass_blocks(self, blocks: list[list[Scalar]]) -> tuple[list[list[Scalar]], list[list[Scalar]]]:
        """Return (B, C): torques of the link rows at one unit acceleration at a time, from rest without gravity."""
        n = self.robot.n

        def column(link: int, motor: int) -> list[Scalar]:
            states, motors = [], []
            for k, (sin, cos, q) in enumerate(zip(*blocks[:3], strict=True)):
                carried = k == link and k not in self.elastic  # a rigid joint's rotor goes with its link
                states.append(JointState(sin, cos, q, 0.0, 1.0 if k == link else 0.0))
                motors.append(MotorState(0.0, 1.0 if k == motor or carried else 0.0, 0.0, 0.0))
            return self._rows(states, motors, gravity=False)[0]

        links = [column(k, -1) for k in range(n)]
        motors = [column(-1, k) for k in self.elastic]
        return [[c[j] for c in links] for j in range(n)], [[c[j] for c in motors] for j in range(n)]

    def _rows(
        self, states: Sequence[JointState], motors: Sequence[MotorState], *, gravity: bool = True
    ) -> tuple[list[Scalar], list[Scalar]]:
        """Return (link rows, motor rows); the motor row of a rigid joint is merged into its link row."""
        link: list[Scalar] = [0.0] * self.robot.n
        motor: list[Scalar] = [0.0] * self.robot.n
        motion = ChainMotion(chain(self.robot, states, gravity=gravity), motors)
        for term in self.terms:
            for side, number, name, value in term.entries(self.robot, motion):
                rows = motor if side == "motor" and number in self.elastic else link
                rows[number] = rows[number] + value * self.values[name]
        return link, motor


class NotPositiveError(ValueError):
    """A pivot is not positive; `pivot` counts unknowns from 0."""

    def __init__(self, pivot: int) -> None:
        super().__init__(f"pivot {pivot} is not positive")
        self.pivot = pivot


@cache
def ldl_solver(n: int) -> Callable[[list[float]], list[float]]:
    """Return a function that solves A x = b for symmetric A of size n.

    Its argument is one list: b, then A's upper triangle by rows; what follows is not looked at.

    Raises
    ------
    NotPositiveError
        (from the returned function) A is not positive definite.

    """
    statements, solution = ldl_statements(n, [f"x[{k}]" for k in range(n + n * (n + 1) // 2)])
    lines = ["def solve(x):", *(f" {line}" for line in statements)]
    lines = [line.replace("return", "raise NotPositiveError(") + ")" if "return" in line else line for line in lines]
    lines.append(f" return [{', '.join(solution)}]")
    scope: dict[str, object] = {"NotPositiveError": NotPositiveError}
    exec("\n".join(lines), scope)  # the text holds nothing but the names above
    return scope["solve"]  # type: ignore[return-value]


def ldl_statements(n: int, given: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the same as scalar statements, and what the unknowns are called after them.

    `given` are b, then A's upper triangle by rows. A pivot k that is not positive makes them return k.
    """
    place = {}
    position = n
    for i in range(n):
        for j in range(i, n):
            place[i, j] = position
            position += 1
    lines = []
    # A = L D L'; u_kj = d_k l_jk, rows of the upper triangle
    for k in range(n):
        for j in range(k, n):
            products = "".join(f" - l{k}_{i} * u{i}_{j}" for i in range(k))
            lines.append(f"u{k}_{j} = {given[place[k, j]]}{products}")
        lines.append(f"if not u{k}_{k} > 0.0: return {k}")
        lines += [f"l{j}_{k} = u{k}_{j} / u{k}_{k}" for j in range(k + 1, n)]
    for k in range(n):
        lines.append(f"y{k} = {given[k]}" + "".join(f" - l{k}_{i} * y{i}" for i in range(k)))
    for k in reversed(range(n)):
        lines.append(f"y{k} = y{k} / u{k}_{k}" + "".join(f" - l{i}_{k} * y{i}" for i in range(k + 1, n)))
    return lines, [f"y{k}" for k in range(n)]
