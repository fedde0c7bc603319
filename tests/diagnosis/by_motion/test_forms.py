"""An effect has forms between which no refinement leads, such as exponents: the others are tried where one fails."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.other_forms import other_forms
from elid_cli.diagnosis.by_motion.refits import grown
from elid_cli.diagnosis.by_motion.rivals import in_best_forms
from elid_cli.diagnosis.by_motion.search import _kept, screened, search
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.diagnosis.by_motion.views import own_unknowns, seen_by, views_of
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.estimation.trajectory.timing_doubts import counting
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
    folder: Path, amplitude: float, velocity: float, exponent: float, duration: float = 6.0, noise: float = 1e-4
) -> tuple[Robot, list[Run], np.ndarray]:
    """Return a robot, its run and where a fit starts, with Stribeck friction at one joint."""

    def grip(x: np.ndarray, v: np.ndarray, load: np.ndarray) -> np.ndarray:
        return np.eye(3)[JOINT] * amplitude * np.exp(-((np.abs(v) / velocity) ** exponent))

    log = plant.written(folder, "log.h5", plant.moved(3, duration, grip=grip, sweep=0.15, noise=noise))
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


def found_in(folder: Path, exponent: float, noise: float) -> tuple[TrajectoryFit, Named]:
    """Return the fit and the effect that a search starts with in one of its forms, where the truth has exponent 1."""
    fit = fit_trajectory(*started(folder, 0.4, 0.3, 1.0, noise=noise))
    (found,) = screened(seen_by(views_of(fit), own_unknowns(fit.unknowns, JOINT), JOINT), JOINT, [STRIBECK], ())
    forms = {form.effect.shape[1]: form for form in (found, *found.forms)}
    own = forms.pop(exponent)
    after, (named,) = _kept(grown(fit, [own.effect]), [Named(own.effect, own.gain, own.helped)], 0)
    return after, replace(named, forms=tuple(forms.values()))


@pytest.mark.parametrize(
    ("noise", "told"),
    [
        pytest.param(3e-4, [], id="nearer in every block"),
        pytest.param(6e-4, [-1.0], id="about as near, and the usual form"),
    ],
)
def test_the_form_that_made_the_log_takes_the_place_of_another(tmp_path: Path, noise: float, told: list[float]) -> None:
    fit, wrong = found_in(tmp_path, -1.0, noise)
    after, (named,) = in_best_forms(fit, [wrong], [(STRIBECK.name, JOINT)], 0)
    assert after.effects[0].shape == pytest.approx((0.3, 1.0), rel=0.1)
    assert after.equations.lighter.sum() < fit.equations.lighter.sum() * 1.02
    left = other_forms(after, [named]).told
    assert [form.parameters["exponent"] for form in left.get(0, ())] == told


def test_forms_that_a_log_cannot_tell_apart_are_told_and_counted_in_the_errors(tmp_path: Path) -> None:
    fit, own = found_in(tmp_path, 1.0, 3e-3)
    forms = other_forms(fit, [own])
    assert {form.parameters["exponent"] for form in forms.told[0]} >= {2.0}
    place = 4 * JOINT + 1  # Coulomb friction
    far = max(abs(dict(form.moved)["fs2"] - fit.z[place]) for form in forms.told[0] if "fs2" in dict(form.moved))
    errors = np.sqrt([np.diag(one.covariance)[place] for one in (fit, counting(fit, forms.shifts))])
    assert far > 2 * errors[0]
    assert errors[1] > 0.49 * far
