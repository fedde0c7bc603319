"""The motion is fitted unasked where torques are computed from commands, and only where that is the better answer."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from elid_cli import LogRequest, identify_logs
from elid_cli.cli import main
from elid_cli.errors import UsageError
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.physical.nearest import make_physical
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.result import Identification
from elid_cli.estimation.trajectory import bodies, unasked
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.bodies import _torques, body_columns, other_bodies
from elid_cli.estimation.trajectory.decided import fit_with_columns, shows_delays
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.estimation.trajectory.normal_equations import simulated
from elid_cli.estimation.trajectory.pushes import columns_of_pushes
from elid_cli.estimation.trajectory.unknowns import PARAMETERS
from elid_cli.experiment.last_log import read_last
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.model.linearised import Linearised
from elid_cli.robot.files import read_robot
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant
from tests.experiment.replay.test_replay import commanded, rigid


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Robot, Recording, str]:
    folder = tmp_path_factory.mktemp("made")
    log = plant.written(folder, "log.h5", plant.moved(3, 6.0))
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


@pytest.fixture(scope="module")
def usual(made: tuple[Robot, Recording, str]) -> Identification:
    """Return what is found of the log unasked."""
    return found_of(*made[:2])


@pytest.fixture(scope="module")
def by_torque(made: tuple[Robot, Recording, str]) -> Identification:
    return found_of(*made[:2], fit="torque")


def test_the_motion_is_fitted_where_the_torque_is_computed(
    made: tuple[Robot, Recording, str], usual: Identification, by_torque: Identification
) -> None:
    robot, recording, log = made
    found, asked = usual, found_of(robot, recording, fit="trajectory")
    assert found.estimator == asked.estimator == "trajectory"
    np.testing.assert_array_equal(found.estimate, asked.estimate)
    np.testing.assert_array_equal(found.std_error, asked.std_error)
    assert found.notes[1:] == asked.notes
    assert "computed from commands" in found.notes[0]
    assert all("held so long" in line for line in found.warnings)  # said loudly: friction would be a third larger
    assert by_torque.estimator == "default"
    assert not any("trajectory" in note for note in by_torque.notes)
    # the command line and Python say the same
    same = identify_logs(LogRequest((log,), robot)).found
    np.testing.assert_array_equal(same.estimate, found.estimate)


def test_the_report_shows_the_drives(
    made: tuple[Robot, Recording, str], usual: Identification, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = made[2]
    file = str(Path(log).with_name("pendulums.xml"))
    assert main(["identify", log, "--robot", file]) == 0
    said = capsys.readouterr().out
    rows = [line.split() for line in said.split("drives, with the bodies of pendulums")[1].splitlines()]
    shown = {row[0]: row[1:] for row in rows if row and row[0] in plant.NAMES}
    truth = np.stack([plant.ARMATURE, plant.COULOMB, plant.VISCOUS, plant.OFFSET], axis=1)
    for name, values in zip(plant.NAMES, truth, strict=True):
        numbers = [float(word) for word in shown[name] if word != "±"]
        assert np.all(np.abs(numbers[::2] - values) < 4.5 * np.array(numbers[1::2])), name
    page = tmp_path / "page.html"
    assert main(["identify", log, "--robot", file, "--json", "--report", str(page)]) == 0
    told = json.loads(capsys.readouterr().out)
    shown_page = page.read_text("utf-8")
    assert ">Drives<" in shown_page
    assert "Base parameters" not in shown_page
    assert "12 of drives; bodies are those of the robot file" in " ".join(said.split())
    assert "base parameter" not in said
    assert told["settings"]["trajectory"]["other_bodies"] == {}
    assert len(told["base_parameters"]) == len(usual.parameters)


def test_least_squares_stand_where_the_file_has_other_bodies_and_nothing_else_is_missing(
    made: tuple[Robot, Recording, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, recording, _ = made
    wrong = heavier(robot, 1, 0.04)
    monkeypatch.setattr(unasked, "_is_sufficient", lambda found: True)
    found = found_of(wrong, recording)
    assert found.estimator == "default"
    assert any("motion of two is simulated nearer" in note for note in found.notes)
    # where more is missing as well, the motion is fitted, and the report warns
    monkeypatch.setattr(unasked, "_is_sufficient", lambda found: False)
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
    assert several.estimator == "default"
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
    assert found_of(robot, recording).estimator == "trajectory"  # the motion leaves nothing but noise
    monkeypatch.setattr(unasked, "is_at_noise", lambda ratios, fit: False)
    found = found_of(robot, recording)
    assert found.estimator == "default"
    assert any("times as badly" in note for note in found.notes)


def test_positions_move_with_bodies_as_a_simulation_of_another_robot_says() -> None:
    robot = rigid(read_robot("planar2"))
    recording = commanded(robot, 4.0)
    signals = prepare(replace(recording, tau=np.zeros_like(recording.q)), robot)
    fit, _ = fit_with_columns(robot, commanded_runs(recording, robot), started_from(robot, signals))
    item, own = fit.tracked[0], fit.unknowns
    equations, parameters = Linearised(robot, without=PARAMETERS), robot.reference()
    before = simulated(equations, replace(item), own, fit.z, parameters, plain=True).error
    torques, spanned = _torques(fit, item, slice(None)), body_columns(fit)[0]
    bodies_of = [(k, name) for k, name in enumerate(robot.parameter_names()) if name.kind in LINK_PARAMETERS]
    for joint, share in ((1, 1e-4), (0, 1e-4)):
        other = heavier(robot, joint, share)
        moved = Linearised(other, without=PARAMETERS)
        after = simulated(moved, replace(item, local=None), own, fit.z, other.reference(), plain=True).error
        change = after - before
        added = np.array([share * parameters[k] if name.joint == joint else 0.0 for k, name in bodies_of])
        pushes = (torques @ np.nan_to_num(added))[None]
        column = columns_of_pushes(equations, replace(item, local=None), own, fit.z, parameters, pushes)[:, :, 0]
        assert np.linalg.norm(column - change) < 2e-3 * np.linalg.norm(change)
        # the directions that are tried span it
        flat = spanned.reshape(change.size, -1)
        left = change.ravel() - flat @ np.linalg.lstsq(flat, change.ravel(), rcond=None)[0]
        assert np.linalg.norm(left) < 2e-3 * np.linalg.norm(change)


def test_no_other_bodies_are_asked_for_by_clean_logs_and_wrong_ones_are_seen(tmp_path: Path) -> None:
    for seed in range(20, 23):
        log = plant.written(tmp_path, f"{seed}.h5", plant.moved(seed, 6.0))
        robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
        recording = read_recording([log], robot)
        asked = []
        for described in (robot, heavier(robot, 2, 0.05)):
            start = started_from(described, prepare(recording, described))
            asked.append(other_bodies(*fit_with_columns(described, commanded_runs(recording, described), start)))
        assert asked[0] == {}
        assert asked[1].keys() == {"three"}


def test_a_joint_that_stays_where_it_is_is_not_known(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    moved = plant.moved(3, 6.0)
    still = {"q_des": moved.commands["q_des"].copy(), "dq_des": moved.commands["dq_des"].copy()}
    still["q_des"][:, 2] = still["dq_des"][:, 2] = 0.0
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(moved.t))
    q, dq = moved.q.copy(), moved.q.copy()
    assert moved.dq is not None
    dq[:] = moved.dq
    q[:, 2], dq[:, 2] = noise, 30 * noise
    log = plant.written(tmp_path, "still.h5", replace(moved, q=q, theta=q, dq=dq, commands=moved.commands | still))
    plant.robot(tmp_path)
    line = ["identify", log, "--robot", str(tmp_path / "pendulums.xml")]
    assert main([*line, "--require-independent", "fs3"]) == 1
    said = capsys.readouterr().out
    row = next(line for line in said.split("drives, with the bodies")[1].splitlines() if line.split()[:1] == ["three"])
    assert row.split() == ["three", *["not", "shown"] * 4]
    assert "of 2 of 3 joints" in " ".join(said.split())
    assert "times what the described bodies need" not in " ".join(said.split())
    assert main([*line, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["settings"]["trajectory"]["joint_parameters"]["three"]["fs"]["estimate"] is None
    assert told["error"].keys() == {"one", "two"}  # with values that nothing shows, no torque is predicted
    verdicts = {item["name"]: item["verdict"] for item in told["base_parameters"]}
    assert verdicts["fs3"] == verdicts["fv3"] == "refused"
    assert verdicts["fs1"] == verdicts["fv2"] == "supported"


def test_no_friction_is_known_to_be_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant, "COULOMB", np.zeros(3))
    log = plant.written(tmp_path, "log.h5", plant.moved(3, 6.0))
    robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
    found = found_of(robot, read_recording([log], robot))
    assert found.estimator == "trajectory"
    for name, own in found.drives.items():
        assert own["fs"]["verdict"] == "supported", name
        assert abs(own["fs"]["estimate"]) < max(4 * own["fs"]["std_error"], 1e-3)
        assert own["fv"]["estimate"] == pytest.approx(plant.VISCOUS[plant.NAMES.index(name)], rel=0.03)


@pytest.mark.parametrize("length", [1.2, 0.3])
def test_a_log_of_short_stretches(made: tuple[Robot, Recording, str], length: float) -> None:
    robot, recording, _ = made
    size = round(length / recording.dt)
    parts = tuple(Segment(a, a + size) for a in range(0, len(recording.t) - size, size + 3))
    found = found_of(heavier(robot, 1, 0.05), replace(recording, segments=parts), fit="auto")
    if length > 1:
        known = found_of(robot, replace(recording, segments=parts)).drives["one"]
        assert known["Ja"]["estimate"] == pytest.approx(plant.ARMATURE[0], rel=0.01)
        assert known["fs"]["estimate"] == pytest.approx(plant.COULOMB[0], rel=0.01)
        # stretches whose first 0.4 s do not count tell of other bodies as well
        words = (*found.notes, *found.warnings)
        assert any("motion of two" in line and "other bodies" in line for line in words)
    else:
        assert found.estimator == "default"
        assert any("could not be fitted" in note for note in found.notes)


def test_a_robot_that_declares_a_wrong_delay_is_written_with_the_right_one(made: tuple[Robot, Recording, str]) -> None:
    robot, recording, _ = made
    late = EffectSpec("torque_delay", "one", {"delay": 0.004})
    found = found_of(replace(robot, effects=(late,)), recording)
    assert found.estimator == "trajectory"
    written = identified_robot(found).effects
    delays = {spec.joint: spec.parameters["delay"] for spec in written if spec.effect == "torque_delay"}
    assert all(abs(delay) < 5e-5 for delay in delays.values())  # the plant's drives act at once
    assert found.drives["one"]["Ja"]["estimate"] == pytest.approx(plant.ARMATURE[0], rel=0.01)


def test_what_is_asked_of_least_squares_keeps_them(
    made: tuple[Robot, Recording, str], usual: Identification, tmp_path: Path
) -> None:
    robot, recording, log = made
    assert found_of(robot, recording, offsets=False).estimator == "default"
    ripple = EffectSpec("torque_ripple", "one", {"amplitude": 0.01, "phase": 0.0, "order": 6.0})
    assert found_of(replace(robot, effects=(ripple,)), recording).estimator == "default"
    soft = EffectSpec("soft_friction", "two", {"velocity": 0.01})
    found = found_of(replace(robot, effects=(soft,)), recording)
    assert found.estimator == "default"
    assert any("has no friction" in note for note in found.notes)
    with pytest.raises(UsageError, match="of the motion"):
        make_physical(usual)
    line = ["identify", log, "--robot", str(Path(log).with_name("pendulums.xml"))]
    assert main([*line, "--require-independent", "cz1", "--quiet"]) == 0
    # the next motion is for drives that are not known, not for bodies that were held
    saved = tmp_path / "saved.json"
    saved.write_text(json.dumps(usual.to_dict(), default=float))
    assert read_last(saved, robot).hidden == ()


def test_columns_of_bodies_are_the_same_in_parts(
    made: tuple[Robot, Recording, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, recording, _ = made
    start = started_from(robot, prepare(recording, robot))
    fit, columns = fit_with_columns(heavier(robot, 1, 0.05), commanded_runs(recording, robot), start)
    (whole,), asked = body_columns(fit), other_bodies(fit, columns)
    monkeypatch.setattr(bodies, "INSTANTS", 100)
    monkeypatch.setattr(bodies, "TOGETHER", 2)
    np.testing.assert_allclose(body_columns(fit)[0], whole, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(body_columns(fit, 3)[0].shape, (len(whole[::3]), *whole.shape[1:]))
    monkeypatch.setattr(bodies, "MEMORY", 1 << 20)
    assert bodies.stride_of(fit) > 1
    assert other_bodies(fit, columns)["two"] == pytest.approx(asked["two"], rel=0.1)


def test_short_logs_are_fitted_together(made: tuple[Robot, Recording, str], tmp_path: Path) -> None:
    robot, _, log = made
    logs = (log, plant.written(tmp_path, "other.h5", plant.moved(4, 6.0)))
    told = identify_logs(LogRequest(logs, robot))
    asked = identify_logs(LogRequest(logs, robot), EstimateOptions(fit="trajectory")).found
    assert told.found.estimator == "trajectory"
    np.testing.assert_allclose(told.found.estimate, asked.estimate, rtol=1e-12)
    np.testing.assert_allclose(told.found.std_error, asked.std_error, rtol=1e-12)
    assert [item.file for item in told.apart] == list(logs)
    assert not any("takes about" in note for note in told.found.notes)


def test_an_offset_that_least_squares_take_for_none_is_no_wrong_gain(tmp_path: Path) -> None:
    # the offset of joint two took up a third of its weight, and a warning doubted kp and kd
    for seed in (30, 31, 32):
        recording = plant.moved(seed, 2.5, noise=1e-3)
        log = plant.written(tmp_path, f"{seed}.h5", recording)
        robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
        found = identify_logs(LogRequest((log,), robot)).found
        assert not any("times what the described bodies need" in line for line in found.warnings)


def test_a_loop_that_holds_its_torque_is_told_with_its_size(usual: Identification) -> None:
    (note,) = [line for line in (*usual.warnings, *usual.notes) if "held so long" in line]
    period = cast("dict[str, float]", usual.settings["trajectory"])["unseen_loop"]
    assert period == pytest.approx(plant.DT, rel=0.1)  # slow motion
    assert "computed at the log's rate" in note
    assert f"viscous friction by up to {plant.KP[0] * period / 2:.2g} N·m·s/rad (one)" in note
    assert f"motor inertia is larger by up to {plant.KD[0] * period / 2:.2g} kg·m² (one)" in note


def test_least_squares_tell_what_a_loop_changes(made: tuple[Robot, Recording, str], by_torque: Identification) -> None:
    robot, recording, _ = made
    loops = [line for line in by_torque.warnings if "every millisecond" in line]
    (line,) = loops
    assert f"friction is larger by {plant.KP[0] * 5e-4:.2g} N·m·s/rad" in line
    assert f"motor inertia by {plant.KD[0] * 5e-4:.2g} kg·m² (one)" in line
    told = replace(robot, effects=tuple(EffectSpec("held_loop", name, {"period": plant.DT}) for name in plant.NAMES))
    assert not any("every millisecond" in line for line in found_of(told, recording, fit="torque").warnings)


@pytest.mark.parametrize(
    ("delay", "deviation", "shown"), [(1e-3, 2e-4, True), (-1e-3, 2e-4, False), (-1e-3, 1e-4, True)]
)
def test_a_motion_ahead_of_its_commands_must_be_clearer(
    made: tuple[Robot, Recording, str], delay: float, deviation: float, shown: bool
) -> None:
    robot, recording, _ = made
    fit, _ = fit_with_columns(
        robot, commanded_runs(recording, robot), started_from(robot, prepare(recording, robot)), soft=False
    )
    own = fit.unknowns.delays
    z, covariance = fit.z.copy(), fit.covariance.copy()
    z[own], covariance[own, own] = delay, deviation**2
    assert shows_delays(replace(fit, z=z, covariance=covariance, left_out=np.repeat(z[None], 6, axis=0))) is shown


def test_a_minute_of_legs_is_short(made: tuple[Robot, Recording, str]) -> None:
    chain = read_robot("puma560")
    assert unasked.seconds_of(chain, 60 * 200, 0.005) < unasked.LONGEST < unasked.seconds_of(chain, 90 * 200, 0.005)
    # joints beside each other cost less than a chain of as many
    assert unasked.seconds_of(made[0], 60 * 200, 0.005) < 0.2 * unasked.seconds_of(chain, 60 * 200, 0.005)
