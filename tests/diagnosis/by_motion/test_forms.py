"""An effect has forms between which no refinement leads, such as exponents: the others are tried where one fails."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.refits import grown
from elid_cli.diagnosis.by_motion.search import _kept, screened, search
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.diagnosis.by_motion.views import own_unknowns, seen_by, views_of
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.model.effects import effect_classes
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

STRIBECK = effect_classes()["stribeck"]
JOINT = 1


def started(
    folder: Path, amplitude: float, velocity: float, exponent: float, duration: float = 6.0
) -> tuple[Robot, list[Run], np.ndarray]:
    """Return a robot, its run and where a fit starts, with Stribeck friction at one joint."""

    def grip(x: np.ndarray, v: np.ndarray, load: np.ndarray) -> np.ndarray:
        return np.eye(3)[JOINT] * amplitude * np.exp(-((np.abs(v) / velocity) ** exponent))

    log = plant.written(folder, "log.h5", plant.moved(3, duration, grip=grip, sweep=0.15))
    robot = robot_as_logged(plant.robot(folder), [log], None, {})
    signals = prepare(read_recording([log], robot), robot)
    assert signals.recording is not None
    return robot, commanded_runs(signals.recording, robot), started_from(robot, signals)


def test_another_form_is_tried_where_the_values_of_one_are_none_that_robots_have(tmp_path: Path) -> None:
    fit = fit_trajectory(*started(tmp_path, 0.25, 0.15, 1.0, 8.0))
    seen = seen_by(views_of(fit), own_unknowns(fit.unknowns, JOINT), JOINT)
    (found,) = screened(seen, JOINT, [STRIBECK], ())
    forms = {form.effect.shape[1]: form for form in (found, *found.forms)}
    assert set(forms) == {1.0, 2.0, -1.0}
    rising, fading = forms[-1.0], forms[1.0]
    failing = Named(rising.effect, rising.gain, rising.helped, (), (fading,))
    end, (named,) = _kept(grown(fit, [rising.effect]), [failing], 0)
    assert named.effect.shape[1] == 1.0
    assert named.gain > 0.95
    assert end.z[end.unknowns.amplitudes_of(0)] == pytest.approx([0.25], rel=0.1)
    # without another form nothing is left of it
    _, left = _kept(grown(fit, [rising.effect]), [Named(rising.effect, rising.gain, rising.helped)], 0)
    assert left == []


def test_the_exponent_is_the_one_that_made_the_log_though_another_did_as_well_in_the_screening(tmp_path: Path) -> None:
    found = search(*started(tmp_path, 0.4, 0.3, 1.0), (), (), only=("stribeck",))
    (named,) = found.named
    assert named.effect.joint == JOINT
    assert named.effect.shape == pytest.approx((0.3, 1.0), rel=0.1)
