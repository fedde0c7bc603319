"""Simulated logs: the described robot follows a smooth reference under control, and a logger watches (eq. 2)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import check_fields, number, of_kind, options_given, whole
from elid_cli.errors import UsageError
from elid_cli.experiment.reference import Reference, ReferenceOptions, is_reference, random_reference
from elid_cli.experiment.simulation.closed_loop import Clock, Controller, follow
from elid_cli.experiment.simulation.control import ControlOptions, Gains, gains_of
from elid_cli.experiment.simulation.effects_at_work import ActiveEffect, active_effects, warm_up
from elid_cli.experiment.simulation.integration import System, longest_step, reference_scene
from elid_cli.experiment.simulation.sensors import SensorOptions, accelerometers, gyroscopes, measured
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.effects.scene import DIRECTION_WIDTH
from elid_cli.robot.robot import Robot
from elid_cli.signals.fitting_robot import check_robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.recording import MEASURED, Recording, Segment

CONTROL_RATE = 500.0
"""Hz; a log that is slower than this is taken from a controller that runs at a multiple of its rate."""


_RULES = {
    "duration": number(above=0),
    "rate": number(above=0),
    "seed": whole(0),
    "reference": is_reference,
    "control": of_kind(ControlOptions, "ControlOptions(...) of elid_cli.experiment.simulation, or leave it out"),
    "sensors": of_kind(SensorOptions, "SensorOptions(...), or leave it out"),
    "friction_width": number(above=0),
    "accuracy": number(above=0),
}


@dataclass(frozen=True)
class SimulationOptions:
    """What to simulate; the same options give the same numbers."""

    duration: float = 10.0
    """s."""
    rate: float = 1000.0
    """Samples per second of the log, and of the controller."""
    seed: int = 0
    reference: Reference | ReferenceOptions = field(default_factory=ReferenceOptions)
    """A trajectory, or how to draw one."""
    control: ControlOptions = field(default_factory=ControlOptions)
    sensors: SensorOptions = field(default_factory=SensorOptions)
    friction_width: float = DIRECTION_WIDTH
    """Speed over which Coulomb friction is rounded (see `Dynamics`)."""
    accuracy: float = 1.0
    """Factor by which integration steps are finer than the default."""

    def __post_init__(self) -> None:
        """Refuse what no simulation can be of (UsageError)."""
        check_fields(self, _RULES)


@dataclass(frozen=True)
class JointFacts:
    """What one joint did, rad (m) and N·m."""

    range: float
    """Link's travel."""
    speed: float
    """Top speed of the link."""
    deflection: float
    """Largest |q - θ|."""
    tau: float
    """rms of the logged torque."""
    tracking: float
    """rms of the link's deviation from its reference."""
    kp: float
    kd: float


@dataclass(frozen=True)
class Simulation:
    """A simulated log and what was behind it."""

    recording: Recording
    motion: Motion
    """The exact motion at the log's instants, accelerations included."""
    tau: Array
    """Torque that the motors delivered from each instant on, N·m, shape (N, n)."""
    tau_link: Array
    """Torque through the transmissions, N·m, shape (N, n); NaN where rigid."""
    reference: Array
    """Link positions that were asked for, shape (N, n)."""
    gains: Gains
    step: float
    """Integration step, the longest where steps differ, s."""
    exact_springs: bool
    """Whether springs were taken exactly (`ExactSprings`); else the classical Runge-Kutta scheme took all."""
    period: float
    """Controller's sample time, s."""
    facts: tuple[JointFacts, ...]


def simulate(
    robot: Robot, options: SimulationOptions | None = None, progress: Callable[[float], None] | None = None
) -> Recording:
    """Return the log of a simulated motion: raw signals (N, n), SI, joint side.

    Parameters
    ----------
    robot
        The description, with its effects; the parameters that matter must be known.
    options
        What to simulate.
    progress
        Called with the fraction done, now and then.

    Raises
    ------
    RobotError
        Unknown parameters, a mass matrix that is not positive definite, an effect that does not fit, or a motion
        that runs away.
    UsageError
        Options that make no log.
    """
    return run(robot, options, progress).recording


