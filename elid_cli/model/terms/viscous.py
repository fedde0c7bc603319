"""Viscous friction of the motors, seen at the joint (eqs. 5, 33)."""

from __future__ import annotations

from collections.abc import Iterator

from elid_cli.model.terms.base_term import ChainMotion, Entry
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot


class Viscous:
    """Viscous friction fv_i."""

    name = "viscous"
    equation = "motor equation: fv θ'"

    def entries(self, robot: Robot, motion: ChainMotion) -> Iterator[Entry]:
        """Yield fv_i in motor row i."""
        for i, motor in enumerate(motion.motors):
            yield Entry("motor", i, StandardParameter("fv", i), motor.dtheta)
