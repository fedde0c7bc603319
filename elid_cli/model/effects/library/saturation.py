"""Saturation: the motor delivers less than the log commands."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene

EVIDENCE = 0.02
"""Least share of the torque beyond a knee that has to be missing in the prediction for the knee to be tried."""
RARE, OFTEN = 0.15, 0.6
"""Largest part of the samples that a limit may cut: by `LEFT`, and by `LEFT_OFTEN`."""
LEFT, LEFT_OFTEN = 0.5, 0.2
"""Largest part of the misfit beyond the limit that may remain when the torque is cut there."""
HARD = 0.03
"""Most that the share of the excess which is missing may differ from 1 where many samples are cut: a wall that yields
looks like a limit that cuts a tenth more than there is."""


class Saturation(Effect):
    """A limit of current or voltage that cuts the peaks of the commanded torque."""

    name = "saturation"
    summary = "torque that is cut at a limit while the log holds the command"
    equation = "motor equation: cut sign(τ) max(|τ| - limit, 0);  cut = 1"
    physics = (
        "The drive's current limit, or the supply voltage at speed, limits the torque; the command does not show it."
    )
    typical = "the top 1-10 % of the samples"
    fingerprint = "motor side and whole joint, only where |τ| is above a limit, proportional to the excess"
    record = "the measured current instead of the command, or motion that stays below the limit"
    place = "torque"
    amplitudes = (
        Parameter(
            "cut",
            "1",
            "share of the excess that is missing: 1 for a hard limit (the default)",
            low=0.7,
            high=1.1,
            default=1.0,
        ),
    )
    shapes = (Parameter("limit", "N·m", "largest torque that is delivered", low=1e-9),)
    example = {"cut": 1.0, "limit": 60.0}
    local = True
    of_drive = "limit"
    simulated = "motor"

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return knees among the largest torques beyond which the model needs less torque than was logged."""
        tau, predicted = scene.tau[:, joint], scene.predicted[:, joint]
        size = np.abs(tau)
        if not np.any(size > 0):
            return []
        missing = np.sign(tau) * (tau - predicted) if np.any(predicted) else size
        knees: list[tuple[float, ...]] = []
        for limit in np.quantile(size, (0.45, 0.6, 0.75, 0.85, 0.92, 0.97, 0.99)):
            excess = np.maximum(size - limit, 0.0)
            power = float(excess @ excess)
            if power > 0 and float(excess @ missing) > EVIDENCE * power:
                knees.append((float(limit),))
        return knees

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the limit cuts peaks only, and the model without it needs about the limit there.

        The excess is a part of the measured torque: taken as a column it would explain whatever it correlates with,
        so the amplitude alone proves nothing.
        """
        tau, predicted, limit = scene.tau[:, joint], scene.predicted[:, joint], values["limit"]
        beyond = np.abs(tau) > limit
        share = float(np.mean(beyond))
        if not 0 < share <= OFTEN or not super().plausible(scene, joint, {"cut": 1.0, **values}):
            return False
        command, needed = tau[beyond], predicted[beyond]
        left = float(np.sum((np.sign(command) * limit - needed) ** 2))
        if share > RARE and abs(values["cut"] - 1.0) > HARD:
            return False
        most = LEFT if share <= RARE else LEFT_OFTEN
        return left < most * float(np.sum((command - needed) ** 2))

    def columns(self, scene: Scene) -> Columns:
        """Return the torque beyond the limit in the motor row."""
        tau = scene.tau[:, self.joint]
        return motor_row(self.joint, tau - np.clip(tau, -self.shape[0], self.shape[0]))

    def delivered(self, command: Array, coefficients: Array) -> Array:
        """Return the torque that the motor delivers."""
        limit = self.shape[0]
        return command - float(coefficients[0]) * (command - np.minimum(np.maximum(command, -limit), limit))
