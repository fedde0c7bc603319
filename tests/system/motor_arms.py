"""Logs of planar arms of which only the motors are seen, by the second simulator: motion past the antiresonance.

As in `plain_arms` the links' motion is given and everything else follows exactly, in the frequency domain where it is
to be differentiated. Here the motion is a slow wide one with a dither of many lines on top, as a torque of even size
per line would make it, and transmissions may damp, lose motion and rub under load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import ACCEL, GYRO, Recording, Segment
from tests.system.plain_arms import GRAVITY, Arm, Array, World, _bodies

OVERSAMPLED = 4
DETUNED = 0.6
"""Damping of the links over sqrt(K M) in the planning of a dither."""


@dataclass(frozen=True)
class Case:
    """How a log is made."""

    kind: str = "cross"
    """``cross``: dither past the resonances; ``below``: to half the lowest antiresonance; ``smooth``: none."""
    top: tuple[float, float] | None = None
    """Highest line of the dither, Hz, from, to, in place of these."""
    signal_to_noise: float = 80.0
    """dB of each channel's own scatter."""
    rate: float = 1000.0
    duration: float = 10.0
    load_friction: Array | None = None
    """Share of the transmission's torque, (n,)."""
    stribeck: Array | None = None
    """N·m at rest beyond Coulomb friction, (n,)."""
    stribeck_speed: float = 0.1
    lost: Array | None = None
    """Lost motion, rad, passed over a tenth of the transmission's torque, (n,)."""
    damping: Array | None = None
    """Transmission damping over stiffness, s, (n,)."""
    delay: float = 0.0
    """s by which the torque acts later than it is logged."""
    width: float = 0.02
    """Speed over which friction changes its sign, rad/s."""
    bits: float | None = None
    """Resolution of the encoders per turn."""
    kinematic: Array | None = None
    """Kinematic error of the gears, twice per turn of the motor, rad at the joint, (n,)."""
    link_mode: tuple[float, float] | None = None
    """Share of every link's inertia that hangs on a spring of its own, and that one's frequency, Hz; damped by 2 %."""
    gyros: tuple[int, ...] = ()
    """Joints whose links carry a gyroscope, mounted in any direction, with a bias and scale errors of 1 %."""
    gyro_noise: float = 2e-3
    """rad/s."""
    accelerometers: tuple[int, ...] = ()
    """Joints whose links carry an accelerometer somewhere, mounted likewise."""
    accel_noise: float = 0.02
    """m/s²."""
    late: float = 2e-3
    """s by which sensors on links are late."""


def inertias(arm: Arm) -> tuple[Array, Array]:
    """Return link and reflected rotor inertia of every joint, the arm half stretched, kg·m²."""
    return mass(arm).diagonal(), arm.rotor * arm.gear**2


def _bent(n: int) -> Array:
    bent: Array = np.r_[-np.pi / 2, np.full(n - 1, 0.6)][None]
    return bent


def _sprung(arm: Arm) -> Array:
    """Return the stiffnesses, of rigid joints one that would lock at 8 Hz: for the size of motions only."""
    return np.where(np.isfinite(arm.stiffness), arm.stiffness, inertias(arm)[0] * (2 * np.pi * 8.0) ** 2)


def locked_frequencies(arm: Arm) -> Array:
    """Return the arm's frequencies with its motors locked, Hz, (n,), in ascending order."""
    return np.sort(np.sqrt(np.linalg.eigvals(np.linalg.solve(mass(arm), np.diag(_sprung(arm)))).real)) / (2 * np.pi)


def mass(arm: Arm, pose: Array | None = None) -> Array:
    """Return the links' mass matrix of the bent arm, or of a pose (n,), kg·m², (n, n)."""
    n = arm.n
    still, bent = np.zeros((1, n)), _bent(n) if pose is None else pose[None]
    rest = _bodies(arm, bent, still, still)[0]
    return np.stack([_bodies(arm, bent, still, np.eye(n)[[i]])[0] - rest for i in range(n)], axis=1)


