"""What a warning proposes to paste mends the log that it was said of, and nothing else."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.logs import read_map_options, read_recording, write_recording
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording, Segment
from tests.logs.made_logs import JOINTS, ROBOT, like, read, recording, written

BASE = recording(3000)
K = 4000.0
SPRUNG = replace(ROBOT, joints=tuple(replace(joint, parameters={"K": K}) for joint in ROBOT.joints))


def loaded(mean: float) -> Recording:
    """Return the log with a load that bends every spring by `mean`, rad, throughout."""
    return like(BASE, theta=BASE.theta + mean, tau=BASE.tau + K * mean)


def about(warnings: tuple[str, ...], words: str) -> list[str]:
    return [warning for warning in warnings if words in warning]


def pasted(said: str, signal: str) -> dict[str, object]:
    """Return the mapping of a signal that a warning proposes."""
    (line,) = re.findall(rf"\b({signal}: {{from: .*?}})(?= |$)", said)
    return read_map_options([line])


@pytest.mark.parametrize("robot", [ROBOT, SPRUNG], ids=["fitted stiffness", "known stiffness"])
def test_an_offset_is_told_beside_what_the_load_bends(tmp_path: Path, robot: Robot) -> None:
    base = loaded(0.05)
    off = base.theta + np.array([0.3, 0.0, -0.4])
    path = written(tmp_path, "log.csv", like(base, theta=off))
    said = about(read_recording([path], robot).warnings, "away from q")
    assert [line.partition(":")[0] for line in said] == ["shoulder", "wrist"]
    assert "+0.35" in said[0]
    assert "encoder_offset" in said[0]
    for line in said:  # one entry of theta holds both
        got = read_recording([path], robot, read_map_options([line.partition("map it: ")[2]]))
        assert np.abs(got.theta - base.theta).max() < 2e-3
        assert not about(got.warnings, "away from q")


def test_an_offset_of_springs_that_nothing_tells_has_two_digits(tmp_path: Path) -> None:
    unknown = like(BASE, theta=BASE.theta + 0.31234, tau=np.full_like(BASE.tau, np.nan), tau_link=None)
    sensed = like(unknown, tau_link=np.random.default_rng(1).normal(size=BASE.q.shape))
    (said, *_) = about(read(written(tmp_path, "log.csv", sensed)).warnings, "away from q")
    assert said.endswith("offset: {shoulder: -0.31, elbow: -0.31, wrist: -0.31}}")


@pytest.mark.parametrize("robot", [ROBOT, SPRUNG], ids=["unknown stiffness", "known stiffness"])
def test_a_sensed_torque_explains_a_deflection(tmp_path: Path, robot: Robot) -> None:
    spring = K * (BASE.theta - BASE.q)
    none = np.full_like(BASE.tau, np.nan)
    base = like(BASE, theta=BASE.theta + 0.06, tau=none, tau_link=spring + K * 0.06)
    assert not about(read_recording([written(tmp_path, "log.csv", base)], robot).warnings, "away from q")
    off = like(base, theta=base.theta + 0.3)
    (said, *_) = about(read_recording([written(tmp_path, "off.csv", off)], robot).warnings, "away from q")
    assert said.endswith("offset: {shoulder: -0.3, elbow: -0.3, wrist: -0.3}}")


@pytest.mark.parametrize("signal", ["q", "theta"])
def test_a_turned_position_is_mended_on_either_side_at_its_joints_alone(tmp_path: Path, signal: str) -> None:
    turned = getattr(BASE, signal) * np.array([1.0, -1.0, -1.0])
    path = written(tmp_path, "log.csv", like(BASE, **{signal: turned}))
    said = about(read(path).warnings, "moves opposite to q")
    assert len(said) == 2
    for line in said:
        got = read(path, mapping=pasted(line, signal))
        assert np.array_equal(getattr(got, signal), getattr(BASE, signal))
        assert not about(got.warnings, "moves opposite")


def test_a_proposal_keeps_what_is_mapped_already(tmp_path: Path) -> None:
    path = written(tmp_path, "log.csv", like(BASE, theta=np.degrees(BASE.theta * np.array([1, 1, -1]) + 0.5)))
    mapping = {"theta": {"from": "theta.{joint}", "unit": "deg", "sign": {"elbow": -1}, "offset": {"shoulder": -0.25}}}
    said = read(path, mapping=mapping).warnings
    (turned, *_) = about(said, "moves opposite")
    assert turned.endswith(
        'theta: {from: "theta.{joint}", unit: deg, offset: {shoulder: -0.25}, sign: {wrist: -1}} where that is theta'
    )
    (moved,) = about(said, "away from q")
    assert "unit: deg, sign: {elbow: -1}, offset: {shoulder: -0.5}}" in moved


@pytest.mark.parametrize("joints", [(0, 1, 2), (1,)])
def test_a_turned_torque_is_mended_at_its_joints_alone(tmp_path: Path, joints: tuple[int, ...]) -> None:
    spring = K * (BASE.theta - BASE.q)
    signs = np.where(np.isin(np.arange(3), joints), -1.0, 1.0)
    path = written(tmp_path, "log.csv", like(BASE, tau=(spring + 0.02 * BASE.tau) * signs))
    said = about(read(path).warnings, "opposite sign of the deflection")
    assert [line.partition(":")[0] for line in said] == [JOINTS[j] for j in joints]
    for line in said:
        assert np.allclose(read(path, mapping=pasted(line, "tau")).tau * signs, read(path).tau)


def test_a_proposal_keeps_lists_of_places(tmp_path: Path) -> None:
    path = written(tmp_path, "log.csv", like(BASE, theta=BASE.theta + np.array([0, 0.5, 0])))
    places = [f"theta.{joint}" for joint in JOINTS]
    (said,) = about(read(path, mapping={"theta": {"from": places}}).warnings, "away from q")
    assert np.abs(read(path, mapping=pasted(said, "theta")).theta - BASE.theta).max() < 2e-3


def test_where_positions_run_opposite_the_torque_is_not_blamed(tmp_path: Path) -> None:
    """The weight that it is compared with is that of another pose."""
    robot = read_robot("planar2")
    t = np.arange(4000) / 500
    q = 0.7 + np.stack([0.8 * np.sin(1.3 * t), 1.2 * np.sin(2.1 * t + 1)], axis=1)
    tau = Dynamics(robot).gravity(q) + 5 * np.cos(t)[:, None]
    deflection = tau / [joint.parameters["K"] for joint in robot.joints]
    arm = Recording(robot.joint_names, 1 / 500, t, q, q + deflection, tau, segments=(Segment(0, 4000),))
    sound, turned = (read(written(tmp_path, name, log), robot=robot).warnings for name, log in
                     (("a.csv", arm), ("b.csv", like(arm, q=q * [1, -1]))))  # fmt: skip
    assert not about(sound, "described bodies")
    assert about(turned, "moves opposite")
    assert not about(turned, "described bodies")


@pytest.mark.parametrize("joint", ["joint1", "joint2"])
def test_one_joint_in_degrees_is_told_without_what_follows_of_it_and_mended_alone(tmp_path: Path, joint: str) -> None:
    """Its deflection is in degrees, too: that says nothing of its encoders' zeros, nor of its torque."""
    robot = read_robot("planar2")
    log = simulate(robot, SimulationOptions(duration=8.0, rate=200.0, seed=1))
    factor = np.where(np.array(robot.joint_names) == joint, 180 / np.pi, 1.0)
    wrong = replace(log, q=factor * log.q, theta=factor * log.theta, sources={}, files=())
    path = str(tmp_path / "log.csv")
    write_recording(wrong, path)
    said = read_recording([path], robot).warnings
    (line,) = about(said, "times too large")
    assert line.startswith(f"positions of {joint} look 57.3 times too large")
    assert not about(said, "away from q")
    assert not about(said, "looks like a current")
    assert all(f"unit: {{{joint}: deg}}" in other for other in about(said, "map it"))
    maps = [read_map_options([entry]) for entry in re.findall(r"map it: (\w+: \{.*?\}\})", line)]
    got = read_recording([path], robot, {name: spec for one in maps for name, spec in one.items()})
    assert np.abs(got.q - log.q).max() < 1e-6
    assert np.abs(got.theta - log.theta).max() < 1e-6
