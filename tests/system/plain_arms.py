"""A second simulator: planar arms in a vertical plane, sharing no code with elid's dynamics.

The link angles follow Fourier series of one period, so that every derivative is exact; the bodies' equations in
absolute angles give the torque through each transmission, that torque the motor's angle, and the motor's equation the
motor's torque. Sensors are written here too: quantised encoders, noise with a memory, a torque that acts later than it
is logged. Only the robot file's types come from elid.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import lfilter

from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.recording import Recording, Segment

Array = np.ndarray
GRAVITY = 9.81
DENSE = 4
"""Instants per logged sample, by which a delay between samples is told."""


@dataclass(frozen=True)
class Arm:
    """A planar arm: per joint length, mass, first moment along the link, inertia about the joint, motor, gear."""

    length: Array
    mass: Array
    moment: Array
    inertia: Array
    rotor: Array
    """Rotor inertia on the motor's side of the gear, kg·m²."""
    gear: Array
    coulomb: Array
    viscous: Array
    stiffness: Array
    """N·m/rad; infinite where the joint is rigid."""

    @property
    def n(self) -> int:
        return len(self.length)

    def described(self, *, known: bool = True) -> Robot:
        """Return elid's description (distal frames, as a user would write it), with or without values."""
        joints = []
        for i in range(self.n):
            # about the frame at the far end: first moment m (x - l), inertia about that end
            far = self.moment[i] - self.mass[i] * self.length[i]
            about = self.inertia[i] - 2 * self.moment[i] * self.length[i] + self.mass[i] * self.length[i] ** 2
            elastic = bool(np.isfinite(self.stiffness[i]))
            values = {
                "m": self.mass[i], "cx": far, "cy": 0.0, "Izz": about, "Jm": self.rotor[i],
                "fs": self.coulomb[i], "fv": self.viscous[i],
            } | ({"K": self.stiffness[i]} if elastic else {})  # fmt: skip
            joints.append(
                Joint(
                    name=f"joint{i + 1}", a=float(self.length[i]), gear_ratio=float(self.gear[i]),
                    transmission="elastic" if elastic else "rigid",
                    parameters={k: float(v) for k, v in values.items()} if known else {},
                )
            )  # fmt: skip
        return Robot(name=f"plain{self.n}", joints=tuple(joints), gravity=(0.0, -GRAVITY, 0.0))


def random_arm(generator: np.random.Generator, n: int, rigid: Sequence[int] = ()) -> Arm:
    """Return an arm of plausible sizes, heavier towards the base; `rigid` joints have no spring."""
    size = 0.55 ** np.arange(n)
    length = generator.uniform(0.3, 0.6, n) * size**0.3
    mass = generator.uniform(8, 20, n) * size
    moment = mass * length * generator.uniform(0.3, 0.6, n)
    inertia = moment**2 / mass * generator.uniform(1.2, 1.6, n)
    gear = generator.uniform(50, 120, n)
    reach = np.cumsum((inertia + mass * length**2)[::-1])[::-1]
    rotor = reach * generator.uniform(0.15, 0.6, n) / gear**2
    weight = GRAVITY * np.cumsum(moment[::-1])[::-1]
    stiffness = reach * (2 * np.pi * generator.uniform(6, 12, n)) ** 2
    stiffness[list(rigid)] = np.inf
    return Arm(
        length, mass, moment, inertia, rotor, gear, weight * generator.uniform(0.03, 0.1, n),
        weight * generator.uniform(0.02, 0.08, n), stiffness,
    )  # fmt: skip


@dataclass
class World:
    """The true motion, dense, (N, n) each."""

    arm: Arm
    t: Array
    q: Array
    dq: Array
    ddq: Array
    theta: Array
    dtheta: Array
    ddtheta: Array
    spring: Array
    """Torque through the transmissions."""


@dataclass(frozen=True)
class Sensors:
    """How the log was taken."""

    rate: float = 1000.0
    bits: float | None = 17
    """Resolution of the encoders per turn; None: no quantisation."""
    noise: float = 0.0
    """White noise of the positions beyond that, rad."""
    torque: float = 0.002
    """Noise of the torques, share of their standard deviation; one number or one per joint."""
    torques: tuple[float, ...] = ()
    """Factors on it per joint."""
    memory: float = 0.0
    """How long the torques' noise remembers, s."""
    delay: float = 0.0
    """Samples by which the torque acts later than it is logged."""
    offsets: tuple[float, ...] = ()
    """Torque offsets per joint, N·m."""
    velocities: bool = False
    jitter: float = 0.0
    """Standard deviation of the stamps, share of a sample."""


@dataclass(frozen=True)
class Laws:
    """What the plain model lacks: functions of the true motion that add to the motors' torque, (N, n)."""

    motor: Sequence[Callable[[World], Array]] = field(default_factory=tuple)


