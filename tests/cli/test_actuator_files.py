"""--write-actuators: drives as simulators' configurations name them, and what a robot file cannot hold, beside it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from elid_cli.cli import main
from elid_cli.errors import UsageError
from elid_cli.estimation.actuator_text import actuator_text
from elid_cli.estimation.actuators import Actuators, Value
from elid_cli.experiment.replay.actuators import with_actuators
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.files import write_text
from elid_cli.logs.writing import write_recording
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import EffectSpec, Limits, Robot

ROOT = Path(__file__).parents[2]
STRIBECK = ROOT / "sample_logs/planar2_stribeck.h5"


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Robot]:
    """Return a log of two rigid joints with a torque offset, the robot's file, and the truth."""
    folder = tmp_path_factory.mktemp("drives")
    arm = read_robot("planar2")
    joints = []
    for joint in arm.joints:
        values = {k: v for k, v in joint.parameters.items() if k not in ("K", "Jm")} | {"Ja": 0.4}
        joints.append(replace(joint, transmission="rigid", gear_ratio=None, parameters=values, limits=Limits()))
    offset = EffectSpec("torque_offset", "joint2", {"offset": 0.3})
    truth = replace(arm, joints=tuple(joints), effects=(offset,))
    log, robot = folder / "log.h5", folder / "arm.yaml"
    write_recording(simulate(truth, SimulationOptions(duration=6.0, rate=500.0, seed=3)), log)
    write_robot(replace(truth, effects=()), robot)
    return log, robot, truth


def test_values_are_the_robots_with_errors_and_units(drives: tuple[Path, Path, Robot], tmp_path: Path) -> None:
    log, robot, truth = drives
    out, same = tmp_path / "drives.json", tmp_path / "drives.yaml"
    assert main(["identify", str(log), "--robot", str(robot), "--write-actuators", str(out), "--quiet"]) == 0
    assert main(["identify", str(log), "--robot", str(robot), "--write-actuators", str(same), "--quiet"]) == 0
    told: dict[str, Any] = json.loads(out.read_text("utf-8"))
    assert yaml.safe_load(same.read_text("utf-8")) == told
    wanted = {"armature": "Ja", "dynamic_friction": "fs", "friction": "fs", "viscous_friction": "fv"}
    for quantity, kind in wanted.items():
        for joint in truth.joints:
            value, error = told["actuators"][quantity][joint.name], told["std_error"][quantity][joint.name]
            assert value == pytest.approx(joint.parameters[kind], rel=0.05)
            assert 0 < error < 0.1 * value
    assert told["actuators"]["offset"]["joint2"] == pytest.approx(0.3, rel=0.05)
    assert told["units"]["viscous_friction"] == "N·m·s/rad"
    assert told["effects"] == []
    assert "transmission_stiffness" not in told["actuators"]
    # the rotor of the first joint shows with its body's inertia only, and the file says so
    assert "go with the bodies" in told["remarks"]["armature"]["joint1"]
    assert told["verdict"]["armature"]["joint1"] == "weak"


def test_an_mjcf_holds_the_mean_of_a_friction_that_it_has_no_place_for(
    drives: tuple[Path, Path, Robot], tmp_path: Path
) -> None:
    """Its friction by angle takes more than half of Coulomb's on the whole."""
    friction = EffectSpec("position_friction", "joint1", {"amplitude": 0.25, "phase": -1.6, "order": 0.7})
    truth = replace(drives[2], effects=(friction,))
    recording = simulate(truth, SimulationOptions(duration=6.0, rate=500.0, seed=3))
    log, robot = tmp_path / "log.h5", tmp_path / "arm.yaml"
    write_recording(recording, log)
    write_robot(truth, robot)
    files = {kind: tmp_path / f"found.{kind}" for kind in ("xml", "yaml", "json")}
    line = ["identify", str(log), "--robot", str(robot), "--quiet", "--write-robot", str(files["xml"])]
    assert main([*line, "--write-robot", str(files["yaml"]), "--write-actuators", str(files["json"])]) == 0
    whole, alone = read_robot(files["yaml"]), read_robot(files["xml"])
    (own,) = (spec for spec in whole.effects if spec.effect == friction.effect)
    moving = np.abs(np.gradient(recording.theta[:, 0], recording.dt)) > 0.05
    p = own.parameters
    mean = float((p["amplitude"] * np.sin(p["order"] * recording.theta[moving, 0] + p["phase"])).mean())
    assert mean < -0.1
    fs = [machine.joints[0].parameters["fs"] for machine in (whole, alone)]
    assert fs[1] - fs[0] == pytest.approx(mean, rel=0.02)
    told: dict[str, Any] = json.loads(files["json"].read_text("utf-8"))
    (held,) = told["effects"]
    assert held["in_dynamic_friction"] == pytest.approx(fs[1] - fs[0])
    for quantity in ("dynamic_friction", "friction"):  # it does not change with speed
        assert told["actuators"][quantity]["joint1"] == pytest.approx(fs[1], abs=0.01 * abs(mean))
    assert "with the mean of position_friction" in told["remarks"]["dynamic_friction"]["joint1"]
    again = with_actuators(alone, str(files["json"]))
    assert again.joints[0].parameters["fs"] == pytest.approx(fs[0])
    assert again.joints[1].parameters["fs"] == whole.joints[1].parameters["fs"]
    assert with_actuators(whole, str(files["json"])).joints[0].parameters["fs"] == fs[0]  # it holds the effect itself
    held["in_dynamic_friction"] = 2.0
    files["json"].write_text(json.dumps(told), "utf-8")
    with pytest.raises(UsageError, match="joint1"):
        with_actuators(alone, str(files["json"]))
    held["in_dynamic_friction"] = "much"
    files["json"].write_text(json.dumps(told), "utf-8")
    with pytest.raises(UsageError, match="not a file of actuators"):
        with_actuators(alone, str(files["json"]))


