"""Coulomb friction that turns gradually with the speed: which speeds a log shows, and how much it may be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene

MOST = 2.0
"""Times a joint's friction that this one may be: with it left out, a fit finds less friction than there is."""
SLOW = 0.1
"""Part of the top speed below which a joint is about to reverse."""
SAMPLES = 4.0
"""Samples that a reversal takes to pass the speed, at least."""


class GradualFriction(Effect):
    """Friction in place of a joint's own, whose first shape is the speed over which it turns."""

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return speeds below half the top speed that a reversal takes several samples to pass, other shapes 0.

        In fewer, the smoothed velocity of a joint that sticks and starts again looks the same.
        """
        top, speed = scene.top_speed(joint), scene.speed(joint)
        slow = speed < SLOW * top
        if not top > 0 or not slow.any():
            return []
        passed = SAMPLES * scene.dt * float(np.median(np.abs(scene.motion.ddtheta[slow, joint])))
        others = (0.0,) * (len(cls.shapes) - 1)
        return [(part * top, *others) for part in (0.01, 0.03, 0.1, 0.3) if part * top >= passed]

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether it is no more than the joint's friction: what is more drives it at the slowest speeds."""
        return super().plausible(scene, joint, values) and values["friction"] <= MOST * max(scene.coulomb(joint), 0.0)
