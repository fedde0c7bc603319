"""Logs of planar2 that hold known effects, made from one simulated motion.

A friction in the motor row changes the motor torque and, under a controller that compensates it, nothing else; a
transmission error changes the motor's angle and what its inertia and friction take. So the equations of motion hold
exactly, and no log but the first has to be integrated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from elid_cli.diagnosis import Diagnosis
from elid_cli.experiment import simulation
from elid_cli.experiment.simulation.sensors import SensorOptions, measured
from elid_cli.logs import write_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording, Segment

Logs = Callable[..., Recording]
Diagnosed = Callable[..., Diagnosis]
STRIBECK, STRIBECK_SPEED = 2.0, 0.1
LOAD = 0.05
SKEW = -0.003
ERROR, ORDER, PHASE = 4e-4, 6.0, 0.5
EFFECTS = {
    "stribeck": ("joint1", {"amplitude": STRIBECK, "velocity": STRIBECK_SPEED}),
    "load_friction": ("joint2", {"coefficient": LOAD}),
    "encoder_skew": ("joint1", {"skew": SKEW}),
    "kinematic_error": ("joint1", {"amplitude": ERROR, "order": ORDER}),
}
WIDTH = simulation.SimulationOptions().friction_width


def arm() -> Robot:
    """Return planar2 with friction that matters."""
    robot = read_robot("planar2")
    friction = ({"fs": 6.0, "fv": 2.0}, {"fs": 3.0, "fv": 1.0})
    joints = [
        dataclasses.replace(joint, parameters={**joint.parameters, **values})
        for joint, values in zip(robot.joints, friction, strict=True)
    ]
    return dataclasses.replace(robot, joints=tuple(joints), effects=())


def moved(robot: Robot, duration: float, seed: int) -> simulation.Simulation:
    """Return the one simulated motion, without sensors' noise."""
    return simulation.run(robot, simulation.SimulationOptions(duration=duration, seed=seed, rate=500.0))


def log_with(robot: Robot, run: simulation.Simulation, effects: Iterable[str], seed: int = 1) -> Recording:
    """Return a log of that motion at 90 dB in which some of `EFFECTS` act."""
    motion, dt = run.motion, run.recording.dt
    q, theta, tau = motion.q.copy(), motion.theta.copy(), run.recording.tau.copy()
    stiffness = np.array([joint.parameters["K"] for joint in robot.joints])
    speed = motion.dtheta
    direction = np.tanh(speed / WIDTH)
    for effect in effects:
        k = robot.joint_names.index(EFFECTS[effect][0])
        if effect == "stribeck":
            tau[:, k] += STRIBECK * direction[:, k] * np.exp(-np.abs(speed[:, k]) / STRIBECK_SPEED)
        elif effect == "load_friction":
            tau[:, k] += LOAD * direction[:, k] * np.abs(stiffness[k] * (motion.theta - motion.q)[:, k])
        elif effect == "encoder_skew":
            q[:, k] = CubicSpline(motion.t, motion.q[:, k])(np.maximum(motion.t - SKEW, 0.0))
        elif effect == "kinematic_error":
            theta[:, k], tau[:, k] = _with_error(robot, run, k)
    signals = {"q": q, "theta": theta, "tau": tau, "dq": motion.dq, "dtheta": speed, "tau_link": run.tau_link}
    logged = measured(robot, signals, dt, SensorOptions(noise_db=90.0), seed)
    whole = (Segment(0, len(motion.t)),)
    return dataclasses.replace(
        run.recording, q=logged["q"], theta=logged["theta"], tau=logged["tau"], segments=whole, files=(), sources={}
    )


def _with_error(robot: Robot, run: simulation.Simulation, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return motor angle and torque of joint k when its transmission errs by ERROR sin(ORDER theta + PHASE)."""
    assert k == 0, "the rotors of the other joints push bodies that move"
    motion, values = run.motion, robot.joints[k].parameters
    inertia = values["Jm"] * robot.joints[k].gear_ratio ** 2
    theta = motion.theta[:, k]
    for _ in range(20):
        theta = motion.theta[:, k] + ERROR * np.sin(ORDER * theta + PHASE)
    slope = 1.0 - ERROR * ORDER * np.cos(ORDER * theta + PHASE)
    bend = ERROR * ORDER**2 * np.sin(ORDER * theta + PHASE)
    speed = motion.dtheta[:, k] / slope
    acceleration = (motion.ddtheta[:, k] - bend * speed**2) / slope
    more = inertia * (acceleration - motion.ddtheta[:, k]) + values["fv"] * (speed - motion.dtheta[:, k])
    more += values["fs"] * (np.tanh(speed / WIDTH) - np.tanh(motion.dtheta[:, k] / WIDTH))
    return theta, run.recording.tau[:, k] + more


def written(folder: Path, name: str, recording: Recording) -> str:
    """Write a log and return its name."""
    write_recording(recording, str(folder / name))
    return name
