"""What a URDF leaves open is answered by the log: which joints are there, and which of them are elastic."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.errors import RobotError, UsageError
from elid_cli.experiment.simulation.run import simulate
from elid_cli.logs import read_map_options, read_recording, robot_as_logged
from elid_cli.logs.adapt import YIELDING
from elid_cli.model.base_parameters import find_base
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.locking import beside_chain, locked
from elid_cli.robot.robot import Limits, Robot
from elid_cli.robot.urdf.write import urdf_text
from tests import forked
from tests.logs.mcap_made import Bag, joint_state
from tests.robot.random_robots import random_robot

TREE = random_robot(45, 5, "urdf", kinds="rrp", parents=(-1, 0, 1, 0, 3), gearless=(0, 1, 2, 3, 4))


def plain_urdf(robot: Robot) -> str:
    """Return a URDF as others write it, without what only elid knows."""
    text = re.sub(r"  <transmission.*?</transmission>\n", "", urdf_text(robot), flags=re.DOTALL)
    return re.sub(r"  <elid.*?\n", "", text)


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(plain_urdf(replace(TREE, gravity=(0.0, 0.0, -9.81))))
    return path


def csv(path: Path, columns: dict[str, np.ndarray]) -> Path:
    t = np.arange(400) / 100
    table = np.column_stack([t, *columns.values()])
    np.savetxt(path, table, delimiter=",", header=",".join(["t", *columns]), comments="")
    return path


def waves(names: list[str]) -> dict[str, np.ndarray]:
    t = np.arange(400) / 100
    return {name: np.sin((1 + 0.3 * k) * t) for k, name in enumerate(names)}


def test_a_log_with_q_alone_makes_the_joints_rigid(arm: Path, tmp_path: Path) -> None:
    names = [f"{s}.axis_{i}" for s in ("q", "tau") for i in range(1, 6)]
    log = csv(tmp_path / "log.csv", waves(names))
    robot = robot_as_logged(read_robot(arm), [log])
    assert [joint.transmission for joint in robot.joints] == ["rigid"] * 5
    (said,) = (note for note in robot.notes if "taken as rigid" in note)
    assert YIELDING not in said  # a stiffness from the motor's side wants the motor's position
    motors = csv(tmp_path / "motors.csv", {name.replace("q.", "theta."): v for name, v in waves(names).items()})
    assert any(YIELDING in note for note in robot_as_logged(read_robot(arm), [motors]).notes)
    recording = read_recording([log], robot)
    np.testing.assert_array_equal(recording.q, recording.theta)


def test_both_positions_make_a_joint_elastic_and_empty_columns_do_not(arm: Path, tmp_path: Path) -> None:
    columns = waves([f"{s}.axis_{i}" for s in ("q", "theta", "tau") for i in range(1, 6)])
    columns["theta.axis_2"] = np.zeros(400)  # what a driver fills in that has no motor encoder
    log = csv(tmp_path / "log.csv", columns)
    robot = robot_as_logged(read_robot(arm), [log])
    assert robot.elastic.tolist() == [True, False, True, True, True]


def test_a_position_that_is_logged_twice_makes_no_joint_elastic(arm: Path, tmp_path: Path) -> None:
    columns = waves([f"{s}.axis_{i}" for s in ("q", "theta", "tau") for i in range(1, 6)])
    noise = np.random.default_rng(3).normal(0, 1e-4, (5, 400))
    for k in range(5):  # of the third the log shows a spring: 1 mrad under the largest torque
        deflection = 1e-3 * columns["tau.axis_3"] if k == 2 else 0.05
        columns[f"theta.axis_{k + 1}"] = columns[f"q.axis_{k + 1}"] + deflection + noise[k]
    log = csv(tmp_path / "log.csv", columns)
    robot = robot_as_logged(read_robot(arm), [log])
    assert robot.elastic.tolist() == [False, False, True, False, False]
    said = (
        "axis_1, axis_2, axis_4, axis_5 taken as rigid: q and theta differ by no more than a constant and sensor noise"
    )
    assert said in robot.notes
    one = csv(tmp_path / "one.csv", {**columns, "theta.axis_1": columns["q.axis_1"] + 2e-3 * columns["tau.axis_1"]})
    assert robot_as_logged(read_robot(arm), [log, one]).elastic.tolist() == [True, False, True, False, False]


def test_joints_that_the_log_lacks_are_locked(arm: Path, tmp_path: Path) -> None:
    log = csv(tmp_path / "log.csv", waves([f"{s}.axis_{i}" for s in ("q", "tau") for i in (1, 3, 4)]))
    robot = robot_as_logged(read_robot(arm), [log], hold={"axis_2": 0.4})
    assert robot.joint_names == ("axis_1", "axis_3", "axis_4")
    assert robot.parents == (-1, 0, 0)
    assert "1 joint locked at 0, as the log does not hold it: axis_5" in robot.notes


def test_the_nearest_name_in_the_log_is_told_of_a_joint_that_it_lacks(arm: Path, tmp_path: Path) -> None:
    words = [f"{s}.{name}" for s in ("q", "tau") for name in ("axis_1", "axis_2", "axis_3", "axis_4", "axsi_5")]
    log = csv(tmp_path / "log.csv", waves(words))
    robot = robot_as_logged(read_robot(arm), [log])
    said = (
        "1 joint locked at 0, as the log does not hold it: axis_5 (nearest name in the log that is no joint's: axsi_5)"
    )
    assert said in robot.notes
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.attrs["joint_names"] = ["axis_1", "axis_2", "axis_3", "axsi_4", "axsi_5"]
        for signal in ("q", "tau"):
            file[signal] = np.column_stack(list(waves(words[:5]).values()))
        file["t"] = np.arange(400) / 100
    (told,) = (n for n in robot_as_logged(read_robot(arm), [tmp_path / "log.h5"]).notes if "locked" in n)
    assert told.endswith("(nearest name in the log that is no joint's: axis_4 axsi_4, axis_5 axsi_5)")
    mapped = {s: {"from": f"/{s}", "joints": {"axis_4": "axsi_4", "axis_1": "axis_1"}} for s in ("q", "tau")}
    robot = robot_as_logged(read_robot(arm), [tmp_path / "log.h5"], mapped)
    assert "axsi_4" not in " ".join(robot.notes)


def test_joints_that_no_message_names_are_locked(arm: Path, tmp_path: Path) -> None:
    arm.write_text(re.sub(r'(<joint name="axis_5"[^>]*>)', r'\1<mimic joint="axis_4"/>', arm.read_text()))
    made, names = Bag(), ["axis_3", "axis_1", "axis_4"]
    made.topic("/joint_states")
    for row, values in enumerate(np.column_stack(list(waves(names).values()))):
        made.add("/joint_states", row * 10**7, joint_state(row * 10**7, names, values, effort=values))
    (log := tmp_path / "log.mcap").write_bytes(made.bytes())
    described = read_robot(arm)
    assert "axis_5 mimics another joint in the file; here it is one of its own" in described.notes
    robot = robot_as_logged(described, [log])
    assert robot.joint_names == ("axis_1", "axis_3", "axis_4")
    assert "2 joints locked at 0, as the log does not hold them: axis_2, axis_5" in robot.notes
    assert not any("mimics" in note for note in robot.notes)
    assert read_recording([log], robot).q.shape[1] == 3


def test_a_table_without_names_of_fewer_joints_is_read_by_the_chain_that_is_proposed(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The chain of the robot that is longest has three joints, and the table seven columns."""
    t = np.arange(400) / 100
    values = np.column_stack(list(waves(["axis_1", "axis_4", "axis_5"]).values()))
    np.savetxt(log := tmp_path / "log.txt", np.column_stack([t, values, 2 * values]))
    assert main(["identify", str(log), "--robot", str(arm)]) == 3
    said = capsys.readouterr().err.partition("hint: ")[2]
    options = shlex.split(said.partition("order: ")[2])
    tip = options[options.index("--tip") + 1]
    assert f"the joints that carry {tip} alone" in said
    maps = [value for name, value in pairwise(options) if name == "--map"]
    robot = robot_as_logged(
        described := read_robot(arm), [log], read_map_options(maps), dict.fromkeys(beside_chain(described, tip), 0.0)
    )
    assert robot.n == 3
    assert not any("the log has it from" in note for note in robot.notes)
    recording = read_recording([log], robot, read_map_options(maps))
    np.testing.assert_allclose(recording.q, values, atol=1e-9)
    np.testing.assert_allclose(recording.tau, 2 * values, atol=1e-9)
    assert main(["info", str(log), "--robot", str(arm)]) == 0
    assert f"--tip {tip}" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("dh", ["urdf", "standard", "modified"])
