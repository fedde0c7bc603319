"""KUKA's fast robot interface: link positions and the joint torque sensors (lbr_fri_ros2_stack).

The times are the message's own, ``time_stamp_sec`` and ``time_stamp_nano_sec``, read like a header stamp.
"""

from __future__ import annotations

from typing import Any

from elid_cli.logs.mapping.profiles import fields
from elid_cli.robot.robot import Robot

SCHEMAS = ("lbr_fri_idl/LBRState",)


def mapping(schema: str, topic: str, robot: Robot) -> dict[str, Any]:
    """Return where the signals are."""
    return fields(topic, q="measured_joint_position", tau_link="measured_torque")
