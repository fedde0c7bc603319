"""The robot under control, sample by sample: controller, motors and the integrated motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.experiment.reference import Reference
from elid_cli.experiment.simulation.control import ControlOptions, Gains
from elid_cli.experiment.simulation.effects_at_work import ActiveEffect
from elid_cli.experiment.simulation.integration import System
from elid_cli.model.dynamics import Dynamics

RUNAWAY = 1e4
"""Positions (rad or m) beyond which a simulation has left its robot."""
_DIFFERENCE = 1e-3
"""s; the wanted motor velocity is a central difference over this time."""
_CHUNK = 1024
"""Controller periods whose references are computed at once."""


@dataclass(frozen=True)
class Clock:
    """Time steps: `steps` integration steps per controller period, `held` periods per sample of the log."""

    period: float
    """Controller's sample time, s."""
    held: int
    steps: int

    @property
    def step(self) -> float:
        """Integration step, s."""
        return self.period / self.steps


@dataclass
class Trace:
    """What happened at every sample of the log: lists of N rows."""

    time: list[float] = field(default_factory=list)
    states: list[tuple[list[float], ...]] = field(default_factory=list)
    """Rows (q, q', θ, θ') of all joints."""
    accelerations: list[tuple[list[float], list[float]]] = field(default_factory=list)
    """Rows (q'', θ'') of all joints."""
    commands: list[list[float]] = field(default_factory=list)
    delivered: list[list[float]] = field(default_factory=list)
    transmitted: list[list[float]] = field(default_factory=list)


class Controller:
    """Motor-side PD control towards a reference that is compensated for the deflection by gravity."""

    def __init__(
        self, nominal: Dynamics, reference: Reference, options: ControlOptions, gains: Gains,
        effects: Sequence[ActiveEffect],
    ) -> None:  # fmt: skip
        self._nominal = nominal
        self._reference = reference
        self._feedforward = options.feedforward
        self._kp, self._kd = gains.kp.tolist(), gains.kd.tolist()
        limits = [joint.limits.torque for joint in nominal.robot.joints]
        self._limits = [math.inf if limit is None else limit for limit in limits]
        self._motors = [active for active in effects if active.effect.simulated == "motor"]

    def plan(self, times: Array) -> list[tuple[list[float], list[float], list[float]]]:
        """Return (θ, θ', feed-forward torque) that are wanted at times (N,)."""
        theta, feed = self._desired(times)
        ahead, _ = self._desired(times + _DIFFERENCE)
        behind, _ = self._desired(times - _DIFFERENCE)
        dtheta = (ahead - behind) / (2 * _DIFFERENCE)
        return list(zip(theta.tolist(), dtheta.tolist(), feed.tolist(), strict=True))

    def _desired(self, times: Array) -> tuple[Array, Array]:
        """Return (motor positions that make up for the deflection, feed-forward torques) at times (N,)."""
        q, dq, ddq = self._reference.evaluate(times)
        if self._feedforward == "none":
            return q, np.zeros_like(q)
        if self._feedforward == "gravity":
            dq, ddq = np.zeros_like(q), np.zeros_like(q)
        link, motor = self._nominal.feedforward(q, dq, ddq)
        return q + np.nan_to_num(link / self._nominal.stiffness), motor

    def command(
        self, wanted: tuple[list[float], list[float], list[float]], theta: list[float], dtheta: list[float]
    ) -> list[float]:
        """Return the torques asked of the motors, within the robot's torque limits, N·m."""
        torques = []
        for r, v, f, a, b, kp, kd, limit in zip(*wanted, theta, dtheta, self._kp, self._kd, self._limits, strict=True):
            torques.append(min(max(f + kp * (r - a) + kd * (v - b), -limit), limit))
        return torques

    def delivered(self, command: list[float]) -> list[float]:
        """Return what the motors make of a command, N·m."""
        if not self._motors:
            return command
        torques = list(command)
        for active in self._motors:
            joint = active.effect.joint
            torques[joint] = float(active.effect.delivered(np.array(torques[joint]), active.coefficients))
        return torques

    def torque(
        self, wanted: tuple[list[float], list[float], list[float]], theta: list[float], dtheta: list[float]
    ) -> list[float]:
        """Return the torques delivered in answer to a motor state, N·m."""
        return self.delivered(self.command(wanted, theta, dtheta))