def test_a_locked_robot_moves_as_the_whole_one_with_these_joints_at_rest(dh: str) -> None:
    whole = random_robot(7, 6, dh, kinds="rrp", parents=(-1, 0, 1, 0, 3, 4), gearless=range(6), rigid=range(6))
    held = {"axis_2": 0.7, "axis_6": -0.2}
    less = locked(whole, held)
    moving = [k for k, name in enumerate(whole.joint_names) if name not in held]
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 6))
    for k, name in enumerate(whole.joint_names):
        if name in held:
            q[k], dq[k], ddq[k] = held[name], 0.0, 0.0
    full = Dynamics(whole).inverse(q, dq, ddq, q, dq, ddq)[1]
    part = Dynamics(less).inverse(*(v[moving] for v in (q, dq, ddq, q, dq, ddq)))[1]
    np.testing.assert_allclose(part, np.array(full)[moving], rtol=1e-9, atol=1e-9 * np.abs(full).max())


def test_tip_keeps_one_chain(arm: Path) -> None:
    robot = read_robot(arm)
    assert beside_chain(robot, "axis_3_link") == ("axis_4", "axis_5")
    with pytest.raises(UsageError, match="--tip axis_9_link: no such link"):
        beside_chain(robot, "axis_9_link")
    with pytest.raises(RobotError, match="no joint is left"):
        locked(robot, dict.fromkeys(robot.joint_names, 0.0))


