"""Logs of random arms made by inverse dynamics, with effects written here a second time.

The links follow Fourier series; the bodies' equation gives the torque through each transmission, the transmission's law
gives the motor angle, and the motor's equation the motor torque. Nothing is integrated, so a log takes a second, and
the effects' formulas are not those of the library: what the diagnosis finds here it has not been told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.recording import Recording, Segment

Array = NDArray[np.float64]

ITERATIONS = 4
"""Of motor angle and rotor acceleration, which need each other a little."""
_SHARP = 0.01
"""rad/s over which Coulomb friction on the link side turns over, so that the motor angle stays smooth."""


@dataclass(frozen=True)
class Made:
    """A made log: robot without values, the true one, and the noise-free signals."""

    robot: Robot
    """Geometry only, as a user who knows no parameter would write it."""
    truth: Robot
    t: Array
    q: Array
    dq: Array
    ddq: Array
    sizes: tuple[Sizes, ...]


@dataclass(frozen=True)
class Sizes:
    """Typical sizes at one joint, by which effects are scaled."""

    torque: float
    speed: float
    deflection: float
    span: float


@dataclass
class Laws:
    """What departs from the plain model; every list holds functions of the whole log."""

    motor: list[Callable[[World], Array]] = field(default_factory=list)
    """World -> torque (N, n) that the motors must deliver in addition."""
    link: list[Callable[[World], Array]] = field(default_factory=list)
    """World -> torque (N, n) that the transmissions must deliver in addition."""
    spring: dict[int, Callable[[World, Array], Array]] = field(default_factory=dict)
    """Joint -> (World, torque through it (N,)) -> deflection theta - q (N,)."""
    sensors: list[Callable[[World, dict[str, Array]], None]] = field(default_factory=list)
    """Change the logged signals in place."""
    gravity: tuple[float, float, float] | None = None
    payload: tuple[float, Array] | None = None
    """Time at which the last body changes, and by what standard parameters."""


@dataclass
class World:
    """The motion as it stands."""

    robot: Robot
    t: Array
    q: Array
    dq: Array
    ddq: Array
    theta: Array
    dtheta: Array
    ddtheta: Array
    through: Array
    """Torque through the transmissions, (N, n)."""

    def stiffness(self, k: int) -> float:
        """Return K of a joint."""
        return float(self.robot.joints[k].parameters["K"])


def random_arm(seed: int, n: int = 3, heavy: bool = False) -> Robot:
    """Return an arm of n revolute joints with offset axes, general inertias and slender links (no K, friction yet)."""
    rng = np.random.default_rng([seed, n, 3])
    scale = 12.0 if heavy else 1.0
    joints = []
    for i in range(n):
        reach = (0.45 if heavy else 0.28) * rng.uniform(0.6, 1.4) * 0.9**i
        mass = scale * rng.uniform(2.0, 6.0) * 0.75**i
        com = reach * np.array([-rng.uniform(0.3, 0.6), rng.uniform(-0.1, 0.1), rng.uniform(-0.15, 0.15)])
        slender = mass * reach**2 * np.diag([rng.uniform(0.01, 0.04), 0.09, 0.09])
        turn, _ = np.linalg.qr(np.eye(3) + 0.15 * rng.normal(size=(3, 3)))
        tensor = turn @ slender @ turn.T + mass * (com @ com * np.eye(3) - np.outer(com, com))
        xx, yy, zz = np.diag(tensor)
        values = [mass, *(mass * com), xx, yy, zz, tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        alpha = float(rng.choice([0.0, np.pi / 2, -np.pi / 2]) + rng.choice([0.0, rng.normal() * 0.2]))
        if i == 0:
            alpha = float(np.pi / 2 * rng.choice([-1, 1]))
        joints.append(
            Joint(
                f"j{i + 1}",
                a=float(reach),
                alpha=alpha,
                d=float(rng.uniform(-0.2, 0.2)) * (2.0 if heavy else 1.0),
                gear_ratio=float(rng.integers(50, 161)),
                parameters=dict(zip(LINK_PARAMETERS, map(float, values), strict=True)),
            )
        )
    return Robot(f"arm{seed}", tuple(joints), gravity=(0.0, 0.0, -9.81))


def fourier(seed: int, n: int, t: Array, slow: bool = False) -> tuple[Array, Array, Array]:
    """Return a random motion of n joints with its derivatives, (N, n) each; top speeds of one to two rad/s."""
    rng = np.random.default_rng([seed, n, 4])
    base = 2 * np.pi / max(float(t[-1]) / 2, 6.0)
    q, dq, ddq = (np.zeros((len(t), n)) for _ in range(3))
    for k in range(n):
        for h in range(1, 8):
            a, phase = rng.normal() / h, rng.uniform(0, 2 * np.pi)
            w = base * (h + rng.uniform(-0.2, 0.2))
            q[:, k] += a * np.sin(w * t + phase)
            dq[:, k] += a * w * np.cos(w * t + phase)
            ddq[:, k] -= a * w * w * np.sin(w * t + phase)
        top = rng.uniform(0.5, 1.0) if slow else rng.uniform(1.0, 2.0)
        factor = min(top / np.abs(dq[:, k]).max(), 1.6 / np.abs(q[:, k]).max())
        for x in (q, dq, ddq):
            x[:, k] *= factor
        q[:, k] += rng.uniform(-0.5, 0.5)
    return q, dq, ddq


def make(
    seed: int,
    n: int = 3,
    *,
    rate: float = 500.0,
    duration: float = 15.0,
    heavy: bool = False,
    bodies_of: Robot | None = None,
) -> Made:
    """Return an arm with drives that suit it and a motion; its bodies are random, or another robot's."""
    n = n if bodies_of is None else bodies_of.n
    rng = np.random.default_rng([seed, n, 5])
    plain = random_arm(seed, n, heavy) if bodies_of is None else _bodies(bodies_of)
    t = np.arange(round(duration * rate)) / rate
    q, dq, ddq = fourier(seed, n, t)
    rigid = _values(plain)
    model = Regressor(plain)
    motion = Motion(t=t, q=q, dq=dq, ddq=ddq, theta=q, dtheta=dq, ddtheta=ddq)
    rows = model.rows(motion, model.equations)
    bodies = np.stack([rows[EstimationRow("link", k)].T @ _part(model, rigid, k) for k in range(n)], 1)
    joints, sizes = [], []
    for k, joint in enumerate(plain.joints):
        torque = float(np.sqrt(np.mean(bodies[:, k] ** 2)))
        speed = float(np.sqrt(np.mean(dq[:, k] ** 2)))
        inertia = float(np.sqrt(np.mean(bodies[:, k] ** 2) / np.mean(ddq[:, k] ** 2)))
        deflection = rng.uniform(1e-3, 3e-3)
        more = {
            "K": torque / deflection,
            "Jm": rng.uniform(0.1, 0.4) * min(inertia, 0.3 * torque) / joint.gear_ratio**2,
            "fs": rng.uniform(0.08, 0.2) * torque,
            "fv": rng.uniform(0.08, 0.2) * torque / speed,
        }
        more = {name: float(value) for name, value in more.items()}
        joints.append(replace(joint, parameters={**joint.parameters, **more}))
        span = float(np.ptp(q[:, k]))
        sizes.append(Sizes(torque * 1.05, float(np.quantile(np.abs(dq[:, k]), 0.98)), deflection * 2, span))
    truth = replace(plain, joints=tuple(joints))
    bare = replace(plain, joints=tuple(replace(j, parameters={}) for j in plain.joints))
    return Made(bare, truth, t, q, dq, ddq, tuple(sizes))


