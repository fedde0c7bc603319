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
from elid_cli.model.coordinates import coordinates_of
from elid_cli.model.effects.declared import is_soft_in_mjcf
from elid_cli.model.runs import Run
from elid_cli.robot.mjcf.held import is_held
from elid_cli.robot.robot import Robot

FINER = 4
"""MuJoCo's steps per step of elid's, whose rule is of second order and MuJoCo's of first."""


def mujoco_motion(robot: Robot, runs: Sequence[Run], offsets: Array, file: str | None = None) -> list[Array]:
    """Return the positions of every run, (N, n), simulated by MuJoCo.

    Parameters
    ----------
    robot, runs, offsets
        The robot, what it is driven by, and the torque that its drives lack, N·m (N), (n,).
    file
        An MJCF to simulate in place of the exported robot, as it stands and in steps of elid's: what a user of it gets.
        Its free base is held fixed; its shapes and actuators take no part.

    Raises
    ------
    UsageError
        MuJoCo is not installed, or does not read the file.
    """
    if importlib.util.find_spec("mujoco") is None:
        raise UsageError("--engine mujoco: MuJoCo is not installed", hint="pip install mujoco")
    import mujoco

    if file is not None:
        model = _held(mujoco, file)
        return [_stepped(mujoco, model, robot, run, offsets, 1) for run in runs]
    robot = replace(robot, source="", rotors={})
    held = tuple(spec for spec in robot.effects if is_held(robot, spec) or is_soft_in_mjcf(robot, spec))
    model = mujoco.MjModel.from_xml_string(mjcf_text(replace(robot, effects=held)))
    return [_stepped(mujoco, model, robot, run, offsets, FINER) for run in runs]


def _held(mujoco: Any, file: str) -> Any:
    """Return the model of an MJCF with its free base held fixed, without actuators and what hangs on them.

    Nothing touches anything. Shapes that make their bodies' inertia stay; others go, whose meshes may not be there.
    """
    try:
        spec = mujoco.MjSpec.from_file(file)
        free = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
        for item in (*spec.keys, *spec.sensors, *spec.actuators, *free):
            spec.delete(item)
        for geom in list(spec.geoms):
            if geom.parent.explicitinertial or geom.parent.name == "world":
                spec.delete(geom)
            else:
                geom.contype = geom.conaffinity = 0
        shown = {geom.meshname for geom in spec.geoms}
        for mesh in list(spec.meshes):
            if mesh.name not in shown:
                spec.delete(mesh)
        return spec.compile()
    except ValueError as error:
        raise UsageError(f"{file}: MuJoCo does not read it: {error}") from None


def _stepped(mujoco: Any, model: Any, robot: Robot, run: Run, offsets: Array, finer: int) -> Array:
    steps = len(run.drives.told) // (len(run.t) - 1)
    finer = 1 if run.drives.stepped else finer  # a simulator's steps are its own
    model.opt.timestep = run.dt / (steps * finer)
    if run.drives.stepped:
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    data = mujoco.MjData(model)
    links = [model.joint(name) for name in robot.joint_names]
    motors = [model.joint(name) for name, _ in _motors(robot, model)]
    at, dof = (np.array([int(item[0]) for item in got]) for got in (
        [joint.qposadr for joint in links], [joint.dofadr for joint in links]))  # fmt: skip
    own, push = (np.array([int(item[0]) for item in got]) for got in (
        [joint.qposadr for joint in motors], [joint.dofadr for joint in motors]))  # fmt: skip
    turns = np.where(own == at, 1.0, [ratio for _, ratio in _motors(robot, model)])
    n = robot.n
    x, v = run.start
    motor = coordinates_of(robot).motors
    data.qpos[own], data.qvel[push] = turns * x[motor], turns * v[motor]
    data.qpos[at], data.qvel[dof] = x[:n], v[:n]
    drives = run.drives
    kd = drives.kd
    if drives.stepped == "implicit":  # as MuJoCo takes joints' own damping
        model.dof_damping[push] += drives.kd / turns**2
        kd = np.zeros(n)
    found, summed = np.empty((len(run.t), n)), np.zeros(n)
    smoothed = None if drives.smoothing is None else np.array(x[motor] * 0.0 + v[motor])
    weights = 0.0 if drives.smoothing is None else -np.expm1(-model.opt.timestep / np.maximum(drives.smoothing, 1e-9))
    found[0], sampled = data.qpos[at], np.zeros(n)
    for k in range(len(run.t) - 1):
        for j in range(steps * finer):
            turned, turning = data.qpos[own] / turns, data.qvel[push] / turns
            if smoothed is not None:
                smoothed += weights * (turning - smoothed)
            damped = turning if smoothed is None else smoothed
            torque = drives.told[k * steps + j // finer] - drives.kp * turned - kd * damped
            if drives.ki is not None:
                torque -= drives.ki * summed
                summed += turned * model.opt.timestep
            if drives.held is not None:  # what was computed at the sample stays
                period = np.maximum(np.round(steps * finer / np.where(drives.held > 0, drives.held, 1.0)), 1)
                now = k * steps * finer + j + np.round((0.0 if drives.since is None else drives.since) * steps * finer)
                sampled = np.where((now % period == 0) | (k + j == 0), torque, sampled)
                torque = np.where(drives.held > 0, sampled, torque)
            data.qfrc_applied[push] = (np.clip(torque, -drives.limit, drives.limit) - offsets) / turns
            mujoco.mj_step(model, data)
        found[k + 1] = data.qpos[at]
    return found


def _motors(robot: Robot, model: Any) -> list[tuple[str, float]]:
    """Return the model's joint that each motor turns, a rotor's where it has one, and its turns per joint turn."""
    names = {model.joint(k).name for k in range(model.njnt)}
    rotors = {j.name: (f"{j.name}_rotor", j.gear_ratio or 1.0) for j in robot.joints} | dict(robot.rotors)
    return [rotors[name] if rotors[name][0] in names else (name, 1.0) for name in robot.joint_names]
