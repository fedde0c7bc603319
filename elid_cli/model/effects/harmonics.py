"""Effects that repeat with the angle of a joint: a sine of one order with amplitude and phase."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Effect, Parameter
from elid_cli.model.effects.scene import Scene

PHASE = Parameter("phase", "rad", "phase of the sine at zero angle", low=-math.pi, high=math.pi)
APART = 0.75
"""Periods over the angle covered by which two orders at one joint must differ."""
ALIKE, NARROW = 0.25, 0.08
"""Periods over the angle covered by which orders that look alike differ, and the least part of one that is searched."""
PASSED, TURNS = 2.0, 2.0
"""Times that the covered angle must be passed, or turns that it must hold."""
SHORT = 0.05
"""Part of the least number of periods that a refined order may lack."""
PART, MANY = 0.5, 10.0
"""Part of a turn below which more periods than so many are no order: nothing says that they go on."""
OFTEN = 2.5
"""Times that such a part must be passed for more of them: each pass shows that they are of the angle."""
UNKNOWN = 3
"""Times the highest order that is tried where the gear's ratio, and with it its own orders, is unknown."""
ORDER = Parameter("order", "1/rev", "periods per turn of the joint (per 2π metres of a sliding joint)", low=1e-3)


class Harmonic(Effect):
    """A pair of columns sin(order angle), cos(order angle), named as amplitude and phase."""

    highest: ClassVar[int] = 128
    """Highest order tried apart from the gear's own."""
    periods: ClassVar[float] = 1.0
    """Least number of periods within the angle covered."""
    short: ClassVar[float] = SHORT
    """Part of that which a refined order may lack: no search begins lower, but may end there."""

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return orders that complete a period within the angle covered, as finely as that angle can tell apart."""
        return [(order,) for order in orders(scene, joint, cls.highest, cls.periods)]

    @classmethod
    def reach(cls, scene: Scene, joint: int, shape: Sequence[float]) -> float:
        """Return how far around an order it is refined: to those that look like it over the angle covered."""
        span, _ = covered(scene, joint)
        return min(max(NARROW, 2 * math.pi * ALIKE / max(span * shape[0], 1e-9)), super().reach(scene, joint, shape))

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the motion covers what is claimed: enough periods, and each of them more than once.

        What an angle that is passed once shows is a course in time as well, unless it holds whole turns.
        """
        if not super().plausible(scene, joint, values):
            return False
        span, travel = covered(scene, joint)
        passed = travel > PASSED * span or span > 2 * math.pi * TURNS
        return passed and values["order"] * span > 2 * math.pi * cls.periods * (1.0 - cls.short)

    @classmethod
    def distinct(cls, scene: Scene, joint: int, shape: Sequence[float], present: Sequence[Sequence[float]]) -> bool:
        """Whether the order is told apart from those present over the angle covered: nearer ones only beat."""
        span, _ = covered(scene, joint)
        return all(abs(shape[0] - other[0]) * span > 2 * math.pi * APART for other in present)

    def waves(self, scene: Scene) -> tuple[Array, Array]:
        """Return sin and cos of order times motor angle, each (N,)."""
        angle = self.shape[0] * scene.motion.theta[:, self.joint]
        return np.sin(angle), np.cos(angle)

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return amplitude, phase and order."""
        sine, cosine = (float(c) / self.unit(scene, self.joint) for c in coefficients)
        return {"amplitude": math.hypot(sine, cosine), "phase": math.atan2(cosine, sine), "order": self.shape[0]}

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`."""
        amplitude = values["amplitude"] * cls.unit(scene, joint)
        phase = values["phase"]
        return amplitude * np.array([math.cos(phase), math.sin(phase)]), (float(values["order"]),)


def covered(scene: Scene, joint: int) -> tuple[float, float]:
    """Return the range of a motor's angle, and the way that it goes within it."""

    def made() -> tuple[float, float]:
        angle = scene.motion.theta[:, joint]
        return float(np.ptp(angle)), float(np.sum(np.abs(np.diff(angle))))

    return scene.of_motion(("covered", joint), made)


def orders(scene: Scene, joint: int, highest: int, periods: float = 1.0) -> list[float]:
    """Return orders to try: integers for a turning joint, multiples of the range for a sliding one, the gear's own.

    An order with less than `periods` in the covered angle is a bend that other effects explain as well; two
    orders closer than a quarter period over that angle look alike, so that the step follows the range.
    """
    span, travel = covered(scene, joint) if scene.samples else (0.0, 0.0)
    if span <= 0 or not math.isfinite(span):
        return []
    least = 2 * math.pi * periods / span
    description = scene.robot.joints[joint]
    if description.revolute:
        step = 1 if span > 3.5 else 2
        highest *= 1 if description.gear_ratio else UNKNOWN
        found = [float(k) for k in (*range(1, 10), *range(10, highest + 1, step)) if k >= least]
    else:
        found = [least * k for k in np.arange(1.0, 33.0 / periods, 0.5 / periods)]
    fastest = scene.top_speed(joint, 0.9)
    gear = abs(description.gear_ratio or math.nan)  # nothing is slower than an unknown gear
    # the rotor's own orders, as long as they are slow enough to be sampled
    own = [gear * k for k in (1.0, 2.0, 4.0) if gear * k * fastest < 2 * math.pi / (8 * scene.dt)]
    found += [k for k in own if k >= least and all(abs(k - other) > 0.25 for other in found)]
    if description.revolute and span < 2 * math.pi * PART and travel < OFTEN * span:
        most = 2 * math.pi * MANY / span
        found = [k for k in found if k <= most or k in own]
    return found
