"""Up to which period loops that hold their torque are as near the motion as ones that act all the time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from elid_cli import LogRequest, identify_logs
from elid_cli.estimation.trajectory import unseen_loops
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.unseen_loops import LITTLE, SHORTEST, by_delay, by_motion
from elid_cli.logs import robot_as_logged
from elid_cli.signals.recording import Recording
from tests.diagnosis.by_motion import plant

DT = 0.01


def fits(monkeypatch: pytest.MonkeyPatch, **by: float) -> tuple[TrajectoryFit, dict[int, TrajectoryFit]]:
    """Return a fit and ones of loops, by how often in a sample, that are so much nearer."""
    monkeypatch.setattr(unseen_loops, "nearer_by", lambda one, _: one.by)
    tried = {int(name[1:]): cast("TrajectoryFit", SimpleNamespace(by=value)) for name, value in by.items()}
    return cast("TrajectoryFit", SimpleNamespace(by=0.0)), tried


@pytest.mark.parametrize("often", [1.5, 3.0, 7.0])
def test_the_period_at_which_loops_are_clearly_farther(monkeypatch: pytest.MonkeyPatch, often: float) -> None:
    """Motion whose error grows with the fourth power of the period, and is clearly farther at a part of a sample."""
    one = -LITTLE * often**4
    fit, tried = fits(monkeypatch, _1=one, _2=one / 16)
    assert by_motion(fit, tried, DT) == pytest.approx(DT / often, rel=0.01)
    assert by_motion(fit, {1: tried[1]}, DT) == pytest.approx(DT / often, rel=0.01)


def test_motion_that_says_nothing_allows_loops_at_the_log_s_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, tried = fits(monkeypatch, _1=-0.5 * LITTLE, _2=0.0)
    assert by_motion(fit, tried, DT) == DT


def test_loops_that_were_not_simulated_may_be_short(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, tried = fits(monkeypatch)
    assert by_motion(fit, tried, DT) == SHORTEST


@pytest.mark.parametrize(("late", "period"), [(4.5e-4, 1.0e-3), (-3e-4, 0.0), (9e-3, DT), (0.0, DT)])
def test_under_smooth_commands_half_a_period_is_no_more_than_the_delay(late: float, period: float) -> None:
    unknowns = SimpleNamespace(delays=slice(0, 1))
    fit = SimpleNamespace(delays=np.array([late]), deviation=np.array([2.5e-5]), unknowns=unknowns)
    log = cast("Recording", SimpleNamespace(dt=DT, smooth=True, changing=True))
    assert by_delay(cast("TrajectoryFit", fit), log) == pytest.approx(period)


def test_commands_that_are_stamped_ahead_are_no_simulator_s_steps(tmp_path: Path) -> None:
    recording = plant.moved(4, 6.0)
    log = plant.written(tmp_path, "log.h5", recording)
    robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
    commands = {
        **recording.commands,
        **{name: np.roll(recording.commands[name], 2, axis=0) for name in ("q_des", "dq_des")},
    }
    late = plant.written(tmp_path, "late.h5", replace(recording, commands=commands))
    right, ahead = (identify_logs(LogRequest((name,), robot)).found for name in (log, late))
    (told,) = [line for line in ahead.warnings if "ahead of the commands" in line]
    before, now = (
        cast("dict[str, list[float]]", found.settings["trajectory"])["delays"][0] for found in (right, ahead)
    )
    assert now == pytest.approx(before - 2 * plant.DT, abs=2e-4)
    assert f"{-1e3 * now:.2g} ms ahead" in told
    assert not any("simulator's steps of twice that" in line for line in (*ahead.notes, *ahead.warnings))
    for one, other in zip(right.parameters, ahead.parameters, strict=True):
        if one.leader.kind in ("Ja", "fs", "fv"):
            assert abs(one.estimate - other.estimate) < 4 * (one.std_error + other.std_error)
            assert other.std_error < 3 * one.std_error
