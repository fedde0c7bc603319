"""Gains of drives from a pair of logs, one of them with a known payload: recovered with their errors, or refused."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from elid_cli.errors import DataError, UsageError
from elid_cli.estimation.drive_gains.gain_errors import slopes_of
from elid_cli.estimation.drive_gains.identification import identify_with_payload
from elid_cli.estimation.drive_gains.payload import parse_payload
from elid_cli.estimation.drive_gains.solve import DriveRows, fit_pair
from elid_cli.estimation.request import LogRequest
from elid_cli.estimation.result import EstimateOptions
from elid_cli.robot.files import read_robot, robot_from_text
from elid_cli.robot.robot import Payload
from elid_cli.robot.text import text_of
from tests import forked
from tests.cli.test_json_schema import SCHEMA, closed, faults
from tests.system.reproduce.drive_gains import loaded, pair

ROBOT = read_robot("planar2")
GAINS = np.array([0.4, 25.0])
MASS = 6.0


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return two logs of an arm with elastic joints, without and with a payload, torque in units of the gains."""
    heavy = loaded(ROBOT, "joint2", MASS, np.array([0.03, -0.02, 0.0]), 0.01)
    folder = tmp_path_factory.mktemp("pair")
    return pair(ROBOT, (heavy, MASS), GAINS, folder, 3, noise=0.01, duration=10, rate=250)


def unknown() -> LogRequest:
    robot = replace(ROBOT, joints=tuple(replace(j, parameters={}) for j in ROBOT.joints))
    return LogRequest([], robot)


def test_gains_are_recovered_and_the_parameters_with_them(logs: list[str]) -> None:
    request = replace(unknown(), logs=logs)
    found = identify_with_payload(request, EstimateOptions(), Payload(MASS, "joint2")).found
    for truth, item in zip(GAINS, found.drive_gains, strict=True):
        assert item.gain is not None
        assert item.std_error is not None
        assert item.std_error < 0.03 * truth
        assert abs(item.gain - truth) < 4 * item.std_error
    names = {item.name: item.estimate for item in found.parameters}
    for name in ("K1", "fs2", "fv2"):
        joint, kind = ROBOT.joints[int(name[-1]) - 1], name[:-1]
        assert names[name] == pytest.approx(joint.parameters[kind], rel=0.08)
    assert found.gain_map.startswith("tau: {from: /tau, scale: [0.")


def test_parameters_are_no_surer_than_the_gains(logs: list[str]) -> None:
    """Friction was up to 11 standard errors off, which left out those of the gains, and "known"."""
    found = identify_with_payload(replace(unknown(), logs=logs), EstimateOptions(), Payload(MASS, "joint2")).found
    items = {item.name: item for item in found.parameters}
    for k, gain in enumerate(found.drive_gains, start=1):
        assert gain.gain is not None
        assert gain.std_error is not None
        for item in (items[f"fs{k}"], items[f"fv{k}"]):
            assert item.std_error / item.estimate > 0.9 * gain.std_error / gain.gain
    told = np.array([item.verdict != "refused" for item in found.parameters])
    assert np.allclose(np.sqrt(np.diag(found.covariance))[told], found.std_error[told], rtol=0.3)
    assert found.triangles is not None
    whole = slopes_of(found, found.triangles).sum(axis=1)  # all torques larger by 1 %
    names = [name for name in items if name.startswith(("fs", "fv", "m"))]
    for name in names:
        assert whole[list(items).index(name)] == pytest.approx(items[name].estimate, rel=1e-6)


def test_the_known_centre_makes_gains_surer(logs: list[str]) -> None:
    request = replace(unknown(), logs=logs)
    free = identify_with_payload(request, EstimateOptions(), Payload(MASS, "joint2")).found.drive_gains
    told = identify_with_payload(request, EstimateOptions(), Payload(MASS, "joint2", (0.03, -0.02, 0.0))).found
    for truth, less, more in zip(GAINS, free, told.drive_gains, strict=True):
        assert more.gain is not None
        assert more.std_error is not None
        assert more.std_error <= 1.05 * (less.std_error or 0.0)
        assert abs(more.gain - truth) < 4 * more.std_error


def test_logs_in_the_other_order_are_told(logs: list[str]) -> None:
    with pytest.raises(DataError, match="the other order"):
        identify_with_payload(replace(unknown(), logs=logs[::-1]), EstimateOptions(), Payload(MASS, "joint2"))


def test_a_payload_that_lifts_nothing_is_refused(logs: list[str]) -> None:
    """Two logs without any payload: nothing tells the scale of the torque."""
    with pytest.raises(DataError, match="no drive's gain can be found"):
        identify_with_payload(replace(unknown(), logs=[logs[0], logs[0]]), EstimateOptions(), Payload(MASS, "joint1"))


