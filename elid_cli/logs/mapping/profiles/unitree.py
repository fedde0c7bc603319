"""Unitree's low-level states and commands: motors without names, in the maker's order."""

from __future__ import annotations

from typing import Any

from elid_cli.robot.robot import Robot

SCHEMAS = tuple(f"unitree_{series}/{name}" for series in ("go", "hg") for name in ("LowState", "LowCmd"))
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
ORDERS = {
    "go": tuple(f"{leg}_{joint}" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")),
    "hg": (
        *(f"{side}_{joint}" for side in ("left", "right") for joint in LEG),
        *("waist_yaw", "waist_roll", "waist_pitch"),
        *(f"{side}_{joint}" for side in ("left", "right") for joint in ARM),
    ),
}
"""The maker's order of motors, by series: quadrupeds; humanoids (G1)."""
STATES = {"q": "q", "dq": "dq", "tau": "tau_est"}
COMMANDS = {"q_des": "q", "dq_des": "dq", "tau_ff": "tau", "kp": "kp", "kd": "kd"}


def mapping(schema: str, topic: str, robot: Robot) -> dict[str, Any]:
    """Return where the signals are, of the joints whose names show which motor is theirs."""
    order = ORDERS["go" if schema.startswith("unitree_go") else "hg"]
    own = {name: name.removesuffix("_joint") for name in robot.joint_names}
    joints = {name: order.index(short) for name, short in own.items() if short in order}
    array, signals = ("motor_state", STATES) if schema.endswith("State") else ("motor_cmd", COMMANDS)
    # without a name that shows it, the motors' order must be said: no joints, and the reason tells
    given = {"joints": joints} if joints else {}
    return {signal: {"from": topic, "field": f"{array}.{field}", **given} for signal, field in signals.items()}
