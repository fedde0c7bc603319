"""The first fit of a log's motion is made once, and anew of anything else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.smooth_commands import as_told
from elid_cli.estimation.trajectory import first_fits
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.first_fits import first_fit
from elid_cli.estimation.trajectory.identification import commanded_runs, fit_of
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """The first fits that are made."""
    found, plain = list[object](), first_fits.fit_with_columns

    def counted(*arguments: object, **how: object) -> object:
        found.append(arguments)
        return plain(*arguments, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(first_fits, "fit_with_columns", counted)
    return found


def test_a_first_fit_is_made_once_and_anew_of_anything_else(tmp_path: Path, made: list[object]) -> None:
    log = plant.written(tmp_path, "log.h5", plant.moved(3, 2.0))
    robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
    recording = read_recording([log], robot)
    start = started_from(robot, prepare(recording, robot))
    (run,) = commanded_runs(recording, robot)
    first = first_fit(robot, [run], start, ((), ()))
    same = replace(run, measured=run.measured.copy(), drives=replace(run.drives, kp=run.drives.kp.copy()))
    again = first_fit(replace(robot), [same], start.copy(), ((), ()), first)
    assert len(made) == 1
    # the motion of the stretches, which later fits change, is each caller's own
    fit, columns = again.with_columns
    np.testing.assert_array_equal(fit.z, first.fit.z)
    np.testing.assert_array_equal(columns[0], first.with_columns[1][0])
    fit.tracked[0].x = fit.tracked[0].x + 1.0
    np.testing.assert_array_equal(again.fit.tracked[0].x, first.found[0].tracked[0].x)
    measured, kp = run.measured.copy(), run.drives.kp * 1.001
    measured[50, 1] += 1e-9
    bodies = replace(robot, gravity=(0.0, 0.0, -9.82))
    for other, runs, begun in (
        (robot, [replace(run, measured=measured)], start),
        (robot, [replace(run, drives=replace(run.drives, kp=kp))], start),
        (robot, [run], start * (1 + 1e-9)),
        (robot, [run, run], start),
        (bodies, [run], start),
    ):
        made.clear()
        first_fit(other, runs, begun, ((), ()), first)
        assert len(made) == 1


def test_a_diagnosis_begins_with_the_fit_that_told_how_drives_were_told(tmp_path: Path, made: list[object]) -> None:
    log = plant.written(tmp_path, "log.h5", plant.moved(3, 4.0, once=True, noise=3e-5))
    robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
    recording = read_recording([log], robot)
    told = as_told(robot, prepare(recording, robot))
    before = len(made)
    assert before == 2  # held commands and smooth ones
    found = diagnose_motion(robot, told)
    assert told.recording is not None
    fit_of(robot, told, told.recording)
    assert len(made) == before
    # without it, the same comes out
    made.clear()
    other = diagnose_motion(robot, replace(told, first=None))
    assert made
    np.testing.assert_array_equal(other.fit_after.z, found.fit_after.z)
