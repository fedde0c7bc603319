"""States of ros2_control: what controllers and the joint state broadcaster publish."""

from __future__ import annotations

from typing import Any

from elid_cli.logs.mapping.profiles import fields
from elid_cli.robot.robot import Robot

SCHEMAS = ("control_msgs/JointTrajectoryControllerState", "control_msgs/DynamicJointState")


def mapping(schema: str, topic: str, robot: Robot) -> dict[str, Any] | list[dict[str, Any]]:
    """Return where the signals are; interfaces of joint states are those of ``/joint_states``.

    Efforts that a controller measures are worth more than those that it puts out.
    """
    if schema.endswith("DynamicJointState"):
        return fields(topic, q="position", dq="velocity", tau_link="effort")
    found: dict[str, Any] = fields(
        topic, q="feedback.positions", dq="feedback.velocities", q_des="reference.positions",
        dq_des="reference.velocities", tau="feedback.effort",
    )  # fmt: skip
    return [found, fields(topic, tau="output.effort")]
