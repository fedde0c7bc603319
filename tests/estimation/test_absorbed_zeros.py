"""A zero of positions that is off by some milliradians hides in first moments: what it moves is marked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.validation.following import ZERO
from elid_cli.report.answers.lacking import words_of
from elid_cli.robot.robot import EffectSpec, Robot
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


def test_a_zero_that_the_log_is_not_sure_of_is_told_with_its_size() -> None:
    """Two values were 17 of their standard errors off, under "Nothing that this log shows"."""
    made = made_rigid(2)
    found = identified(made, made.robot, _off_by(1, 0.007), torque=0.003, seed=2)
    true = found.base.values(as_rigid(made.truth).reference())
    far = [abs(p.estimate - value) / p.std_error for p, value in zip(found.parameters, true, strict=True)]
    assert max(far) > 10.0
    assert max(z for z, p in zip(far, found.parameters, strict=True) if not p.bias_possible) < 4.0
    assert "the zero of the positions of j2 may be off (offset 0.00906 ± 0.0027 rad)" in found.notes[0]
    assert "Nothing that this log shows for sure" in words_of(found)


def _slow(joint: int, robot: Robot) -> tuple[EffectSpec, Laws]:
    """Return friction that rises towards zero speed at a joint, as a file declares it and as it acts."""
    size = 0.5 * robot.joints[joint].parameters["fs"]

    def torque(world: World) -> np.ndarray:
        total = np.zeros_like(world.q)
        speed = world.dtheta[:, joint]
        total[:, joint] = size * np.sign(speed) * np.exp(-np.abs(speed) / 0.1)
        return total

    return EffectSpec("stribeck", robot.joint_names[joint], {"amplitude": size, "velocity": 0.1}), Laws(motor=[torque])


def test_a_zero_is_asked_for_beside_effects_of_the_file() -> None:
    made = made_rigid(2)
    spec, laws = _slow(0, made.truth)
    robot = replace(made.robot, effects=(spec,))
    right = identified(made, robot, laws, torque=0.003, seed=2)
    assert right.model == "sufficient"
    assert not any(p.bias_possible for p in right.parameters)
    found = identified(made, robot, replace(laws, sensors=_off_by(1, 0.02).sensors), torque=0.003, seed=2)
    assert [(item.joint, item.follows) for item in found.insufficient] == [("j2", ZERO)]
    true = found.base.values(as_rigid(made.truth).reference())
    far = [abs(p.estimate - value) / p.std_error for p, value in zip(found.parameters, true, strict=True)]
    assert max(z for z, p in zip(far, found.parameters, strict=True) if not p.bias_possible) < 4.0
