"""The nearest body is one, needs nearly the same torques, and what is a body already stays."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.robot.inertia import about_centre, about_origin, real_tensor
from elid_cli.robot.nearest_body import is_body, nearest_body


def rod(rng: np.random.Generator) -> Array:
    """Return a thin body somewhere: two of its second moments are nearly 0."""
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    second = turn @ np.diag([0.02, 1e-6, 1e-6]) @ turn.T
    return about_origin(rng.uniform(0.2, 3.0), rng.standard_normal(3) * 0.1, np.trace(second) * np.eye(3) - second)


@pytest.mark.parametrize("seed", range(8))
def test_errors_of_inertias_give_way_where_torques_least_tell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true, felt = rod(rng), rng.standard_normal((60, 10)) * ([1.0] * 4 + [1.0, 1e-4, 1.0, 1.0, 1.0, 1.0])
    off = true + np.concatenate([np.zeros(4), 1e-4 * rng.standard_normal(6)])
    off[4] = true[4] * 0.9
    assert not is_body(off)
    found = nearest_body(off, felt)
    assert is_body(found)
    assert real_tensor(about_centre(found)[2])
    assert found[0] == off[0]
    # of all that are near, the true body is one: the nearest needs torques at most as far off as those it needs
    assert np.linalg.norm(felt @ (found - off)) <= 1.05 * np.linalg.norm(felt @ (true - off))


def test_a_body_stays_and_no_mass_is_refused() -> None:
    rng = np.random.default_rng(1)
    true = rod(rng)
    assert is_body(true)
    assert nearest_body(true, np.eye(10)) is true
    with pytest.raises(ValueError, match="a mass of -1"):
        nearest_body(np.array([-1.0, *true[1:]]), np.eye(10))
    assert not is_body(np.zeros(10))
