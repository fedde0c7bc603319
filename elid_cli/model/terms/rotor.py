"""Inertia of the rotors: spinning at k_m times the motor velocity, riding on body i-1 (eq. 8: B_d, B_Y; eq. 27-28)."""

from __future__ import annotations

from collections.abc import Iterator

from elid_cli.model.kinematics import add, cross, dot, scale
from elid_cli.model.terms.base_term import ChainMotion, Entry
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot


class Rotor:
    """Rotor inertia Jm_i about its own axis, motor side of the gear."""

    name = "rotor"
    equation = (
        "motor equation: k² Jm θ'' + k Jm z·alpha_{i-1};  link equation j<i: k Jm w_j·(θ'' z + θ' omega_{i-1}×z);  "
        "gear ratio unknown: motor equation: Ja θ''"
    )

    def entries(self, robot: Robot, motion: ChainMotion) -> Iterator[Entry]:
        """Yield the coefficients of Jm_i in motor row i and, through the body it rides on, in the rows that move it.

        A rotor of unknown gear ratio has its inertia at the joint, Ja_i, in its own row only.
        """
        for i, (joint, motor) in enumerate(zip(robot.joints, motion.motors, strict=True), start=1):
            if joint.gear_ratio is None:
                yield Entry("motor", i - 1, StandardParameter("Ja", i - 1), motor.ddtheta)
                continue
            carrier = motion.bodies[robot.parents[i - 1] + 1]
            ratio, axis = joint.gear_ratio, joint.motor_axis
            own = motor.ddtheta * (ratio * ratio)
            yield Entry("motor", i - 1, StandardParameter("Jm", i - 1), own + dot(axis, carrier.alpha) * ratio)
            moment = add(scale(axis, motor.ddtheta), scale(cross(carrier.omega, axis), motor.dtheta))
            for j, (_, w) in carrier.twists:
                yield Entry("link", j, StandardParameter("Jm", i - 1), dot(w, moment) * ratio)
