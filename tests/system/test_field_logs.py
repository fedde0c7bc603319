"""Logs as thirty-two tools write them: each is identified, after one command of elid's own hints at most."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from elid_cli.cli import main
from elid_cli.estimation.identify import identify
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.field_logs import LOGS

URDF = """<robot name="arm">
  <link name="base"/>
  <joint name="joint1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="150" velocity="3"/><dynamics friction="1.5" damping="0.8"/></joint>
  <link name="upper"><inertial><origin xyz="0.2 0 0.02"/><mass value="4"/>
    <inertia ixx="0.02" iyy="0.08" izz="0.08" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint2" type="revolute"><origin xyz="0.4 0 0"/><parent link="upper"/><child link="lower"/>
    <axis xyz="0 1 0"/><limit lower="-2.5" upper="2.5" effort="80" velocity="3"/>
    <dynamics friction="0.9" damping="0.4"/></joint>
  <link name="lower"><inertial><origin xyz="0.15 0 -0.01"/><mass value="2.5"/>
    <inertia ixx="0.01" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""
RATE = "250"
AS_SURE = 0.5
"""Standard errors by which an estimate may differ from that of the samples themselves: the same log, told in fewer
digits, by stamps that fall between two of another clock, with velocities or without."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    (path := tmp_path_factory.mktemp("robot") / "arm.urdf").write_text(URDF)
    return path


def driven(robot: Robot) -> Robot:
    """Return the robot with rigid joints and the inertia of its rotors, which a URDF does not hold."""
    joints = (replace(j, transmission="rigid", parameters={**j.parameters, "Ja": 0.3}) for j in robot.joints)
    return replace(robot, joints=tuple(joints))


@pytest.fixture(scope="module")
def log(robot: Path) -> Recording:
    sensors = SensorOptions(position_noise=1e-5, velocity_noise=1e-3, torque_noise_relative=0.01, velocities=True)
    return simulate(driven(read_robot(robot)), SimulationOptions(duration=8, rate=250, sensors=sensors))


@pytest.fixture(scope="module")
def reference(robot: Path, log: Recording) -> list[dict[str, Any]]:
    """Return the base parameters of the samples themselves, which are near the truth."""
    truth = driven(read_robot(robot))
    found = identify(truth, prepare(replace(log, dq=None), truth))
    for item in found.parameters:
        assert abs(item.estimate - item.reference) < 4.5 * item.std_error + 0.005 * abs(item.reference), item.name
    return [{"name": p.name, "estimate": p.estimate, "std_error": p.std_error} for p in found.parameters]


def hinted(said: str) -> list[str]:
    """Return the options of the hint of an error, or of what warnings ask to map."""
    hint = said.partition("hint: ")[2]
    if "--map" in hint:
        return shlex.split("--map" + hint.partition("--map")[2].partition(", or ")[0])
    lines = re.findall(r"map it: (\w+: \{.*\})", said)
    return [word for line in dict.fromkeys(lines) for word in ("--map", line)]


def identified(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = main(arguments)
    said = capsys.readouterr()
    return code, said.out, said.err


def test_there_are_thirty_two_of_them() -> None:
    assert len(LOGS) == 32


@pytest.mark.parametrize("form", LOGS)
def test_a_log_is_identified_with_one_hint_at_most(
    form: str, robot: Path, log: Recording, reference: list[dict[str, Any]], tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    path = LOGS[form](tmp_path, log)
    command = ["identify", str(path), "--robot", str(robot), "--json"]
    code, out, said = identified(command, capsys)
    pasted = hinted(said)
    if pasted:
        # its own rate is what no log without time can tell: the hint says so, and to put it there
        assert "--rate" not in pasted or "it holds no time" in said
        pasted = [RATE if before == "--rate" else word for before, word in zip(["", *pasted], pasted, strict=False)]
        code, out, said = identified([*command, *pasted], capsys)
        assert hinted(said) == [], said
    assert code == 0, said
    answer = json.loads(out)
    assert answer["log"]["rate"] == pytest.approx(250, rel=1e-4)
    assert answer["base_parameters"][0]["verdict"] == "supported"
    for item, plain in zip(answer["base_parameters"], reference, strict=True):
        assert item["name"] == plain["name"]
        assert abs(item["estimate"] - plain["estimate"]) < AS_SURE * plain["std_error"], item["name"]
