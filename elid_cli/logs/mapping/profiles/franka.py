"""Franka: link and motor positions, and the joint torque sensors (franka_ros2; franka_ros)."""

from __future__ import annotations

from typing import Any

from elid_cli.logs.mapping.profiles import fields
from elid_cli.robot.robot import Robot

SCHEMAS = ("franka_msgs/FrankaRobotState", "franka_msgs/FrankaState")


def mapping(schema: str, topic: str, robot: Robot) -> dict[str, Any]:
    """Return where the signals are: torques are the sensors', `tau_link`."""
    if schema.endswith("FrankaState"):
        return fields(topic, q="q", dq="dq", tau_link="tau_J", theta="theta", dtheta="dtheta")
    link, motor = "measured_joint_state", "measured_joint_motor_state"
    return fields(
        topic, q=f"{link}.position", dq=f"{link}.velocity", tau_link=f"{link}.effort",
        theta=f"{motor}.position", dtheta=f"{motor}.velocity",
    )  # fmt: skip
