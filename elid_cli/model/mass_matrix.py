"""Equations of motion with parameters put in, motors eliminated; its small solver.

Every zero of the geometry and of the parameters shortens the programs. Unknowns are the link accelerations and
those of the motors behind elastic transmissions; a rigid joint has one row, the sum of its two. Motors couple to
each other through the links only, so their accelerations are eliminated inside the trace (Schur complement) and an
n x n system remains.

A simulator solves one such system some hundred thousand times; for a dozen unknowns a call into LAPACK costs more
than the arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from elid_cli.model.kinematics import Body, JointState, chain
from elid_cli.model.program import Program, compile_program
from elid_cli.model.terms.base_term import BaseTerm, ChainMotion, MotorState, entries
from elid_cli.model.terms.rigid_body import RigidBody
from elid_cli.model.towards_base import Inertia, JointRows, mass_rows, with_unit_twists
from elid_cli.model.tracing import Graph, Scalar
from elid_cli.robot.parameter import LINK_PARAMETERS, StandardParameter
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
        resting = [JointState(sin, cos, q, 0.0, 0.0) for sin, cos, q in zip(*blocks[:3], strict=True)]
        B: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
        for i, j, entry in mass_rows(self.robot, resting, [self._inertia(k) for k in range(n)]):
            B[i][j] = entry
        C: list[list[Scalar]] = [[] for _ in range(n)]
        for k, column in enumerate(self._of_rotors(resting)):
            for i in range(n):
                if k in self.elastic:
                    C[i].append(column[i])
                else:  # a rigid joint's rotor goes with its link
                    B[i][k] = B[i][k] + column[i]
        for i in range(n):
            for j in range(i):
                B[i][j] = B[j][i]
        return B, C

    def _of_rotors(self, resting: Sequence[JointState]) -> list[list[Scalar]]:
        """Return the link rows' torques at one unit acceleration of a motor at a time, everything else at rest.

        Bodies at rest need none: every term's entries are of the motor whose parameters they multiply.
        """
        n = self.robot.n
        motion = ChainMotion(self._bodies(resting, gravity=False), [MotorState(0.0, 1.0, 0.0, 0.0)] * n)
        rows = [JointRows(n) for _ in range(n)]
        moving = [term for term in self.terms if not isinstance(term, RigidBody)]
        for entry in entries(moving, self.robot, motion):
            rows[entry.parameter.joint].take(entry, self.values, self.elastic)
        return [own.torques(self.robot, resting)[0] for own in rows]

    def _bodies(self, states: Sequence[JointState], *, gravity: bool) -> list[Body]:
        """Return the bodies' motion with their own six unit motions as twists."""
        return with_unit_twists(chain(self.robot, states, gravity=gravity, twists=False))

    def _inertia(self, k: int) -> Inertia:
        """Return the inertia of the body that joint k moves."""
        m, *rest = (self.values[StandardParameter(kind, k)] for kind in LINK_PARAMETERS)
        return Inertia(m, (rest[0], rest[1], rest[2]), (rest[3], rest[4], rest[5], rest[6], rest[7], rest[8]))

    def _rows(self, states: Sequence[JointState], motors: Sequence[MotorState]) -> tuple[list[Scalar], list[Scalar]]:
        """Return (link rows, motor rows); the motor row of a rigid joint is merged into its link row."""
        motion, rows = ChainMotion(self._bodies(states, gravity=True), motors), JointRows(self.robot.n)
        for entry in entries(self.terms, self.robot, motion):
            rows.take(entry, self.values, self.elastic)
        return rows.torques(self.robot, states)


class NotPositiveError(ValueError):
    """A pivot is not positive; `pivot` counts unknowns from 0."""

    def __init__(self, pivot: int) -> None:
        super().__init__(f"pivot {pivot} is not positive")
        self.pivot = pivot


@cache
def ldl_solver(ancestors: tuple[tuple[int, ...], ...]) -> Callable[[list[float]], list[float]]:
    """Return a function that solves A x = b for symmetric A, shape (n, n), whose zeros are those of a tree.

    `ancestors` are, for each unknown j, those i up to j itself where A[i, j] may be other than 0 (`Robot.ancestors`).
    The function's argument is one list: b, then A's upper triangle by rows; what follows is not looked at.

    Raises
    ------
    NotPositiveError
        (from the returned function) A is not positive definite.

    """
    n = len(ancestors)
    statements, solution = ldl_statements(ancestors, [f"x[{k}]" for k in range(n + n * (n + 1) // 2)])
    lines = ["def solve(x):", *(f" {line}" for line in statements)]
    lines = [line.replace("return", "raise NotPositiveError(") + ")" if "return" in line else line for line in lines]
    lines.append(f" return [{', '.join(solution)}]")
    scope: dict[str, object] = {"NotPositiveError": NotPositiveError}
    exec("\n".join(lines), scope)  # the text holds nothing but the names above
    return scope["solve"]  # type: ignore[return-value]


def ldl_statements(ancestors: Sequence[Sequence[int]], given: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the same as scalar statements, and what the unknowns are called after them.

    `given` are b, then A's upper triangle by rows. A pivot k that is not positive makes them return k. The last unknown
    goes first, so that what is 0 stays 0 (Featherstone, Int. J. Robotics Research 24, 2005).
    """
    n = len(ancestors)
    before = [own[:-1] for own in ancestors]
    after: list[list[int]] = [[k for k in range(n) if j in before[k]] for j in range(n)]
    lines = []

    def less(start: str, products: Iterable[str]) -> str:
        return start + "".join(f" - {product}" for product in products)

    # A = L' D L with L unit lower; u_kj = d_k l_kj
    for k in reversed(range(n)):
        for j in reversed(ancestors[k]):
            place = n + j * n - j * (j - 1) // 2 + k - j
            both = (f"l{i}_{k} * u{i}_{j}" for i in reversed(after[k]))
            lines.append(f"u{k}_{j} = {less(given[place], both)}")
        lines.append(f"if not u{k}_{k} > 0.0: return {k}")
        lines += [f"l{k}_{j} = u{k}_{j} / u{k}_{k}" for j in before[k]]
    for k in reversed(range(n)):
        lines.append(f"y{k} = {less(given[k], (f'l{i}_{k} * y{i}' for i in reversed(after[k])))}")
    for k in range(n):
        lines.append(f"y{k} = {less(f'y{k} / u{k}_{k}', (f'l{k}_{j} * y{j}' for j in before[k]))}")
    return lines, [f"y{k}" for k in range(n)]
