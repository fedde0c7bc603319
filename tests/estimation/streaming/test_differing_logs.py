"""Logs of two robots that are fitted together, and stiffness where no torque confirms the file's inertias."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.logs.writing import write_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot

ROBOT = Path(__file__).parents[3] / "robots" / "planar2.yaml"
QUIET = SensorOptions(noise_db=80.0)


def softer(robot: Robot, share: float) -> Robot:
    """Return a robot whose transmissions are softer by a share."""
    joints = tuple(
        replace(joint, parameters={**joint.parameters, "K": (1 - share) * joint.parameters["K"]})
        for joint in robot.joints
    )
    return replace(robot, joints=joints)


def written(folder: Path, name: str, robot: Robot, seed: int) -> str:
    path = folder / name
    write_recording(simulate(robot, SimulationOptions(duration=8.0, seed=seed, sensors=QUIET)), path)
    return str(path)


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_logs_of_two_robots_are_not_one_model(tmp_path: Path, share: float, capsys: pytest.CaptureFixture[str]) -> None:
    robot = read_robot(ROBOT)
    logs = [written(tmp_path, "a.h5", robot, 1), written(tmp_path, "b.h5", softer(robot, share), 2)]
    code = main(["identify", *logs, "--robot", str(ROBOT), "--json", "--fail-on-insufficient"])
    found = json.loads(capsys.readouterr().out)
    differs = share > 0
    assert bool(code) == differs
    assert found["model"] == ("insufficient" if differs else "sufficient")
    assert all(item["follows"] == "logs" for item in found["insufficient"])
    values = {item["name"]: item for item in found["base_parameters"]}
    for k, joint in enumerate(robot.joints, start=1):
        item, apart = values[f"K{k}"], share * joint.parameters["K"]
        if differs:
            assert item["verdict"] != "supported" or item["std_error"] > 0.2 * apart
        else:
            assert abs(item["estimate"] - joint.parameters["K"]) < 4 * item["std_error"]


def test_stiffness_by_inertias_that_no_torque_confirms_may_be_biased(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = read_robot(ROBOT)
    log = simulate(robot, SimulationOptions(duration=8.0, seed=3, sensors=QUIET))
    tau = log.tau.copy()
    tau[:, 1] = np.nan
    path = tmp_path / "log.h5"
    write_recording(replace(log, tau=tau), path)
    assert main(["identify", str(path), "--robot", str(ROBOT), "--json"]) == 0
    values = {item["name"]: item for item in json.loads(capsys.readouterr().out)["base_parameters"]}
    assert values["K2"]["bias_possible"]
    assert not values["K1"]["bias_possible"]
