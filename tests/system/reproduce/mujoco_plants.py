"""Public robots under commands with MuJoCo as the plant: two arms, a biped's leg and a biped, drives drawn at random.

MuJoCo reads the public file itself and steps it by Runge and Kutta every tenth of a millisecond. Its friction loss is
soft: a joint turns after its friction does, and creeps where it rests: by default, below some hundredths of
a radian per second. At twice the step, as stiff as MuJoCo allows, friction still turns by the step too early, and
the truth would be another than drives and friction say, by up to a quarter of a percent. So steps are five times
shorter, and friction as much stiffer, wherever a joint is slow. Plants may have the default instead, as most users' do:
the force is at most the friction loss F, and below that it is ``D (v' + v / lead)``, with D the inertia that MuJoCo
takes the joint to have times d / (1 - d) of ``solimpfriction``.

elid sees the same file without drive parameters, and a log of commands, gains and positions of encoders. Rates, delays
of commands, encoders and gains differ from log to log. The robots come with the extra ``robots``.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli.logs.writing import write_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.locking import beside_chain, locked
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording, Segment

STEP = 1e-4
"""s; MuJoCo's step …"""
SHORTER = 5
"""… and how many it takes instead where a joint is slow."""
SECONDS = 16.0
RATES = (200, 400, 1000)
"""Hz."""
DELAYS = (0.0, 0.002, 0.006)
"""s; by which commands act late."""
BITS = (14, 17, 20)
"""Of the encoders, per turn of the joint."""


@dataclass(frozen=True)
class Kind:
    """A public robot and the size of its drives."""

    file: str
    tip: str | None
    lock: dict[str, float]
    reach: float
    """Amplitude of the motion, rad."""
    first: tuple[float, float]
    """Frequencies between which position loops are set, Hz."""


KINDS = {
    "ur5": Kind("ur5_robot.urdf", None, {}, 0.2, (3.0, 5.0)),
    "z1": Kind("z1.urdf", None, {"jointGripper": 0.0}, 0.5, (3.0, 6.0)),
    "g1 leg": Kind("g1_29dof_rev_1_0.urdf", "left_ankle_roll_link", {}, 0.35, (4.0, 7.0)),
    "bolt": Kind("bolt.urdf", None, {}, 0.4, (4.0, 7.0)),
}
FURTHER = {
    "ur3": Kind("ur3_robot.urdf", None, {}, 0.3, (3.0, 5.0)),
    "ur10": Kind("ur10_robot.urdf", None, {}, 0.2, (3.0, 5.0)),
}
"""Robots that only logs with MuJoCo's default friction are made of."""


@dataclass(frozen=True)
class Drives:
    """What the plant's joints have, each (n,): the truth."""

    armature: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    offset: np.ndarray
    kp: np.ndarray
    kd: np.ndarray

    @property
    def truth(self) -> np.ndarray:
        """Return inertia, Coulomb, viscous friction and offset, (n, 4)."""
        return np.stack([self.armature, self.coulomb, self.viscous, self.offset], axis=1)


@dataclass(frozen=True)
class State:
    """A joint of the plant at one instant, SI."""

    x: float
    v: float
    load: float
    """Torque that the bodies need, N·m."""


@dataclass(frozen=True)
class Extra:
    """What one joint has beyond the model: a torque that it needs, Coulomb friction, of its state, a lower limit."""

    joint: int
    push: Callable[[State], float] | None = None
    grip: Callable[[State], float] | None = None
    limit: float | None = None
    """Largest torque of its drive, N·m."""


@dataclass(frozen=True)
class Plant:
    """A robot as MuJoCo has it, and as elid reads it."""

    kind: Kind
    robot: Robot
    model: Any
    address: np.ndarray
    """Degree of freedom of every joint, (n,)."""
    soft: bool = False
    """Whether its friction is MuJoCo's default."""