def _bodies(robot: Robot) -> Robot:
    """Return a robot's bodies, without its drives."""
    joints = (
        replace(j, parameters={name: j.parameters[name] for name in LINK_PARAMETERS if name in j.parameters})
        for j in robot.joints
    )
    return replace(robot, joints=tuple(joints), effects=())


def log_of(made: Made, laws: Laws) -> dict[str, Array]:
    """Return the noise-free signals q, theta, tau of a log, (N, n) each, in which some laws act."""
    robot = made.truth if laws.gravity is None else replace(made.truth, gravity=laws.gravity)
    n, model = robot.n, Regressor(robot)
    values = _values(robot)
    for k in range(n):
        values[model.index[f"K{k + 1}"]] = 0.0
    angles = made.q.copy(), made.dq.copy(), made.ddq.copy()
    world = World(made.truth, made.t, made.q, made.dq, made.ddq, *angles, np.zeros_like(made.q))
    own = np.zeros_like(made.q)
    for _ in range(ITERATIONS):
        motion = Motion(
            t=made.t, q=made.q, dq=made.dq, ddq=made.ddq, theta=world.theta, dtheta=world.dtheta, ddtheta=world.ddtheta
        )
        rows = model.rows(motion, model.equations)
        through = np.stack([rows[EstimationRow("link", k)].T @ _part(model, values, k) for k in range(n)], 1)
        if laws.payload is not None:
            start, change = laws.payload
            other = values.copy()
            last = [model.index[f"{name}{n}"] for name in LINK_PARAMETERS]
            other[last] += change
            after = np.stack([rows[EstimationRow("link", k)].T @ _part(model, other, k) for k in range(n)], 1)
            share = 0.5 * (1 + np.tanh((made.t - start) / 0.03))[:, None]
            through = (1 - share) * through + share * after
        own = np.stack([rows[EstimationRow("motor", k)].T @ _part(model, values, k, "motor") for k in range(n)], 1)
        for link in laws.link:
            through = through + link(world)
        world.through = through
        for k in range(n):
            law = laws.spring.get(k)
            e = through[:, k] / world.stiffness(k) if law is None else law(world, through[:, k])
            world.theta[:, k] = made.q[:, k] + e
        world.dtheta, world.ddtheta = _derivatives(world.t, world.theta)
    tau = own + world.through
    for motor in laws.motor:
        tau = tau + motor(world)
    signals = {"q": made.q.copy(), "theta": world.theta.copy(), "tau": tau}
    for sensor in laws.sensors:
        sensor(world, signals)
    return signals


