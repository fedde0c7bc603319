"""One /joint_states with effort, the commonest log of all: its effort is the torque of the joints that are rigid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.logs import read_map_options
from elid_cli.logs.formats.csv import FIELDS
from elid_cli.logs.inspect import inspect_log
from elid_cli.robot.robot import Robot
from tests.logs.made_logs import JOINTS, ROBOT, read, recording
from tests.logs.mcap_made import Bag, joint_state

BASE = recording(1500)
RIGID = replace(ROBOT, joints=tuple(replace(joint, transmission="rigid") for joint in ROBOT.joints))
MIXED = replace(ROBOT, joints=(*RIGID.joints[:2], ROBOT.joints[2]))


def bag(folder: Path, motor_positions: bool = False) -> Path:
    made = Bag()
    topics = ["/joint_states", *(["/motor_states"] if motor_positions else [])]
    for topic in topics:
        made.topic(topic)
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        stamp = 10**18 + t
        made.add("/joint_states", stamp, joint_state(stamp, list(JOINTS), BASE.q[row], effort=BASE.tau[row]))
        if motor_positions:
            made.add("/motor_states", stamp, joint_state(stamp, list(JOINTS), BASE.theta[row]))
    path = folder / "log.mcap"
    path.write_bytes(made.bytes())
    return path


def plotjuggler(folder: Path) -> Path:
    topic = FIELDS["q"][0]
    names = [f"{topic}/{joint}/{field}" for field in ("position", "effort") for joint in JOINTS]
    table = np.column_stack([BASE.t, BASE.q, BASE.tau])
    path = folder / "log.csv"
    np.savetxt(path, table, delimiter=",", header=",".join(["__time", *names]), comments="")
    return path


@pytest.mark.parametrize("made", [bag, plotjuggler])
def test_the_effort_is_the_torque_of_rigid_joints(tmp_path: Path, made: object) -> None:
    log = read(made(tmp_path), robot=RIGID)  # type: ignore[operator]
    np.testing.assert_allclose(log.tau, BASE.tau, atol=1e-12)
    assert log.tau_link is None
    assert log.warnings == ()
    assert any("tau is the effort of" in note for note in log.notes)


def test_a_mapping_as_the_old_hint_gave_it_raises_no_false_warnings(tmp_path: Path) -> None:
    log = read(bag(tmp_path), robot=RIGID, mapping=read_map_options(["tau=/joint_states.effort"]))
    np.testing.assert_array_equal(log.tau, BASE.tau)
    assert log.tau_link is None
    assert log.warnings == ()


def test_the_effort_of_an_elastic_joint_without_motor_side_is_that_of_its_torque_sensor(tmp_path: Path) -> None:
    log = read(bag(tmp_path), robot=MIXED)
    np.testing.assert_array_equal(log.tau[:, :2], BASE.tau[:, :2])
    assert np.isnan(log.tau[:, 2]).all()
    assert log.tau_link is not None
    np.testing.assert_array_equal(log.tau_link[:, 2], BASE.tau[:, 2])
    assert any("tau of shoulder elbow is the effort" in note for note in log.notes)
    said = next(note for note in log.notes if "joint torque sensors" in note)
    assert "(tau_link) of wrist, declared elastic" in said


@pytest.mark.parametrize("robot", [ROBOT, RIGID])
def test_beside_a_motor_side_the_effort_of_joint_states_stays_the_sensors(tmp_path: Path, robot: Robot) -> None:
    log = read(bag(tmp_path, motor_positions=True), robot=robot)
    assert np.isnan(log.tau).all()
    assert log.tau_link is not None
    np.testing.assert_array_equal(log.tau_link, BASE.tau)


@pytest.mark.parametrize("made", [bag, plotjuggler])
@pytest.mark.parametrize("robot", [RIGID, MIXED])
def test_what_info_writes_reads_the_same_signals(tmp_path: Path, made: object, robot: Robot) -> None:
    path = made(tmp_path)  # type: ignore[operator]
    plain = read(path, robot=robot)
    for info in (inspect_log(path, robot), inspect_log(path)):
        mapped = read(path, robot=robot, mapping=dict(info.resolved))
        np.testing.assert_array_equal(mapped.tau, plain.tau)
        np.testing.assert_array_equal(np.isnan(mapped.tau), np.isnan(plain.tau))
        assert (mapped.tau_link is None) == (plain.tau_link is None)
        assert mapped.warnings == plain.warnings
    assert ("tau" in inspect_log(path, robot).taken) == (robot is RIGID)


def test_a_signal_and_its_place_are_spelt_as_in_a_file_or_with_an_equals_sign() -> None:
    told = {"q_des": {"from": "/joint_commands.position"}}
    assert read_map_options(["q_des: /joint_commands.position"]) == told
    assert read_map_options(["q_des=/joint_commands.position"]) == told


@pytest.mark.parametrize("labels", [JOINTS, JOINTS[::-1], JOINTS[1:], JOINTS[:2]])
def test_another_topic_with_the_joints_that_lack_is_named(tmp_path: Path, labels: tuple[str, ...]) -> None:
    """That of a namespace is not taken by itself: it may hold what was wanted, not what was."""
    recorder = Bag()
    order = [JOINTS.index(label) for label in labels]
    for topic in ("/joint_states", "/arm/joint_states", "/motor_states"):
        recorder.topic(topic)
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        stamp = 10**18 + t
        recorder.add("/joint_states", stamp, joint_state(stamp, list(JOINTS[:2]), BASE.q[row, :2]))
        recorder.add("/arm/joint_states", stamp, joint_state(stamp, list(labels), BASE.q[row, order]))
        recorder.add("/motor_states", stamp, joint_state(stamp, list(JOINTS), BASE.theta[row], effort=BASE.tau[row]))
    path = tmp_path / "log.mcap"
    path.write_bytes(recorder.bytes())
    (said,) = (warning for warning in read(path).warnings if "no link position q" in warning)
    (noted,) = (note for note in inspect_log(path, ROBOT).notes if "is not in" in note)
    assert noted.startswith("q of wrist is not in /joint_states.position")
    for words in (said, noted):
        assert ("/arm/joint_states.position names wrist as well" in words) == ("wrist" in labels)
        assert ("map it: q: {from: /arm/joint_states, field: position}" in words) == (len(labels) == 3)
    if len(labels) == 3:
        log = read(path, mapping=read_map_options([said.partition("map it: ")[2]]))
        np.testing.assert_allclose(log.q, BASE.q, atol=1e-12)
