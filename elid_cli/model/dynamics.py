"""Forward and inverse dynamics of one described robot, one instant at a time (eqs. 1, 2, 6-8)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.model.effects.scene import DIRECTION_WIDTH, direction_widths
from elid_cli.model.mass_matrix import (
    BLOCKS,
    NotPositiveError,
    NumericEquations,
    ReducedEquations,
    ldl_solver,
    ldl_statements,
)
from elid_cli.model.program import Program, compile_program
from elid_cli.model.regressor import Regressor, inputs_of
from elid_cli.model.tracing import Graph, Scalar
from elid_cli.robot.ideal import DRIVE
from elid_cli.robot.parameter import MOTOR_PARAMETERS, StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.robot.yaml import quoted
from elid_cli.signals.motion import Motion, random_motion

Vector = Sequence[float]
_Function = Callable[[Sequence[float]], list[float]]

_NEGLIGIBLE = 1e-11
"""A column smaller than this share of the largest one does not move the robot."""
_WIDE = 10.0
"""Feed-forward friction is rounded over this many widths."""


class Dynamics:
    """Equations of motion of a robot with known parameters.

    Parameters
    ----------
    robot
        The robot description.
    parameters
        Standard parameters in standard order (p,); by default the description's reference values. NaN is allowed
        where the motion does not depend on the parameter, which then counts as 0.
    friction_width
        Speed (rad/s; a tenth of it in m/s) over which Coulomb friction's sign(v) is rounded as tanh(v / width). There
        is no stiction state: a joint held by friction creeps at less than about this speed.
    inert
        Whether motors behind springs must have an inertia, as every acceleration needs.

    Raises
    ------
    RobotError
        A parameter that matters is unknown, or a motor has no inertia.

    """

    def __init__(
        self,
        robot: Robot,
        parameters: Array | None = None,
        *,
        friction_width: float = DIRECTION_WIDTH,
        inert: bool = True,
    ) -> None:
        self.robot = robot
        self._friction_width = friction_width
        self.model = Regressor(robot)
        self.parameters = _known(self.model, robot.reference() if parameters is None else parameters)
        self.widths = direction_widths(robot, friction_width)
        """Speed over which each joint's Coulomb friction is rounded, shape (n,)."""
        self._width_list: list[float] = self.widths.tolist()
        self._values = dict(zip(self.model.names, self.parameters.tolist(), strict=True))
        self._folded = NumericEquations(robot, self.model.terms, self._values)
        self.elastic = self._folded.elastic
        """Joints with a motor state of their own."""
        self.stiffness = np.array([self._values.get(StandardParameter("K", k), math.nan) for k in range(robot.n)])
        """K of every joint, NaN where rigid, shape (n,)."""
        for k, inertia in zip(self.elastic, self._folded.motor_inertia(), strict=True):
            if inert and not inertia > 0:
                raise self._no_rotor(k)

    def acceleration(
        self,
        q: Vector,
        dq: Vector,
        theta: Vector,
        dtheta: Vector,
        tau: Vector,
        extra: tuple[Vector, Vector] | None = None,
    ) -> tuple[list[float], list[float]]:
        """Return (q'', θ'') of all joints, rad/s² or m/s²; for a rigid joint both are the same.

        Parameters
        ----------
        q, dq, theta, dtheta
            State, all joints; for rigid joints theta and dtheta are not looked at.
        tau
            Motor torques seen at the joints, N·m.
        extra
            Torques of effects on the model's side (a friction is positive), in (link rows, motor rows).

        Raises
        ------
        RobotError
            The mass matrix is not positive definite here.

        """
        n = self.robot.n
        motor = [dtheta[k] if k in self.elastic else dq[k] for k in range(n)]
        deflection = [a - b for a, b in zip(q, theta, strict=True)]
        links, motors = extra if extra is not None else ([0.0] * n, [0.0] * n)
        motor_force = [u - value for u, value in zip(tau, motors, strict=True)]
        ddq, ddtheta = self.solve(list(q), list(dq), motor, deflection, [-value for value in links], motor_force)
        full = list(ddq)
        for k, value in zip(self.elastic, ddtheta, strict=True):
            full[k] = value
        return ddq, full

    def solve(
        self,
        q: list[float],
        dq: list[float],
        dtheta: list[float],
        deflection: list[float],
        link_force: list[float],
        motor_force: list[float],
    ) -> tuple[list[float], list[float]]:
        """Return (q'' of all joints, θ'' of elastic joints); the integrator's door, lists of n floats.

        For a rigid joint `dtheta` is `dq`, and the two forces act on the same row.

        Raises
        ------
        RobotError
            The mass matrix is not positive definite here.

        """
        direction = [math.tanh(v / width) for v, width in zip(dtheta, self._width_list, strict=True)]
        out = self._core(
            [*map(math.sin, q), *map(math.cos, q), *q, *dq, *dtheta, *direction, *deflection, *link_force, *motor_force]
        )
        try:
            ddq = self._solve(out)
        except NotPositiveError as problem:
            raise self._not_positive(problem.pivot, q) from None
        n = len(q)
        place = n + n * (n + 1) // 2
        ddtheta = []
        for couplings in self._reduced.couplings:
            value = out[place]
            place += 1
            for k, c in couplings:
                value -= out[c] * ddq[k]
            ddtheta.append(value)
        return ddq, ddtheta

    def statements(self) -> tuple[list[str], list[str]]:
        """Return `solve` without link forces as scalar statements, and what its accelerations are called after them.

        The names they start from are q0, …, v0, … (q'), w0, … (θ'), g0, … (q - θ) and f0, … (motor force); they need
        sin, cos and tanh, and return a pivot's number where the mass matrix is not positive definite.
        """
        joints = range(self.robot.n)
        lines = [f"{name}{k} = {f}(q{k})" for name, f in (("s", "sin"), ("c", "cos")) for k in joints]
        lines += [f"d{k} = tanh(w{k} / {width!r})" for k, width in enumerate(self._width_list)]
        inputs = [f"{name}{k}" for name in "scqvwdg" for k in joints]
        core, out = self._reduced.program.statements([*inputs, *("0.0" for _ in joints), *(f"f{k}" for k in joints)])
        solved, ddq = ldl_statements(self.robot.ancestors, out)
        place = self.robot.n + self.robot.n * (self.robot.n + 1) // 2
        motors = []
        for number, couplings in enumerate(self._reduced.couplings):
            terms = "".join(f" - {out[c]} * {ddq[k]}" for k, c in couplings)
            motors.append(f"m{number} = {out[place + number]}{terms}")
        return [*lines, *core, *solved, *motors], [*ddq, *(f"m{k}" for k in range(len(motors)))]

    def described_by(self, parameters: Array) -> Dynamics:
        """Return the same robot with other standard parameters (p,)."""
        return Dynamics(self.robot, parameters, friction_width=self._friction_width)

    def value(self, parameter: StandardParameter) -> float:
        """Return a parameter's value, 0 where the robot has no such parameter."""
        return float(self._values.get(parameter, 0.0))

    def mass_matrix(self, q: Vector) -> Array:
        """Return the mass matrix of eq. (8), rows and columns q then θ of the elastic joints, shape (n+m, n+m)."""
        n, m = self.robot.n, len(self.elastic)
        out = self._mass([*map(math.sin, q), *map(math.cos, q), *q, *([0.0] * (n * (BLOCKS - 3)))])
        matrix = np.zeros((n + m, n + m))
        matrix[:n] = np.reshape(out, (n, n + m))
        matrix[n:, :n] = matrix[:n, n:].T
        matrix[range(n, n + m), range(n, n + m)] = self._folded.motor_inertia()
        return matrix

    def inverse(
        self, q: Vector, dq: Vector, ddq: Vector, theta: Vector, dtheta: Vector, ddtheta: Vector
    ) -> tuple[list[float], list[float]]:
        """Return (link rows, motor rows) of eq. (2) for a given motion: 0 and the motor torques when it is free.

        The one row of a rigid joint stands among the motor rows, with 0 among the link rows. sign(θ') is rounded
        as in `acceleration`.
        """
        columns = [np.array([v], dtype=float) for v in (q, dq, ddq, theta, dtheta, ddtheta)]
        for k in range(self.robot.n):
            if k not in self.elastic:
                for link in range(3):
                    columns[link + 3][0, k] = columns[link][0, k]
        inputs = inputs_of(Motion(np.zeros(1), *columns))
        inputs[7::9, 0] = np.tanh(inputs[5::9, 0] / self.widths)
        out = self._inverse(inputs[:, 0].tolist())
        return out[: self.robot.n], out[self.robot.n :]

    def rigid_loads(self, q: Vector, dq: Vector, ddq: Vector) -> list[float]:
        """Return what the bodies beyond each rigid joint need, N·m: its torque without its own rotor and friction."""
        inputs: list[float] = []  # as `inputs_of`, of one instant
        for x, v, a in zip(q, dq, ddq, strict=True):
            inputs += (math.sin(x), math.cos(x), x, v, a, v, a, 0.0, 0.0)
        loads = self._loads(inputs)
        return [0.0 if k in self.elastic else value for k, value in enumerate(loads)]

    def gravity(self, q: Array) -> Array:
        """Return the torques that hold the links at rest, N·m; positions and result of shape (N, n)."""
        return self.feedforward(q, np.zeros_like(q), np.zeros_like(q))[0]

    def feedforward(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
        """Return (torque through the transmissions, motor torque) for motors that move with their links, N·m.

        Positions, velocities, accelerations and results are of shape (N, n). Friction is rounded widely, so that
        the torque hardly jumps at reversals. For a rigid joint both torques are the motor's.
        """
        n = self.robot.n
        inputs = inputs_of(Motion(np.zeros(q.shape[0]), q, dq, ddq, q, dq, ddq))
        inputs[7::9] = np.tanh(inputs[5::9] / (_WIDE * self.widths[:, None]))
        out = np.empty((2 * n, q.shape[0]))
        self.inverse_program.run(inputs, out)
        total = out[:n] + out[n:]
        rigid = ~self.robot.elastic
        return np.where(rigid, total.T, out[:n].T), total.T.copy()

    # the forward equations take most of the tracing, and many ask for the inverse ones alone
    @cached_property
    def _reduced(self) -> ReducedEquations:
        return self._folded.reduced()

    @cached_property
    def _core(self) -> _Function:
        return self._reduced.program.scalar()

    @cached_property
    def _solve(self) -> Callable[[list[float]], list[float]]:
        return ldl_solver(self.robot.ancestors)

    @cached_property
    def _mass(self) -> _Function:
        return self._folded.mass().scalar()

    @cached_property
    def _loads(self) -> _Function:
        n = self.robot.n
        graph = Graph(9 * n)
        outputs: list[Scalar] = [0.0] * n
        for row, columns in self.model.trace(graph, paper=True).items():
            own = {f"{kind}{row.joint + 1}" for kind in MOTOR_PARAMETERS}
            for name, value in columns.items():
                if name not in own:
                    outputs[row.joint] = outputs[row.joint] + value * self._values[name]
        return compile_program(graph, outputs).scalar()

    @cached_property
    def _inverse(self) -> _Function:
        return self.inverse_program.scalar()

    @cached_property
    def inverse_program(self) -> Program:
        """Trace the regressor's own rows (`Model.trace`), so that it shares no elimination with `solve`."""
        n = self.robot.n
        graph = Graph(9 * n)
        outputs: list[Scalar] = [0.0] * (2 * n)
        for row, columns in self.model.trace(graph, paper=True).items():
            place = row.joint if row.kind == "link" else n + row.joint
            for name, value in columns.items():
                outputs[place] = outputs[place] + value * self._values[name]
        return compile_program(graph, outputs)

    def _no_rotor(self, k: int) -> RobotError:
        name = self.robot.rotor_names[k]
        return RobotError(
            f"{self.robot.name}: {self.robot.joints[k].name}: {name[:2]} = {self._values[name]:g} kg·m²",
            detail="a motor behind an elastic transmission needs a positive rotor inertia to move",
            hint="give a positive Jm and gear_ratio, or Ja, or transmission: rigid",
        )

    def _not_positive(self, pivot: int, q: Vector) -> RobotError | ValueError:
        if not all(map(math.isfinite, q)):  # a motion that runs away, and no fault of the masses
            return ValueError("no finite position")
        where = ", ".join(f"{x:.3g}" for x in q)
        return RobotError(
            f"{self.robot.name}: {self.robot.joints[pivot].name}: the mass matrix is not positive definite",
            detail=f"at q = {where}: these parameters describe no physical robot",
            hint="the inertia of body i contains that of rotor i+1, which rides on it: is Jm counted in?",
        )


def _known(model: Regressor, parameters: Array) -> Array:
    """Return the parameters with 0 for unknown ones that move nothing; raise where one matters."""
    if missing := unknown_parameters(model, parameters):
        raise _unknown(model.robot, missing)
    return np.asarray(np.nan_to_num(np.array(parameters, dtype=float)))


def unknown_parameters(model: Regressor, parameters: Array) -> list[StandardParameter]:
    """Return the parameters that are NaN among the values (p,) and that the robot's motion depends on."""
    unknown = np.flatnonzero(np.isnan(parameters))
    if not unknown.size:
        return []
    motion = random_motion(model.robot.n, model.robot.elastic, 40)
    sizes = np.abs(model.dense(motion, model.equations)).max(axis=(0, 1))
    return [model.names[k] for k in unknown if sizes[k] > _NEGLIGIBLE * sizes.max()]


def _unknown(robot: Robot, missing: list[StandardParameter]) -> RobotError:
    by_joint: dict[int, list[str]] = {}
    for name in missing:
        by_joint.setdefault(name.joint, []).append(name.kind)
    parts = [f"{robot.joints[k].name} {' '.join(kinds)}" for k, kinds in sorted(by_joint.items())]
    return RobotError(
        f"{robot.name}: parameters that its motion depends on are unknown",
        detail="; ".join(parts),
        hint=_where_to_say(robot, by_joint),
    )


def _where_to_say(robot: Robot, missing: Mapping[int, Sequence[str]]) -> str:
    """Return in words how unknown parameters (kinds by joint) are given."""
    place = "under the joints' parameters:"
    if robot.source:
        k, kinds = min(missing.items())
        line = f"joints: {{{quoted(robot.joints[k].name)}: {{parameters: {{{kinds[0]}: …}}}}}}"
        place = f"{robot.place_to_say}, {line}"
    if all(set(kinds) <= set(DRIVE) for kinds in missing.values()) and not robot.elastic[list(missing)].any():
        found = "identify them: elid identify … --write-robot FILE.yaml"
        return f"give them {place}, {found}, or let elid simulate take them as 0: --ideal-drives"
    return f"give them {place}, or identify first: elid identify … --write-robot FILE.yaml"