def recorded(
    made: Made, signals: dict[str, Array], *, db: float, counts: float, torque: float, colour: float, seed: int
) -> Recording:
    """Return a recording with encoder noise `db` below the signal, or steps of `counts` per turn, and torque noise."""
    rng = np.random.default_rng([seed, 77])
    dt = float(made.t[1] - made.t[0])

    def sensed(x: Array) -> Array:
        if counts:
            step = 2 * np.pi / counts
            return step * np.round(x / step)
        size = np.sqrt(np.mean((x - x.mean(axis=0)) ** 2, axis=0)) * 10 ** (-db / 20)
        noisy: Array = x + size * rng.standard_normal(x.shape)
        return noisy

    noise = rng.standard_normal(signals["tau"].shape)
    if colour:
        from scipy.signal import lfilter

        rho = float(np.exp(-dt / colour))
        noise = lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise, axis=0)
    tau = signals["tau"] + torque * np.sqrt(np.mean(signals["tau"] ** 2, axis=0)) * noise
    q, theta = sensed(signals["q"]), sensed(signals["theta"])
    return Recording(made.robot.joint_names, dt, made.t, q, theta, tau, segments=(Segment(0, len(made.t)),))


def _values(robot: Robot) -> Array:
    model = Regressor(robot)
    values = np.zeros(model.parameters)
    for k, joint in enumerate(robot.joints):
        for name, value in joint.parameters.items():
            values[model.index[f"{name}{k + 1}"]] = value
    return values


def _part(model: Regressor, values: Array, k: int, kind: str = "link") -> Array:
    plan = next(p for p in model.equations.rows if p.row == EstimationRow(kind, k))  # type: ignore[arg-type]
    return values[plan.columns]


def _derivatives(t: Array, x: Array) -> tuple[Array, Array]:
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(t, x, k=5)
    return np.asarray(spline(t, 1)), np.asarray(spline(t, 2))


# --- effects, written a second time -------------------------------------------------------------------------------


def _at(world: World, k: int, values: Array) -> Array:
    result = np.zeros_like(world.q)
    result[:, k] = values
    return result


def _dahl(e: Array, distance: float) -> Array:
    """Return Dahl's state of a history, between -1 and 1: exact step by step over straight pieces."""
    z, result = 0.0, np.zeros(len(e))
    for i in range(1, len(e)):
        step = e[i] - e[i - 1]
        s = np.sign(step)
        z = s + (z - s) * np.exp(-abs(step) / distance)
        result[i] = z
    return result


