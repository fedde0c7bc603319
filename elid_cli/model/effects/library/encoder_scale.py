"""Encoder scale: motor and link encoders disagree in proportion to the joint's position."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import model_torque
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.parameter import StandardParameter

LARGEST = 0.06
"""Share from which the check of the encoders tells a wrong unit or gear ratio before any fit."""
STEP = 1e-3
"""Share of the motor's motion by which the derivative of torques is taken; they are linear in it."""

MOST = 0.1
"""Part of its motion by which a rotor may twist the spring: of more, K is not known yet."""


class EncoderScale(Effect):
    """A share of the joint's position in the deflection that is no deflection.

    The motor reads theta (1 + scale) where it is at theta. Of what it reads the share c = scale / (1 + scale) is too
    much; the coefficient is K c. The column holds c theta in the spring, and what rotor and viscous friction need less.
    A link encoder that reads q (1 + scale) gives the scale -scale / (1 + scale) here: the two differ by so much in the
    bodies' motion alone.
    """

    name = "encoder_scale"
    summary = "scale of motor or link encoder off (gear ratio, counts per turn)"
    equation = "link equation: +K c θ, motor equation: the same with -, c = scale / (1 + scale); θ', θ'' times 1 - c"
    physics = (
        "One of the two encoders has a wrong scale: a gear ratio one tooth off, counts per turn not quite right. The"
        " data hardly tell which: the motor's is put right, and of the link's the scale has the other sign."
    )
    typical = "1e-5 to 1e-3 (counts), 1e-3 to 0.03 (a tooth of the gear)"
    fingerprint = "motor side much more than whole joint, along the joint's position, loaded or not"
    record = "the joint's whole range, lightly loaded, or one pose range under several loads"
    taken = "Over less than half a turn, an encoder that sits off the centre of its shaft reads much the same"
    place = "encoder"
    either_sign = "A ratio is off either way."
    elastic_only = strains_spring = from_model = True
    amplitudes = (Parameter("scale", "1", "share that the motor encoder reads too much", low=-LARGEST, high=LARGEST),)
    in_deflection = "position"
    least_gain = 0.5  # noise of encoders weakens the spring: what it then lacks follows the load, and so the position
    always_fitted = "a wrong ratio is wrong all the time"
    example = {"scale": 0.001}
    twins = ("encoder_offset",)
    simulated = "log"

    def columns(self, scene: Scene) -> Columns:
        """Return the motor's position in both rows of the transmission, and what its rotor needs less."""
        columns = dict(spring_rows(self.joint, scene.motion.theta[:, self.joint]))
        for number, change in enumerate(self._rotor(scene)):
            if np.any(change):
                row = EquationRow(*(("motor", number) if number < scene.robot.n else ("link", number - scene.robot.n)))
                columns[row] = columns.get(row, np.zeros((1, scene.samples))) + change
        return columns

    def _rotor(self, scene: Scene) -> Array:
        """Return d(torques but the spring's)/d(-scale) / K, motor rows then link rows, (2n, N); 0 where K is unknown.

        Without the scale a fit takes what it adds for a deflection, and K comes out far too small: then it is unknown.
        """
        stiffness, nothing = float(scene.stiffness[self.joint]), np.zeros((2 * scene.robot.n, scene.samples))
        if not stiffness > 0:
            return nothing
        parameters = np.array(scene.parameters)
        parameters[scene.robot.parameter_names().index(StandardParameter("K", self.joint))] = 0.0
        own = scene.motion.of_joint(self.joint)
        less = {name: (1 - STEP) * getattr(own, name) for name in ("theta", "dtheta", "ddtheta")}
        moved = model_torque(scene, parameters, (self.joint, own.changed(**less)))
        change = (moved - model_torque(scene, parameters)) / (STEP * stiffness)
        return change if np.std(change[self.joint]) <= MOST * np.std(own.theta) else nothing

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return the scale from K c."""
        share = float(coefficients[0]) / self.unit(scene, self.joint)
        return {"scale": share / (1 - share) if share != 1 else np.inf}

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Return K c from the scale."""
        scale = float(values["scale"])
        return np.array([cls.unit(scene, joint) * scale / (1 + scale)]), ()

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the motor's position and speed as logged."""
        return self._in_channels(signals, ("theta", "dtheta"), lambda channel: channel * (1 + values["scale"]))