def test_a_joint_that_shares_nothing_with_the_payload_is_refused() -> None:
    """Two joints with parameters of their own; the payload, of which all is known, loads the second one alone."""
    rng = np.random.default_rng(2)
    count, known, gains = 4000, np.array([0.0, 0.0, 3.0, 1.0]), np.array([2.0, 5.0])
    truth, carried = np.array([1.0, -2.0, 4.0, 0.5]), np.arange(count) >= 2000
    rows = []
    for j in range(2):
        columns = rng.normal(size=(4, count))
        columns[2 - 2 * j : 4 - 2 * j] = 0.0
        clean = (truth @ columns + carried * (known @ columns)) / gains[j]
        nuisances = np.vstack([np.ones(count), rng.normal(size=count)])
        rows.append(DriveRows(columns, nuisances, clean + 0.1 * rng.normal(size=count), np.ones(count, dtype=bool)))
    fit = fit_pair(rows, carried, carried.astype(int), known, np.zeros((4, 0)))
    assert np.isnan(fit.gain[0])
    assert abs(fit.gain[1] - gains[1]) < 4 * fit.std_error[1] < 0.05 * gains[1]


def test_what_is_no_pair_is_a_wrong_use(logs: list[str]) -> None:
    for names, payload, words in (
        (logs[:1], Payload(MASS, "joint2"), "needs two logs"),
        (logs, Payload(MASS, "joint3"), "no joint 'joint3'"),
    ):
        with pytest.raises(UsageError, match=words):
            identify_with_payload(replace(unknown(), logs=names), EstimateOptions(), payload)


def test_the_payload_may_be_declared_by_the_robot(logs: list[str]) -> None:
    heavy = Payload(MASS, "joint2", (0.03, -0.02, 0.0))
    robot = robot_from_text(text_of(replace(unknown().robot, payload=heavy)), "arm.yaml")
    assert robot.payload == heavy
    request = replace(unknown(), logs=logs, robot=robot)
    told = identify_with_payload(request, EstimateOptions(), None).found.drive_gains
    assert told == identify_with_payload(request, EstimateOptions(), heavy).found.drive_gains
    with pytest.raises(UsageError, match="planar2 declares none"):
        identify_with_payload(replace(unknown(), logs=logs), EstimateOptions(), None)
    for line, said in (("{mass: 0, joint: joint2}", "0 kg is no payload"), ("{mass: 1, joint: j2}", "no joint 'j2'")):
        with pytest.raises(UsageError, match=said):
            robot_from_text(f"{text_of(ROBOT)}payload: {line}\n", "arm.yaml")


def test_what_is_written_is_a_payload_or_refused() -> None:
    assert parse_payload("2.805@joint6") == Payload(2.805, "joint6")
    assert parse_payload("declared") is None
    assert parse_payload("1@a:0,-0.5,1e-2") == Payload(1.0, "a", (0.0, -0.5, 0.01))
    for text in ("2.8", "@joint6", "-1@joint6", "x@joint6", "1@joint6:0,0", "nan@joint6"):
        with pytest.raises(UsageError, match="--payload"):
            parse_payload(text)


def test_the_command_prints_gains_and_a_mapping_to_go_on_with(logs: list[str]) -> None:
    line = ["identify", *logs, "--robot", "planar2", "--payload", f"{MASS}@joint2"]
    done = forked.run([*line, "--json"])
    output = json.loads(done.stdout)
    assert faults(closed(SCHEMA), output) == []
    low, high = output["drive_gains"][1]["interval"]
    assert 0.9 * GAINS[1] < low < high < 1.1 * GAINS[1]
    report = forked.run(line).stdout
    assert "gains of the drives" in report
    current = [*line, "--map", "tau: {from: /tau, unit: A}"]
    done = forked.run(current)
    assert done.returncode == 0
    assert "which is no torque" not in done.stdout + done.stderr
    assert "Only if" not in done.stdout
    pasted = shlex.split(done.stdout.partition("Next: ")[2])
    assert pasted.count("--map") == 1
    assert "unit: A, scale: [0." in pasted[pasted.index("--map") + 1]
    following = report.partition("Next: elid ")[2].strip()
    again = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m elid_cli {following} --json"], capture_output=True, text=True, check=True
    )
    before, after = (
        {item["name"]: item["estimate"] for item in text["base_parameters"]}
        for text in (output, json.loads(again.stdout))
    )
    assert after["K1"] == pytest.approx(before["K1"], rel=1e-3)
