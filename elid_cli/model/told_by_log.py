"""What a log told the drives, or which torque drove the joints."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording


def told_by_log(
    recording: Recording, robot: Robot, *, commanded: bool
) -> tuple[Array, tuple[Array, Array] | None, Array, Array]:
    """Return kp q_des + kd dq_des + tau_ff of every sample, the first two, and the gains, (N, n) each.

    Where measured torques drive the robot (not `commanded`) these, and no gains.

    Raises
    ------
    LogError
        The log lacks what drives a joint.
    """
    if not commanded:
        check_any(recording.tau, robot, "torque")
        none = np.zeros_like(recording.tau)
        return recording.tau, None, none, none
    logged = {name: recording.commands.get(name) for name in ("q_des", "dq_des", "tau_ff", "kp", "kd")}
    missing = [name for name in ("q_des", "kp", "kd") if logged[name] is None]
    if missing:
        raise LogError(
            f"the log holds no {' and no '.join(missing)}",
            hint=f"give the gains with --kp and --kd, or as control: {robot.place_to_say}",
        )
    for name in ("q_des", "kp", "kd"):
        check_any(logged[name], robot, name)
    known = {name: np.zeros_like(recording.q) if v is None else np.nan_to_num(v) for name, v in logged.items()}
    wanted = logged["q_des"]
    parts = known["kp"] * (np.nan if wanted is None else wanted), known["kd"] * known["dq_des"]
    return parts[0] + parts[1] + known["tau_ff"], parts, known["kp"], known["kd"]


def check_any(values: Array | None, robot: Robot, what: str) -> None:
    """Refuse a log without any value of a joint (LogError)."""
    for k, name in enumerate(robot.joint_names):
        if values is None or np.isnan(values[:, k]).all():
            raise LogError(f"{name} has no {what} in this log: it cannot be replayed")


def either(one: Array | None, other: Array | None) -> Array:
    """Return a signal, joints that lack it from another one."""
    if one is None or other is None:
        found = other if one is None else one
        return np.full((1, 1), np.nan) if found is None else found
    return np.where(np.isnan(one).all(axis=0), other, one)
