"""Messages of known makers need no mapping: Franka, KUKA FRI, Unitree, ros2_control."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elid_cli.errors import LogError
from elid_cli.robot.robot import Joint, Robot
from tests.logs.made_logs import JOINTS, ROBOT, read, recording
from tests.logs.mcap_made import DYNAMIC, HEADER, RULE, STAMP, Bag, joint_state

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
        return {"motor_cmd": [{"q": 0.5, "dq": 0.0, "tau": 0.0, "kp": 25.0, "kd": 0.5} for _ in range(20)]}

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


def test_without_names_that_show_it_the_order_of_motors_must_be_said(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no position") as caught:
        read(unitree(tmp_path), robot=RIGID)
    assert "which are whose says joints:" in caught.value.detail


def test_states_of_a_trajectory_controller(tmp_path: Path) -> None:
    text = (
        f"{HEADER}string[] joint_names\ntrajectory_msgs/JointTrajectoryPoint reference\n"
        f"trajectory_msgs/JointTrajectoryPoint feedback\n{RULE}\nMSG: trajectory_msgs/JointTrajectoryPoint\n"
        f"float64[] positions\nfloat64[] velocities\nfloat64[] effort\n{STAMP}"
    )

    def message(row: int, stamp: int) -> dict[str, Any]:
        told = {"positions": (BASE.q[row] + 0.1).tolist(), "velocities": [], "effort": []}
        seen = {"positions": BASE.q[row].tolist(), "velocities": [], "effort": BASE.tau[row].tolist()}
        return {"header": head(stamp), "joint_names": list(JOINTS), "reference": told, "feedback": seen}

    schema = "control_msgs/msg/JointTrajectoryControllerState"
    log = read(bag(tmp_path, ("/arm/controller_state", schema, text, message)), robot=RIGID)
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