def motion(arm: Arm, seed: int, duration: float, rate: float, fast: float = 1.2, reach: float = 1.0) -> World:
    """Return a motion of `duration` seconds: Fourier series up to `fast` Hz, phases by `seed`."""
    generator = np.random.default_rng(seed)
    count = round(duration * rate) * DENSE
    period = count / (rate * DENSE)
    t = np.arange(count) / (rate * DENSE)
    spectrum = np.zeros((count // 2 + 1, arm.n), dtype=complex)
    lines = np.arange(1, max(3, int(fast * period)) + 1)
    for i in range(arm.n):
        size = (
            generator.uniform(0.3, 1.0, len(lines))
            / (1 + lines / period)
            * np.exp(2j * np.pi * generator.random(len(lines)))
        )
        spectrum[lines, i] = size / np.sqrt(np.sum(np.abs(size) ** 2)) * generator.uniform(0.5, 0.8) * reach
    frequency = 2j * np.pi * np.arange(len(spectrum))[:, None] / period

    def back(order: int) -> Array:
        return np.fft.irfft(spectrum * frequency**order, count, axis=0) * count / 2

    def rates(values: Array) -> tuple[Array, Array]:
        transformed = np.fft.rfft(values, axis=0)
        transformed[int(40 * max(fast, 1) * period) :] = 0.0  # nothing moves there: rounding only
        return tuple(np.fft.irfft(transformed * frequency**k, count, axis=0) for k in (1, 2))

    q, dq, ddq = (back(k) for k in range(3))
    spring = _bodies(arm, q, dq, ddq)
    theta, dtheta, ddtheta = q.copy(), dq.copy(), ddq.copy()
    for i in reversed(range(arm.n)):  # a link carries the rotors after it
        for later in range(i + 1, arm.n):
            carried = ddq[:, :later].sum(axis=1)
            spring[:, i] += arm.rotor[later] * (carried + arm.gear[later] * ddtheta[:, later])
        if np.isfinite(arm.stiffness[i]):
            theta[:, i] = q[:, i] + spring[:, i] / arm.stiffness[i]
            first, second = rates(theta[:, i : i + 1])
            dtheta[:, i], ddtheta[:, i] = first[:, 0], second[:, 0]
    return World(arm, t, q, dq, ddq, theta, dtheta, ddtheta, spring)


def _bodies(arm: Arm, q: Array, dq: Array, ddq: Array) -> Array:
    """Return what the bodies need of the torque at each joint, (N, n), by Lagrange's equations in absolute angles."""
    n = arm.n
    angle, speed, acceleration = (np.cumsum(v, axis=1) for v in (q, dq, ddq))
    # link i: its own inertia about its joint; lengths carry what is beyond
    beyond = np.concatenate([np.cumsum(arm.mass[::-1])[::-1][1:], [0.0]])
    force = np.zeros_like(q)
    for i in range(n):
        for j in range(n):
            inner, outer = min(i, j), max(i, j)
            if i == j:
                force[:, i] += (arm.inertia[i] + beyond[i] * arm.length[i] ** 2) * acceleration[:, i]
                continue
            coupling = arm.length[inner] * (arm.moment[outer] + beyond[outer] * arm.length[outer])
            apart = angle[:, i] - angle[:, j]
            force[:, i] += coupling * (np.cos(apart) * acceleration[:, j] + np.sin(apart) * speed[:, j] ** 2)
        force[:, i] += GRAVITY * (arm.moment[i] + beyond[i] * arm.length[i]) * np.cos(angle[:, i])
    return np.cumsum(force[:, ::-1], axis=1)[:, ::-1]


def torque(world: World, laws: Laws | None = None) -> Array:
    """Return the motors' torques, (N, n)."""
    arm = world.arm
    total = world.spring.copy()
    for i in range(arm.n):
        carried = world.ddq[:, :i].sum(axis=1)
        total[:, i] += arm.rotor[i] * arm.gear[i] * (carried + arm.gear[i] * world.ddtheta[:, i])
        total[:, i] += arm.coulomb[i] * np.sign(world.dtheta[:, i]) + arm.viscous[i] * world.dtheta[:, i]
    for law in laws.motor if laws else ():
        total += law(world)
    return total


def log(
    arm: Arm,
    seed: int = 0,
    duration: float = 20.0,
    sensors: Sensors | None = None,
    laws: Laws | None = None,
    fast: float = 1.2,
) -> Recording:
    """Return a log of an arm as its sensors would take it."""
    sensors = sensors or Sensors()
    generator = np.random.default_rng(seed + 10_000)
    world = motion(arm, seed, duration, sensors.rate, fast)
    acts = torque(world, laws)
    logged = np.roll(acts, -round(sensors.delay * DENSE), axis=0)  # what is logged now acts later
    pick = slice(0, None, DENSE)
    stamps = world.t[pick]

    def read(values: Array) -> Array:
        seen = values[pick] + sensors.noise * generator.standard_normal(values[pick].shape)
        if sensors.jitter:
            late = sensors.jitter / sensors.rate * generator.standard_normal(len(stamps))
            seen = np.stack([np.interp(stamps + late, world.t, c) for c in values.T], axis=1)
        if sensors.bits is None:
            return seen
        count = 2 * np.pi / 2**sensors.bits
        return np.round(seen / count) * count

    pole = float(np.exp(-1 / (sensors.rate * sensors.memory))) if sensors.memory else 0.0
    white = generator.standard_normal((len(stamps) + 1000, arm.n))
    noise = lfilter([np.sqrt(1 - pole**2)], [1, -pole], white, axis=0)[1000:]
    size = np.asarray(sensors.torques or np.ones(arm.n)) * sensors.torque * acts.std(axis=0)
    tau = logged[pick] + size * noise + np.asarray(sensors.offsets or np.zeros(arm.n))
    theta, q = read(world.theta), read(world.q)
    for i in np.flatnonzero(~np.isfinite(arm.stiffness)):
        q[:, i] = theta[:, i]
    whole = (Segment(0, len(stamps)),)
    names = tuple(f"joint{i + 1}" for i in range(arm.n))
    recording = Recording(names, 1.0 / sensors.rate, stamps, q, theta, tau, segments=whole, files=("log.h5",))
    if sensors.velocities:
        speeds = [v[pick] + 0.01 * v.std() * generator.standard_normal(v[pick].shape) for v in (world.dq, world.dtheta)]
        recording = replace(recording, dq=speeds[0], dtheta=speeds[1])
    return recording