def laws_of(effect: str, made: Made, k: int) -> Laws:
    """Return the laws of one effect of a size that matters, at joint k (KeyError for an unknown name)."""
    n, s = made.truth.n, made.sizes[k]
    p = made.truth.joints[k].parameters
    fs, fv, K = p["fs"], p["fv"], p["K"]
    end = float(made.t[-1])
    laws = Laws()
    other = (k + 1) % n

    def motor(f: Callable[[World], Array]) -> None:
        laws.motor.append(lambda w: _at(w, k, f(w)))

    def link(f: Callable[[World], Array]) -> None:
        laws.link.append(lambda w: _at(w, k, f(w)))

    def sensor(channel: str, f: Callable[[World, Array], Array]) -> None:
        def changed(w: World, signals: dict[str, Array]) -> None:
            signals[channel][:, k] = f(w, signals[channel][:, k])

        laws.sensors.append(changed)

    def spring(more: Callable[[World, Array, Array], Array]) -> None:
        """Set e = (torque - more(world, e)) / K by iteration."""

        def law(w: World, torque: Array) -> Array:
            e = torque / K
            for _ in range(40):
                e = 0.5 * e + 0.5 * (torque - more(w, e, torque)) / K
            return e

        laws.spring[k] = law

    match effect:
        case "stribeck":
            motor(lambda w: 0.5 * fs * np.sign(w.dtheta[:, k]) * np.exp(-np.abs(w.dtheta[:, k]) / (0.06 * s.speed)))
        case "stribeck_gauss":
            motor(lambda w: 0.6 * fs * np.sign(w.dtheta[:, k]) * np.exp(-((w.dtheta[:, k] / (0.08 * s.speed)) ** 2)))
        case "asymmetric_coulomb":
            motor(lambda w: 0.2 * fs * (w.dtheta[:, k] > 0))
        case "asymmetric_viscous":
            motor(lambda w: 0.2 * fv * np.abs(w.dtheta[:, k]))
        case "torque_offset":
            motor(lambda w: np.full(len(w.t), 0.2 * fs))
        case "load_friction":
            motor(lambda w: 0.06 * np.abs(w.through[:, k]) * np.sign(w.dtheta[:, k]))
        case "quadratic_viscous":
            motor(lambda w: 0.4 * fv / s.speed * w.dtheta[:, k] * np.abs(w.dtheta[:, k]))
        case "friction_drift":
            motor(
                lambda w: (
                    -(1 - np.exp(-2 * w.t / end)) * (0.35 * fs * np.sign(w.dtheta[:, k]) + 0.35 * fv * w.dtheta[:, k])
                )
            )
        case "position_friction":
            motor(lambda w: 0.3 * fs * np.sin(4 * w.theta[:, k] + 0.4) * np.sign(w.dtheta[:, k]))
        case "torque_ripple":
            motor(lambda w: 0.3 * fs * np.sin(14 * w.theta[:, k] - 0.7))
        case "velocity_coupling":
            motor(lambda w: 0.4 * fv * w.dtheta[:, other] + 0.2 * fs * np.sign(w.dtheta[:, other]))
        case "transmission_damping":

            def damped(w: World, torque: Array) -> Array:
                # e + T e' = torque / K, by repeated substitution: the motion is slow against T = 2 ms
                e = torque / K
                for _ in range(3):
                    e = torque / K - 2e-3 * _derivatives(w.t, e)[0]
                return e

            laws.spring[k] = damped
        case "cubic_stiffness":
            spring(lambda w, e, torque: 0.5 * K / s.deflection**2 * e**3)
        case "backlash":
            # dead zone of +-gap, turned over within a hundredth of the torque
            laws.spring[k] = lambda w, torque: torque / K + 0.15 * s.deflection * np.tanh(torque / (0.01 * s.torque))
        case "hysteresis":
            spring(lambda w, e, torque: 0.06 * s.torque * _dahl(e, 0.2 * s.deflection))
        case "kinematic_error":
            laws.spring[k] = lambda w, torque: torque / K + 0.06 * s.deflection * np.sin(20 * w.theta[:, k] + 0.5)
        case "encoder_offset":
            sensor("theta", lambda w, x: x + 0.1 * s.deflection)
        case "encoder_skew":
            laws.sensors.append(lambda w, x: _late(w.t, x["q"], k, 0.002))
        case "torque_delay":
            laws.sensors.append(lambda w, x: _late(w.t, x["tau"], k, -0.004))
        case "torque_gain":
            sensor("tau", lambda w, x: 0.92 * x)
        case "link_spring":
            link(lambda w: 0.2 * s.torque / s.span * w.q[:, k] + 0.1 * s.torque)
        case "link_coulomb":
            link(lambda w: 0.5 * fs * np.tanh(w.dq[:, k] / _SHARP))
        case "link_viscous":
            link(lambda w: 0.6 * fv * w.dq[:, k])
        case "gravity_direction":
            down = np.array(made.truth.gravity)
            size = float(np.linalg.norm(down))
            first, second = np.argsort(np.abs(down), kind="stable")[:2]  # the horizontal axes of the base
            turned = down * float(np.sqrt(1 - 0.02**2 - 0.025**2))
            turned[[first, second]] += size * np.array([0.02, -0.025])
            laws.gravity = (float(turned[0]), float(turned[1]), float(turned[2]))
        case "payload":
            last = made.truth.joints[-1].parameters
            m, r = 0.25 * last["m"], np.array([0.03, 0.02, 0.05])
            tensor = m * (r @ r * np.eye(3) - np.outer(r, r)) + 1e-3 * m * np.eye(3)
            change = [m, *(m * r), *np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]]
            laws.payload = (0.55 * end, np.array(change))
        case "contact":
            link(lambda w: 0.25 * s.torque * np.exp(-(((w.t - 0.46 * end) / 0.15) ** 2)))
        case "flexible_mode":
            link(lambda w: _mode(w.t, w.ddq[:, k], 0.12 * s.torque / float(np.std(w.ddq[:, k])), 9.0, 0.03))
        # effects that the library does not hold
        case "loose_mount":
            sensor("q", lambda w, x: x + 0.15 * s.deflection * np.tanh(3 * w.ddq[:, k] / np.std(w.ddq[:, k])))
        case "warm_gain":
            sensor("tau", lambda w, x: x * (1 + 0.08 * w.t / end))
        case "soft_stop":
            low = float(np.quantile(made.q[:, k], 0.85))
            link(lambda w: 2.0 * s.torque / s.span * np.maximum(w.q[:, k] - low, 0.0) ** 1.5)
        case "dragging_cable":
            edge = float(np.quantile(made.q[:, k], 0.6))
            link(
                lambda w: (
                    0.08
                    * s.torque
                    * (0.5 + 0.5 * np.tanh((w.q[:, k] - edge) / 0.03))
                    * (1.0 + 0.5 * np.tanh(w.dq[:, k] / _SHARP))
                )
            )
        case "presliding":
            # friction builds up over a distance instead of at once
            motor(lambda w: fs * (_dahl(w.theta[:, k], 0.01) - np.sign(w.dtheta[:, k])))
        case _:
            raise KeyError(effect)
    return laws


