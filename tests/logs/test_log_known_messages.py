"""Messages of known makers need no mapping: Franka, KUKA FRI, Unitree, ros2_control."""

from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elid_cli.errors import LogError
from elid_cli.logs.mcap.ros_schema import KNOWN
from elid_cli.robot.robot import Joint, Robot
from tests.logs.made_logs import JOINTS, ROBOT, read, recording
from tests.logs.mcap_made import DYNAMIC, HEADER, RULE, STAMP, Bag, encoder, joint_state

BASE = recording(700)
RIGID = replace(ROBOT, joints=tuple(replace(joint, transmission="rigid") for joint in ROBOT.joints))
JOINT_STATE = f"{RULE}\nMSG: sensor_msgs/JointState\n{HEADER}string[] name\n"
JOINT_STATE += "float64[] position\nfloat64[] velocity\nfloat64[] effort\n"


def bag(folder: Path, *topics: tuple[str, str, str, Any]) -> Path:
    """Write topics, (name, schema, its text, row and stamp to message), at 1 kHz."""
    made = Bag()
    for topic, schema, text, _ in topics:
        made.topic(topic, schema, text)
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        for topic, _, _, message in topics:
            made.add(topic, 10**18 + t, message(row, 10**18 + t))
    path = folder / "log.mcap"
    path.write_bytes(made.bytes())
    return path


def head(stamp: int) -> dict[str, Any]:
    return {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}


def test_a_franka_log_has_both_positions_and_the_torque_sensors(tmp_path: Path) -> None:
    text = f"{HEADER}sensor_msgs/JointState measured_joint_state\nsensor_msgs/JointState measured_joint_motor_state\n"

    def message(row: int, stamp: int) -> dict[str, Any]:
        link = joint_state(stamp, list(JOINTS), BASE.q[row], 0 * BASE.q[row] + 1, BASE.tau[row])
        motor = joint_state(stamp, list(JOINTS), BASE.theta[row])
        return {"header": head(stamp), "measured_joint_state": link, "measured_joint_motor_state": motor}

    topic = "/franka_robot_state_broadcaster/robot_state"
    path = bag(tmp_path, (topic, "franka_msgs/msg/FrankaRobotState", text + JOINT_STATE + STAMP, message))
    log = read(path)
    np.testing.assert_array_equal(log.q, BASE.q)
    np.testing.assert_array_equal(log.theta, BASE.theta)
    assert log.tau_link is not None
    np.testing.assert_array_equal(log.tau_link, BASE.tau)
    assert np.isnan(log.tau).all()
    assert any(f"franka_msgs/FrankaRobotState on {topic}" in note for note in log.notes)


def test_kukas_state_has_link_positions_and_torque_sensors(tmp_path: Path) -> None:
    text = "float64[3] measured_joint_position\nfloat64[3] measured_torque\nfloat64 sample_time\n"

    def message(row: int, stamp: int) -> dict[str, Any]:
        seen = {"measured_joint_position": BASE.q[row].tolist(), "measured_torque": BASE.tau[row].tolist()}
        return {**seen, "sample_time": 0.001}

    log = read(bag(tmp_path, ("/lbr/state", "lbr_fri_idl/msg/LBRState", text, message)))
    np.testing.assert_array_equal(log.q, BASE.q)
    assert log.tau_link is not None
    np.testing.assert_array_equal(log.tau_link, BASE.tau)


