"""The model: columns of the regressor, row by row, from the list of terms (eqs. 13, 14, 35-37).

Rows come in two pairings. ``link``/``motor`` are the paper's: 2n rows per sample, link rows with right-hand side
0. ``sum``/``motor`` is what estimation uses: the sum of a joint's two rows has the motor torque as right-hand side
and no spring in it, so no row is homogeneous and rows may be weighted freely. A rigid joint has its sum row only.

Where a joint torque sensor reads the torque in the transmission, three rows join these two, in which link and motor
side decouple: ``load``, what the bodies need = reading; ``drive``, rotor and friction = motor torque - reading;
``spring``, K (theta - q) = reading. An effect that the model lacks shows in one of the three only. The two are sums of
them (sum = load + drive, motor = drive + spring), but without the sensor's noise: each row has its own weight, and
standard errors know that the rows share their noise.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.memory import Recent
from elid_cli.model.kinematics import JointState, chain
from elid_cli.model.program import Program, compile_program
from elid_cli.model.terms.base_term import BaseTerm, ChainMotion, MotorState
from elid_cli.model.terms.coulomb import Coulomb
from elid_cli.model.terms.rigid_body import RigidBody
from elid_cli.model.terms.rotor import Rotor
from elid_cli.model.terms.spring import Spring
from elid_cli.model.terms.viscous import Viscous
from elid_cli.model.tracing import Graph, Node, Scalar
from elid_cli.robot.built import check_size
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.fitting_robot import check_robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.trigonometry import sine_and_cosine

Kind = Literal["sum", "motor", "link", "load", "drive", "spring"]
SENSOR_KINDS: tuple[Kind, ...] = ("load", "drive", "spring")
"""Row groups of a joint with a torque sensor."""
_ORDER: tuple[Kind, ...] = ("link", "sum", "motor", *SENSOR_KINDS)

BASE_TERMS: tuple[BaseTerm, ...] = (RigidBody(), Rotor(), Coulomb(), Viscous(), Spring())

INPUTS = 9
"""Inputs per joint: sin q, cos q, q, q', q'', θ', θ'', sign θ', q - θ."""


class EstimationRow(NamedTuple):
    """One row group of the regressor: an equation of one joint, for all samples."""

    kind: Kind
    joint: int


@dataclass(frozen=True)
class RowPlan:
    """Which standard parameters have a column in a row group, and where the traced program writes them."""

    row: EstimationRow
    columns: NDArray[np.intp]
    first: int

    @property
    def slots(self) -> slice:
        """Outputs of the program that belong to this row."""
        return slice(self.first, self.first + len(self.columns))


@dataclass(frozen=True)
class RegressorPlan:
    """A traced program and the rows it yields."""

    program: Program
    rows: tuple[RowPlan, ...]


_PLANS: Recent[RegressorPlan] = Recent(16)
"""Tracing and compiling takes as long as 20 000 samples do; a fleet or a diagnosis asks for the same rows often."""


