"""A log of moves from pose to pose, whose coarse encoders read the same counts whenever a joint is back at a pose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

COUNT = 2 * np.pi / 4096


@pytest.fixture(scope="module")
def pendulums(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    bare = plant.robot(tmp_path_factory.mktemp("pendulums"))
    return replace(bare, joints=tuple(replace(joint, transmission="rigid") for joint in bare.joints))


def read(folder: Path, robot: Robot, log: Recording) -> Recording:
    from elid_cli.logs import read_recording

    bare = replace(log, tau=np.full_like(log.tau, np.nan))
    return read_recording([plant.written(folder, "rests.h5", bare)], robot)


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_what_is_left_of_counts_at_rest_is_no_effect(pendulums: Robot, seed: int, tmp_path: Path) -> None:
    # each of these was told as torque ripple or friction over the angle, by 5 of its errors and more
    log = read(tmp_path, pendulums, plant.moved(seed, 20.0, resting=True, count=COUNT))
    assert not diagnose_motion(pendulums, prepare(log, pendulums)).effects


def test_an_effect_is_found_among_rests(pendulums: Robot, tmp_path: Path) -> None:
    def ripple(q: np.ndarray, dq: np.ndarray, bodies: np.ndarray) -> np.ndarray:
        return np.array([0.0, 0.1 * np.sin(6.0 * q[1]), 0.0])

    log = read(tmp_path, pendulums, plant.moved(1, 20.0, push=ripple, resting=True, count=COUNT))
    (found,) = diagnose_motion(pendulums, prepare(log, pendulums)).effects
    assert (found.effect, found.joint) == ("torque_ripple", "two")
    assert abs(found.parameters["amplitude"] - 0.1) < 4 * found.std_error["amplitude"] < 0.05
