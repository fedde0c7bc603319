"""Where springs rest: what a robot file says of it is believed, and what a diagnosis finds is the offset's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.result import Identification
from elid_cli.logs.reading import read_recording
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import OFFSET, moved, robot, written

STIFFNESS, PRELOAD = 1.5, -0.45
SPRUNG = "one"


@pytest.fixture(scope="module")
def sprung() -> Recording:
    spring = np.array([1.0, 0.0, 0.0])
    return moved(3, 6.0, push=lambda x, v, load: spring * (STIFFNESS * x + PRELOAD))


def offset_of(found: Identification) -> float:
    """Return the torque offset of the joint with the spring."""
    return next(
        item.parameters["offset"] for item in found.nuisances
        if item.effect == "torque_offset" and item.joint == SPRUNG
    )  # fmt: skip


@pytest.mark.parametrize("preload", [PRELOAD, 0.3])
def test_a_declared_spring_keeps_its_preload(tmp_path: Path, sprung: Recording, preload: float) -> None:
    spec = EffectSpec("link_spring", SPRUNG, {"stiffness": 1.2, "preload": preload})
    arm = replace(robot(tmp_path), effects=(spec,))
    signals = prepare(read_recording([written(tmp_path, "log.h5", sprung)], arm), arm)
    found = identify(arm, signals, EstimateOptions(fit="trajectory"))
    (effect,) = found.effects
    assert effect.parameters["stiffness"] == pytest.approx(STIFFNESS, rel=2e-3)
    assert effect.parameters["preload"] == pytest.approx(preload, abs=1e-9)
    # the offset is what the motion needs beyond it
    assert offset_of(found) == pytest.approx(OFFSET[0] + PRELOAD - preload, abs=1e-3)


def test_the_preload_of_a_spring_that_was_found_is_moved_to_the_offset(tmp_path: Path, sprung: Recording) -> None:
    arm = robot(tmp_path)
    signals = prepare(read_recording([written(tmp_path, "log.h5", sprung)], arm), arm)
    found = diagnose_motion(arm, signals, None, ("link_spring",))
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("link_spring", SPRUNG)
    assert effect.parameters["stiffness"] == pytest.approx(STIFFNESS, rel=2e-3)
    # it pushes the joint nowhere on the whole
    middle = sprung.q[:, 0].mean()
    assert abs(middle) > 0.01
    assert effect.parameters["preload"] == pytest.approx(-STIFFNESS * middle, abs=1e-3)
    assert offset_of(found.after) == pytest.approx(OFFSET[0] + PRELOAD + STIFFNESS * middle, abs=2e-3)