class Regressor:
    """Regressor of a robot: standard parameters in standard order, columns from terms.

    Parameters
    ----------
    robot
        The robot description.
    terms
        Base terms; by default the paper's five.

    Raises
    ------
    RobotError
        More than `MOST_JOINTS` joints.
    UsageError
        `robot` is no robot.

    """

    def __init__(self, robot: Robot, terms: Sequence[BaseTerm] = BASE_TERMS) -> None:
        check_robot(robot)
        check_size(robot, robot.name)
        self.robot = robot
        self.terms = tuple(terms)
        self.names = robot.parameter_names()
        self.index = {name: k for k, name in enumerate(self.names)}
        self._sensed: dict[tuple[int, ...], RegressorPlan] = {}

    @property
    def parameters(self) -> int:
        """Number of standard parameters p (14 per elastic joint, 13 per rigid one)."""
        return len(self.names)

    @cached_property
    def estimation(self) -> RegressorPlan:
        """Sum and motor rows (the spring eliminated from the sum rows)."""
        return self._plan(paper=False)

    def sensed(self, sensors: NDArray[np.bool_]) -> RegressorPlan:
        """Return the rows of `estimation`, followed by those of the elastic joints that have torque sensors, (n,).

        Without a sensor the plan is `estimation` itself.
        """
        joints = tuple(int(k) for k in np.flatnonzero(sensors) if self.robot.joints[k].elastic)
        if joints not in self._sensed:
            self._sensed[joints] = self._plan(paper=False, sensors=joints) if joints else self.estimation
        return self._sensed[joints]

    @cached_property
    def equations(self) -> RegressorPlan:
        """Link and motor rows as in eq. (13); the single row of a rigid joint stays a sum row."""
        return self._plan(paper=True)

    def rows(self, motion: Motion, plan: RegressorPlan | None = None) -> dict[EstimationRow, Array]:
        """Return the columns of every row group for all samples.

        Parameters
        ----------
        motion
            States at N instants.
        plan
            `estimation` (default) or `equations`.

        Returns
        -------
        dict
            Row -> array of shape (len(columns), N); which parameters these are is in the plan.

        """
        plan = plan or self.estimation
        program, place = plan.program.distinct
        out = np.empty((program.outputs, motion.samples))
        program.run(inputs_of(motion, program), out)
        return {item.row: out[place[item.slots]] for item in plan.rows}

    def dense(self, motion: Motion, plan: RegressorPlan | None = None) -> Array:
        """Return the whole regressor, shape (rows, N, p); for tests and small questions only."""
        plan = plan or self.estimation
        rows = self.rows(motion, plan)
        dense = np.zeros((len(plan.rows), motion.samples, self.parameters))
        for k, item in enumerate(plan.rows):
            dense[k][:, item.columns] = rows[item.row].T
        return dense

    def _plan(self, *, paper: bool, sensors: tuple[int, ...] = ()) -> RegressorPlan:
        if self.terms != BASE_TERMS:
            return self._traced(paper=paper, sensors=sensors)
        key = (self.robot.structure, paper, sensors)
        return _PLANS.of(key, lambda: self._traced(paper=paper, sensors=sensors))

    def _traced(self, *, paper: bool, sensors: tuple[int, ...]) -> RegressorPlan:
        graph = Graph(INPUTS * self.robot.n)
        values = self.trace(graph, paper=paper, sensors=sensors)
        rows: list[RowPlan] = []
        outputs: list[Scalar] = []
        order = {"link": 0, "sum": 0, "motor": 1, "load": 2, "drive": 2, "spring": 2}
        for row in sorted(values, key=lambda r: (order[r.kind], r.joint, _ORDER.index(r.kind))):
            present = {name: value for name, value in values[row].items() if isinstance(value, Node) or value != 0}
            filled = [(self.index[name], present[name]) for name in sorted(present, key=self.index.__getitem__)]
            rows.append(RowPlan(row, np.array([k for k, _ in filled], dtype=np.intp), len(outputs)))
            outputs += [value for _, value in filled]
        return RegressorPlan(compile_program(graph, outputs), tuple(rows))

    def trace(
        self, graph: Graph, *, paper: bool, sensors: tuple[int, ...] = ()
    ) -> dict[EstimationRow, dict[StandardParameter, Scalar]]:
        """Record the coefficients of all parameters on `graph`, whose inputs are those of `inputs_of`."""
        inputs = [graph.input(slot) for slot in range(INPUTS * self.robot.n)]
        return self._coefficients(inputs, paper=paper, sensors=sensors)

    def blocks(self, motion: Motion) -> Iterator[tuple[EstimationRow, NDArray[np.intp], Array]]:
        """Yield (row, columns, their values (N, columns)) of the rows of `estimation`, without a traced program.

        For a question that is asked once of few samples: tracing takes longer than this and has the same result.
        """
        # arrays stand where traced values usually do: the recursion only adds and multiplies
        for row, values in self._coefficients(list(inputs_of(motion)), paper=False).items():
            names = sorted(values, key=self.index.__getitem__)
            columns = np.array([self.index[name] for name in names], dtype=np.intp)
            block = np.empty((len(names), motion.samples))
            for k, name in enumerate(names):
                block[k] = values[name]
            shown = block.any(axis=1)
            yield row, columns[shown], np.ascontiguousarray(block[shown].T)

    def _coefficients(
        self, inputs: Sequence[Any], *, paper: bool, sensors: tuple[int, ...] = ()
    ) -> dict[EstimationRow, dict[StandardParameter, Any]]:
        states, motors = states_of(inputs, self.robot)
        motion = ChainMotion(chain(self.robot, states), motors)
        values: dict[EstimationRow, dict[StandardParameter, Any]] = {}
        for k, joint in enumerate(self.robot.joints):
            if joint.elastic:
                values[EstimationRow("link" if paper else "sum", k)] = {}
                values[EstimationRow("motor", k)] = {}
            else:
                values[EstimationRow("sum", k)] = {}
            values |= {EstimationRow(kind, k): {} for kind in SENSOR_KINDS if k in sensors}
        targets: dict[tuple[str, int], list[dict[StandardParameter, Any]]] = {}
        for term in self.terms:
            for side, number, name, value in term.entries(self.robot, motion):
                spring = name.kind == "K" and name.joint == number
                if side == "motor" and not spring and self.robot.joints[number].torque_at == "link":
                    continue
                if (side, number) not in targets:
                    targets[side, number] = [values[row] for row in self._targets(side, number, paper=paper)]
                for columns in targets[side, number]:
                    columns[name] = columns[name] + value if name in columns else value
                read = _read(side, number, spring=spring) if number in sensors else None
                if read is not None:
                    values[read][name] = values[read].get(name, 0.0) + value
        return values

    def _targets(self, side: str, joint: int, *, paper: bool) -> list[EstimationRow]:
        if not self.robot.joints[joint].elastic:
            return [EstimationRow("sum", joint)]
        if side == "link":
            return [EstimationRow("link" if paper else "sum", joint)]
        return (
            [EstimationRow("motor", joint)] if paper else [EstimationRow("sum", joint), EstimationRow("motor", joint)]
        )


