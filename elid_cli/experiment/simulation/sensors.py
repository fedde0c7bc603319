"""What the logger sees of a simulated motion: noise, quantisation, which signals are recorded."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import check_fields, flag, names, number, optional
from elid_cli.errors import UsageError, did_you_mean
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.recording import LINK_SENSORS

CHANNELS = ("q", "theta", "tau", "dq", "dtheta", "tau_link", "temperature", "gyro", "accel")
"""Signals in the order of their random streams; a new one goes to the end, or the bytes of old seeds change."""


_SIZE, _COUNTS = number(least=0), optional(number(above=0))
_RULES = {
    "noise_db": optional(number(endless=True)),
    "position_noise": _SIZE,
    "velocity_noise": _SIZE,
    "counts": _COUNTS,
    "motor_counts": _COUNTS,
    "motor_side": flag,
    "torque_noise": _SIZE,
    "torque_noise_relative": _SIZE,
    "torque_correlation": _SIZE,
    "velocities": flag,
    "tau_link": flag,
    "temperature": flag,
    "gyro": names,
    "gyro_noise": _SIZE,
    "accel": names,
    "accel_noise": _SIZE,
}
"""Of the fields of `SensorOptions`; an infinite ratio of signal to noise is no noise."""


@dataclass(frozen=True)
class SensorOptions:
    """Sensors of the log; everything is off by default.

    Noise is white and Gaussian; it is added before quantisation. Sizes are joint-side, one number for all joints.
    """

    noise_db: float | None = None
    """Signal-to-noise ratio of positions and velocities, dB of each channel's own rms (80 dB: 1e-4 of it)."""
    position_noise: float = 0.0
    """Standard deviation added to positions, rad or m."""
    velocity_noise: float = 0.0
    """Standard deviation added to measured velocities, rad/s or m/s."""
    counts: float | None = None
    """Counts per turn (per m for a prismatic joint) of the encoders; None: not quantised."""
    motor_counts: float | None = None
    """Counts of the motor encoders where they differ, per turn of the motor (`motor_side`) or of the joint."""
    motor_side: bool = False
    """Whether motor encoders count on the motor's side of the gear, which divides their step by the gear ratio."""
    torque_noise: float = 0.0
    """Standard deviation added to torques, N·m."""
    torque_noise_relative: float = 0.0
    """Standard deviation added to torques, as a share of each channel's rms."""
    torque_correlation: float = 0.0
    """Correlation time of the torque noise, s; 0: white. Coloured noise is first-order autoregressive."""
    velocities: bool = False
    """Whether velocities are logged."""
    tau_link: bool = False
    """Whether a torque sensor behind the gear is logged."""
    temperature: bool = False
    """Whether motor temperatures are logged (a warm-up that follows the friction losses)."""
    gyro: tuple[str, ...] = ()
    """Joints whose links carry a gyroscope, mounted in any direction and with a bias, as the seed has it."""
    gyro_noise: float = 0.0
    """Standard deviation added to its rates, rad/s."""
    accel: tuple[str, ...] = ()
    """Joints whose links carry an accelerometer, near the link's origin, as the seed has it, with direction and bias.
    It is a sensor of its own: beside a gyroscope it is mounted in another direction."""
    accel_noise: float = 0.0
    """Standard deviation added to its readings, m/s²."""

    def __post_init__(self) -> None:
        """Refuse noise and encoders that no sensor has (UsageError)."""
        check_fields(self, _RULES)


BIAS = {"gyroscope": 0.01, "accelerometer": 0.05}
"""Standard deviation of a sensor's bias, rad/s and m/s²."""
REACH = 0.1
"""m from the origin of a link's frame within which its accelerometer is."""
AXES = 3


def measured(robot: Robot, signals: dict[str, Array], dt: float, options: SensorOptions, seed: int) -> dict[str, Array]:
    """Return the logged channels, shape (N, n) each, from the exact ones.

    Parameters
    ----------
    robot
        Gear ratios and joint types.
    signals
        ``q``, ``theta``, ``tau``, ``dq``, ``dtheta``, ``tau_link`` and perhaps ``temperature``.
    dt
        Sample time, s.
    options
        The sensors.
    seed
        The same seed gives the same noise; every channel has its own stream.

    Raises
    ------
    UsageError
        An encoder with no counts.

    """
    wanted = ["q", "theta", "tau"]
    wanted += ["dq", "dtheta"] if options.velocities else []
    wanted += ["tau_link"] if options.tau_link else []
    wanted += ["temperature"] if options.temperature and "temperature" in signals else []
    logged: dict[str, Array] = {}
    for name in wanted:
        generator = np.random.default_rng([seed, 1 + CHANNELS.index(name)])
        logged[name] = signals[name] + _noise(name, signals[name], dt, options, generator)
    for name in ("q", "theta"):
        step = _steps(robot, name, options)
        if step is not None:
            logged[name] = np.round(logged[name] / step) * step
    # the gear of a rigid joint has one shaft, whichever encoder is read
    rigid = ~robot.elastic
    for link, motor in (("q", "theta"), ("dq", "dtheta")):
        if motor in logged and rigid.any():
            logged[link] = np.where(rigid, logged[motor], logged[link])
    return logged


