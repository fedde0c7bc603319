"""Motion of a robot's joints over samples: positions, velocities and accelerations of links and motors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """States of all joints at N instants, arrays of shape (N, n), rad (or m) and s.

    For a rigid joint the motor's state equals the link's. Motor states are divided by the gear ratio.
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    theta: Array
    dtheta: Array
    ddtheta: Array

    @property
    def samples(self) -> int:
        """Number of instants N."""
        return int(self.q.shape[0])

    def positions(self, part: slice) -> Array:
        """Return positions of links and motors over some samples, (2, n, m)."""
        return np.stack([self.q[part].T, self.theta[part].T])

    def speeds(self, part: slice) -> Array:
        """Return velocities of motors over some samples, (n, m)."""
        return self.dtheta[part].T

    def __getitem__(self, index: slice | NDArray[np.intp] | NDArray[np.bool_]) -> Motion:
        return Motion(
            self.t[index],
            self.q[index],
            self.dq[index],
            self.ddq[index],
            self.theta[index],
            self.dtheta[index],
            self.ddtheta[index],
        )


def random_motion(n: int, elastic: NDArray[np.bool_], samples: int, seed: int = 0) -> Motion:
    """Return independent random states: links and motors move freely, as structural questions need.

    Parameters
    ----------
    n, samples
        Joints and instants.
    elastic
        Which joints have a motor state of their own, shape (n,).
    seed
        Seed of the generator; the same seed gives the same states.

    """
    generator = np.random.default_rng(seed)
    q, dq, ddq, theta, dtheta, ddtheta = generator.uniform(-np.pi, np.pi, (6, samples, n))
    theta, dtheta, ddtheta = (
        np.where(elastic, motor, link) for motor, link in ((theta, q), (dtheta, dq), (ddtheta, ddq))
    )
    return Motion(np.arange(samples, dtype=float), q, dq, ddq, theta, dtheta, ddtheta)