FOREIGN = ("loose_mount", "warm_gain", "soft_stop", "dragging_cable", "presliding")
WHOLE = ("gravity_direction", "payload")
KNOWN = (
    "stribeck", "stribeck_gauss", "asymmetric_coulomb", "asymmetric_viscous", "torque_offset", "load_friction",
    "quadratic_viscous", "friction_drift", "position_friction", "torque_ripple", "velocity_coupling",
    "transmission_damping", "cubic_stiffness", "backlash", "hysteresis", "kinematic_error", "encoder_offset",
    "encoder_skew", "torque_delay", "torque_gain", "link_spring", "link_coulomb", "link_viscous", "gravity_direction",
    "payload", "contact", "flexible_mode",
)  # fmt: skip


def _late(t: Array, x: Array, k: int, by: float) -> None:
    """Let channel k tell what was true `by` seconds before."""
    from scipy.interpolate import make_interp_spline

    x[:, k] = make_interp_spline(t, x[:, k], k=3)(np.clip(t - by, t[0], t[-1]))


def _mode(t: Array, acceleration: Array, inertia: float, frequency: float, damping: float) -> Array:
    """Return the torque that an oscillator of given inertia on the link adds, less what a rigid one would take."""
    from scipy.signal import cont2discrete, lfilter, lfilter_zi

    w = 2 * np.pi * frequency
    system = cont2discrete(([-1.0, 0.0, 0.0], [1.0, 2 * damping * w, w * w]), float(t[1] - t[0]), method="bilinear")
    numerator, denominator = system[0].ravel(), system[1]
    # it has swung out before the log begins
    relative, _ = lfilter(numerator, denominator, acceleration, zi=lfilter_zi(numerator, denominator) * acceleration[0])
    result: Array = inertia * relative
    return result
