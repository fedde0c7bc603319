"""Logs without commanded velocities: drives that are told the rate of their positions, or that are told none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import EffectSpec, Robot
from tests.diagnosis.by_motion import plant

TRUTH = {"Ja": plant.ARMATURE, "fs": plant.COULOMB, "fv": plant.VISCOUS}


@pytest.fixture(scope="module")
def pendulums(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    bare = plant.robot(tmp_path_factory.mktemp("pendulums"))
    return replace(bare, joints=tuple(replace(joint, transmission="rigid") for joint in bare.joints))


def written(folder: Path, name: str, *, rates: bool) -> str:
    """Write a log of drives that are told rates or none, without these."""
    log = plant.moved(3, 12.0, rates=rates)
    commands = {name: values for name, values in log.commands.items() if name != "dq_des"}
    return plant.written(folder, name, replace(log, tau=np.full_like(log.tau, np.nan), dq=None, commands=commands))


@pytest.mark.parametrize("rates", [True, False])
def test_what_drives_are_told_is_what_the_motion_shows(
    pendulums: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str], rates: bool
) -> None:
    log, robot, out = (
        written(tmp_path, "bare.h5", rates=rates),
        str(tmp_path / "arm.yaml"),
        str(tmp_path / "found.yaml"),
    )
    write_robot(pendulums, robot)
    assert main(["identify", log, "--robot", robot, "--json", "--write-robot", out]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["log"]["sources"].get("dq_des") == "rate") == rates
    assert any("no dq_des is logged" in note for note in told["log"]["notes"])
    for kind, values in TRUTH.items():
        for name, value in zip(pendulums.joint_names, values, strict=True):
            own = told["settings"]["trajectory"]["joint_parameters"][name][kind]
            assert abs(own["estimate"] - value) < 4 * own["std_error"] < 0.1 * value, (name, kind)

    # also of a robot that declares an effect which no fit of the motion holds in its shape
    written_robot = read_robot(out)
    more = EffectSpec("stribeck", "two", {"amplitude": 1e-3, "velocity": 0.1, "exponent": 2.0})
    write_robot(
        replace(written_robot, effects=(*written_robot.effects, more)), robot_with := str(tmp_path / "more.yaml")
    )
    for described in (out, robot_with):
        assert main(["replay", log, "--robot", described, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["mean_abs"] < 3e-4
    said = ["--map", "dq_des=rate"] if rates else []
    assert main(["identify", log, "--robot", robot, "--write-robot", out, *said]) == 0
    assert (" --map dq_des=rate" in capsys.readouterr().out.splitlines()[-1]) == rates


def test_the_rate_is_taken_where_the_user_says_so(
    pendulums: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, robot = written(tmp_path, "none.h5", rates=False), str(tmp_path / "arm.yaml")
    write_robot(pendulums, robot)
    assert main(["identify", log, "--robot", robot, "--map", "dq_des=rate", "--fit", "trajectory", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["log"]["sources"]["dq_des"] == "rate"
    assert any("kd (dq_des - dq)" in note for note in told["log"]["notes"])
    own = told["settings"]["trajectory"]["joint_parameters"]["one"]["fv"]
    assert abs(own["estimate"] - plant.VISCOUS[0]) > 10 * own["std_error"]  # the log is of drives that are told none