def random_motor_arm(generator: np.random.Generator, n: int, rigid: tuple[int, ...] = ()) -> Arm:
    """Return an arm whose joints' locked frequencies and ratios of inertias are spread as robots' are."""
    size = 0.55 ** np.arange(n)
    length = generator.uniform(0.3, 0.6, n) * size**0.3
    mass = generator.uniform(8, 20, n) * size
    moment = mass * length * generator.uniform(0.3, 0.6, n)
    inertia = moment**2 / mass * generator.uniform(1.2, 1.6, n)
    plain = Arm(length, mass, moment, inertia, *np.ones((5, n)))
    link, _ = inertias(plain)
    gear = generator.uniform(50, 120, n)
    rotor = link * np.exp(generator.uniform(np.log(0.2), np.log(1.5), n)) / gear**2
    low = np.linspace(3.5, 6.0, n) if n > 1 else np.array([3.5])
    high = np.linspace(10.0, 16.0, n) if n > 1 else np.array([16.0])
    locked = np.exp(generator.uniform(np.log(low), np.log(high)))
    stiffness = link * (2 * np.pi * locked) ** 2
    stiffness[list(rigid)] = np.inf
    weight = GRAVITY * np.cumsum(moment[::-1])[::-1]
    size = (link + rotor * gear**2) * 3.0 + 0.5 * weight
    return Arm(
        length, mass, moment, inertia, rotor, gear, size * generator.uniform(0.02, 0.08, n),
        size * generator.uniform(0.02, 0.06, n), stiffness,
    )  # fmt: skip


