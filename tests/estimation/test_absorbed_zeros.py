"""A zero of positions that is off by some milliradians hides in first moments: what it moves is marked."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.estimation.validation.following import ZERO
from elid_cli.report.answers.lacking import words_of
from tests.estimation.test_unsaid_causes import as_rigid, identified, made_rigid
from tests.system.reproduce.inverse_logs import Laws, World


def _off_by(joint: int, offset: float) -> Laws:
    def read(_: World, signals: dict[str, np.ndarray]) -> None:
        for side in ("q", "theta"):
            signals[side][:, joint] += offset

    return Laws(sensors=[read])


@pytest.mark.parametrize(("seed", "offset"), [(2, 0.01), (2, 0.02), (3, 0.02), (4, 0.02)])
def test_what_a_wrong_zero_moves_is_marked(seed: int, offset: float) -> None:
    made = made_rigid(seed)
    found = identified(made, made.robot, _off_by(1, offset), torque=0.003, seed=seed)
    true = found.base.values(as_rigid(made.truth).reference())
    far = [abs(p.estimate - value) / p.std_error for p, value in zip(found.parameters, true, strict=True)]
    assert max(far) > 5.0
    assert max(z for z, p in zip(far, found.parameters, strict=True) if not p.bias_possible) < 4.0
    assert found.model == "insufficient"


def test_a_wrong_zero_is_said_where_noise_is_all_that_is_left() -> None:
    made = made_rigid(2)
    found = identified(made, made.robot, _off_by(1, 0.01), torque=0.003, seed=2)
    assert [(item.joint, item.follows) for item in found.insufficient] == [("j2", ZERO)]
    assert "the zero of the positions of j2 looks off, or the base tilted, which other values take up" in words_of(
        found
    )


@pytest.mark.parametrize("seed", [4, 5, 6, 7])
def test_right_zeros_are_not_doubted(seed: int) -> None:
    made = made_rigid(seed)
    found = identified(made, made.robot, Laws(), torque=0.003, seed=seed)
    assert found.model == "sufficient"
    assert not any(p.bias_possible for p in found.parameters)
