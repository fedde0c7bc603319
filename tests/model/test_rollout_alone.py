"""Steps of chains of one joint are those of the loops for chains of any length, to the last bit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from elid_cli.model.rollout_alone import compiled_steps_alone, steps_alone
from elid_cli.model.rollout_loops import compiled_steps, steps

INSTANTS, EACH, VARIANTS, STRETCHES, CHAINS = 40, 4, 2, 2, 12


def arrays(rng: np.random.Generator, soft: bool) -> list[np.ndarray]:
    """Return what both take: chains under every kind of drive, many of which come to rest or reach their limit."""
    of_chain, of_variant = (STRETCHES, CHAINS, 1), (VARIANTS, STRETCHES, CHAINS, 1)
    every = (INSTANTS, *of_chain)
    told = rng.uniform(-20, 20, ((INSTANTS - 1) * EACH, *of_chain))
    equations = [rng.uniform(0.5, 1.0, (*every, 1)), rng.uniform(-5, 5, every), *rng.uniform(-2, 2, (2, *every, 1)),
                 *rng.uniform(-1, 1, (2, *every))]  # fmt: skip
    held = np.where(np.arange(CHAINS) % 3 == 1, 1.0, np.where(np.arange(CHAINS) % 3 == 2, 0.5, 0.0))[:, None]
    lag = np.where(np.arange(CHAINS) % 2, 0.002, -0.001)[:, None]
    drives = [rng.uniform(5, 30, of_chain), rng.uniform(0, 2, of_chain), rng.uniform(0, 3, of_chain),
              np.broadcast_to(held, of_chain).copy(), np.broadcast_to(lag, of_chain).copy(),
              rng.uniform(0, 1, of_chain), *rng.uniform(0.2, 1, (4, *of_chain))]  # fmt: skip
    start = [*rng.uniform(-0.5, 0.5, (2, *of_chain))]
    fading = rng.uniform(0, 1, of_variant) if soft else np.zeros(of_variant)
    joints = [rng.uniform(0.01, 0.1, of_variant), rng.uniform(0, 3, of_variant), rng.uniform(0, 1, of_variant),
              rng.uniform(-1, 1, of_variant), rng.choice([8.0, np.inf], of_variant), fading,
              rng.uniform(0.01, 0.2, of_variant), rng.uniform(0, 0.004, of_variant)]  # fmt: skip
    over_time = [rng.uniform(-1, 1, (INSTANTS - 1, *of_variant)), rng.uniform(-0.5, 0.5, (1, *of_variant))]
    return [*equations, told, *drives, *start, *joints, *over_time]


@pytest.mark.parametrize("fast", [False, True])
@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize(("later", "damped"), [(0.5, 0.0), (0.0, 0.0), (0.0, 1.0)])
def test_one_joint_takes_the_steps_of_a_chain(fast: bool, soft: bool, later: float, damped: float) -> None:
    several: Callable[..., None] | None = compiled_steps() if fast else steps
    if several is None:
        pytest.skip("needs Numba")
    alone = compiled_steps_alone() if fast else steps_alone
    given = arrays(np.random.default_rng(5), soft)
    shape = (INSTANTS, VARIANTS, STRETCHES, CHAINS, 1)
    found = []
    for take in (several, alone):
        x, v = np.full((2, *shape), np.nan)
        take(*given, 0.01, later, damped, x, v)
        found.append((x, v))
    np.testing.assert_array_equal(found[1], found[0])
    assert np.isfinite(found[0]).all()
    # every kind of step is taken: joints at rest, and motion that is another for each
    assert np.abs(np.diff(found[0][0], axis=0)).min() < 1e-6 < np.ptp(found[0][0], axis=0).min()