def plant_of(name: str, *, soft: bool = False) -> Plant:
    """Return a robot of the public packages, its other joints held at 0; `soft`: with MuJoCo's default friction."""
    import mujoco

    kind = (KINDS | FURTHER)[name]
    listed = importlib.metadata.files("example-robot-data") or []
    path = next(Path(str(f.locate())) for f in listed if f.name == kind.file)
    read = read_robot(path)
    held = dict.fromkeys(beside_chain(read, kind.tip) if kind.tip else (), 0.0) | kind.lock
    read = locked(read, held)
    robot = replace(read, joints=tuple(replace(j, transmission="rigid") for j in read.joints))
    spec = mujoco.MjSpec.from_file(str(path))
    spare = [joint for joint in spec.joints if joint.name not in robot.joint_names]
    for item in (*spec.keys, *spec.sensors, *spec.actuators, *spec.geoms, *spec.meshes, *spare):
        spec.delete(item)
    for joint in spec.joints:
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    # fused into the body that they are fixed to, massless links (a foot of bolt) would lose their inertia
    spec.compiler.fusestatic = False
    spec.option.timestep = STEP
    spec.option.gravity = list(robot.gravity)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for joint in robot.joints:
        drive = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.biastype, drive.gainprm[0] = mujoco.mjtBias.mjBIAS_AFFINE, 1.0
        if joint.limits.torque is not None:
            drive.forcelimited, drive.forcerange = (
                mujoco.mjtLimited.mjLIMITED_TRUE,
                [-joint.limits.torque, joint.limits.torque],
            )
    model = spec.compile()
    if not soft:
        model.dof_solimp[:, :2] = 0.999
    address = np.array([int(model.joint(joint).dofadr[0]) for joint in robot.joint_names])
    return Plant(kind, robot, model, address, soft)


def drawn(plant: Plant, rng: np.random.Generator) -> Drives:
    """Return drives of a size that suits the bodies."""
    import mujoco

    n, kind = plant.robot.n, plant.kind
    body, torque = np.zeros(n), np.zeros(n)
    data = mujoco.MjData(plant.model)
    full = np.zeros((plant.model.nv, plant.model.nv))
    plant.model.dof_armature[:] = 0.0
    for q in rng.uniform(-kind.reach, kind.reach, (20, n)):
        data.qpos[plant.address] = q
        mujoco.mj_forward(plant.model, data)
        mujoco.mj_fullM(plant.model, data, full)
        body += np.diag(full)[plant.address] / 20
        torque += np.abs(data.qfrc_bias[plant.address]) / 20
    armature = np.maximum(body, 0.02 * body.max()) * rng.uniform(0.3, 1.0, n)
    total = body + armature
    usual = torque + total * (2 * np.pi * 0.7) ** 2 * kind.reach
    coulomb = usual * rng.uniform(0.1, 0.3, n)
    viscous = usual * rng.uniform(0.05, 0.2, n) / (2 * np.pi * 0.5 * kind.reach)
    natural = 2 * np.pi * rng.uniform(*kind.first, n)
    stiffness = total * natural**2
    return Drives(armature, coulomb, viscous, coulomb * rng.uniform(-0.5, 0.5, n), stiffness,
                  2 * rng.uniform(0.4, 0.8, n) * total * natural)  # fmt: skip