def _read(side: str, joint: int, *, spring: bool) -> EstimationRow | None:
    """Return the row that an entry of eq. (13) has its place in where a sensor reads the transmission's torque."""
    if spring:  # as it loads the motor: what the sensor reads
        return EstimationRow("spring", joint) if side == "motor" else None
    return EstimationRow("load" if side == "link" else "drive", joint)


def states_of(inputs: Sequence[Any], robot: Robot) -> tuple[list[JointState], list[MotorState]]:
    """Return what the terms see of joints and motors in the inputs of `inputs_of`, traced or arrays."""
    states, motors = [], []
    for k, joint in enumerate(robot.joints):
        sin, cos, q, dq, ddq, dtheta, ddtheta, direction, deflection = inputs[INPUTS * k : INPUTS * (k + 1)]
        states.append(JointState(sin, cos, q, dq, ddq))
        if joint.elastic:
            motors.append(MotorState(dtheta, ddtheta, direction, deflection))
        else:
            motors.append(MotorState(dq, ddq, direction, 0.0))
    return states, motors


def direction_inputs(joints: int) -> list[int]:
    """Return the numbers of the traced program's inputs that jump: each motor's direction."""
    return [INPUTS * k + 7 for k in range(joints)]


def inputs_of(motion: Motion, program: Program | None = None, out: Array | None = None) -> Array:
    """Return the traced program's inputs, shape (9 n, N).

    Parameters
    ----------
    motion
        States at N instants.
    program
        Only what this program uses is filled in, the rest left as it is.
    out
        Written to where given, (9 n, N).
    """
    n = motion.q.shape[1]
    rows = np.empty((n * INPUTS, motion.samples)) if out is None else out
    used = range(n * INPUTS) if program is None else program.used
    for k in range(n):
        fill_inputs(rows, motion, k, used)
    return rows


def fill_inputs(rows: Array, motion: Motion, joint: int, used: Container[int], width: float | None = None) -> None:
    """Write those inputs of a joint, of the traced program's `rows` (9 n, N), that are among the `used` ones.

    The motor's direction is rounded over a speed `width`, so that it has a slope where the velocity changes sign.
    """
    first = INPUTS * joint
    row = rows[first : first + INPUTS]
    wanted = {slot for slot in range(INPUTS) if first + slot in used}
    if wanted & {0, 1, 2, 8}:
        row[2] = motion.q[:, joint]  # samples side by side first: functions of strided samples take longer
    if wanted & {0, 1}:
        sine_and_cosine(row[2], row[0], row[1])
    for slot, values in ((3, motion.dq), (4, motion.ddq), (5, motion.dtheta), (6, motion.ddtheta)):
        if slot in wanted:
            row[slot] = values[:, joint]
    if 7 in wanted:
        speed = motion.dtheta[:, joint]
        row[7] = np.sign(speed) if width is None else np.tanh(speed / width)
    if 8 in wanted:
        np.subtract(row[2], motion.theta[:, joint], out=row[8])
