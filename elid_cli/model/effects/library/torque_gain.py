"""Torque gain: the torque channel is off by a factor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Parameter, Same
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene
from elid_cli.robot.robot import Robot

OWN = "motor", "link", "spring", "torque", "sensor"
"""Places of effects that act at their own joint alone."""
UNSCALED = "delay", "reading gain", "reading offset"
"""Faults that are no torque of the motor."""
LEAST = 0.015
"""Least gain error that is told from the errors of smoothing."""


class TorqueGain(Effect):
    """A torque constant that differs from the one the log was scaled with.

    The column is the torque that the model predicts. The measured one would explain everything by itself, with
    every parameter at 0 and a gain of -1.
    """

    name = "torque_gain"
    summary = "torque constant off by a factor, against the other joints"
    equation = "motor equation: gain τ_predicted, that is τ_logged = (1 + gain) τ"
    physics = "Torque constants scatter by a few per cent and fall as the magnets warm; current sensors are not exact."
    typical = "±3-10 %"
    fingerprint = "one joint only, motor side and whole joint, proportional to its torque"
    record = (
        "motion in which joints load each other; a factor common to all joints scales every parameter, which no log"
        " shows, so this is the factor relative to the other joints"
    )
    taken = (
        "Torques of joints without such a factor are taken to be right against one another: differences of up to"
        f" {100 * LEAST:g} % between them have no name, and a joint's values are off by as much as its torque is"
    )
    place = "torque"
    either_sign = "A torque constant is off either way."
    from_model = True
    of_drive = "gain"
    amplitudes = (Parameter("gain", "1", "share by which the logged torque is too large", low=-0.35, high=0.5),)
    example = {"gain": 0.05}
    simulated = "log"

    @classmethod
    def unfit(cls, robot: Robot, joint: int) -> str:
        """Return that there is no other joint to compare with, if so."""
        return "" if robot.n > 1 else "it is a gain against other joints, and the robot has only one"

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the gain is one of a torque constant and not the last per cent that smoothing takes."""
        return super().plausible(scene, joint, values) and abs(values["gain"]) > LEAST

    @classmethod
    def same_here(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Same, ...]:
        """Return the gain of the other joint of two: with all parameters scaled along, either explains the other."""
        if scene.robot.n != 2:
            return ()
        return (Same(cls.name, 1 - joint, {"gain": 1.0 / (1.0 + values["gain"]) - 1.0}),)

    @classmethod
    def same_together(cls, robot: Robot, found: Mapping[int, Mapping[str, float]]) -> tuple[Same, ...]:
        """Return the gain of the one joint without, where all others have one: a common factor moves it there."""
        rest = [joint for joint in range(robot.n) if joint not in found]
        if len(found) < 2 or len(rest) != 1:
            return ()
        first = next(iter(found.values()))
        return (Same(cls.name, rest[0], {"gain": 1.0 / (1.0 + first["gain"]) - 1.0}),)

    def columns(self, scene: Scene) -> Columns:
        """Return the predicted torque in the motor row, with that of the effects that the model has beside it."""
        alone = scene.predicted if scene.alone is None else scene.alone
        return motor_row(self.joint, alone[:, self.joint] + self._beside(scene))

    def _beside(self, scene: Scene) -> Array:
        """Return what other effects add to the torque of this motor, (N,): the factor is on that as well.

        Not those with a memory, whose state is found from what this column leaves.
        """
        added = np.zeros(scene.samples)
        for effect, linear in scene.found:
            elsewhere = effect.joint != self.joint and effect.place in OWN
            if elsewhere or effect.memory or effect.of_drive == self.of_drive or effect.nuisance in UNSCALED:
                continue
            for row, values in effect.columns(scene).items():
                if row.joint == self.joint:
                    added += linear @ values
        return added

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the torque as logged."""
        return self._in_channels(signals, ("tau",), lambda tau: tau * (1.0 + values["gain"]))
