"""What the noise of the samples that simulations start from adds to the errors of a trajectory fit.

A stretch is simulated from its first position and a velocity that is a slope through the first few. Their noise is one
error of the whole motion, which friction that holds a joint may keep for long: no residual without memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.block_sums import Equations
from elid_cli.estimation.trajectory.loss import weighed
from elid_cli.estimation.trajectory.normal_equations import Tracked, as_late, simulated
from elid_cli.estimation.trajectory.unknowns import Unknowns
from elid_cli.model.linearised import Linearised
from elid_cli.model.runs import starting


def start_covariance(
    equations: Linearised, tracked: Sequence[Tracked], columns: Sequence[Array], unknowns: Unknowns, z: Array,
    found: Equations, inverse: Array,
) -> Array:  # fmt: skip
    """Return what noise of the first samples adds to the covariance of the unknowns, (U, U).

    Parameters
    ----------
    equations, unknowns, z
        The robot, and values of the unknowns, (U,).
    tracked, columns
        The stretches about their simulated motions, and how the positions change with the unknowns, (N, n, U) each.
    found, inverse
        Normal equations at z, and the inverse of their matrix.
    """
    parameters, size = unknowns.robot.reference(), np.maximum(found.size, 1e-9)
    longest = max(len(joints) for joints in unknowns.chains)
    added = np.zeros_like(inverse)
    for item, slopes in zip(tracked, columns, strict=True):
        known = as_late(item, unknowns, z)
        here = simulated(equations, replace(item), unknowns, z, parameters, plain=True).error
        light = (weighed(here, item.usual, item.counts).light / size) ** 2
        noise = (size, size * _slope_noise(item.run.dt))
        for number in range(longest):  # chains do not move each other
            moved = [joints[number] for joints in unknowns.chains if len(joints) > number]
            for kind, deviation in enumerate(noise):
                start = [part.copy() for part in item.run.start]
                start[kind][moved] += deviation[moved]
                run, late = (replace(part, start=(start[0], start[1])) for part in (item.run, known))
                other = replace(item, run=run, latest=(run, float(z[unknowns.delays][run.source]), late))
                change = simulated(equations, other, unknowns, z, parameters, plain=True).error - here
                for joints in unknowns.chains:
                    pulled = np.einsum("nju,nj->u", slopes[:, joints], (light * change)[:, joints])
                    added += np.outer(inverse @ pulled, inverse @ pulled)
    return added


def _slope_noise(dt: float) -> float:
    """Return the standard deviation of a parabola's slope at the first of its samples, of noise of 1."""
    time = dt * np.arange(starting(dt))
    return float(np.sqrt(np.linalg.inv(np.vander(time, 3).T @ np.vander(time, 3))[1, 1]))