@pytest.mark.parametrize("encoding", ["cdr", "json"])
def test_kukas_time_is_the_messages_own(tmp_path: Path, encoding: str) -> None:
    made = Bag()
    text = "uint32 time_stamp_sec\nuint32 time_stamp_nano_sec\n"
    text += "float64[3] measured_joint_position\nfloat64[3] measured_torque\n"
    language = "ros2msg" if encoding == "cdr" else "jsonschema"
    made.topic("/lbr/state", "lbr_fri_idl/msg/LBRState", text, encoding=encoding, language=language, shown=None)
    late = np.random.default_rng(0).integers(0, 10**7, BASE.t.size).tolist()
    for row, t in enumerate(np.rint(BASE.t * 2e9).astype(int).tolist()):
        stamp = 10**18 + t
        seen = {"measured_joint_position": BASE.q[row].tolist(), "measured_torque": BASE.tau[row].tolist()}
        own = {"time_stamp_sec": stamp // 10**9, "time_stamp_nano_sec": stamp % 10**9}
        made.add("/lbr/state", stamp + late[row], {**own, **seen})
    path = tmp_path / "log.mcap"
    path.write_bytes(made.bytes())
    log = read(path)
    np.testing.assert_array_equal(log.q, BASE.q)
    np.testing.assert_allclose(log.t, 2 * BASE.t, atol=1e-9)


def test_frankas_older_state_has_motors_too(tmp_path: Path) -> None:
    made = Bag()  # a ROS 1 message, which is found in files that were converted: its names are none of ROS 2
    made.topic("/franka_states", "franka_msgs/FrankaState", "", encoding="json", language="jsonschema")
    seen = {"q": BASE.q, "dq": BASE.q + 1, "tau_J": BASE.tau, "theta": BASE.theta, "dtheta": BASE.theta + 2}
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        values = {name: values[row].tolist() for name, values in seen.items()}
        made.add("/franka_states", 10**18 + t, {"header": head(10**18 + t), **values})
    path = tmp_path / "log.mcap"
    path.write_bytes(made.bytes())
    log = read(path)
    np.testing.assert_array_equal(log.q, BASE.q)
    np.testing.assert_array_equal(log.theta, BASE.theta)
    assert log.tau_link is not None
    assert log.dq is not None
    assert log.dtheta is not None
    np.testing.assert_array_equal(log.tau_link, BASE.tau)
    np.testing.assert_array_equal(log.dq, BASE.q + 1)
    np.testing.assert_array_equal(log.dtheta, BASE.theta + 2)


LEG = tuple(Joint(f"FL_{name}_joint", transmission="rigid") for name in ("hip", "thigh", "calf"))
MOTOR = f"{RULE}\nMSG: unitree_go/MotorState\nfloat32 q\nfloat32 dq\nfloat32 tau_est\n"
COMMAND = f"{RULE}\nMSG: unitree_go/MotorCmd\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\n"


def unitree(folder: Path) -> Path:
    def state(row: int, stamp: int) -> dict[str, Any]:
        motors = [{"q": 0.0, "dq": 0.0, "tau_est": 0.0} for _ in range(20)]
        for j in range(3):
            motors[3 + j] = {"q": BASE.q[row, j], "dq": 0.0, "tau_est": BASE.tau[row, j]}
        return {"motor_state": motors}

    def command(row: int, stamp: int) -> dict[str, Any]:
        return {"motor_cmd": [{"q": 0.5, "dq": 0.25, "tau": 0.125 * k, "kp": 25.0, "kd": 0.5} for k in range(20)]}

    return bag(
        folder,
        ("/lowstate", "unitree_go/msg/LowState", f"unitree_go/MotorState[20] motor_state\n{MOTOR}", state),
        ("/lowcmd", "unitree_go/msg/LowCmd", f"unitree_go/MotorCmd[20] motor_cmd\n{COMMAND}", command),
    )


def test_unitrees_motors_are_told_by_the_joints_names(tmp_path: Path) -> None:
    log = read(unitree(tmp_path), robot=Robot("leg", LEG))
    np.testing.assert_allclose(log.q, BASE.q, atol=1e-6)
    np.testing.assert_allclose(log.tau, BASE.tau, atol=1e-5)
    assert log.commands["kp"][0].tolist() == [25.0] * 3
    assert log.commands["q_des"][0].tolist() == [0.5] * 3
    assert log.commands["dq_des"][0].tolist() == [0.25] * 3
    assert log.commands["tau_ff"][0].tolist() == [0.375, 0.5, 0.625]
    assert log.commands["kd"][0].tolist() == [0.5] * 3


def test_without_names_that_show_it_the_order_of_motors_must_be_said(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no position") as caught:
        read(unitree(tmp_path), robot=RIGID)
    assert "say which is whose in a mapping, by joints:" in caught.value.detail


def motors(robot: Robot, schema: str) -> list[int | None]:
    """Return the motor of every joint of a robot, as its message's profile tells them."""
    from elid_cli.logs.mapping.profiles.unitree import mapping

    joints = mapping(schema, "/lowstate", robot)["q"]["joints"]
    return [joints.get(name) for name in robot.joint_names]


@pytest.mark.parametrize(
    ("name", "schema", "joints", "order"),
    [
        ("go2", "unitree_go/LowState", ["FL_hip_joint", "FR_calf_joint", "RR_thigh_joint", "RL_hip"], [3, 2, 7, 9]),
        ("h1", "unitree_go/LowState", ["left_hip_yaw_joint", "torso_joint", "left_elbow_joint"], [7, 6, 19]),
        ("g1_29dof", "unitree_hg/LowState", ["left_hip_yaw_joint", "right_wrist_yaw_joint"], [2, 28]),
        ("body", "unitree_hg/LowState", ["left_hip_yaw_joint", "waist_pitch_joint"], [2, 14]),
        ("h1_2", "unitree_hg/LowState", ["left_hip_yaw_joint", "right_wrist_yaw_joint"], [0, 26]),
        ("body", "unitree_hg/LowState", ["left_hip_yaw_joint", "torso_joint"], [0, 12]),
        ("body", "unitree_hg/LowState", ["left_hip_yaw_joint", "left_knee_joint"], [None, None]),
        ("body", "unitree_hg/LowState", ["left_hip_yaw_joint", "waist_yaw_joint", "head_yaw_joint"], [None] * 3),
    ],
)
def test_the_makers_order_of_motors(name: str, schema: str, joints: list[str], order: list[int | None]) -> None:
    robot = Robot(name, tuple(Joint(joint, transmission="rigid") for joint in joints))
    assert motors(robot, schema) == order


def test_as_many_motors_as_joints_are_not_taken_in_the_robots_order(tmp_path: Path) -> None:
    def state(row: int, stamp: int) -> dict[str, Any]:
        return {"motor_state": [{"q": BASE.q[row, j], "dq": 0.0, "tau_est": BASE.tau[row, j]} for j in range(3)]}

    text = f"unitree_go/MotorState[3] motor_state\n{MOTOR}"
    path = bag(tmp_path, ("/lowstate", "unitree_go/msg/LowState", text, state))
    with pytest.raises(LogError, match="no position") as caught:
        read(path, robot=RIGID)
    assert "say which is whose in a mapping, by joints:" in caught.value.detail
    assert "joints: {shoulder: 0, elbow: 1, wrist: 2}" in caught.value.hint
    told = {
        signal: {"from": "/lowstate", "field": f"motor_state.{name}", "joints": [2, 1, 0]}
        for signal, name in (("q", "q"), ("tau", "tau_est"))
    }
    np.testing.assert_allclose(read(path, mapping=told, robot=RIGID).q, BASE.q[:, ::-1], atol=1e-6)


@pytest.mark.parametrize("measured", [True, False])
def test_efforts_that_a_controller_puts_out_stand_for_those_it_does_not_measure(tmp_path: Path, measured: bool) -> None:
    point = f"{RULE}\nMSG: trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\n"
    text = f"{HEADER}string[] joint_names\n"
    text += "".join(f"trajectory_msgs/JointTrajectoryPoint {name}\n" for name in ("reference", "feedback", "output"))
    text += f"{point}float64[] effort\n{STAMP}"

    def message(row: int, stamp: int) -> dict[str, Any]:
        told = {"positions": (BASE.q[row] + 0.1).tolist(), "velocities": (BASE.q[row] + 3).tolist(), "effort": []}
        seen = {"positions": BASE.q[row].tolist(), "velocities": (BASE.q[row] + 2).tolist()}
        seen["effort"] = (BASE.tau[row] + 1).tolist() if measured else []
        out = {"positions": [], "velocities": [], "effort": BASE.tau[row].tolist()}
        names = {"header": head(stamp), "joint_names": list(JOINTS)}
        return {**names, "reference": told, "feedback": seen, "output": out}

    schema = "control_msgs/msg/JointTrajectoryControllerState"
    log = read(bag(tmp_path, ("/arm/controller_state", schema, text, message)), robot=RIGID)
    np.testing.assert_array_equal(log.tau, BASE.tau + measured)
    assert log.dq is not None
    np.testing.assert_array_equal(log.dq, BASE.q + 2)
    np.testing.assert_allclose(log.commands["dq_des"], BASE.q + 3)


CONTROLLER = (
    f"{HEADER}string[] joint_names\ntrajectory_msgs/JointTrajectoryPoint reference\n"
    f"trajectory_msgs/JointTrajectoryPoint feedback\n{RULE}\nMSG: trajectory_msgs/JointTrajectoryPoint\n"
    f"float64[] positions\nfloat64[] velocities\nfloat64[] effort\n{STAMP}"
)


def test_of_two_sources_of_torque_that_with_more_joints_is_taken_for_all(tmp_path: Path) -> None:
    def states(row: int, stamp: int) -> dict[str, Any]:
        return joint_state(stamp, list(JOINTS), BASE.q[row], effort=BASE.tau[row])

    def controller(row: int, stamp: int) -> dict[str, Any]:
        told = {"positions": [], "velocities": [], "effort": []}
        seen = {"positions": [], "velocities": [], "effort": [1.5 * BASE.tau[row, 0]]}
        return {"header": head(stamp), "joint_names": [JOINTS[0]], "reference": told, "feedback": seen}

    path = bag(
        tmp_path,
        ("/joint_states", "sensor_msgs/msg/JointState", None, states),  # type: ignore[arg-type]
        ("/c", "control_msgs/msg/JointTrajectoryControllerState", CONTROLLER, controller),
    )
    log = read(path, robot=RIGID)
    np.testing.assert_array_equal(log.tau, BASE.tau)
    assert log.sources["tau"] == "/joint_states.effort"
    assert f"tau of {JOINTS[0]} could be read from /c.feedback.effort as well, which has fewer joints" in log.notes
    told = {"tau": {"from": "/c", "field": "feedback.effort"}}
    log = read(path, robot=RIGID, mapping=told)
    np.testing.assert_array_equal(log.tau, BASE.tau * [1.5, 1.0, 1.0])
    assert log.sources["tau"] == f"/joint_states.effort of {' '.join(JOINTS[1:])}, else /c.feedback.effort"


def test_states_of_a_trajectory_controller(tmp_path: Path) -> None:
    def message(row: int, stamp: int) -> dict[str, Any]:
        told = {"positions": (BASE.q[row] + 0.1).tolist(), "velocities": [], "effort": []}
        seen = {"positions": BASE.q[row].tolist(), "velocities": [], "effort": BASE.tau[row].tolist()}
        return {"header": head(stamp), "joint_names": list(JOINTS), "reference": told, "feedback": seen}

    schema = "control_msgs/msg/JointTrajectoryControllerState"
    log = read(bag(tmp_path, ("/arm/controller_state", schema, CONTROLLER, message)), robot=RIGID)
    np.testing.assert_array_equal(log.q, BASE.q)
    np.testing.assert_array_equal(log.tau, BASE.tau)
    np.testing.assert_allclose(log.commands["q_des"], BASE.q + 0.1)


def test_dynamic_joint_states_are_like_joint_states_and_the_source_with_more_joints_wins(tmp_path: Path) -> None:
    def dynamic(row: int, stamp: int) -> dict[str, Any]:
        values = [
            {"interface_names": ["position", "effort"], "values": [BASE.q[row, j], BASE.tau[row, j]]} for j in range(3)
        ]
        return {"header": head(stamp), "joint_names": list(JOINTS), "interface_values": values}

    def one(row: int, stamp: int) -> dict[str, Any]:
        return joint_state(stamp, [JOINTS[0]], BASE.q[row, :1] + 1)

    path = bag(
        tmp_path,
        ("/joint_states", "sensor_msgs/msg/JointState", None, one),  # type: ignore[arg-type]
        ("/dynamic_joint_states", "control_msgs/msg/DynamicJointState", DYNAMIC, dynamic),
    )
    log = read(path, robot=RIGID)
    np.testing.assert_array_equal(log.q, BASE.q)
    np.testing.assert_array_equal(log.tau, BASE.tau)
    assert "q could be read from /joint_states as well, which has fewer joints" in log.notes
    # of an effort the robot tells whose torque it is, which another note says
    assert "q effort are taken as known of control_msgs/DynamicJointState on /dynamic_joint_states" in log.notes
    assert "tau is the effort of /dynamic_joint_states.effort, as the log holds nothing else of the motors" in log.notes


def bare_bag(folder: Path, kind: str, text: str, message: Any) -> Path:
    """Write a bag as ROS 2 Humble does, in SQLite and without definitions of its messages."""
    encode = encoder(kind, text)
    with sqlite3.connect(path := folder / "run_0.db3") as base:
        base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        base.execute("INSERT INTO topics VALUES(1, '/state', ?, 'cdr')", (kind,))
        rows = [(10**18 + round(1e9 * t), encode(message(k))) for k, t in enumerate(BASE.t.tolist())]
        base.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)", rows)
    base.close()
    return path


def test_unitrees_messages_are_read_from_a_bag_without_definitions(tmp_path: Path) -> None:
    kind = "unitree_hg/LowState"
    parts = [f"{RULE}\nMSG: unitree_hg/{name}\n{KNOWN[f'unitree_hg/{name}']}" for name in ("IMUState", "MotorState")]
    imu = {"quaternion": [1.0, 0, 0, 0], "gyroscope": [0.0] * 3, "accelerometer": [0.0] * 3, "rpy": [0.0] * 3}
    idle = {"mode": 1, "dq": 0.0, "ddq": 0.0, "temperature": [20, 20], "vol": 48.0, "sensor": [0, 0], "motorstate": 0}
    rest = {"wireless_remote": [0] * 40, "reserve": [0] * 4, "crc": 0}

    def message(row: int) -> dict[str, Any]:
        at = np.zeros((2, 35))
        at[:, 12:15] = BASE.q[row], BASE.tau[row]
        motors = [{**idle, "q": q, "tau_est": tau, "reserve": [0] * 4} for q, tau in at.T.tolist()]
        state = {"version": [0, 0], "mode_pr": 0, "mode_machine": 5, "tick": row, "motor_state": motors}
        return {**state, "imu_state": {**imu, "temperature": 30}, **rest}

    waist = tuple(Joint(f"waist_{name}_joint", transmission="rigid") for name in ("yaw", "roll", "pitch"))
    path = bare_bag(tmp_path, "unitree_hg/msg/LowState", "".join([KNOWN[kind], *parts]), message)
    log = read(path, robot=Robot("g1", waist))
    np.testing.assert_allclose(log.q, BASE.q, atol=1e-6)
    np.testing.assert_allclose(log.tau, BASE.tau, atol=1e-4)


def test_a_bag_without_the_definition_of_its_messages_says_so(tmp_path: Path) -> None:
    kind = "franka_msgs/msg/FrankaRobotState"
    path = bare_bag(tmp_path, kind, "float64[3] q\n", lambda row: {"q": BASE.q[row].tolist()})
    with pytest.raises(LogError, match="no position") as caught:
        read(path, robot=RIGID)
    assert f"not decoded: {kind}: the bag does not hold its definition" in caught.value.detail
    assert "ros2 bag convert" in caught.value.hint
    (tmp_path / "other").mkdir()
    other = bare_bag(
        tmp_path / "other", "unitree_go/msg/LowState", "float64[3] q\n", lambda row: {"q": BASE.q[row].tolist()}
    )
    with pytest.raises(LogError, match="no position"):  # of another version: of another length
        read(other, robot=Robot("leg", LEG))
