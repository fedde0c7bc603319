"""Logs of the paper's planar robot: friction of eq. (43)-(44), B-spline motion, quantised encoders, noise by SN."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.classical import RateNoise, identify_paper
from elid_cli.estimation.identify import EstimateOptions, Identification, identify
from elid_cli.experiment.reference import ReferenceOptions
from elid_cli.experiment.simulation import ControlOptions, Simulation, SimulationOptions, run
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare

Array = NDArray[np.float64]

FRICTION = np.array(
    [[0.1434, 0.3302, 0.2499, 0.0537, 0.2991, 16.624], [0.1391, 0.3576, 0.2451, 0.1073, 0.3389, 10.097]]
)
"""Eq. (44): f1...f6 of joints 1 and 2."""
COUNTS = 1.25e6
STATES = ("q", "dq", "ddq", "theta", "dtheta", "ddtheta")


def with_friction(robot: Robot, *, known: bool) -> Robot:
    """Return the robot with the Stribeck terms of eq. (43): their values, or only that they exist."""
    specs = []
    for joint, f in zip(robot.joint_names, FRICTION, strict=True):
        for amplitude, velocity, exponent in ((-f[2], f[3], 1.0), (-f[4], 1.0 / f[5], -1.0)):
            given = {"amplitude": amplitude, "velocity": velocity} if known else {"velocity": 0.1}
            specs.append(EffectSpec("stribeck", joint, {**given, "exponent": exponent}))
    return replace(robot, effects=tuple(specs))


def motion_of(robot: Robot, seed: int, duration: float = 8.9) -> Simulation:
    """Simulate a B-spline motion under PD control at 1 kHz, exact positions."""
    options = SimulationOptions(
        duration=duration,
        seed=seed,
        reference=ReferenceOptions(amplitude=0.75, interval=1.1),
        control=ControlOptions(continuous=True),
    )
    return run(robot, options)


def quantised(values: Array) -> Array:
    """Return positions as an encoder of 1.25 M counts reads them."""
    step = 2 * np.pi / COUNTS
    return np.round(values / step) * step


def noise_of(values: Array, level: float | None) -> Array:
    """Return the standard deviation of noise at a signal-to-noise ratio in dB, (n,)."""
    return np.zeros(values.shape[1]) if level is None else values.std(axis=0) * 10 ** (-level / 20)


def log_of(
    simulation: Simulation, level: float | None, seed: int, *, rates: bool
) -> tuple[Recording, tuple[Array, Array] | None]:
    """Return a noisy log; with `rates`, noise is on q, q' and q'' separately, as the paper words it."""
    generator = np.random.default_rng(seed)
    noisy = {}
    for name in STATES:
        exact = getattr(simulation.motion, name)
        noisy[name] = exact + noise_of(exact, level) * generator.standard_normal(exact.shape)
    recording = replace(simulation.recording, q=quantised(noisy["q"]), theta=quantised(noisy["theta"]))
    if not rates:
        return replace(recording, dq=None, dtheta=None), None
    return replace(recording, dq=noisy["dq"], dtheta=noisy["dtheta"]), (noisy["ddq"], noisy["ddtheta"])


def by_paper(robot: Robot, simulation: Simulation, level: float | None, seed: int, *, rates: bool) -> Identification:
    """Identify by the paper's estimator."""
    recording, _ = log_of(simulation, None if rates else level, seed, rates=False)
    spread = {name: noise_of(getattr(simulation.motion, name), level) for name in STATES}
    noise = RateNoise(spread, seed) if rates else None
    return identify_paper(robot, prepare(recording, robot), EstimateOptions(estimator="paper"), noise)


def by_elid(
    robot: Robot, simulation: Simulation, level: float | None, seed: int, *, rates: bool, accurate: bool = False,
    fit: Literal["torque", "trajectory"] = "torque",
) -> Identification:  # fmt: skip
    """Identify by the default estimator, the accurate one, or the trajectory fit."""
    recording, accelerations = log_of(simulation, level, seed, rates=rates)
    signals = prepare(recording, robot, SignalOptions(), accelerations)
    return identify(robot, signals, EstimateOptions(accurate=accurate, fit=fit, guards=False))
