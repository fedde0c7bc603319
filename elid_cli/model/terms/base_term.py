"""What a base term of the model knows: its standard parameters and where each enters the equations of motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

from elid_cli.model.kinematics import Body
from elid_cli.model.tracing import Scalar
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot

Side = Literal["link", "motor"]
"""Row of a joint: the link's equation (right-hand side 0) or the motor's (right-hand side: motor torque)."""


class Entry(NamedTuple):
    """Coefficient of one standard parameter in one row of eq. (13): ``value`` = dY/d(parameter)."""

    side: Side
    joint: int
    parameter: StandardParameter
    value: Scalar


@dataclass(frozen=True)
class MotorState:
    """One motor's motion: velocity, acceleration, direction of motion and the deflection q - theta."""

    dtheta: Scalar
    ddtheta: Scalar
    direction: Scalar
    deflection: Scalar


@dataclass(frozen=True)
class ChainMotion:
    """What base terms compute from: the bodies' motion (0 is the base) and the motors' states."""

    bodies: Sequence[Body]
    motors: Sequence[MotorState]


class BaseTerm(Protocol):
    """A term of the 14-parameters-per-joint model, linear in its parameters."""

    name: str
    equation: str

    def entries(self, robot: Robot, motion: ChainMotion) -> Iterator[Entry]:
        """Yield the non-zero coefficients of the term's parameters, row by row."""
        ...


def entries(terms: Iterable[BaseTerm], robot: Robot, motion: ChainMotion) -> Iterator[Entry]:
    """Yield the non-zero coefficients of the parameters of all terms."""
    for term in terms:
        yield from term.entries(robot, motion)
