"""The motion is fitted unasked where torques are computed from commands, and only where that is the better answer."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli import LogRequest, identify_logs
from elid_cli.cli import main
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.result import Identification
from elid_cli.estimation.trajectory import unasked
from elid_cli.estimation.trajectory.bodies import _changes, other_bodies
from elid_cli.estimation.trajectory.decided import fit_with_columns
from elid_cli.estimation.trajectory.identification import commanded_runs, started_from
from elid_cli.estimation.trajectory.normal_equations import as_late, simulated
from elid_cli.estimation.trajectory.unknowns import PARAMETERS
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.model.linearised import Linearised
from elid_cli.robot.files import read_robot
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant
from tests.experiment.replay.test_replay import commanded, rigid


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Robot, Recording, str]:
    folder = tmp_path_factory.mktemp("made")
    log = plant.written(folder, "log.h5", plant.moved(3, 8.0))
    robot = robot_as_logged(plant.robot(folder), [log], None, {})
    return robot, read_recording([log], robot), log


def heavier(robot: Robot, joint: int, share: float) -> Robot:
    """Return the robot with a body described heavier than it is, all of its parameters alike."""
    joints = list(robot.joints)
    own = {k: v * (1 + share) if k in LINK_PARAMETERS else v for k, v in joints[joint].parameters.items()}
    joints[joint] = replace(joints[joint], parameters=own)
    return replace(robot, joints=tuple(joints))


def found_of(robot: Robot, recording: Recording, **options: object) -> Identification:
    return identify(robot, prepare(recording, robot), EstimateOptions(**options))  # type: ignore[arg-type]


def test_the_motion_is_fitted_where_the_torque_is_computed(made: tuple[Robot, Recording, str]) -> None:
    robot, recording, log = made
    found, asked = found_of(robot, recording), found_of(robot, recording, fit="trajectory")
    assert found.estimator == asked.estimator == "trajectory"
    np.testing.assert_array_equal(found.estimate, asked.estimate)
    np.testing.assert_array_equal(found.std_error, asked.std_error)
    assert found.notes[1:] == asked.notes
    assert "computed from commands" in found.notes[0]
    assert not found.warnings
    by_torque = found_of(robot, recording, fit="torque")
    assert by_torque.estimator == "default"
    assert not any("trajectory" in note for note in by_torque.notes)
    # the command line and Python say the same
    same = identify_logs(LogRequest((log,), robot)).found
    np.testing.assert_array_equal(same.estimate, found.estimate)


def test_the_report_shows_the_drives(made: tuple[Robot, Recording, str], capsys: pytest.CaptureFixture[str]) -> None:
    robot, recording, log = made
    file = str(Path(log).with_name("pendulums.xml"))
    assert main(["identify", log, "--robot", file]) == 0
    said = capsys.readouterr().out
    rows = [line.split() for line in said.split("drives, with the bodies of pendulums")[1].splitlines()]
    shown = {row[0]: row[1:] for row in rows if row and row[0] in plant.NAMES}
    truth = np.stack([plant.ARMATURE, plant.COULOMB, plant.VISCOUS, plant.OFFSET], axis=1)
    for name, values in zip(plant.NAMES, truth, strict=True):
        numbers = [float(word) for word in shown[name] if word != "±"]
        assert np.all(np.abs(numbers[::2] - values) < 4.5 * np.array(numbers[1::2])), name
    assert "12 of drives; bodies are those of the robot file" in " ".join(said.split())
    assert "base parameter" not in said
    assert main(["identify", log, "--robot", file, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["settings"]["trajectory"]["other_bodies"] == {}
    assert len(told["base_parameters"]) == len(found_of(robot, recording).parameters)


def test_least_squares_stand_where_the_file_has_other_bodies_and_nothing_else_is_missing(
    made: tuple[Robot, Recording, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, recording, _ = made
    wrong = heavier(robot, 1, 0.04)
    monkeypatch.setattr(unasked, "_is_whole", lambda found: True)
    found = found_of(wrong, recording)
    assert found.estimator == "default"
    assert any("two asks for other bodies" in note for note in found.notes)
    # where more is missing as well, the motion is fitted, and the report warns
    monkeypatch.setattr(unasked, "_is_whole", lambda found: False)
    found = found_of(wrong, recording)
    assert found.estimator == "trajectory"
    (warning,) = [line for line in found.warnings if "other bodies" in line]
    assert "the motion of two asks" in warning
    told = found.settings["trajectory"]
    assert isinstance(told, dict)
    assert told["other_bodies"].keys() == {"two"}


@pytest.mark.parametrize("compiled", [True, False])
def test_a_long_log_is_told_of_the_trajectory_fit(
    made: tuple[Robot, Recording, str], monkeypatch: pytest.MonkeyPatch, compiled: bool
) -> None:
    robot, recording, log = made
    monkeypatch.setattr(unasked, "LONGEST" if compiled else "PLAIN", 1e-3 if compiled else 10.0)
    if not compiled:
        monkeypatch.setattr(unasked, "compiled_steps", lambda: None)
    found = found_of(robot, recording)
    assert found.estimator == "default"
    (note,) = [note for note in found.notes if "--fit trajectory" in note]
    assert ("Numba" in note) is not compiled
    several = identify_logs(LogRequest((log, log), robot)).found
    assert any("--fit trajectory" in note for note in several.notes)


def test_a_robot_without_bodies_is_fitted_by_torque(made: tuple[Robot, Recording, str]) -> None:
    robot, recording, _ = made
    joints = (replace(robot.joints[0], parameters={}), *robot.joints[1:])
    found = found_of(replace(robot, joints=joints), recording)
    assert found.estimator == "default"
    assert not any("--fit trajectory" in note for note in found.notes)


def test_a_motion_that_predicts_torque_far_worse_is_not_told(
    made: tuple[Robot, Recording, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, recording, _ = made
    monkeypatch.setattr(unasked, "FARTHER", 1e-3)
    found = found_of(robot, recording)
    assert found.estimator == "default"
    assert any("times as badly" in note for note in found.notes)


def test_positions_move_with_bodies_as_a_simulation_of_another_robot_says() -> None:
    robot = rigid(read_robot("planar2"))
    recording = commanded(robot, 4.0)
    signals = prepare(replace(recording, tau=np.zeros_like(recording.q)), robot)
    fit, _ = fit_with_columns(robot, commanded_runs(recording, robot), started_from(robot, signals))
    item, own = fit.tracked[0], fit.unknowns
    equations = Linearised(robot, without=PARAMETERS)
    before = simulated(equations, replace(item), own, fit.z, robot.reference(), plain=True).error
    changes = _changes(fit)[0]
    # each direction is a mixture of parameters: what a heavier second body does must be one of their sums
    for joint, share in ((1, 1e-4), (0, 1e-4)):
        other = heavier(robot, joint, share)
        moved = Linearised(other, without=PARAMETERS)
        after = simulated(moved, replace(item, local=None), own, fit.z, other.reference(), plain=True).error
        change = (after - before).ravel()
        flat = changes.reshape(len(change), -1)
        left = change - flat @ np.linalg.lstsq(flat, change, rcond=None)[0]
        assert np.linalg.norm(left) < 2e-3 * np.linalg.norm(change)
    assert as_late(item, own, fit.z).dt == item.run.dt


def test_no_other_bodies_are_asked_for_by_clean_logs_and_wrong_ones_are_seen(tmp_path: Path) -> None:
    for seed in range(20, 26):
        log = plant.written(tmp_path, f"{seed}.h5", plant.moved(seed, 8.0))
        robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
        recording = read_recording([log], robot)
        asked = []
        for described in (robot, heavier(robot, 2, 0.05)):
            start = started_from(described, prepare(recording, described))
            asked.append(other_bodies(*fit_with_columns(described, commanded_runs(recording, described), start)))
        assert asked[0] == {}
        assert asked[1].keys() == {"three"}
