"""JSON lists base parameters in standard order, and the covariance with them, whatever found them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli.estimation.identify import identify
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.logs.reading import read_recording
from elid_cli.logs.writing import write_recording
from elid_cli.report.answers.identification_json import identification_payload
from elid_cli.robot.files import read_robot
from elid_cli.robot.parameter import place_in_order
from elid_cli.signals.signals import prepare


def test_what_a_log_without_motor_torque_does_not_show_stands_in_its_place(tmp_path: Path) -> None:
    robot = read_robot("planar2")
    log = simulate(robot, SimulationOptions(duration=5.0, rate=250.0, seed=2, sensors=SensorOptions(tau_link=True)))
    write_recording(replace(log, tau=np.full_like(log.tau, np.nan)), tmp_path / "log.h5")
    recording = read_recording([str(tmp_path / "log.h5")], robot)
    told = identification_payload(identify(robot, prepare(recording, robot)), recording)
    leading = [next(iter(entry["terms"])) for entry in told["base_parameters"]]
    assert leading == sorted(leading, key=place_in_order)
    assert leading[-8:] == ["Jm1", "Jm2", "fs1", "fs2", "fv1", "fv2", "K1", "K2"]
    assert len(told["covariance"]) == len(leading)
    for k, entry in enumerate(told["base_parameters"]):
        if entry["estimate"] is None:
            assert told["covariance"][k] == [None] * len(leading)
            name = robot.parameter_names()[list(map(str, robot.parameter_names())).index(leading[k])]
            assert entry["reference"] == robot.reference()[robot.parameter_names().index(name)]
        else:
            np.testing.assert_allclose(told["covariance"][k][k], entry["std_error"] ** 2, rtol=1e-9)