def test_identify_with_a_plain_urdf_and_q_alone(arm: Path, tmp_path: Path) -> None:
    """The whole way: no gear, no transmission, a log of q and tau, two joints missing."""
    robot = locked(read_robot(arm), {"axis_4": 0.0, "axis_5": 0.0})
    joints = [replace(j, transmission="rigid", parameters=dict(j.parameters) | {"Ja": 0.5}) for j in robot.joints]
    truth = replace(robot, joints=tuple(joints))
    recording = simulate(truth)
    log = tmp_path / "log.csv"
    columns = {f"q.{n}": recording.q[:, k] for k, n in enumerate(recording.joints)}
    columns |= {f"tau.{n}": recording.tau[:, k] for k, n in enumerate(recording.joints)}
    table = np.column_stack([recording.t, *columns.values()])
    np.savetxt(log, table, delimiter=",", header=",".join(["t", *columns]), comments="")
    done = forked.run(["identify", str(log), "--robot", str(arm), "--json"])
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["joints"] == list(truth.joint_names)
    assert any("locked at 0" in note for note in answer["robot_notes"])
    base = find_base(Regressor(truth))
    expected = dict(zip(base.names, base.values(truth.reference()), strict=True))
    found = [item for item in answer["base_parameters"] if item["verdict"] == "supported"]
    assert len(found) > 10
    for item in found:
        assert abs(item["estimate"] - expected[item["name"]]) < 5 * item["std_error"] + 0.02 * abs(item["estimate"])


def test_an_unknown_gear_ratio_is_told(arm: Path, tmp_path: Path) -> None:
    log = csv(tmp_path / "log.csv", waves([f"q.axis_{i}" for i in range(1, 6)]))
    said = [note for note in robot_as_logged(read_robot(arm), [log]).notes if "gear ratio" in note]
    ja = "a rotor is then described by its inertia at the joint (Ja), without coupling to others"
    assert said == [f"no gear ratio is known; {ja}"]
    (tmp_path / "arm.elid.yaml").write_text("joints:\n  axis_1: {gear_ratio: 100}\n")
    said = [note for note in robot_as_logged(read_robot(arm), [log]).notes if "gear ratio" in note]
    assert len(said) == 1
    assert said[0].startswith("gear ratio not known: axis_2, axis_3, axis_4, axis_5;")