def test_a_file_of_actuators_holds_no_means_for_a_robot_file_that_is_refused(
    drives: tuple[Path, Path, Robot], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    friction = EffectSpec("position_friction", "joint1", {"amplitude": 0.25, "phase": -1.6, "order": 0.7})
    drift = EffectSpec("friction_drift", "joint2", {"coulomb": 0.1, "viscous": 0.02, "time": 5.0})
    robot, log, told = tmp_path / "arm.yaml", str(drives[0]), tmp_path / "found.json"
    write_robot(replace(drives[2], effects=(friction, drift)), robot)
    files = ["--write-robot", str(tmp_path / "found.xml"), "--write-robot", str(tmp_path / "found.yaml")]
    assert main(["identify", log, "--robot", str(robot), *files, "--write-actuators", str(told)]) == 2
    assert "mean" not in capsys.readouterr().err
    assert not (tmp_path / "found.xml").exists()
    data = json.loads(told.read_text("utf-8"))
    assert not any("in_dynamic_friction" in effect for effect in data["effects"])
    fs = read_robot(tmp_path / "found.yaml").joints[0].parameters["fs"]
    assert data["actuators"]["dynamic_friction"]["joint1"] == pytest.approx(fs)


def test_what_the_log_does_not_show_is_null_with_a_reason(drives: tuple[Path, Path, Robot], tmp_path: Path) -> None:
    _, robot, truth = drives
    still, out = tmp_path / "still.h5", tmp_path / "drives.json"
    recording = simulate(replace(truth, effects=()), SimulationOptions(duration=6.0, rate=500.0, seed=3))
    tau = np.random.default_rng(0).normal(0, 200.0, recording.tau.shape)
    write_recording(replace(recording, tau=recording.tau + tau), still)
    assert main(["identify", str(still), "--robot", str(robot), "--write-actuators", str(out), "--quiet"]) == 0
    told = json.loads(out.read_text("utf-8"))
    refused = [(q, j) for q, joints in told["verdict"].items() for j, v in joints.items() if v == "refused"]
    assert refused
    for quantity, joint in refused:
        assert told["actuators"][quantity][joint] is None
        assert told["std_error"][quantity][joint] is None
        assert told["remarks"][quantity][joint]


def test_a_spring_of_a_link_is_in_a_new_mjcf(tmp_path: Path) -> None:
    from elid_cli.experiment.mjcf import mjcf_text

    robot = read_robot("planar2")
    spring = EffectSpec("link_spring", "joint2", {"stiffness": 30.0, "preload": -12.0})
    constant = EffectSpec("link_spring", "joint1", {"stiffness": 0.0, "preload": 5.0})
    write_text(tmp_path / "arm.xml", mjcf_text(replace(robot, effects=(spring, constant))))
    again = read_robot(tmp_path / "arm.xml")
    springs = {spec.joint: spec.parameters for spec in again.effects}
    assert springs["joint2"] == pytest.approx(spring.parameters)
    assert springs["joint1"]["preload"] == pytest.approx(5.0)
    assert abs(springs["joint1"]["stiffness"]) < 1e-6
    assert "not in this file" not in (tmp_path / "arm.xml").read_text("utf-8")


@pytest.mark.parametrize("name", ["drives.txt", "none/drives.json"])
def test_a_name_that_cannot_be_written_is_refused_before_any_work(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    assert main(["identify", str(STRIBECK), "--robot", "planar2", "--write-actuators", str(path)]) == 2
    assert str(path.name) in capsys.readouterr().err


def test_an_error_that_nobody_knows_is_null() -> None:
    robot = read_robot("planar2")
    value = Value(0.002, math.nan, "supported")
    told = json.loads(actuator_text(Actuators(robot, {"delay": {"joint1": value}}, ()), yaml=False))
    assert told["std_error"] == {"delay": {"joint1": None}}
    assert told["actuators"] == {"delay": {"joint1": 0.002}}
