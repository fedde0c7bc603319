"""Motors that turn with another joint: a belt or a parallelogram from the base, told from theta - q."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elid_cli._types import Array
from elid_cli.logs.checks.encoder_pairs import Pair
from elid_cli.robot.robot import Robot

LARGE = 0.02
"""Part of a joint's own motion from which theta - q is looked at."""
STILL = 1e-9
"""rad or m; spread of a position that does not move."""
FOLLOWS = 0.999
"""Part of its variance that another joint's motion must explain: no deflection follows one so closely."""


def coupled_motors(q: Array, theta: Array, pairs: Sequence[Pair], robot: Robot) -> Iterator[str]:
    """Name joints whose motor position holds a multiple of another joint's position, q and theta (N, n)."""
    for pair in pairs:
        apart = theta[:, pair.j] - q[:, pair.j]
        size = float(np.std(apart))
        if size < LARGE * float(np.std(q[:, pair.j])):
            continue
        for k, other in enumerate(robot.joint_names):
            moved = q[:, k] if np.isfinite(q[:, k]).all() else theta[:, k]
            if k == pair.j or not np.isfinite(moved).all() or not float(np.std(moved)) > STILL:
                continue
            share, level = np.polyfit(moved, apart, 1)
            if float(np.std(apart - share * moved - level)) ** 2 > (1.0 - FOLLOWS) * size**2:
                continue
            taken = "the difference for deflection" if robot.joints[pair.j].elastic else "theta for its position"
            yield (
                f"{pair.name}: theta - q is {share:.3g} times the position of {other}: the motor turns with that joint "
                f"(a belt, a parallelogram), and elid takes {taken}; log theta without it"
            )
            break