def _spectrum(arm: Arm, case: Case, generator: np.random.Generator, count: int, period: float) -> Array:
    """Return the links' motion as a spectrum, (lines, n)."""
    link, rotor = inertias(arm)
    lines = np.arange(1, max(3, round((2.5 if case.kind == "smooth" else 0.7) * period)) + 1)
    spectrum = np.zeros((count // 2 + 1, arm.n), dtype=complex)
    locked = locked_frequencies(arm)
    top = {"cross": locked[-1] * generator.uniform(1.3, 2.2), "below": locked[0] * generator.uniform(0.4, 0.6)}
    if case.top is not None:
        top[case.kind] = generator.uniform(*case.top)
    for i in range(arm.n):
        turn = np.exp(2j * np.pi * generator.random(len(lines)))
        size = generator.uniform(0.3, 1.0, len(lines)) / (1 + lines / period) * turn
        spectrum[lines, i] = size / np.sqrt(np.sum(np.abs(size) ** 2)) * generator.uniform(0.4, 0.7)
        if case.kind in top:
            f = np.exp(np.linspace(np.log(0.7), np.log(top[case.kind]), int(generator.integers(25, 60))))
            place = np.unique(np.round(f * period).astype(int))
            size = (link[i] + rotor[i]) * generator.uniform(2.0, 6.0) / np.sqrt(len(place) / 2)
            turn = np.exp(2j * np.pi * generator.random(len(place)))
            spectrum[place] += size * turn[:, None] * _answer(arm, 2 * np.pi * place / period, i)
    return spectrum


def _answer(arm: Arm, omega: Array, motor: int) -> Array:
    """Return how the links answer to a motor's torque about the bent arm, its motors held by drives, (lines, n)."""
    link, rotor = inertias(arm)
    n, K, both = arm.n, np.diag(_sprung(arm)), link + rotor
    hold = 2 * np.pi * 1.7
    drive = both[None] * (hold**2 + 1.6j * hold * omega[:, None]) - (omega**2)[:, None] * rotor
    whole = np.zeros((len(omega), 2 * n, 2 * n), dtype=complex)
    # as the arm bends its frequencies move: no line stays at one for long
    damping = DETUNED * np.sqrt(np.diag(K) * link) * np.eye(n)
    whole[:, :n, :n] = K - (omega**2)[:, None, None] * mass(arm) + 1j * omega[:, None, None] * damping
    whole[:, n:, n:] = K + drive[:, :, None] * np.eye(n)
    whole[:, :n, n:] = whole[:, n:, :n] = -K
    push = np.zeros((1, 2 * n, 1))  # of as many dimensions as `whole`: else older NumPy takes it for vectors
    push[0, n + motor] = 1.0
    answer: Array = np.linalg.solve(whole, push)[:, :n, 0]
    return answer


def _world(arm: Arm, case: Case, generator: np.random.Generator) -> World:
    count = round(case.duration * case.rate) * OVERSAMPLED
    t = np.arange(count) / (case.rate * OVERSAMPLED)
    period = count / (case.rate * OVERSAMPLED)
    spectrum = _spectrum(arm, case, generator, count, period)
    omega = 2j * np.pi * np.arange(len(spectrum))[:, None] / period
    centre = np.r_[-np.pi / 2, np.full(arm.n - 1, 0.6)]
    q, dq, ddq = (np.fft.irfft(spectrum * omega**k, count, axis=0) * count / 2 for k in range(3))
    q = q + centre
    limit = int(min(300.0, 0.4 * case.rate) * period)  # nothing moves beyond: rounding only

    def rates(values: Array) -> tuple[Array, Array]:
        lines = np.fft.rfft(values - values[0], axis=0)
        lines[limit:] = 0.0
        first, second = (np.fft.irfft(lines * omega[:, 0] ** k, count) for k in (1, 2))
        return first, second

    spring = _bodies(arm, q, dq, ddq)
    theta, dtheta, ddtheta = q.copy(), dq.copy(), ddq.copy()
    if case.link_mode is not None:
        share, own = case.link_mode[0], 2 * np.pi * case.link_mode[1]
        follows = (0.04 * own * omega + own**2) / (omega**2 + 0.04 * own * omega + own**2)
        lag = np.fft.irfft((follows - 1) * omega**2 * spectrum, count, axis=0) * count / 2
        spring = spring + share * inertias(arm)[0] * lag
    for i in reversed(range(arm.n)):
        for later in range(i + 1, arm.n):
            carried = ddq[:, :later].sum(axis=1)
            spring[:, i] += arm.rotor[later] * (carried + arm.gear[later] * ddtheta[:, later])
        if np.isfinite(arm.stiffness[i]):
            deflection = spring[:, i] / arm.stiffness[i]
            if case.damping is not None:
                lines = np.fft.rfft(deflection) / (1 + omega[:, 0] * case.damping[i])
                deflection = np.fft.irfft(lines, count)
            if case.lost is not None:
                deflection = deflection + case.lost[i] * np.tanh(spring[:, i] / (0.1 * spring[:, i].std()))
            if case.kinematic is not None:
                deflection = deflection + case.kinematic[i] * np.sin(2 * arm.gear[i] * q[:, i] + i)
            theta[:, i] = q[:, i] + deflection
            dtheta[:, i], ddtheta[:, i] = rates(theta[:, i])
    return World(arm, t, q, dq, ddq, theta, dtheta, ddtheta, spring)


def _torque(world: World, case: Case) -> Array:
    arm, total = world.arm, world.spring.copy()
    for i in range(arm.n):
        carried = world.ddq[:, :i].sum(axis=1)
        sign = np.tanh(world.dtheta[:, i] / case.width)
        total[:, i] += arm.rotor[i] * arm.gear[i] * (carried + arm.gear[i] * world.ddtheta[:, i])
        total[:, i] += arm.coulomb[i] * sign + arm.viscous[i] * world.dtheta[:, i]
        if case.load_friction is not None:
            total[:, i] += case.load_friction[i] * np.abs(world.spring[:, i]) * sign
        if case.stribeck is not None:
            total[:, i] += case.stribeck[i] * sign * np.exp(-((world.dtheta[:, i] / case.stribeck_speed) ** 2))
    return total


def motor_log(arm: Arm, seed: int, case: Case | None = None) -> Recording:
    """Return a log of motor positions and torques; the links' positions are there for rigid joints only."""
    case = case or Case()
    generator = np.random.default_rng([seed, 5])
    world = _world(arm, case, generator)
    tau = np.roll(_torque(world, case), -round(case.delay * case.rate * OVERSAMPLED), axis=0)
    pick = slice(0, None, OVERSAMPLED)
    share = 10 ** (-case.signal_to_noise / 20)

    def read(values: Array) -> Array:
        seen = values[pick]
        noisy: Array = seen + share * seen.std(axis=0) * generator.standard_normal(seen.shape)
        return noisy

    theta, torque = read(world.theta), read(tau)
    if case.bits is not None:
        step = 2 * np.pi / 2**case.bits
        theta = np.round(theta / step) * step
    q = np.where(np.isfinite(arm.stiffness), np.nan, theta)
    names = tuple(f"joint{i + 1}" for i in range(arm.n))
    whole = (Segment(0, len(theta)),)
    gyro = _sensors(world, case, case.gyros, GYRO, np.random.default_rng([seed, 9]))
    accel = _sensors(world, case, case.accelerometers, ACCEL, np.random.default_rng([seed, 10]))
    return Recording(
        names, 1 / case.rate, world.t[pick], q, theta, torque, gyro=gyro, accel=accel, segments=whole,
        files=("log.h5",),
    )  # fmt: skip


def _sensors(
    world: World, case: Case, joints: tuple[int, ...], signals: tuple[str, ...], generator: np.random.Generator
) -> dict[str, Array]:
    """Return what sensors of one kind on the links log."""
    logged = {axis: np.full((len(world.t) // OVERSAMPLED, world.arm.n), np.nan) for axis in signals if joints}
    late = round(case.late * case.rate * OVERSAMPLED)
    noise, bias = (case.gyro_noise, 0.02) if signals == GYRO else (case.accel_noise, 0.05)
    for k in joints:
        turn, _ = np.linalg.qr(generator.standard_normal((3, 3)))
        axes = turn * np.linalg.det(turn) @ (np.eye(3) + 0.01 * generator.standard_normal((3, 3)))
        if signals == GYRO:  # the arm turns about one axis
            felt = world.dq[:, : k + 1].sum(axis=1)[:, None] * np.array([0.0, 0.0, 1.0])
        else:
            felt = _felt(world, k, generator.uniform(-0.1, 0.1, 2))
        seen = np.roll(felt, late, axis=0)[::OVERSAMPLED] @ axes.T + bias * generator.standard_normal(3)
        seen += noise * generator.standard_normal(seen.shape)
        for name, values in zip(signals, seen.T, strict=True):
            logged[name][:, k] = values
    return logged


def _felt(world: World, k: int, place: Array) -> Array:
    """Return the acceleration minus gravity of a place on link k, m from its far end, in the link's axes, (N, 3).

    In the plane as complex numbers: the place is the sum of l exp(iφ) over the links, φ their absolute angles.
    """
    angle, speed, acceleration = (np.cumsum(values, axis=1) for values in (world.q, world.dq, world.ddq))
    arms = [*world.arm.length[:k].astype(complex), world.arm.length[k] + complex(*place)]
    whole = np.full(len(angle), 1j * GRAVITY)
    for j, arm in enumerate(arms):
        whole += arm * np.exp(1j * angle[:, j]) * (1j * acceleration[:, j] - speed[:, j] ** 2)
    own = whole * np.exp(-1j * angle[:, k])
    return np.stack([own.real, own.imag, np.zeros(len(own))], axis=1)


def told_robot(arm: Arm, seed: int, error: float = 0.2, *, elastic: bool = True) -> Robot:
    """Return the robot file of an arm whose rotors are known to ±`error`; all joints elastic where asked for."""
    generator = np.random.default_rng([seed, 6])
    joints = []
    for joint in arm.described().joints:
        told = {"Jm": joint.parameters["Jm"] * (1 + error * generator.uniform(-1, 1))}
        joints.append(replace(joint, parameters=told, transmission="elastic" if elastic else joint.transmission))
    return replace(arm.described(), joints=tuple(joints))
