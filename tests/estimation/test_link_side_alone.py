"""Logs with joint torque sensors and no motor torque: the link side is identified alone, with the transmission."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.identify import Identification, LogRequest, identify, identify_logs
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.logs import read_recording, write_recording
from elid_cli.report.answers.identification_json import base_payload
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare

SENSORS = SensorOptions(position_noise=1e-5, torque_noise_relative=0.01, tau_link=True)


@pytest.fixture(scope="module")
def sensed(planar: Robot) -> Recording:
    log = simulate(planar, SimulationOptions(duration=8.0, rate=500.0, seed=5, sensors=SENSORS))
    return replace(log, tau=np.full_like(log.tau, np.nan), sources={})


def read_again(folder: Path, log: Recording, robot: Robot) -> Recording:
    write_recording(log, folder / "log.h5")
    return read_recording([folder / "log.h5"], robot)


def verdicts(found: Identification) -> dict[str, str]:
    return {str(item["name"]): str(item["verdict"]) for item in base_payload(found)}


def test_stiffness_and_bodies_are_found_and_motors_refused(tmp_path: Path, planar: Robot, sensed: Recording) -> None:
    log = read_again(tmp_path, sensed, planar)
    found = identify(planar, prepare(log, planar))
    for name in ("K1", "K2"):
        item = next(p for p in found.parameters if p.name == name)
        assert item.verdict == "supported"
        assert item.relative_error < 0.01
    bodies = [p for p in found.parameters if p.verdict == "supported" and p.leader[0] in "mcI"]
    assert len(bodies) >= 5
    assert max(p.relative_error for p in bodies) < 0.05
    said = verdicts(found)
    for name in ("Jm1", "Jm2", "fs1", "fs2", "fv1", "fv2"):
        assert said[name] == "refused"
        assert "no motor torque" in found.reasons[name]
    assert sensed.tau_link is not None
    for k, error in enumerate(found.error.values()):
        assert error.torque_rms == pytest.approx(np.sqrt(np.mean(sensed.tau_link[:, k] ** 2)), rel=0.1)
        assert error.relative < 0.03
        assert error.spring_relative is not None
        assert error.spring_relative < 0.03
    assert any("the link side is identified from the joint torque sensors" in note for note in found.notes)


def test_without_motor_positions_the_bodies_are_found_and_the_stiffness_is_refused(
    tmp_path: Path, planar: Robot, sensed: Recording
) -> None:
    log = read_again(tmp_path, replace(sensed, theta=np.full_like(sensed.theta, np.nan)), planar)
    found = identify(planar, prepare(log, planar))
    said = verdicts(found)
    assert said["K1"] == said["K2"] == said["fs1"] == "refused"
    assert "no motor position" in found.reasons["K1"]
    bodies = [p for p in found.parameters if p.verdict == "supported" and p.leader[0] in "mcI"]
    assert max(p.relative_error for p in bodies) < 0.05
    assert all(error.relative < 0.03 for error in found.error.values())


def test_logs_that_are_reduced_and_merged_say_the_same(tmp_path: Path, planar: Robot, sensed: Recording) -> None:
    other = simulate(planar, SimulationOptions(duration=8.0, rate=500.0, seed=6, sensors=SENSORS))
    paths = [tmp_path / "one.h5", tmp_path / "two.h5"]
    for path, log in zip(paths, (sensed, replace(other, tau=np.full_like(other.tau, np.nan))), strict=True):
        write_recording(log, path)
    found = identify_logs(LogRequest([str(path) for path in paths], planar)).found
    said = verdicts(found)
    assert said["K1"] == said["K2"] == "supported"
    assert said["fs1"] == said["Jm2"] == "refused"


def test_a_rigid_joint_has_its_bodies_without_rotor(tmp_path: Path, planar: Robot, sensed: Recording) -> None:
    rigid = replace(planar, joints=tuple(replace(j, transmission="rigid") for j in planar.joints))
    found = identify(rigid, prepare(read_again(tmp_path, sensed, rigid), rigid))
    assert {"fs1", "fv2", "Jm1"} <= {name for name, verdict in verdicts(found).items() if verdict == "refused"}
    assert all(error.relative < 0.03 for error in found.error.values())
