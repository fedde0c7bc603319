"""--write-robot: only files that exist are named, and what a format cannot hold is said."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from elid_cli.cli import main
from elid_cli.experiment.robot_file import not_held, stays_aside
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.logs.writing import write_recording
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import EffectSpec, Robot

ROOT = Path(__file__).parents[2]


ARM = """<mujoco model="arm"><compiler angle="radian"/><option gravity="0 -9.81 0"/><worldbody>
<body name="one"><joint name="joint1" axis="0 0 1"/><inertial pos="0.25 0 0" mass="21" diaginertia="1 1 14"/>
<body name="two" pos="0.5 0 0"><joint name="joint2" axis="0 0 1"/>
<inertial pos="0.25 0 0" mass="6" diaginertia="1 1 2"/></body></body></worldbody></mujoco>"""


def test_a_stiffness_that_the_users_mjcf_cannot_hold_is_said(
    planar: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, arm, out = tmp_path / "log.csv", tmp_path / "arm.xml", tmp_path / "out.xml"
    arm.write_text(ARM)
    sensors = SensorOptions(position_noise=3e-5, torque_noise_relative=0.03)
    write_recording(simulate(planar, SimulationOptions(duration=8.0, rate=500.0, seed=3, sensors=sensors)), log)
    words = ["identify", str(log), "--robot", str(arm), "--write-robot", str(out), "--json"]
    assert main(words) == 2  # the bodies nearest to least squares are no real ones: no simulator would load the file
    refused = capsys.readouterr().err
    assert "of joint2 would have the principal moments of inertia" in refused
    assert "--physical" in refused
    assert not out.exists()
    assert main([*words, "--physical"]) == 0
    said = capsys.readouterr().err
    assert f"left out: {out}: K1, K2: the file's joints are rigid; arm.elid.yaml or a .yaml holds stiffnesses" in said
    assert "left out: K1, K2: the file's joints are rigid" in out.read_text()


@pytest.mark.usefixtures("diagnosed_once")
def test_a_file_that_could_not_be_written_is_not_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = ROOT / "sample_logs" / "planar2_stribeck.h5"
    good, bad = tmp_path / "found.yaml", tmp_path / "found.urdf"
    words = ["diagnose", str(log), "--robot", "planar2", "--only", "stribeck"]
    assert main([*words, "--write-robot", str(bad)]) == 2
    told = capsys.readouterr()
    assert not bad.exists()
    assert str(bad) not in told.out
    assert "this format cannot hold stribeck" in told.err
    assert "--write-actuators found.json" in told.err
    held = ["--write-robot", str(tmp_path / "found.xml"), "--write-actuators", str(tmp_path / "drives.json")]
    assert main([*words, "--write-robot", str(good), *held]) == 0
    told = capsys.readouterr()
    assert f"--robot {good}" in told.out
    assert "4 × stribeck, 2 × torque_delay: drives.json holds them" in " ".join(told.err.split())
    assert "drives.json holds them" in (tmp_path / "found.xml").read_text("utf-8")
    drives_beside_effects(json.loads((tmp_path / "drives.json").read_text("utf-8")))


def drives_beside_effects(told: dict[str, Any]) -> None:
    """Check that friction at rest holds the fading term of eq. (43), and that its error is larger for it."""
    assert {(e["effect"], e["as"], e["at"], e["in_mjcf"]) for e in told["effects"]} == {
        ("stribeck", "friction", "motor", False)
    }
    for joint in ("joint1", "joint2"):
        fading = [e["parameters"] for e in told["effects"] if e["joint"] == joint and e["parameters"]["exponent"] > 0]
        values = told["actuators"]
        assert values["friction"][joint] - values["dynamic_friction"][joint] == pytest.approx(fading[0]["amplitude"])
        assert told["std_error"]["friction"][joint] > told["std_error"]["dynamic_friction"][joint]


def test_what_the_yaml_beside_a_file_says_and_the_file_cannot_is_told(tmp_path: Path) -> None:
    (arm := tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "arm.elid.yaml").write_text("gravity: [0, 0, -9.81]\njoints: {joint2: {gear_ratio: 50}}\n")
    robot = read_robot(arm)
    gravity, gears = stays_aside(robot, str(tmp_path / "out.xml"))
    assert gravity == "gravity: [0, 0, -9.81]: out.elid.yaml has to hold it; without that the file means [0, -9.81, 0]"
    assert gears.startswith("the gear ratio of joint2: armature is the rotor's inertia at the joint, without its coup")
    assert stays_aside(robot, "out.urdf") == []
    assert stays_aside(replace(robot, gravity=(0.0, -9.81, 0.0)), "out.urdf") == [
        "gravity: [0, -9.81, 0]: out.elid.yaml has to hold it; without that the file means [0, 0, -9.81]"
    ]
    assert stays_aside(robot, "out.yaml") == []


def test_an_mjcf_with_rotors_holds_gears_stiffnesses_and_damping(
    planar: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damped = EffectSpec("transmission_damping", "joint1", {"damping": 8.0})
    spring = EffectSpec("link_spring", "joint2", {"stiffness": 30.0, "preload": -12.0})
    robot = replace(planar, effects=(damped, spring))
    log, own, xml, again = (str(tmp_path / name) for name in ("log.h5", "own.yaml", "found.xml", "again.xml"))
    write_recording(simulate(robot, SimulationOptions(duration=8.0, rate=500.0, seed=3)), log)
    write_robot(robot, own)
    assert main(["identify", log, "--robot", own, "--write-robot", xml]) == 0
    assert main(["identify", log, "--robot", xml, "--write-robot", again]) == 0
    told = capsys.readouterr().err
    for words in ("gear ratio", "are rigid", "transmission_damping", "link_spring"):
        assert words not in told
    for file in (xml, again):
        found = read_robot(file)
        assert [(spec.effect, spec.joint) for spec in found.effects] == [
            ("transmission_damping", "joint1"), ("link_spring", "joint2"),
        ]  # fmt: skip
        assert found.effects[0].parameters["damping"] == pytest.approx(8.0, rel=0.05)
        assert [joint.gear_ratio for joint in found.joints] == [0.1, 0.1]
    assert not_held(read_robot(xml), "set.xml") == []
    beside = replace(planar, effects=(EffectSpec("link_viscous", "joint1", {"friction": 1.0}),))
    assert not_held(beside, "set.xml") == []
    assert not_held(beside, "set.urdf") == ["link_viscous of joint1: the format cannot hold it"]
