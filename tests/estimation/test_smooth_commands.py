"""A log that is slower than its commands: those between its samples are smooth, where the motion shows that."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation import smooth_commands
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.result import Identification, Nuisance
from elid_cli.estimation.trajectory.nearer import Nearer
from elid_cli.experiment.replay import ReplayOptions, replay
from elid_cli.report.answers.lacking import motion_words
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import held_mean
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant
from tests.estimation.trajectory import test_soft_friction as soft_friction

TRUTH = {"Ja": plant.ARMATURE, "fs": plant.COULOMB, "fv": plant.VISCOUS}


@pytest.fixture(scope="module")
def pendulums(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    bare = plant.robot(tmp_path_factory.mktemp("pendulums"))
    return replace(bare, joints=tuple(replace(joint, transmission="rigid") for joint in bare.joints))


def every(
    step: int, seed: int = 0, duration: float = 16.0, delay: float = 0.0, noise: float = 5e-5, **friction: plant.Extra
) -> Recording:
    """Return every so many samples of a log, with the torque of their commands as reading a file gives it."""
    log = plant.moved(seed, duration, delay, noise=noise, sweep=0.15, **friction)
    t, q = log.t[::step], log.q[::step]
    told = {name: values[::step] for name, values in log.commands.items()}
    dt = step * log.dt
    mean = {name: held_mean(told[name], [(0, len(t))]) for name in ("q_des", "dq_des")}
    tau = told["kp"] * (mean["q_des"] - q) + told["kd"] * (mean["dq_des"] - np.gradient(q, dt, axis=0))
    none = {"dq": None, "dtheta": None, "segments": (Segment(0, len(t)),), "sources": {"tau": "command"}}
    return replace(log, t=t, dt=dt, q=q, theta=q, tau=tau, commands=told, **none)


def test_commands_of_a_slow_log_are_smooth(pendulums: Robot) -> None:
    log = every(5)
    signals = prepare(log, pendulums)
    found = identify(pendulums, signals)
    assert found.settings["commands"] == "smooth"
    assert any("--commands held" in note for note in found.notes)
    told = found.settings["trajectory"]["joint_parameters"]
    for kind, values in TRUTH.items():
        for name, value in zip(pendulums.joint_names, values, strict=True):
            own = told[name][kind]
            assert abs(own["estimate"] - value) < max(4 * own["std_error"], 0.03 * value), (name, kind)

    written = identified_robot(found)
    smooth, held = (replay(written, log, ReplayOptions(commands=how)) for how in ("smooth", "held"))
    assert (smooth.commands, held.commands) == ("smooth", "held")
    assert smooth.mean_abs < 2e-4 < 0.1 * held.mean_abs

    # a torque that is predicted badly is at fault where the motion leaves nothing but noise
    bad = replace(found, error={name: replace(e, relative=0.3, floor=None) for name, e in found.error.items()})
    assert motion_words(bad, ()).startswith(
        "Yes: the motion simulated under the commands is off by the encoders' noise"
    )
    moved = {**found.settings["trajectory"], "noise_ratio": dict.fromkeys(pendulums.joint_names, 2.0)}
    assert not motion_words(replace(bad, settings={**found.settings, "trajectory": moved}), ())

    diagnosed = diagnose_motion(pendulums, signals)
    assert not diagnosed.effects
    assert diagnosed.recording.smooth
    assert replay(diagnosed.refined, diagnosed.recording).mean_abs < 2e-4  # what its figures show
    assert any("--commands held" in note for note in diagnosed.after.notes)


def test_held_commands_stay_held(pendulums: Robot) -> None:
    found = identify(pendulums, prepare(every(1), pendulums))
    assert "commands" not in found.settings


def test_the_next_command_judges_the_written_robot_by_smooth_commands(
    pendulums: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tau = np.full_like(every(5).tau, np.nan)  # a log of commands alone
    log = plant.written(tmp_path, "slow.h5", replace(every(5), tau=tau))
    robot, out = str(tmp_path / "arm.yaml"), str(tmp_path / "found.yaml")
    write_robot(pendulums, robot)
    assert main(["identify", log, "--robot", robot, "--write-robot", out]) == 0
    assert f"Next: elid validate {log} --robot {out} --commands smooth" in capsys.readouterr().out
    errors = {}
    for how in ("smooth", "held"):
        main(["validate", log, "--robot", out, "--commands", how, "--json"])
        told = json.loads(capsys.readouterr().out)
        errors[how] = max(own["relative"] for own in told["error"].values())
        assert told["log"]["commands"] == how
    assert errors["smooth"] < 0.03 < 0.1 * errors["held"]
    main(["replay", log, "--robot", out, "--json"])  # it decides by the motion
    told = json.loads(capsys.readouterr().out)
    assert told["log"]["commands"] == "smooth"
    assert told["mean_abs"] < 2e-4

    # an MJCF holds no delay, and its values are of another fit: of the same commands
    bare, made = str(tmp_path / "bare.xml"), str(tmp_path / "made.xml")
    plant.robot(tmp_path)
    (tmp_path / "pendulums.xml").rename(bare)
    assert main(["diagnose", log, "--robot", bare, "--write-robot", made, "--write-robot", out, "--drop-effects"]) == 0
    assert f"Next: elid replay {log} --robot {out} --commands smooth" in capsys.readouterr().out
    inertia = [joint.parameters["Ja"] for joint in read_robot(made).joints]
    assert np.allclose(inertia, plant.ARMATURE, rtol=0.2)  # without the delay; held commands make it a third


def test_several_slow_logs_and_reduced_ones_have_smooth_commands(
    pendulums: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = [every(5, seed, delay=0.008) for seed in (0, 1)]  # as late as held ones would be early, and more
    logs = [
        plant.written(tmp_path, f"{k}.h5", replace(part, tau=np.full_like(part.tau, np.nan)))
        for k, part in enumerate(parts)
    ]
    robot, triangles = str(tmp_path / "arm.yaml"), str(tmp_path / "reduced.npz")
    write_robot(pendulums, robot)
    assert main(["identify", *logs, "--robot", robot, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["settings"]["commands"] == told["log"]["commands"] == "smooth"
    for kind, values in TRUTH.items():
        for name, value in zip(pendulums.joint_names, values, strict=True):
            own = told["settings"]["trajectory"]["joint_parameters"][name][kind]
            assert abs(own["estimate"] - value) < max(4 * own["std_error"], 0.01 * value), (name, kind)
    assert max(e["relative"] for log in told["error_by_log"] for e in log["error"].values()) < 0.02

    assert main(["reduce", logs[0], "--robot", robot, "-o", triangles]) == 0
    capsys.readouterr()
    for command in ([triangles], [triangles, logs[1]]):
        assert main(["identify", *command, "--robot", robot, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["settings"]["commands"] == told["log"]["commands"] == "smooth"
        assert max(e["relative"] for e in told["error"].values()) < 0.02
    assert main(["identify", triangles, "--robot", robot, "--commands", "held"]) == 2
    assert "reduced with other commands" in capsys.readouterr().err

    # what the user says stands
    assert main(["identify", logs[0], "--robot", robot, "--commands", "held", "--json"]) == 0
    assert "commands" not in json.loads(capsys.readouterr().out)["settings"]


@pytest.mark.parametrize(
    ("late", "fv", "asked"), [(0.0, -0.1, True), (0.0, 0.1, False), (0.02, -0.1, False), (-0.02, 0.1, True)]
)
def test_the_motion_is_asked_where_half_a_sample_may_be_in_viscous_friction(
    pendulums: Robot, monkeypatch: pytest.MonkeyPatch, late: float, fv: float, asked: bool
) -> None:
    names = pendulums.parameter_names()
    values = np.array([fv if name.kind == "fv" else 1.0 for name in names])
    found = SimpleNamespace(robot=pendulums, standard=values)
    monkeypatch.setattr(smooth_commands, "_least_squares", lambda robot, signals: found)
    monkeypatch.setattr(smooth_commands, "_stairs", lambda held, found: 0.0)
    monkeypatch.setattr(smooth_commands, "_delay", lambda found: late)
    monkeypatch.setattr(smooth_commands, "nearer_by_motion", lambda *logs, **how: Nearer(1.0, True, (0.0, 0.0)))
    told = smooth_commands.as_told(pendulums, prepare(every(4, duration=6.0), pendulums)).recording
    assert told is not None
    assert told.smooth is asked


@pytest.mark.parametrize("policy", [True, False])
def test_commands_that_step_are_never_smooth(pendulums: Robot, monkeypatch: pytest.MonkeyPatch, policy: bool) -> None:
    log = every(1, duration=6.0)
    if policy:  # it keeps its commands for four samples
        kept = np.arange(len(log.t)) // 4 * 4
        log = replace(log, commands={name: values[kept] for name, values in log.commands.items()})
    monkeypatch.setattr(smooth_commands, "_stairs", lambda held, found: 1.0)
    monkeypatch.setattr(smooth_commands, "nearer_by_motion", lambda *logs, **how: Nearer(9.0, True, (0.0, 0.0)))
    told = smooth_commands.as_told(pendulums, prepare(log, pendulums)).recording
    assert told is not None
    assert told.smooth is not policy


def test_commands_are_smooth_where_positions_are_noisy(pendulums: Robot) -> None:
    signals = prepare(every(4, noise=3e-3), pendulums)
    found = identify(pendulums, signals, EstimateOptions(fit="torque", guards=False))
    assert found.settings["commands"] == "smooth"


def test_smooth_commands_of_a_log_with_torques_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "sample_logs/planar2.mcap", "--robot", "planar2", "--commands", "smooth"]) == 2
    assert "--commands smooth: the log holds torques" in capsys.readouterr().err


@pytest.mark.parametrize("delay", [0.0005, 0.001])
def test_a_delay_of_the_drives_hides_less_than_half_a_sample_of_smooth_commands(pendulums: Robot, delay: float) -> None:
    found = identify(pendulums, prepare(every(2, 2, delay=delay), pendulums))
    assert found.settings["commands"] == "smooth"
    told = found.settings["trajectory"]["joint_parameters"]
    for name, value in zip(pendulums.joint_names, plant.VISCOUS, strict=True):
        assert told[name]["fv"]["estimate"] == pytest.approx(value, rel=0.003)


def test_smooth_commands_are_told_from_held_ones_where_friction_fades_in(pendulums: Robot) -> None:
    """Smoothed friction left ten times the noise with both, and viscous friction came out 40 to 90 % too large."""
    log = every(4, 3, 10.0, delay=0.003, push=soft_friction.smooth, grip=soft_friction.none_dry)
    found = identify(pendulums, prepare(log, pendulums))
    assert found.settings["commands"] == "smooth"
    told = found.settings["trajectory"]["joint_parameters"]
    for name, value in zip(pendulums.joint_names, plant.VISCOUS, strict=True):
        assert told[name]["fv"]["estimate"] == pytest.approx(value, rel=0.03)
    assert all(late.parameters["delay"] == pytest.approx(0.003 + 0.5 * plant.DT, abs=3e-4) for late in delays_of(found))


def test_a_delay_knows_of_commands_that_may_be_smooth(pendulums: Robot) -> None:
    """Without a word it was half a sample short, with errors of a hundredth of that."""
    log = every(2, 1, 8.0, delay=0.006, noise=3e-3)
    found = identify(pendulums, prepare(log, pendulums), EstimateOptions(fit="trajectory"))
    assert "commands" not in found.settings
    assert any("--commands smooth, or held, says which" in note for note in found.notes)
    for late in delays_of(found):
        assert abs(late.parameters["delay"] - 0.006) < 2 * late.std_error["delay"]
        assert late.std_error["delay"] > 0.4 * log.dt
    assert any(spec.effect == "torque_delay" for spec in identified_robot(found).effects)
    sure = identify(pendulums, prepare(replace(log, smooth=True), pendulums), EstimateOptions(fit="trajectory"))
    assert all(late.std_error["delay"] < 0.1 * log.dt for late in delays_of(sure))


def delays_of(found: Identification) -> list[Nuisance]:
    return [item for item in found.nuisances if item.effect == "torque_delay"]