def run(
    robot: Robot, options: SimulationOptions | None = None, progress: Callable[[float], None] | None = None
) -> Simulation:
    """Simulate a robot as `simulate` does, and return what was behind the log as well."""
    check_robot(robot)
    options = options_given("simulate", options, SimulationOptions)
    samples = _samples(options)
    dt = 1.0 / options.rate
    nominal = Dynamics(robot, friction_width=options.friction_width)
    effects = active_effects(robot, reference_scene(nominal, dt, options.duration))
    phases = _phases(nominal, effects, dt, options)

    reference = options.reference
    if isinstance(reference, ReferenceOptions):
        reference = random_reference(robot, options.duration, options.seed, reference)
    positions = reference.evaluate(np.linspace(0.0, options.duration, 24))[0]
    held = max(math.ceil(CONTROL_RATE / options.rate), 1)
    gains = gains_of(options.control, nominal, positions, dt / held)
    step = min(longest_step(system, positions[::3], options.accuracy) for _, system in phases)
    clock = Clock(dt / held, held, max(math.ceil(dt / held / step), 1), samples, options.accuracy)

    controller = Controller(nominal, reference, options.control, gains, effects)
    first = phases[0][1]
    theta = positions[0] + np.nan_to_num(first.dynamics.gravity(positions[:1])[0] / first.dynamics.stiffness)
    trace = follow(
        phases, controller, first.initial(positions[0], theta), clock,
        continuous=options.control.continuous, progress=progress,
    )  # fmt: skip
    *states, commands, delivered, transmitted = trace.columns()
    motion = Motion(*states)
    stood = phases[-1][1].dynamics.robot  # on a base that is tilted from the start, if at all
    recording = _recording(stood, motion, commands, transmitted, effects, dt, options)
    asked = reference.evaluate(motion.t)[0]
    facts = _facts(recording, motion, asked, gains)
    exact = [system.longest for _, system in phases if system.longest is not None]
    step = max([clock.step, *exact])
    return Simulation(
        recording, motion, delivered, transmitted, asked, gains, step, bool(exact), clock.period, facts
    )  # fmt: skip


def exact(result: Simulation) -> Recording:
    """Return the log that perfect sensors would have given: the motion, and the torque that motors delivered."""
    motion = result.motion
    return replace(
        result.recording,
        t=motion.t,
        q=motion.q,
        theta=motion.theta,
        tau=result.tau,
        dq=motion.dq,
        dtheta=motion.dtheta,
        tau_link=result.tau_link,
        temperature=None,
    )


def filed(result: Simulation, path: str, digest: str) -> Simulation:
    """Return the result with the name and the SHA-256 of the file that its log was written to."""
    return replace(result, recording=replace(result.recording, files=(path,), sha256=(digest,)))


def _samples(options: SimulationOptions) -> int:
    size = options.duration * options.rate
    if not (options.rate > 0 and math.isfinite(size) and round(size) >= 2):
        raise UsageError(f"a log of {options.duration:g} s at {options.rate:g} Hz", hint="it needs two samples or more")
    return round(size)


def _phases(
    nominal: Dynamics, effects: list[ActiveEffect], dt: float, options: SimulationOptions
) -> list[tuple[float, System]]:
    """Return (start, system), the robot as it is from each start on (a payload, a tilted base)."""
    altering = [active for active in effects if active.effect.simulated == "robot"]
    starts = [
        active.effect.altered(nominal.robot, nominal.parameters, active.coefficients).start for active in altering
    ]
    phases = [(0.0, nominal)]
    for start, active in sorted(zip(starts, altering, strict=True), key=lambda pair: pair[0]):
        before = phases[-1][1]
        now = active.effect.altered(before.robot, before.parameters, active.coefficients)
        changed = Dynamics(now.robot, now.parameters, friction_width=options.friction_width)
        if start <= 0:
            phases = [(0.0, changed)]
        else:
            phases.append((start, changed))
    return [(start, System(dynamics, effects, dt, options.duration)) for start, dynamics in phases]


def _facts(recording: Recording, motion: Motion, asked: Array, gains: Gains) -> tuple[JointFacts, ...]:
    columns = (
        np.ptp(motion.q, axis=0),
        np.abs(motion.dq).max(axis=0),
        np.abs(motion.q - motion.theta).max(axis=0),
        np.sqrt(np.mean(recording.tau**2, axis=0)),
        np.sqrt(np.mean((motion.q - asked) ** 2, axis=0)),
        gains.kp,
        gains.kd,
    )
    return tuple(JointFacts(*row) for row in np.stack(columns, axis=1).tolist())


def _recording(
    robot: Robot, motion: Motion, commands: Array, transmitted: Array, effects: list[ActiveEffect], dt: float,
    options: SimulationOptions,
) -> Recording:  # fmt: skip
    signals = {
        "t": motion.t,
        "q": motion.q,
        "theta": motion.theta,
        "tau": commands,
        "dq": motion.dq,
        "dtheta": motion.dtheta,
        "tau_link": transmitted,
        "temperature": np.array([[warm_up(t)] * robot.n for t in motion.t.tolist()]),
    }
    for active in effects:
        if active.effect.simulated == "log":
            signals |= active.effect.logged(signals, dt, active.values)
    logged = measured(robot, signals, dt, options.sensors, options.seed)
    return Recording(
        joints=robot.joint_names,
        dt=dt,
        t=signals["t"],
        **{name: logged.get(name) for name in MEASURED},  # type: ignore[arg-type]
        gyro=gyroscopes(robot, motion.q, motion.dq, options.sensors, options.seed),
        accel=accelerometers(robot, motion, options.sensors, options.seed),
        segments=(Segment(0, motion.samples),),
    )
