"""Filters of velocity that are long beside what a first step from a short one tells: the bottom is narrow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.identify import identify
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.signals import prepare
from tests.estimation.trajectory import servo

TRUTH = np.array([servo.ARMATURE, servo.COULOMB, servo.VISCOUS])


@pytest.mark.parametrize(("seed", "time"), [(1, 0.006), (2, 0.010), (3, 0.015)])
def test_a_filter_of_some_milliseconds_is_named_and_nothing_else(tmp_path: Path, seed: int, time: float) -> None:
    """A step from 3 ms went past the bottom; soft friction, or a loop in steps of a simulator, was named instead."""
    arm = servo.robot(tmp_path)
    found = diagnose_motion(arm, prepare(servo.moved(seed, smoothing=time), arm), None, ("velocity_filter",))
    assert [(e.effect, e.joint) for e in found.effects] == [("velocity_filter", "j")]
    assert found.effects[0].parameters["time"] == pytest.approx(time, rel=0.02)
    np.testing.assert_allclose(found.fit_after.values[0, :3], TRUTH, rtol=0.02)


@pytest.mark.parametrize(("seed", "time"), [(4, 0.006), (5, 0.010)])
def test_identify_counts_filters_where_much_more_than_noise_is_left_without(
    tmp_path: Path, seed: int, time: float
) -> None:
    """Beside 6 ms all values were supported, an inertia hundreds of its standard errors too small among them."""
    arm = servo.robot(tmp_path)
    found = identify(arm, prepare(servo.moved(seed, smoothing=time), arm))
    told = found.settings["trajectory"]
    assert isinstance(told, dict)
    assert told["velocity_filters"]["j"] == pytest.approx(time, rel=0.02)
    assert told["other_bodies"] == {}
    assert found.model == "insufficient"
    own = told["joint_parameters"]["j"]["Ja"]
    assert abs(own["estimate"] - servo.ARMATURE) < 2 * own["std_error"]
    assert any("nearer with a filter of the velocity" in warning for warning in found.warnings)


def test_a_filter_that_is_declared_without_a_time_is_estimated(tmp_path: Path) -> None:
    """It was ignored without a word, and inertia and friction made up for it."""
    arm = replace(servo.robot(tmp_path), effects=(EffectSpec("velocity_filter", "j", {}),))
    found = identify(arm, prepare(servo.moved(6, smoothing=0.007), arm))
    (effect,) = [item for item in found.effects if item.effect == "velocity_filter"]
    assert effect.parameters["time"] == pytest.approx(0.007, rel=0.02)
    assert 0 < effect.std_error["time"] < 1e-4
    told = found.settings["trajectory"]
    assert isinstance(told, dict)
    own = told["joint_parameters"]["j"]
    for kind, value in zip(("Ja", "fs", "fv"), TRUTH, strict=True):
        assert own[kind]["estimate"] == pytest.approx(value, rel=0.02)
    without = identify(arm, prepare(servo.moved(7), arm))
    assert "velocity_filter" not in {item.effect for item in without.effects}
    assert any("declared without a time" in warning for warning in without.warnings)
