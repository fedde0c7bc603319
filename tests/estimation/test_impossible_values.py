"""Values that no robot has: they are not called supported, and no robot file holds them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.estimation.identify import Identification, identify
from elid_cli.estimation.refined_robot import identified_robot, remarks
from elid_cli.estimation.validation.prediction import validate
from elid_cli.estimation.validation.verdicts import impossible
from elid_cli.logs.writing import write_recording
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Limits, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals, prepare

PUSHED = 1.0
"""Torque that drives joint 2 with its speed, N·m·s/rad: more than its friction holds it back."""


def pushed(recording: Recording) -> Recording:
    """Return a log in which something drives joint 2 the faster it turns."""
    speed = np.gradient(recording.theta, recording.t, axis=0)
    return replace(recording, tau=recording.tau - PUSHED * np.array([0.0, 1.0]) * speed)


@pytest.fixture(scope="module")
def driven(planar: Robot, noisy: Recording) -> tuple[Identification, Signals]:
    signals = prepare(pushed(noisy), planar)
    return identify(planar, signals), signals


def value(found: Identification, name: str) -> float:
    return next(item.estimate for item in found.parameters if item.leader == name)


def test_negative_friction_is_not_supported(driven: tuple[Identification, Signals]) -> None:
    item = next(item for item in driven[0].parameters if item.leader == "fv2")
    assert item.estimate < -10 * item.std_error
    assert item.verdict == "weak"
    assert item.reason.startswith("negative, which no robot's is")
    assert any("fv2" in sentence for sentence in driven[0].warnings)


def test_an_inertia_that_stands_alone_is_not_negative_either() -> None:
    base = find_base(Regressor(read_robot("puma560")))
    alone = {
        name: k
        for k, leader in enumerate(base.leaders)
        if base.classes[name := base.parameters[leader]] == "independent"
    }
    for name in ("Izz6", "Jm6", "fs6", "K6"):
        assert impossible(base, alone[name], -1.0, 0.1)
        assert not impossible(base, alone[name], -1.0, 0.5)  # within what it scatters by
    for name in ("cx6", "Ixy6"):
        assert not impossible(base, alone[name], -1.0, 0.1)


def test_the_file_holds_the_nearest_robot_that_could_be(driven: tuple[Identification, Signals]) -> None:
    found, signals = driven
    written = identified_robot(found)
    assert written.joints[1].parameters["fv"] == 0
    names = [item.leader for item in found.parameters]
    moved = found.base.values(written.reference()) - found.estimate
    # the least squares with fv2 known to be 0: what the conditional expectation of a normal distribution says
    k = names.index("fv2")
    rest = [j for j in range(len(names)) if j != k]
    expected = found.covariance[rest, k] / found.covariance[k, k] * -found.estimate[k]
    np.testing.assert_allclose(moved[rest], expected, rtol=1e-6, atol=1e-9)
    assert any("fv2" in line and "written as 0" in line for line in remarks(found))
    assert validate(written, signals).error["joint2"].rms > found.error["joint2"].rms


def test_a_stiffness_that_nobody_knows_is_left_out(planar: Robot, noisy: Recording) -> None:
    signals = prepare(noisy, planar)
    found = identify(planar, signals)
    unseen = tuple(
        replace(p, verdict="refused", reason="why not", reference=np.nan) if p.leader == "K2" else p
        for p in found.parameters
    )
    standard = found.standard.copy()
    standard[[str(name) for name in found.base.parameters].index("K2")] = -13.3
    refused = replace(found, parameters=unseen, standard=standard)
    written = identified_robot(refused)
    assert "K" not in written.joints[1].parameters
    assert "K" in written.joints[0].parameters
    assert any(line == "K2 is not known: why not. It is left out." for line in remarks(refused))
    judged = validate(written, signals)
    assert judged.error["joint2"].spring_rms is None  # not predicted without it
    assert judged.error["joint2"].rms == pytest.approx(validate(identified_robot(found), signals).error["joint2"].rms)
    known = tuple(replace(p, reference=3000.0) if p.leader == "K2" else p for p in unseen)
    assert identified_robot(replace(refused, parameters=known)).joints[1].parameters["K"] == pytest.approx(3000.0)


def test_the_command_says_what_it_writes(noisy: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, robot = tmp_path / "pushed.csv", tmp_path / "found.yaml"
    write_recording(pushed(noisy), log)
    assert main(["identify", str(log), "--robot", "planar2", "--write-robot", str(robot), "--json"]) == 0
    out, err = capsys.readouterr()
    assert "fv2" in err
    assert "written as 0" in err
    assert {e["name"]: e["verdict"] for e in json.loads(out)["base_parameters"]}["fv2"] == "weak"
    assert read_robot(str(robot)).joints[1].parameters["fv"] == 0
    assert "written as 0" in robot.read_text("utf-8")


def test_no_value_counts_as_known_where_a_joint_moves_far_beyond_its_range(planar: Robot, noisy: Recording) -> None:
    turned = np.array([1.0, 20.0])  # in no unit that there is: degrees of one joint would be told by the fit
    far = replace(noisy, q=noisy.q * turned, theta=noisy.theta * turned)
    assert all(item.bias_possible for item in identify(planar, prepare(far, planar)).parameters)
    assert not any(item.bias_possible for item in identify(planar, prepare(noisy, planar)).parameters)
    # the same positions, far beyond what the file allows; one without limits says nothing of the kind
    narrow = Limits(position=(-0.01, 0.01))
    for limits, marked in ((narrow, True), (Limits(), False)):
        robot = replace(planar, joints=tuple(replace(joint, limits=limits) for joint in planar.joints))
        assert {item.bias_possible for item in identify(robot, prepare(noisy, robot)).parameters} == {marked}
