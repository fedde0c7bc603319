"""What a fit to the motion, or least squares beside it, say of values that something missing may have moved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from elid_cli import sample
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.result import Identification
from elid_cli.estimation.trajectory.doubtful_joints import with_doubtful_joints
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.identification import fit_of, identification_of
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.report.answers.identification import identification_report
from elid_cli.report.answers.lacking import words_of
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals, prepare
from tests.diagnosis.by_motion import plant
from tests.experiment.replay.test_replay import commanded, rigid


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Identification, Identification, TrajectoryFit, Signals]:
    """Return two coupled joints by least squares and by their motion, the fit, and the log."""
    arm = rigid(read_robot("planar2"))
    parts = [{**{k: v for k, v in j.parameters.items() if k not in ("K", "Jm")}, "Ja": 0.1} for j in arm.joints]
    joints = [replace(j, gear_ratio=None, parameters=own) for j, own in zip(arm.joints, parts, strict=True)]
    robot = replace(arm, joints=tuple(joints))
    log = commanded(robot, 4.0)
    q = log.q + 1e-4 * np.random.default_rng(0).standard_normal(log.q.shape)
    log = replace(log, q=q, theta=q, dq=None)
    recording = read_recording([plant.written(tmp_path_factory.mktemp("made"), "log.h5", log)], robot)
    signals = prepare(recording, robot)
    found = identify(robot, signals, EstimateOptions(fit="torque", guards=False))
    fit, bodies = fit_of(robot, signals, recording)
    return found, unmarked(identification_of(found, fit, signals, bodies)), fit, signals


def unmarked(told: Identification) -> Identification:
    """Return a fit of which nothing is doubted yet, whatever its log says."""
    fit = dict(told.settings["trajectory"])  # type: ignore[call-overload]
    drives = {
        joint: {name: {**item, "verdict": "supported", "bias_possible": False} for name, item in own.items()}
        for joint, own in fit["joint_parameters"].items()
    }
    fit |= {"other_bodies": {}, "velocity_filters": {}, "negative_friction": {}, "joint_parameters": drives}
    parameters = tuple(replace(item, bias_possible=False) for item in told.parameters)
    settings = {**told.settings, "trajectory": fit}
    return replace(told, parameters=parameters, settings=settings, noise=(), insufficient=())


def ratios_of(told: Identification, *ratios: float) -> dict[str, float]:
    return dict(zip(told.robot.joint_names, ratios, strict=True))


def test_what_a_model_lacks_marks_the_joint_and_those_coupled_to_it(
    fitted: tuple[Identification, Identification, TrajectoryFit, Signals],
) -> None:
    told, recording = replace(fitted[1], model="insufficient"), fitted[3].recording
    marked = with_doubtful_joints(told, recording, ratios_of(told, 0.9, 2.0))
    assert all(item.bias_possible for item in marked.parameters)
    drives = marked.settings["trajectory"]["joint_parameters"]  # type: ignore[index]
    for own in drives.values():
        assert {item["bias_possible"] for item in own.values()} == {True}
        assert {item["verdict"] for item in own.values()} == {"supported"}  # their errors are what they are
    (report,) = [identification_report(marked, recording, "robot")] if recording is not None else []
    assert "may be biased by what is missing: all values" in str(report).lower()
    (note, *_) = sample([marked], 5).notes
    assert note.endswith("is insufficient: true values may lie outside the sets' range")


@pytest.mark.parametrize(
    ("model", "ratios"),
    [("sufficient", (2.0, 2.0)), ("insufficient", (1.1, 1.2)), ("not judged", (0.5, 0.5))],
)
def test_what_lacks_nothing_that_the_motion_shows_is_not_marked(
    fitted: tuple[Identification, Identification, TrajectoryFit, Signals],
    model: str, ratios: tuple[float, float],
) -> None:  # fmt: skip
    told = replace(fitted[1], model=model)  # type: ignore[arg-type]
    same = with_doubtful_joints(told, fitted[3].recording, ratios_of(told, *ratios))
    assert not any(item.bias_possible for item in same.parameters)
    assert same.settings == told.settings


def test_other_bodies_that_the_motion_asks_for_mark_values_at_the_noise(
    fitted: tuple[Identification, Identification, TrajectoryFit, Signals],
) -> None:
    told, recording = replace(fitted[1], model="insufficient"), fitted[3].recording
    fit = {**told.settings["trajectory"], "other_bodies": {told.robot.joint_names[0]: 0.2}}  # type: ignore[dict-item]
    told = replace(told, settings={**told.settings, "trajectory": fit})
    marked = with_doubtful_joints(told, recording, ratios_of(told, 1.0, 1.0))
    assert all(item.bias_possible for item in marked.parameters)


def test_a_delay_that_the_other_values_are_beside_is_written_however_unsure_it_is(
    fitted: tuple[Identification, Identification, TrajectoryFit, Signals],
) -> None:
    found, _, fit, signals = fitted
    covariance, z = fit.covariance.copy(), fit.z.copy()
    covariance[fit.unknowns.delays, fit.unknowns.delays] += 1e-6
    z[fit.unknowns.delays] = 6e-4
    told = identification_of(found, replace(fit, covariance=covariance, z=z), signals)
    late = [spec.parameters["delay"] for spec in identified_robot(told).effects if spec.effect == "torque_delay"]
    assert len(late) == told.robot.n
    assert min(late) == pytest.approx(6e-4)


def made(folder: Path, log: Recording) -> tuple[Robot, Signals]:
    """Return the pendulums and a log of theirs."""
    file = plant.written(folder, "log.h5", log)
    robot = robot_as_logged(plant.robot(folder), [file], None, {})
    return robot, prepare(read_recording([file], robot), robot)


def test_drives_that_damp_less_than_the_log_has_it_leave_a_friction_that_is_called_what_it_is(tmp_path: Path) -> None:
    log = plant.moved(3, 6.0)
    gains = {**log.commands, "kd": 1.5 * log.commands["kd"]}
    robot, signals = made(tmp_path, replace(log, commands=gains))
    found = identify(robot, signals)
    assert not any("everywhere" in line for line in found.warnings)
    assert found.model == "insufficient" or found.estimator == "trajectory"
    assert words_of(found).startswith("Something")
    assert all(item.bias_possible for item in found.parameters)


def test_targets_that_drives_go_to_in_ramps_are_not_called_sufficient(tmp_path: Path) -> None:
    log, hold = plant.moved(3, 8.0, rates=False), 10
    # drives are told ramps, and the log has what these end at, as of servos that go to each target evenly
    told = log.commands["q_des"]
    ends = np.minimum((np.arange(len(told)) // hold + 1) * hold, len(told) - 1)
    robot, signals = made(tmp_path, replace(log, commands={**log.commands, "q_des": told[ends]}))
    found = identify(robot, signals)
    assert found.model == "insufficient"
    assert words_of(found).startswith("Something")
    assert all(item.bias_possible for item in found.parameters)
    if found.estimator == "default":
        assert isinstance(found.settings["simulated_motion"], dict | MappingProxyType)
