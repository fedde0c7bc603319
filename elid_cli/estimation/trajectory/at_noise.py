"""Whether a simulated motion is off by the noise of the encoders alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import noise_between_jumps

if TYPE_CHECKING:  # reports ask it of logs with torque as well, which need no simulation
    from elid_cli.estimation.trajectory.fit import TrajectoryFit

NOISE = 1.5
"""Times the encoders' noise up to which simulated positions are off by that noise alone …"""
LESS = 0.3
"""… below which they are too small for that noise …"""
STILL = 0.01
"""… and below which the joint rests at one count of its encoder."""


def is_at_noise(ratios: Mapping[Any, float], fit: TrajectoryFit | None = None) -> bool:
    """Whether errors of the simulated positions, joint by joint in times the encoders' noise, are that noise.

    An error that is clearly less says that the noise was taken for larger than it is. Then that of the `fit` must have
    no memory, where it is at hand, or be what changes from sample to sample.
    """
    moving = [ratio for ratio in ratios.values() if ratio > STILL]
    if not moving or max(moving) >= NOISE:
        return False
    if fit is None or min(moving) > LESS:
        return True
    from elid_cli.estimation.trajectory.memory import has_memory

    return not has_memory(fit.equations) or _is_scatter(fit)


def _is_scatter(fit: TrajectoryFit) -> bool:
    """Whether the errors of a fit are no larger than their differences from sample to sample make them.

    Joints that rest within one count of their encoder have an error with a memory, and are where they are told to be.
    """
    count = len(fit.settled_rms)
    errors = [(item.x[:, :count] + item.finer - item.run.measured)[item.counts] for item in fit.tracked]
    alone = [noise_between_jumps(error, (Segment(0, len(error)),), item.run.dt) * np.sqrt(len(error))
             for error, item in zip(errors, fit.tracked, strict=True)]  # fmt: skip
    scatter = np.sqrt(np.sum(np.square(alone), axis=0) / sum(map(len, errors)))
    return bool((fit.settled_rms < NOISE * scatter).all())
