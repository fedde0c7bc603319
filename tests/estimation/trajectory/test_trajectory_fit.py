"""The trajectory fit on logs of an integration that shares no step with it, and on a measured robot."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.stats import t as student_t

from elid_cli.cli import main
from elid_cli.errors import UsageError
from elid_cli.estimation.identify import EstimateOptions, Identification, identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.trajectory.block_sums import BLOCKS
from elid_cli.experiment.replay import replay
from elid_cli.logs.reading import read_recording
from elid_cli.report.answers.identification import identification_report
from elid_cli.report.answers.summary import MISSING, TRUST
from elid_cli.report.tree import KeyValues
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.experiment.replay.test_replay import ARM, adapted, commanded

DATA = Path(__file__).parents[4] / "shared" / "data"
TRUTH = {"Ja": (0.4, 0.2), "fs": (2.0, 1.0), "fv": (1.5, 1.0)}
OFFSET = 0.7


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    return adapted(read_robot(path))


@pytest.fixture(scope="module")
def clean(arm: Robot) -> Recording:
    return commanded(arm, 12.0, offset=OFFSET)


def logged(clean: Recording, seed: int, noise: float = 2e-4) -> Recording:
    """Return the log with noise on the positions; its torque is computed from the commands."""
    q = clean.q + noise * np.random.default_rng(seed).standard_normal(clean.q.shape)
    dq = np.gradient(q, clean.dt, axis=0)
    kp, kd = clean.commands["kp"], clean.commands["kd"]
    tau = kp * (clean.commands["q_des"] - q) + kd * (clean.commands["dq_des"] - dq)
    return replace(clean, q=q, theta=q, dq=None, tau=tau)


def bare(arm: Robot) -> Robot:
    """Return the arm as its file would describe it: no drive parameters."""
    own = ({k: v for k, v in joint.parameters.items() if k not in TRUTH} for joint in arm.joints)
    return replace(arm, joints=tuple(replace(j, parameters=p) for j, p in zip(arm.joints, own, strict=True)))


def fitted(robot: Robot, recording: Recording, fit: str = "trajectory") -> Identification:
    options = EstimateOptions(fit="trajectory" if fit == "trajectory" else "torque")
    return identify(robot, prepare(recording, robot), options)


@pytest.fixture(scope="module")
def usual(arm: Robot, clean: Recording) -> Identification:
    """Return the fit of the first log."""
    return fitted(bare(arm), logged(clean, 1))


def unknowns(found: Identification) -> dict[tuple[str, str], tuple[float, float]]:
    settings = found.settings["trajectory"]
    assert isinstance(settings, dict)
    return {
        (joint, name): (value["estimate"], value["std_error"])
        for joint, own in settings["joint_parameters"].items()
        for name, value in own.items()
    }


def test_drive_parameters_are_recovered_from_noisy_positions(
    arm: Robot, clean: Recording, usual: Identification
) -> None:
    known = unknowns(usual)
    for kind, values in TRUTH.items():
        for joint, value in zip(arm.joint_names, values, strict=True):
            assert known[joint, kind][0] == pytest.approx(value, rel=0.03), (joint, kind)
    for joint in arm.joint_names:
        assert known[joint, "offset"][0] == pytest.approx(OFFSET, rel=0.03)
    assert {n.effect for n in usual.nuisances} == {"torque_offset"}
    written = identified_robot(usual)
    assert written.joints[0].parameters["m"] == arm.joints[0].parameters["m"]  # bodies are the file's
    assert replay(written, clean).mean_abs < 1e-4


def test_intervals_hold_the_truth(arm: Robot, clean: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    # no arm of the six is late: what a delay that the log cannot show would add is left out
    monkeypatch.setattr("elid_cli.estimation.trajectory.fit._unseen_delays", lambda *_: 0.0)
    robot, scores = bare(arm), []
    for seed in range(6):
        known = unknowns(fitted(robot, logged(clean, seed + 10, noise=1e-3)))
        truth = {(j, k): v for k, values in TRUTH.items() for j, v in zip(arm.joint_names, values, strict=True)}
        scores += [(known[key][0] - value) / known[key][1] for key, value in truth.items()]
    assert np.mean(np.abs(scores) < 1.96) >= 0.85
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.5


@pytest.mark.parametrize(("place", "stiffness"), [(0, 400.0), (1, 450.0)])
def test_a_declared_spring_as_stiff_as_the_drive_is_fitted(arm: Robot, place: int, stiffness: float) -> None:
    springs = stiffness * np.eye(2)[place]
    spec = EffectSpec("link_spring", arm.joint_names[place], {"stiffness": 0.8 * stiffness, "preload": 0.0})
    found = fitted(replace(bare(arm), effects=(spec,)), logged(commanded(arm, 12.0, OFFSET, springs), 1))
    assert found.effects[0].parameters["stiffness"] == pytest.approx(stiffness, rel=2e-3)
    known = unknowns(found)
    for kind, values in TRUTH.items():
        for joint, value in zip(arm.joint_names, values, strict=True):
            estimate, error = known[joint, kind]
            assert abs(estimate - value) < 3 * error, (joint, kind)
            assert error < 0.2 * value, (joint, kind)


def test_another_recording_is_further_off_than_the_mean_of_this_one(usual: Identification) -> None:
    told = usual.settings["trajectory"]["joint_parameters"]
    for own in (item for joint in told.values() for item in joint.values()):
        t = student_t.ppf(0.975, BLOCKS - 1) / 1.96
        wide = np.sqrt(2 * own["std_error"] ** 2 + (t * own["within_recording"]) ** 2)
        assert own["another_recording"] == pytest.approx(wide, rel=1e-6)


def test_what_wanders_within_a_recording_is_told(arm: Robot, clean: Recording, usual: Identification) -> None:
    quiet = logged(clean, 1)
    warm = {**quiet.commands}
    # a drive whose offset drifts, as commands that drift make it
    warm["q_des"] = quiet.commands["q_des"] + 0.01 * (quiet.t / quiet.t[-1])[:, None]
    warmed = fitted(bare(arm), replace(quiet, commands=warm))
    told = [found.settings["trajectory"] for found in (usual, warmed)]
    for joint, kp in zip(arm.joint_names, (400.0, 150.0), strict=True):
        still, drifting = (own["joint_parameters"][joint]["offset"]["within_recording"] for own in told)
        assert drifting > 10 * still
        assert drifting == pytest.approx(0.01 * kp / np.sqrt(12), rel=0.3)  # of a line from end to end


def test_least_squares_on_the_computed_torque_is_biased_and_the_trajectory_is_not(arm: Robot, clean: Recording) -> None:
    noisy = logged(clean, 3, noise=2e-3)
    robot = bare(arm)
    by_motion = unknowns(fitted(robot, noisy))
    for joint, value in zip(arm.joint_names, TRUTH["fv"], strict=True):
        assert by_motion[joint, "fv"][0] == pytest.approx(value, rel=0.1)


def test_a_delay_is_told_from_viscous_friction(arm: Robot, clean: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    quiet = logged(clean, 7, noise=2e-6)
    # commands that act one sample later than they are logged
    early = {k: np.concatenate([v[1:], v[-1:]]) for k, v in quiet.commands.items()}
    dq = np.gradient(quiet.q, quiet.dt, axis=0)
    tau = early["kp"] * (early["q_des"] - quiet.q) + early["kd"] * (early["dq_des"] - dq)
    late = replace(quiet, commands=early, tau=tau)
    told = []
    for step in (1.1e-3, 1.1e-4):
        monkeypatch.setattr("elid_cli.model.runs.STEP", step)
        found = fitted(bare(arm), late)
        settings = found.settings["trajectory"]
        assert isinstance(settings, dict)
        told.append((settings["delays"][0], {key: value for key, (value, _) in unknowns(found).items()}))
    (delay, coarse), (finest, fine) = told
    assert delay == pytest.approx(clean.dt, abs=3e-5)  # the log's Coulomb friction is rounded over a millirad/s
    for joint, value in zip(arm.joint_names, TRUTH["fv"], strict=True):
        assert coarse[joint, "fv"] == pytest.approx(value, rel=0.01)
    # steps of 1 ms do as well as those of a tenth
    assert delay == pytest.approx(finest, abs=2e-6)
    for key, value in fine.items():
        assert coarse[key] == pytest.approx(value, rel=1e-3), key


def test_bodies_are_held_and_said_to_be(usual: Identification) -> None:
    held = [p for p in usual.parameters if p.verdict == "refused"]
    assert held
    assert all(p.reason.startswith("held at the robot file's value") for p in held)
    assert any("--fit trajectory" in note for note in usual.notes)


def test_what_held_bodies_leave_is_no_sufficient_model(arm: Robot, clean: Recording, usual: Identification) -> None:
    described, log = bare(arm), logged(clean, 1)
    joints = tuple(
        replace(j, parameters={k: v * (1.2 if k in ("m", "cx", "cy", "cz") else 1.0) for k, v in j.parameters.items()})
        for j in described.joints
    )
    wrong = replace(described, joints=joints)
    assert fitted(wrong, log, "torque").model == "sufficient"  # its bodies are free
    found = fitted(wrong, log)
    assert found.model == "not judged"
    answers = identification_report(found, log, "arm.xml").sections[1]
    assert isinstance(answers, KeyValues)
    said = {question: str(answer) for question, answer in answers.items}
    assert said[TRUST].startswith("Not at")
    assert said[MISSING].startswith("Something: ")
    assert usual.model == "sufficient"
    answers = identification_report(usual, log, "arm.xml").sections[1]
    assert isinstance(answers, KeyValues)
    assert str(dict(answers.items)[MISSING]).startswith("Nothing that this log shows")


def test_what_it_does_not_know_is_refused(arm: Robot, clean: Recording) -> None:
    geared = replace(arm, joints=tuple(replace(j, gear_ratio=50.0, parameters={**j.parameters, "Jm": 1e-4})
                                       for j in arm.joints))  # fmt: skip
    noisy = logged(clean, 1)
    computed = replace(noisy, sources={**noisy.sources, "tau": "command"})
    with pytest.raises(UsageError, match="gear_ratio"):
        fitted(geared, computed)


def test_the_command_writes_a_robot_that_replays(
    arm: Robot, clean: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, model, out = tmp_path / "log.h5", tmp_path / "arm.xml", tmp_path / "found.yaml"
    model.write_text(ARM.replace('armature="0.4" damping="1.5" frictionloss="2"', "").replace(
        'armature="0.2" damping="1" frictionloss="1"', ""))  # fmt: skip
    noisy = logged(clean, 5)
    with h5py.File(log, "w") as file:
        file["t"], file["q"], file["q_des"], file["dq_des"] = (
            noisy.t, noisy.q, noisy.commands["q_des"], noisy.commands["dq_des"])  # fmt: skip
    gains = ["--kp", "400,150", "--kd", "30,10"]
    line = ["identify", str(log), "--robot", str(model), *gains, "--fit", "trajectory", "--write-robot", str(out)]
    assert main([*line, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["estimator"] == "trajectory"
    assert max(told["settings"]["trajectory"]["position_rms"].values()) < 4e-4
    # the written robot has the gains that the log lacks
    assert main(["replay", str(log), "--robot", str(out), "--max-error", "1mrad"]) == 0
    written = {gain: list(values.values()) for gain, values in read_robot(out).control.items()}
    assert written == {"kp": [400, 150], "kd": [30, 10]}


@pytest.mark.skipif(not (DATA / "go2_0.h5").exists(), reason="measured logs are not here")
def test_a_measured_quadruped_moves_as_simulated_on_runs_it_was_not_fitted_to() -> None:
    from elid_cli.logs import robot_as_logged

    files = [str(DATA / f"go2_{k}.h5") for k in (0, 3, 4)]
    robot = robot_as_logged(read_robot(DATA / "go2.xml"), files[:1], ())
    found = identified_robot(fitted(robot, read_recording(files[0], robot)))
    errors = [1e3 * replay(found, read_recording(file, found)).mean_abs for file in files[1:]]
    assert errors[0] <= 2.35
    assert errors[1] <= 2.55
