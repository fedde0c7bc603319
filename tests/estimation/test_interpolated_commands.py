"""Drives that go to each commanded position on a line over one period of commands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.identify import identify
from elid_cli.estimation.interpolated_commands import interpolated, period_of
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.smooth_commands import recorded_as_told
from elid_cli.experiment.replay import replay
from elid_cli.signals.signals import prepare
from tests.estimation.trajectory import servo

TRUTH = np.array([servo.ARMATURE, servo.COULOMB, servo.VISCOUS])


def test_commands_on_lines_reach_each_position_when_the_next_one_comes() -> None:
    log = servo.moved(1, 0.5)
    assert period_of(log) == servo.EVERY
    asked, lines = log.commands["q_des"][:, 0], interpolated(log)[:, 0]
    np.testing.assert_allclose(lines[servo.EVERY :: servo.EVERY], asked[: -servo.EVERY : servo.EVERY], atol=1e-12)
    np.testing.assert_allclose(np.diff(lines, 2)[np.arange(len(lines) - 2) % servo.EVERY != 3], 0.0, atol=1e-12)
    still = replace(log, commands={**log.commands, "q_des": np.zeros_like(log.commands["q_des"])})
    assert period_of(still) == 0


@pytest.mark.parametrize(("seed", "delay"), [(1, 0.0), (2, 0.004)])
def test_drives_that_interpolate_are_found_and_no_effect_in_their_place(
    tmp_path: Path, seed: int, delay: float
) -> None:
    """Soft friction or filters of velocity were named, and values tens of standard errors off were known."""
    arm = servo.robot(tmp_path)
    signals = prepare(servo.moved(seed, lines=True, delay=delay), arm)
    found = diagnose_motion(arm, signals)
    assert found.effects == ()
    assert any("interpolate the commanded positions" in note for note in found.after.notes)
    error = found.fit_after.deviation[:3]
    np.testing.assert_array_less(np.abs(found.fit_after.values[0, :3] - TRUTH), 5 * error)
    np.testing.assert_allclose(found.fit_after.values[0, :3], TRUTH, rtol=5e-3)
    np.testing.assert_allclose(found.fit_after.delays, delay, atol=5e-5)


def test_a_fit_says_so_and_a_replay_has_it(tmp_path: Path) -> None:
    arm = servo.robot(tmp_path)
    found = identify(arm, prepare(servo.moved(3, lines=True), arm))
    assert found.settings["commands"] == "interpolated"
    assert found.model == "sufficient"
    assert sum("interpolate the commanded positions" in note for note in found.notes) == 1
    other = recorded_as_told(identified_robot(found), servo.moved(4, 5.0, lines=True))
    told = replay(identified_robot(found), other)
    assert told.commands == "interpolated"
    assert told.mean_abs < 3 * servo.NOISE


@pytest.mark.parametrize("changes", [{}, {"smoothing": 0.01}, {"delay": 0.009}])
def test_late_drives_are_none_that_interpolate(tmp_path: Path, changes: dict[str, float]) -> None:
    arm = servo.robot(tmp_path)
    found = identify(arm, prepare(servo.moved(5, **changes), arm))  # type: ignore[arg-type]
    assert "commands" not in found.settings


def test_drives_that_filter_their_commands_are_warned_of(tmp_path: Path) -> None:
    """Values tens of standard errors off were known, and the model sufficed."""
    arm = servo.robot(tmp_path)
    found = identify(arm, prepare(servo.moved(6, targets=0.012), arm))
    assert "commands" not in found.settings
    assert any("filter the commanded positions" in warning for warning in found.log_warnings)