def test_a_joint_locked_elsewhere_than_the_log_has_it_is_told(arm: Path, tmp_path: Path) -> None:
    columns = waves([f"q.axis_{i}" for i in range(1, 6)])
    log = csv(tmp_path / "log.csv", columns | {"q.axis_3": np.full(400, 1.2)})
    robot = read_robot(arm)
    assert not any("is locked" in note for note in robot_as_logged(robot, [log]).notes)
    assert not any("is locked" in note for note in robot_as_logged(robot, [log], hold={"axis_3": 1.201}).notes)
    notes = robot_as_logged(robot, [log], hold={"axis_3": 0.0, "axis_5": 0.5}).notes
    said = [note for note in notes if "is locked" in note]
    assert [note.partition(":")[0] for note in said] == [
        "axis_3 is locked at 0, but the log has it from 1.2 to 1.2",
        "axis_5 is locked at 0.5, but the log has it from -1 to 1",
    ]


def test_a_joint_locked_outside_its_limits_is_told(arm: Path) -> None:
    robot = read_robot(arm)
    joints = tuple(replace(joint, limits=Limits((-1.0, 2.0))) for joint in robot.joints)
    robot = replace(robot, joints=joints)
    assert not any("limits" in note for note in robot_as_logged(robot, [], hold={"axis_1": 1.5}).notes)
    notes = robot_as_logged(robot, [], hold={"axis_1": 100.0}).notes
    assert "axis_1 is locked at 100, outside its limits, -1 to 2" in notes


def test_a_joint_that_the_yaml_beside_locks_outside_its_limits_is_told(arm: Path) -> None:
    limits = "joints: {axis_1: {limits: {position: [-1, 2]}}}\n"
    arm.with_suffix(".elid.yaml").write_text(limits + "lock: {axis_1: 100}\n")
    assert "axis_1 is locked at 100, outside its limits, -1 to 2" in robot_as_logged(read_robot(arm), []).notes
    arm.with_suffix(".elid.yaml").write_text(limits + "lock: {axis_1: 1.5}\n")
    assert not any("limits" in note for note in robot_as_logged(read_robot(arm), []).notes)


NUMBERED = [f"{s}{i}" for s in ("q", "tau") for i in range(1, 6)]


def read_columns(robot: Robot, log: Path) -> dict[str, int]:
    """Return the wave (by its number from 0) that each joint's position is read from."""
    values, read = np.column_stack(list(waves(NUMBERED).values())), read_recording([log], robot)
    return {name: int(np.argmin(np.abs(values.T - read.q[:, k]).sum(axis=1))) for k, name in enumerate(read.joints)}


def test_numbers_of_columns_are_those_of_the_whole_robot_whichever_joints_are_locked(arm: Path, tmp_path: Path) -> None:
    described, held = read_robot(arm), {"axis_2": 0.0}
    own = {"axis_1": 0, "axis_3": 2, "axis_4": 3, "axis_5": 4}
    log = csv(tmp_path / "log.csv", waves(NUMBERED))
    assert read_columns(robot_as_logged(described, [log], hold=held), log) == own
    less = csv(tmp_path / "less.csv", {name: values for name, values in waves(NUMBERED).items() if name[-1] != "2"})
    robot = robot_as_logged(described, [less])
    assert "1 joint locked at 0, as the log does not hold it: axis_2" in robot.notes
    assert read_columns(robot, less) == own
    with h5py.File(arrays := tmp_path / "log.h5", "w") as file:
        table = np.column_stack(list(waves(NUMBERED).values()))
        file["t"], file["q"], file["tau"] = np.arange(400) / 100, table[:, :5], table[:, 5:]
    assert read_columns(robot_as_logged(described, [arrays], hold=held), arrays) == own


