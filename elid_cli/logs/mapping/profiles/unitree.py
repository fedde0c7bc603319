"""Unitree's low-level states and commands: motors without names, in the maker's order.

The orders are those of the enumerations in the examples of unitree_sdk2. Humanoids whose joints have the same names
have them in different orders, so a joint that only one of them has, or the robot's name, must show which it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from elid_cli.robot.robot import Robot

SCHEMAS = tuple(f"unitree_{series}/{name}" for series in ("go", "hg") for name in ("LowState", "LowCmd"))
LEGS = tuple(f"{leg}_{joint}" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf"))
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
G1_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
H1_2_LEG = ("hip_yaw", "hip_pitch", "hip_roll", "knee", "ankle_pitch", "ankle_roll")
WAIST = ("waist_yaw", "waist_roll", "waist_pitch")


def _sides(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{side}_{name}" for side in ("left", "right") for name in names)


H1 = {"right_hip_roll": 0, "right_hip_pitch": 1, "right_knee": 2, "left_hip_roll": 3, "left_hip_pitch": 4}
H1 |= {"left_knee": 5, "torso": 6, "left_hip_yaw": 7, "right_hip_yaw": 8, "left_ankle": 10, "right_ankle": 11}
H1 |= {f"{side}_{name}": first + k for side, first in (("right", 12), ("left", 16)) for k, name in enumerate(ARM[:4])}
GO = {name: k for k, name in enumerate(LEGS)} | H1
"""Motors of the quadrupeds and of the H1, whose messages are the same: no name is in both."""
G1 = {name: k for k, name in enumerate((*_sides(G1_LEG), *WAIST, *_sides(ARM)))}
H1_2 = {name: k for k, name in enumerate((*_sides(H1_2_LEG), "torso", *_sides(ARM)))}
STATES = {"q": "q", "dq": "dq", "tau": "tau_est"}
COMMANDS = {"q_des": "q", "dq_des": "dq", "tau_ff": "tau", "kp": "kp", "kd": "kd"}


def mapping(schema: str, topic: str, robot: Robot) -> dict[str, Any]:
    """Return where the signals are, of the joints whose names show which motor is theirs."""
    order = GO if schema.startswith("unitree_go") else _humanoid(robot)
    own = {name: name.removesuffix("_joint") for name in robot.joint_names}
    # without a name that shows it the motors' order must be said: no joints, and the reason tells
    joints = {name: order[short] for name, short in own.items() if short in order}
    array, signals = ("motor_state", STATES) if schema.endswith("State") else ("motor_cmd", COMMANDS)
    return {signal: {"from": topic, "field": f"{array}.{field}", "joints": joints} for signal, field in signals.items()}


def _humanoid(robot: Robot) -> Mapping[str, int]:
    """Return the order of a humanoid's motors; empty where neither its name nor its joints show which one it is."""
    names = {name.removesuffix("_joint") for name in (*robot.joint_names, *robot.held)}
    called = robot.name.lower().replace("-", "_")
    if called.startswith("h1_2") or "torso" in names:
        return H1_2
    if called.startswith("g1") or (names & set(WAIST) and not any(name.startswith("head") for name in names)):
        return G1
    return {}