def wanted(plant: Plant, rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """Return commanded positions, (N, n): a chirp and two sines of every joint, rising from rest."""
    n, reach = plant.robot.n, plant.kind.reach
    phase, slow = rng.uniform(0, 2 * np.pi, (3, n)), rng.uniform(1.2, 2.6, n)
    chirp = 2 * np.pi * (0.2 * t + 0.5 * 1.8 * t**2 / SECONDS)
    parts = (
        0.4 * np.sin(chirp[:, None] + phase[0])
        + 0.45 * np.sin(slow * t[:, None] + phase[1])
        + 0.15 * np.sin(2.7 * slow * t[:, None] + phase[2])
    )
    q: np.ndarray = reach * parts * np.minimum(1.0, t / 0.5)[:, None]
    return q


def logged(
    plant: Plant, number: int, extra: Callable[[Drives], Extra] | None = None
) -> tuple[Recording, Drives, float]:
    """Return log `number` of a plant, its drives and the delay of its commands, s; `extra` is added to the drives."""
    rng = np.random.default_rng([number, plant.robot.n, len(plant.robot.name)])
    drives = drawn(plant, rng)
    rate, late, bits = (of[int(rng.integers(len(of)))] for of in (RATES, DELAYS, BITS))
    dt = 1.0 / rate
    t = dt * np.arange(round(SECONDS * rate) + 1)
    q_des = wanted(plant, rng, t)
    dq_des = np.gradient(q_des, dt, axis=0)
    q = _stepped(plant, drives, (q_des, dq_des), round(dt / STEP), late,
                 None if extra is None else extra(drives))  # fmt: skip
    lsb = 2 * np.pi / 2**bits
    q = lsb * np.round((q + 0.5 * lsb * rng.standard_normal(q.shape)) / lsb)
    gains = {"kp": np.tile(drives.kp, (len(t), 1)), "kd": np.tile(drives.kd, (len(t), 1))}
    recording = Recording(
        joints=plant.robot.joint_names, dt=dt, t=t, q=q, theta=q, tau=np.full_like(q, np.nan),
        commands={"q_des": q_des, "dq_des": dq_des, **gains}, segments=(Segment(0, len(t)),), files=("made.h5",),
    )  # fmt: skip
    return recording, drives, late


def _stepped(
    plant: Plant, drives: Drives, told: tuple[np.ndarray, np.ndarray], fine: int, late: float, extra: Extra | None
) -> np.ndarray:
    """Return the positions at the instants of commands, (N, n)."""
    import mujoco

    model, at = plant.model, plant.address
    model.dof_armature[at], model.dof_frictionloss[at] = drives.armature, drives.coulomb
    model.dof_damping.reshape(model.nv, -1)[at, 0] = drives.viscous
    data = mujoco.MjData(model)
    if plant.soft:  # how soft MuJoCo makes friction goes with the inertia that it knows, as of a file with armatures
        mujoco.mj_setConst(model, data)
    data.qpos[at] = told[0][0]
    found = np.empty_like(told[0])
    found[0] = data.qpos[at]
    shift, held = round(late / STEP), np.zeros(model.nv)
    model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = -drives.kp, -drives.kd
    commands = drives.kp * told[0] + drives.kd * told[1]
    known = model.actuator_forcelimited.copy(), model.actuator_forcerange.copy()
    if extra is not None and extra.limit is not None:
        drive = model.actuator(plant.robot.joint_names[extra.joint]).id
        model.actuator_forcelimited[drive], model.actuator_forcerange[drive] = True, (-extra.limit, extra.limit)
    torque, taken = -drives.offset, 0
    for k in range((len(found) - 1) * fine):
        data.ctrl[:] = commands[max(k - shift, 0) // fine]
        if extra is not None:
            j = extra.joint
            mujoco.mj_mulM(model, data, held, data.qacc)
            load = held[at[j]] - drives.armature[j] * data.qacc[at[j]] + data.qfrc_bias[at[j]]
            state = State(float(data.qpos[at[j]]), float(data.qvel[at[j]]), float(load))
            if extra.push is not None:
                torque[j] = -drives.offset[j] - extra.push(state)
            if extra.grip is not None:
                model.dof_frictionloss[at[j]] = max(drives.coulomb[j] + extra.grip(state), 0.0)
        data.qfrc_applied[at] = torque
        speed, change = np.abs(data.qvel[at]), np.abs(data.qacc[at])
        slow = not plant.soft and bool((speed < STEP * (2 * change + 4 * drives.coulomb / drives.armature)).any())
        each = SHORTER if slow else 1
        if each != taken:
            taken, model.opt.timestep = each, STEP / each
            if not plant.soft:
                model.dof_solref[:, 0] = 2 * STEP / each
        mujoco.mj_step(model, data, nstep=each)
        if (k + 1) % fine == 0:
            found[(k + 1) // fine] = data.qpos[at]
    model.actuator_forcelimited[:], model.actuator_forcerange[:] = known
    return found


def computed_torque(recording: Recording) -> np.ndarray:
    """Return the torque that the commands of a log ask for, N·m, (N, n)."""
    told = recording.commands
    error, rate = told["q_des"] - recording.q, told["dq_des"] - np.gradient(recording.q, recording.dt, axis=0)
    found: np.ndarray = told["kp"] * error + told["kd"] * rate
    return found


def written(folder: Path, recording: Recording) -> str:
    """Write a log with its commands and gains, and return its path."""
    path = folder / "log.h5"
    write_recording(recording, path)
    return str(path)