def test_columns_numbered_without_the_locked_joints_are_taken_so_and_told(arm: Path, tmp_path: Path) -> None:
    described = read_robot(arm)
    log = csv(tmp_path / "log.csv", waves([f"{s}{i}" for s in ("q", "tau") for i in range(1, 5)]))
    robot = robot_as_logged(described, [log], hold={"axis_2": 0.0})
    assert not any("the log has it" in note for note in robot.notes)
    recording = read_recording([log], robot)
    np.testing.assert_allclose(recording.q, np.column_stack(list(waves(list("1234")).values())), atol=1e-9)
    assert "q: values of q{i} have no names: taken in the order of the joints that are not held" in recording.notes


@pytest.mark.parametrize("key", ["lock: {axis_4: 0.1}", "tip: axis_1"])
def test_a_joint_that_the_yaml_beside_locks_elsewhere_is_told(arm: Path, tmp_path: Path, key: str) -> None:
    arm.with_suffix(".elid.yaml").write_text(key + "\n")
    log = csv(tmp_path / "log.csv", waves([f"{s}.axis_{i}" for s in ("q", "tau") for i in range(1, 6)]))
    notes = robot_as_logged(read_robot(arm), [log]).notes
    told = [note for note in notes if "but the log has it from" in note]
    assert [note.split()[0] for note in told] == ([f"axis_{k}" for k in range(2, 6)] if "tip" in key else ["axis_4"])


def test_a_joint_that_does_not_move_in_a_log_of_both_positions_is_locked_where_it_stands(
    arm: Path, tmp_path: Path
) -> None:
    columns = waves([f"{s}.axis_{i}" for s in ("q", "theta", "tau") for i in range(1, 6)])
    columns |= {"q.axis_3": np.full(400, 1.2), "theta.axis_3": np.full(400, 1.21)}
    log = csv(tmp_path / "log.csv", columns)
    robot = robot_as_logged(described := read_robot(arm), [log])
    assert robot.joint_names == ("axis_1", "axis_2", "axis_4", "axis_5")
    assert robot.held == {"axis_3": 1.2}
    assert "1 joint locked where the log has it without any motion: axis_3 at 1.2" in robot.notes
    by_option = robot_as_logged(described, [log], hold={"axis_3": 1.2})
    assert robot.joints == by_option.joints
    assert robot.joints != robot_as_logged(described, [log], hold={"axis_3": 0.0}).joints
    other = csv(tmp_path / "other.csv", waves(list(columns)))  # here it moves
    both = robot_as_logged(described, [log, other])
    assert both.elastic.tolist() == [True] * 5
    elsewhere = csv(tmp_path / "elsewhere.csv", columns | {"q.axis_3": np.full(400, 0.7)})
    assert robot_as_logged(described, [log, elsewhere]).elastic.tolist() == [True, True, False, True, True]


def test_a_joint_that_stands_still_without_torque_is_locked_and_one_with_torque_or_motion_is_not(
    arm: Path, tmp_path: Path
) -> None:
    """The fingers of a gripper in /joint_states: their efforts are zeros, and their positions jitter at most."""
    columns = waves([f"{s}.axis_{i}" for s in ("q", "tau") for i in range(1, 6)])
    columns |= {"q.axis_5": 0.02 + 1e-5 * columns["q.axis_5"], "tau.axis_5": np.zeros(400)}
    columns |= {"q.axis_2": np.full(400, 0.5), "tau.axis_3": np.zeros(400)}  # held by its drive; moves, torque unknown
    log = csv(tmp_path / "log.csv", columns)
    robot = robot_as_logged(read_robot(arm), [log])
    assert robot.held == pytest.approx({"axis_5": 0.02}, abs=1e-5)
    assert robot.joint_names == ("axis_1", "axis_2", "axis_3", "axis_4")
    silent = csv(tmp_path / "silent.csv", {name: v for name, v in columns.items() if name.startswith("q")})
    assert not robot_as_logged(read_robot(arm), [silent]).held
