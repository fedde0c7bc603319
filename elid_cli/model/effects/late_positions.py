"""Effects that are positions of a joint read at another instant than the rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.rows import derivative
from elid_cli.model.effects.scene import Scene
from elid_cli.signals.motion import Motion
from elid_cli.signals.time_shift import shifted

LEAST = 0.01
"""Part of the sample time below which a shift in time is none."""
STEP = 1e-4
"""s; shift by which the derivative of torques is taken."""


class LatePositions(Effect):
    """Channels of one joint whose readings are older than the others', by the first amplitude."""

    late: ClassVar[tuple[str, ...]]
    """Positions that are: ``q``, ``theta``."""

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether it is a shift that a log can have: one of nanoseconds stands for something else."""
        age = values.get(cls.amplitudes[0].name, np.inf)
        return abs(age) >= LEAST * scene.dt and super().plausible(scene, joint, values)

    def moved(self, scene: Scene) -> Motion:
        """Return the motion of this joint alone with the late positions as they are `STEP` later, (N, 1)."""
        motion, j, arrays = scene.motion, self.joint, dict[str, Array]()
        for name in self.late:
            position, speed, bend = (getattr(motion, f"{order}{name}") for order in ("", "d", "dd"))
            rates = speed[:, j], bend[:, j], derivative(bend[:, j], scene.dt, scene.starts)
            for order, values, rate in zip(("", "d", "dd"), (position, speed, bend), rates, strict=True):
                arrays[f"{order}{name}"] = (values[:, j] + STEP * rate)[:, None]
        return motion.of_joint(j).changed(**arrays)

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the late positions and speeds as logged: each reading is that old."""
        age = values[self.amplitudes[0].name]
        names = [f"{order}{name}" for order in ("", "d") for name in self.late]
        return self._in_channels(signals, names, lambda channel: shifted(channel, -age / dt))
