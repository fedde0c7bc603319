"""Transmission stiffness: the spring between motor and link (eqs. 6, 34)."""

from __future__ import annotations

from collections.abc import Iterator

from elid_cli.model.terms.base_term import ChainMotion, Entry
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot


class Spring:
    """Stiffness K_i of an elastic transmission."""

    name = "spring"
    equation = "link equation: K (q - θ);  motor equation: -K (q - θ)"

    def entries(self, robot: Robot, motion: ChainMotion) -> Iterator[Entry]:
        """Yield K_i in link row i and, with the other sign, in motor row i; rigid joints have none."""
        for i, (joint, motor) in enumerate(zip(robot.joints, motion.motors, strict=True)):
            if joint.elastic:
                yield Entry("link", i, StandardParameter("K", i), motor.deflection)
                yield Entry("motor", i, StandardParameter("K", i), -motor.deflection)