def follow(
    phases: Sequence[tuple[float, System]],
    controller: Controller,
    x: list[float],
    samples: int,
    clock: Clock,
    *,
    continuous: bool,
    accuracy: float = 1.0,
    progress: Callable[[float], None] | None = None,
) -> Trace:
    """Run the loop from state `x` and return what happened at every sample.

    Parameters
    ----------
    phases
        (start, system) in order of time; a later one takes over from its start on.
    controller
        What commands the motors.
    x
        State of the first system at time 0.
    samples
        Samples of the log.
    clock
        Time steps.
    continuous
        Whether the controller acts at every instant; otherwise its torque is held over a period.
    accuracy
        Factor by which steps are finer than the default.
    progress
        Called with the fraction done.

    Raises
    ------
    RobotError
        The motion runs away.

    """
    trace = Trace()
    period, steps, h = clock.period, clock.steps, clock.step
    periods = (samples - 1) * clock.held + 1
    stages = 2 * steps if continuous else 1
    for _, system in phases:
        system.prepare(4 * steps * periods)
        if not continuous:
            system.hold(period, steps, accuracy)
    for first in range(0, periods, _CHUNK):
        count = min(_CHUNK, periods - first)
        plan = controller.plan(period * (first + np.arange(count * stages + 1) / stages))
        for k in range(count):
            now = first + k
            t = now * period
            system = _system(phases, t)
            _, _, theta, dtheta = system.split(x)
            wanted = plan[k * stages]
            command = controller.command(wanted, theta, dtheta)
            acting = controller.delivered(command)
            if now % clock.held == 0:
                _note(trace, system, t, x, command, acting)
            if now == periods - 1:
                break
            try:
                if continuous:
                    x = _answered(system, controller, plan[k * stages : (k + 1) * stages + 1], t, h, x)
                else:
                    x = system.advance(t, h, steps, x, acting)
                _check_bounded(system.split(x)[0])
            except (ValueError, OverflowError):
                raise _runaway(system.dynamics, t) from None
        if progress is not None:
            progress((first + count) / periods)
    return trace


def _check_bounded(q: Sequence[float]) -> None:
    """Raise OverflowError where a position is beyond all bounds, or no number."""
    if not all(-RUNAWAY < value < RUNAWAY for value in q):
        raise OverflowError


def _answered(
    system: System,
    controller: Controller,
    plan: Sequence[tuple[list[float], list[float], list[float]]],
    t: float,
    h: float,
    x: list[float],
) -> list[float]:
    """Return the state after one period with a controller that acts at every instant; `plan` is of half steps."""
    for s in range(len(plan) // 2):
        begin, middle, end = (partial(controller.torque, plan[2 * s + i]) for i in range(3))
        x = system.step(t + s * h, h, x, (begin, middle, end))
    return x


def _system(phases: Sequence[tuple[float, System]], t: float) -> System:
    chosen = phases[0][1]
    for start, system in phases[1:]:
        if t >= start:
            chosen = system
    return chosen


def _note(trace: Trace, system: System, t: float, x: list[float], command: list[float], acting: list[float]) -> None:
    trace.time.append(t)
    trace.states.append(system.split(x))
    ddq, motors, _ = system.accelerations(t, x, acting)
    ddtheta = list(ddq)
    for k, value in zip(system.dynamics.elastic, motors, strict=True):
        ddtheta[k] = value
    trace.accelerations.append((ddq, ddtheta))
    trace.commands.append(command)
    trace.delivered.append(acting)
    trace.transmitted.append(system.transmitted(t, x, acting))


def _runaway(dynamics: Dynamics, t: float) -> RobotError:
    return RobotError(
        f"{dynamics.robot.name}: the simulated motion runs away at {t:.3g} s",
        detail="its parameters or effects make the controlled robot unstable",
        hint="lower gains (--kp, --kd), a higher --rate, or smaller effects",
    )
