"""Encoder eccentricity: a link encoder that sits off the centre of its shaft reads wrong once per turn."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.bodies import SIDES, model_torque
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.harmonics import PHASE
from elid_cli.model.effects.rows import spring_rows
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot

LARGEST = 0.1
"""rad; a disc that runs out by a tenth of its radius."""
STEP = 1e-4
"""rad; amplitude with which the derivative of torques is taken; they are nearly linear in it."""
MOST = 0.1
"""Part of the spring's strain that bodies may need for it: of more, K is not known yet."""
ROUNDS = 12
"""Times that the angle at which the encoder is wrong is taken from its reading: each leaves a tenth or less."""
LEAST = 0.5
"""rad; range of angles below which a sine of one turn is a line and a constant."""


class EncoderEccentricity(Effect):
    """A sine of one period per turn in the link's position.

    It strains the spring, and the bodies are elsewhere than the encoder says.
    """

    name = "encoder_eccentricity"
    title = "eccentric link encoder"
    summary = "link encoder off the centre of its shaft: wrong once per turn"
    equation = (
        "all link equations: what the bodies' torques are at q - amplitude sin(q + phase), less what they are at q; of"
        " an elastic joint: link equation: -K amplitude sin(q + phase), motor equation: the same with +"
    )
    physics = (
        "The disc or the magnet of an encoder is mounted a little off the shaft's axis, or its ring runs out: the"
        " reading leads over half a turn and lags over the other. Behind a gear that counts as rigid, whose motor alone"
        " is read, an output that runs out does the same."
    )
    typical = "0.1-5 mrad"
    fingerprint = (
        "along the joint's position, one period per turn: of an elastic joint on the motor side much more than of the"
        " whole joint, of a rigid one hardly anything, as the bodies' parameters take it up"
    )
    record = "the joint's whole turn, lightly loaded; readings of a second encoder or of marks on the joint"
    place = "encoder"
    strains_spring = from_model = True
    amplitudes = (
        Parameter("amplitude", "rad", "what the link encoder reads wrong at most", low=0.0, high=LARGEST),
        PHASE,
    )
    in_deflection = "turn"
    least_gain = 0.5
    always_fitted = "an encoder that is off its centre is off all the time"
    example = {"amplitude": 0.001, "phase": 0.7}
    twins = ("kinematic_error", "encoder_scale")
    simulated = "log"

    @classmethod
    def unfit(cls, robot: Robot, joint: int) -> str:
        """Return that a sliding joint does not turn, if so."""
        slides = f"it needs a joint that turns, and {robot.joints[joint].name} slides"
        return super().unfit(robot, joint) or ("" if robot.joints[joint].revolute else slides)

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the motion goes far enough for a sine of one turn to be no line."""
        wide = bool(np.ptp(scene.motion.q[:, joint]) > LEAST)
        return wide and cls.unit(scene, joint) > 0 and super().plausible(scene, joint, values)

    @classmethod
    def unit(cls, scene: Scene, joint: int) -> float:
        """Return K where it strains a spring."""
        return super().unit(scene, joint) if scene.robot.joints[joint].elastic else 1.0

    def columns(self, scene: Scene) -> Columns:
        """Return sine and cosine of the link's position in both rows of the transmission, and what bodies need less."""
        q, columns = scene.motion.q[:, self.joint], dict[EquationRow, Array]()
        if scene.robot.joints[self.joint].elastic:
            columns = {row: np.array(values) for row, values in spring_rows(self.joint, -np.sin(q), -np.cos(q)).items()}
        rows = [EquationRow(side, k) for side in SIDES for k in range(scene.robot.n)]
        for number, changes in enumerate(self._bodies(scene)):
            for row, change in zip(rows, changes, strict=True):
                if np.any(change):
                    columns.setdefault(row, np.zeros((2, scene.samples)))[number] += change
        return columns

    def _bodies(self, scene: Scene) -> list[Array]:
        """Return d(torques but the spring's) / d(amplitude) / K of sine and cosine, (2n, N) each; 0 where K is unknown.

        Without the sine a fit takes it for a deflection, and K may come out far too small: then it is unknown.
        """
        unit, nothing = self.unit(scene, self.joint), np.zeros((2 * scene.robot.n, scene.samples))
        if not unit > 0:
            return [nothing, nothing]
        parameters, elastic = np.array(scene.parameters), scene.robot.joints[self.joint].elastic
        if elastic:
            parameters[scene.robot.parameter_names().index(StandardParameter("K", self.joint))] = 0.0
        own, as_read = scene.motion.of_joint(self.joint), model_torque(scene, parameters)
        found = []
        for wave, slope in _waves(own.q):
            moved = {
                "q": own.q - STEP * wave,
                "dq": own.dq - STEP * slope * own.dq,
                "ddq": own.ddq - STEP * (slope * own.ddq - wave * own.dq**2),
            }
            if not elastic:  # one encoder reads both sides
                moved |= {"theta": moved["q"], "dtheta": moved["dq"], "ddtheta": moved["ddq"]}
            torques = model_torque(scene, parameters, (self.joint, own.changed(**moved)))
            change = (torques - as_read) / (STEP * unit)
            found.append(nothing if elastic and np.max(np.std(change, axis=1)) > MOST else change)
        return found

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return amplitude and phase."""
        sine, cosine = (float(c) / self.unit(scene, self.joint) for c in coefficients)
        return {"amplitude": math.hypot(sine, cosine), "phase": math.atan2(cosine, sine)}

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`."""
        amplitude, phase = values["amplitude"] * cls.unit(scene, joint), values["phase"]
        return amplitude * np.array([math.cos(phase), math.sin(phase)]), ()

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the link's position and speed as logged; of a rigid joint those of its motor, which are the same.

        What is wrong repeats with the reading; a negative amplitude takes it off one.
        """
        amplitude, phase, q = values["amplitude"], values["phase"], signals["q"][:, self.joint]
        reading = q
        for _ in range(ROUNDS if amplitude > 0 else 1):
            reading = q + amplitude * np.sin(reading + phase)
        slope = amplitude * np.cos((reading if amplitude > 0 else q) + phase)
        both = "theta" in signals and np.array_equal(q, signals["theta"][:, self.joint], equal_nan=True)
        positions, speeds = (("q", "theta"), ("dq", "dtheta")) if both else (("q",), ("dq",))
        found = self._in_channels(signals, positions, lambda _: reading)
        return found | self._in_channels(
            signals, speeds, lambda speed: speed / (1 - slope) if amplitude > 0 else speed * (1 + slope)
        )


def _waves(q: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return sine and cosine of an angle, each with its derivative by the angle."""
    return (np.sin(q), np.cos(q)), (np.cos(q), -np.sin(q))
