"""Transmission compliance: a transmission that the robot file takes as rigid yields under its load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import body_torque
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import derivative
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.robot import Robot

STEP = 1e-6
"""rad/(N·m); compliance by which torques are compared."""


class TransmissionCompliance(Effect):
    """What the bodies' torques change where a link is behind its motor by the load over the stiffness.

    To first order, below the joint's antiresonance: q = theta - compliance · load, and its rates likewise. The load is
    the present model's.
    """

    name = "transmission_compliance"
    summary = "transmission that yields, of a joint taken as rigid"
    equation = (
        "all link equations: what the bodies' torques are at q = theta - compliance load, less those at q = theta"
    )
    physics = (
        "A harmonic drive, a belt or a long shaft twists under load: the link is not where the motor's encoder says."
        " Its stiffness is 1/compliance."
    )
    typical = "stiffness 1e3 to 1e7 N·m/rad: the link is 0.5 to 5 mrad behind under full load"
    fingerprint = "whole joint, of every joint whose torque depends on this joint's motion, along load and rates"
    record = (
        "an encoder on the link, or a multisine past the antiresonance with the joint declared elastic (elid excite"
        " --show-stiffness); either gives the stiffness itself"
    )
    place = "chain"
    from_model = quasi_static = True
    amplitudes = (Parameter("compliance", "rad/(N·m)", "deflection per torque, 1/stiffness", low=0.0, high=0.1),)
    example = {"compliance": 2e-5}
    simulated = "log"

    @classmethod
    def summary_of(cls, terms: Sequence[Mapping[str, float]], errors: Sequence[Mapping[str, float]] = ()) -> str:
        """Return what it is, with the stiffness."""
        stiffness = 1.0 / max(terms[0]["compliance"], 1e-300)
        return f"{cls.summary} (stiffness {float(f'{stiffness:.2g}'):.6g} N·m/rad)"

    @classmethod
    def unfit(cls, robot: Robot, joint: int) -> str:
        """Return that the joint's stiffness is a parameter, where its transmission is elastic."""
        name = robot.joints[joint].name
        own = f"the transmission of {name} is elastic: its K is a parameter" if robot.joints[joint].elastic else ""
        return own or super().unfit(robot, joint)

    def columns(self, scene: Scene) -> Columns:
        """Return what all torques of the bodies change with the link's motion per compliance."""
        motion, j = scene.motion, self.joint
        load = scene.load[:, j]
        rate = derivative(load, scene.dt, scene.starts)
        bend = derivative(rate, scene.dt, scene.starts)
        moved = motion.of_joint(j).changed(
            q=motion.q[:, [j]] - STEP * load[:, None],
            dq=motion.dq[:, [j]] - STEP * rate[:, None],
            ddq=motion.ddq[:, [j]] - STEP * bend[:, None],
        )
        parameters, key = np.asarray(scene.parameters), ("body torques as read",)
        if key not in scene.cache:  # the same for every joint
            scene.cache[key] = body_torque(scene, parameters)
        change = (body_torque(scene, parameters, (j, moved)) - scene.cache[key]) / STEP
        change[j] += scene.with_bodies.get(j, 0.0) * bend  # the rotor turns with the motor
        return {EquationRow("link", k): row[None] for k, row in enumerate(change) if np.any(row)}

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the joint's positions and speeds as logged, of its motor: before the link's by the deflection."""
        deflection = values["compliance"] * signals["tau_link"][:, self.joint]
        rate = derivative(deflection, dt)
        places = self._in_channels(signals, ("q", "theta"), lambda channel: channel + deflection)
        return places | self._in_channels(signals, ("dq", "dtheta"), lambda channel: channel + rate)
