"""Logs of arms with joint torque sensors, simulated once and shared by the tests of this folder.

The motion is integrated without noise; noise, and what acts in the log or in the motors' torque alone, is added to it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from elid_cli.experiment.simulation import Simulation, SimulationOptions, run
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording

FRICTION = ({"fs": 6.0, "fv": 2.0}, {"fs": 3.0, "fv": 1.0})
POSITION_NOISE, TORQUE_NOISE, READING_NOISE = 3e-5, 0.01, 0.003
STRIBECK, STRIBECK_SPEED = 2.0, 0.1
WIDTH = SimulationOptions().friction_width


def planar() -> Robot:
    """Return planar2 with friction that matters."""
    robot = read_robot("planar2")
    joints = zip(robot.joints, FRICTION, strict=True)
    return replace(robot, joints=tuple(replace(j, parameters={**j.parameters, **more}) for j, more in joints))


def shoulder() -> Robot:
    """Return the first three joints of the PUMA 560, all elastic: an arm that moves in space."""
    robot = read_robot("puma560")
    return replace(robot, name="shoulder", joints=robot.joints[:3])


@cache
def motion(arm: str = "planar", hysteresis: float = 0.0) -> Simulation:
    """Return 8 s of motion, exact; 3 s with hysteresis, whose state takes long to integrate."""
    robot = planar() if arm == "planar" else shoulder()
    if hysteresis:
        spec = EffectSpec("hysteresis", "joint1", {"torque": hysteresis, "distance": 1e-3})
        robot = replace(robot, effects=(spec,))
    return run(robot, SimulationOptions(duration=3.0 if hysteresis else 8.0, rate=500.0, seed=5))


def logged(
    arm: str = "planar",
    seed: int = 1,
    hysteresis: float = 0.0,
    stribeck: float = 0.0,
    gain: tuple[float, ...] = (),
    offset: tuple[float, ...] = (),
) -> Recording:
    """Return a log with sensors' noise; `stribeck` acts on joint1, `gain` and `offset` in the readings, per joint."""
    made = motion(arm, hysteresis)
    log = made.recording
    generator = np.random.default_rng(seed)

    def noisy(values: np.ndarray, size: float | np.ndarray) -> np.ndarray:
        return values + size * generator.standard_normal(values.shape)

    tau = log.tau.copy()
    speed = made.motion.dtheta[:, 0]
    tau[:, 0] += stribeck * np.tanh(speed / WIDTH) * np.exp(-np.abs(speed) / STRIBECK_SPEED)
    reading = made.tau_link * (1 + np.array(gain or (0.0,))) + np.array(offset or (0.0,))
    return replace(
        log,
        q=noisy(log.q, POSITION_NOISE),
        theta=noisy(log.theta, POSITION_NOISE),
        tau=noisy(tau, TORQUE_NOISE * tau.std(axis=0)),
        tau_link=noisy(reading, READING_NOISE * reading.std(axis=0)),
    )


def without_sensors(log: Recording) -> Recording:
    """Return the log as a robot without torque sensors would have written it."""
    return replace(log, tau_link=None)
