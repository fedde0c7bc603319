"""Contact: something pushes a link for a moment."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import link_row
from elid_cli.model.effects.scene import Scene

WIDTHS = (0.15, 0.3, 0.6)
"""s; lengths of a push that are tried."""
LONGEST = 2.0
"""s; a push that lasts longer is no moment any more."""
BEST = 4
"""Places of each length that are returned."""


class Contact(Effect):
    """A bump of torque on one link in a short window of time."""

    name = "contact"
    summary = "push from outside, or a fault of a torque signal, for a moment"
    equation = "link equation: torque (1 + cos(2π (t - time)/width))/2 within |t - time| < width/2"
    physics = "A collision, a hand, a cable that catches: a force on the arm that no motion of its own explains."
    typical = "0.1-1 s; any size"
    fingerprint = "whole joint only, for one short time"
    record = "the same motion again: what does not come again came from outside"
    place = "link"
    either_sign = "What touches the link may resist or push on."
    amplitudes = (Parameter("torque", "N·m", "height of the bump that resists (positive) or pushes on (negative)"),)
    shapes = (
        Parameter("time", "s", "middle of the window"),
        Parameter("width", "s", "length of the window", low=1e-3),
    )
    example = {"torque": 12.0, "time": 0.8, "width": 0.3}
    local = True
    event = True

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return the windows in which the logged torque departs most from the prediction."""
        t = scene.motion.t
        if len(t) < 8:
            return []
        missing = scene.tau[:, joint] - scene.predicted[:, joint]
        found: list[tuple[float, ...]] = []
        for width in WIDTHS:
            half = round(width / 2 / scene.dt)
            if half < 2 or 2 * half + 1 > len(t) // 4:
                continue
            bump = 0.5 + 0.5 * np.cos(np.pi * np.arange(-half, half + 1) / (half + 1))
            # the mean within three widths is what other effects would explain
            smooth = np.convolve(missing, np.full(6 * half + 1, 1 / (6 * half + 1)), mode="same")[: len(t)]
            score = np.abs(np.convolve(missing - smooth, bump, mode="same"))[: len(t)]
            score[:half] = score[len(t) - half :] = 0.0
            for _ in range(BEST):
                k = int(np.argmax(score))
                if score[k] <= 0:
                    break
                found.append((float(t[k]), width))
                score[max(k - 2 * half, 0) : k + 2 * half + 1] = 0.0
        return found

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the push is within the log, short, and no stronger than a few times what the motor gives."""
        t, top = scene.motion.t, float(np.max(np.abs(scene.tau[:, joint]), initial=0.0))
        inside = t[0] <= values["time"] <= t[-1] and 0 < values["width"] <= LONGEST
        return bool(inside and abs(values["torque"]) <= 3 * top)

    @classmethod
    def looks(cls, scene: Scene, joint: int) -> int:
        """Return how many windows, half a width apart, the log holds."""
        return max(1, round(sum(2 * scene.samples * scene.dt / width for width in WIDTHS)))

    def columns(self, scene: Scene) -> Columns:
        """Return the bump in the link row."""
        time, width = self.shape
        phase = (scene.motion.t - time) / width
        return link_row(self.joint, np.where(np.abs(phase) < 0.5, 0.5 + 0.5 * np.cos(2 * np.pi * phase), 0.0))