def gyroscopes(robot: Robot, q: Array, dq: Array, options: SensorOptions, seed: int) -> dict[str, Array]:
    """Return what gyroscopes on links log, (N, n) by `GYRO`, of the links' exact motion, (N, n); empty without any.

    Raises
    ------
    UsageError
        No such joint.
    """
    from elid_cli.model.link_vectors import LinkRates

    joints = _carriers(robot, options.gyro, "gyroscope")
    if not joints:
        return {}
    rates = LinkRates(robot, joints).values((q, dq))
    exact = dict(zip(joints, rates.swapaxes(0, 1), strict=True))
    generator = np.random.default_rng([seed, 1 + CHANNELS.index("gyro")])
    return _mounted("gyroscope", exact, robot.n, options.gyro_noise, generator)


def accelerometers(robot: Robot, motion: Motion, options: SensorOptions, seed: int) -> dict[str, Array]:
    """Return what accelerometers on links log, (N, n) by `ACCEL`, of the links' exact motion; empty without any.

    `robot` is in the field of gravity that acted.

    Raises
    ------
    UsageError
        No such joint.
    """
    from elid_cli.model.link_vectors import LinkForces

    joints = _carriers(robot, options.accel, "accelerometer")
    if not joints:
        return {}
    stream = [seed, 1 + CHANNELS.index("accel")]
    places = np.random.default_rng([*stream, 1])
    felt = LinkForces(robot, joints).values(
        (motion.q, motion.dq, motion.ddq), np.array([_within(REACH, places) for _ in joints])
    )
    exact = dict(zip(joints, felt.swapaxes(0, 1), strict=True))
    return _mounted("accelerometer", exact, robot.n, options.accel_noise, np.random.default_rng(stream))


def _carriers(robot: Robot, names: Sequence[str], kind: str) -> list[int]:
    """Return the joints, each once, whose links carry a sensor of a kind (UsageError)."""
    unknown = next((name for name in names if name not in robot.joint_names), None)
    if unknown is not None:
        article = "an" if kind[0] in "aeiou" else "a"
        raise UsageError(f"no joint {unknown!r} for {article} {kind}", hint=did_you_mean(unknown, robot.joint_names))
    return [robot.joint_names.index(name) for name in dict.fromkeys(names)]


def _mounted(
    kind: str, exact: Mapping[int, Array], joints: int, noise: float, generator: np.random.Generator
) -> dict[str, Array]:
    """Return what sensors log that are mounted in any direction, (N, n) by axis, n `joints`.

    `exact` is what they measure in the frames of the links that carry them, (N, 3) by joint; `noise` its standard
    deviation.
    """
    samples = len(next(iter(exact.values())))
    logged = {axis: np.full((samples, joints), np.nan) for axis in LINK_SENSORS[kind]}
    for joint, values in exact.items():
        turn, upper = np.linalg.qr(generator.standard_normal((AXES, AXES)))
        turn = turn * np.sign(np.diag(upper))
        turn[:, 0] *= np.linalg.det(turn)
        own = values @ turn.T + BIAS[kind] * generator.standard_normal(AXES)
        own += noise * generator.standard_normal(own.shape)
        for axis, column in zip(logged.values(), own.T, strict=True):
            axis[:, joint] = column
    return logged


def _within(reach: float, generator: np.random.Generator) -> list[float]:
    """Return a place that is anywhere in a ball of radius `reach` about the origin alike, (3,)."""
    towards = generator.standard_normal(AXES)
    place: list[float] = (reach * np.cbrt(generator.uniform()) / np.linalg.norm(towards) * towards).tolist()
    return place


def _noise(name: str, exact: Array, dt: float, options: SensorOptions, generator: np.random.Generator) -> Array:
    white = generator.standard_normal(exact.shape)
    rms = np.sqrt(np.mean(np.square(np.nan_to_num(exact)), axis=0))  # NaN: no such sensor at the joint
    if name in ("tau", "tau_link"):
        size = np.hypot(options.torque_noise, options.torque_noise_relative * rms)
        return np.asarray(size * _coloured(white, dt, options.torque_correlation))
    if name == "temperature":
        return np.zeros_like(exact)
    absolute = options.position_noise if name in ("q", "theta") else options.velocity_noise
    relative = 0.0 if options.noise_db is None else 10 ** (-options.noise_db / 20)
    return np.asarray(np.hypot(absolute, relative * rms) * white)


def _coloured(white: Array, dt: float, correlation: float) -> Array:
    """Return first-order autoregressive noise of unit variance from white noise."""
    if correlation <= 0:
        return white
    from scipy.signal import lfilter

    pole = math.exp(-dt / correlation)
    driven = white * math.sqrt(1 - pole * pole)
    driven[0] = white[0]  # stationary from the first sample on
    return np.asarray(lfilter([1.0], [1.0, -pole], driven, axis=0))


def _steps(robot: Robot, name: str, options: SensorOptions) -> Array | None:
    """Return the encoder's step at every joint, rad or m, shape (n,); None where not quantised."""
    counts = options.counts
    if name == "theta" and options.motor_counts is not None:
        counts = options.motor_counts
    if counts is None:
        return None
    if not counts > 0:
        raise UsageError(f"an encoder with {counts:g} counts per turn")
    turn = np.array([2 * math.pi if joint.revolute else 1.0 for joint in robot.joints])
    if name == "theta" and options.motor_side:
        return 2 * math.pi / (counts * np.abs(robot.known_ratios("encoders on the motors' shafts")))
    return turn / counts
