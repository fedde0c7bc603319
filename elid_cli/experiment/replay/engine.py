"""Replay through MuJoCo: the exported model under the same drives, as a check that it moves as elid's does."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import UsageError
from elid_cli.experiment.mjcf import mjcf_text
from elid_cli.model.rollout import coordinates_of
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

FINER = 4
"""MuJoCo's steps per step of elid's, whose rule is of second order and MuJoCo's of first."""


def mujoco_motion(robot: Robot, runs: Sequence[Run], offsets: Array) -> list[Array]:
    """Return the positions of every run, (N, n), simulated by MuJoCo.

    Raises
    ------
    UsageError
        MuJoCo is not installed.
    """
    if importlib.util.find_spec("mujoco") is None:
        raise UsageError("--engine mujoco: MuJoCo is not installed", hint="pip install mujoco")
    import mujoco

    model = mujoco.MjModel.from_xml_string(mjcf_text(replace(robot, effects=())))
    return [_stepped(mujoco, model, robot, run, offsets) for run in runs]


def _stepped(mujoco: Any, model: Any, robot: Robot, run: Run, offsets: Array) -> Array:
    steps = len(run.drives.told) // (len(run.t) - 1)
    model.opt.timestep = run.dt / (steps * FINER)
    data = mujoco.MjData(model)
    links = [model.joint(name) for name in robot.joint_names]
    motors = [model.joint(name) for name in _motor_names(robot, model)]
    at, dof = (np.array([int(item[0]) for item in got]) for got in (
        [joint.qposadr for joint in links], [joint.dofadr for joint in links]))  # fmt: skip
    own, push = (np.array([int(item[0]) for item in got]) for got in (
        [joint.qposadr for joint in motors], [joint.dofadr for joint in motors]))  # fmt: skip
    turns = np.where(own == at, 1.0, [joint.gear_ratio or 1.0 for joint in robot.joints])
    n = robot.n
    x, v = run.start
    motor = coordinates_of(robot).motors
    data.qpos[own], data.qvel[push] = turns * x[motor], turns * v[motor]
    data.qpos[at], data.qvel[dof] = x[:n], v[:n]
    drives = run.drives
    found = np.empty((len(run.t), n))
    found[0] = data.qpos[at]
    for k in range(len(run.t) - 1):
        for j in range(steps * FINER):
            turned, turning = data.qpos[own] / turns, data.qvel[push] / turns
            torque = drives.told[k * steps + j // FINER] - drives.kp * turned - drives.kd * turning
            data.qfrc_applied[push] = (np.clip(torque, -drives.limit, drives.limit) - offsets) / turns
            mujoco.mj_step(model, data)
        found[k + 1] = data.qpos[at]
    return found


def _motor_names(robot: Robot, model: Any) -> list[str]:
    """Return the joint of the exported model that each motor turns: a rotor of its own where the joint is elastic."""
    names = {model.joint(k).name for k in range(model.njnt)}
    return [rotor if (rotor := f"{joint.name}_rotor") in names else joint.name for joint in robot.joints]
