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
    samples: int
    """Samples of the log."""
    accuracy: float = 1.0
    """Factor by which steps are finer than the default."""

    @property
    def periods(self) -> int:
        """Controller periods of the log."""
        return (self.samples - 1) * self.held + 1

    @property
    def step(self) -> float:
        """Integration step, s."""
        return self.period / self.steps


@dataclass
class Trace:
    """What happened at every sample of the log, noted one by one or many at once."""

    _rows: list[Sequence[float | list[float]]] = field(default_factory=list)
    _blocks: list[Sequence[Array]] = field(default_factory=list)

    def note(self, *row: float | list[float]) -> None:
        """Keep a sample: t, then lists of all joints: q, q', q'', θ, θ', θ'', command, delivered, transmitted."""
        self._rows.append(row)

    def note_all(self, *block: Array) -> None:
        """Keep N samples that follow: the same, t of shape (N,), all others of shape (N, n)."""
        self._settle()
        self._blocks.append(block)

    def columns(self) -> list[Array]:
        """Return all samples: the same as `note_all` takes."""
        self._settle()
        return [np.concatenate(parts) for parts in zip(*self._blocks, strict=True)]

    def _settle(self) -> None:
        if self._rows:
            self._blocks.append([np.array(values) for values in zip(*self._rows, strict=True)])
            self._rows = []


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

    def wanted(self, times: Array) -> tuple[Array, Array, Array]:
        """Return (θ, θ', feed-forward torque) that are wanted at times (N,), each of shape (N, n)."""
        theta, feed = self._desired(times)
        ahead, _ = self._desired(times + _DIFFERENCE)
        behind, _ = self._desired(times - _DIFFERENCE)
        return theta, (ahead - behind) / (2 * _DIFFERENCE), feed

    @property
    def law(self) -> tuple[Array, Array, Array] | None:
        """(kp, kd, torque limits), each of shape (n,), where motors deliver what they are asked for; else None."""
        return None if self._motors else (np.array(self._kp), np.array(self._kd), np.array(self._limits))

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
    clock: Clock,
    *,
    continuous: bool,
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
    clock
        Time steps.
    continuous
        Whether the controller acts at every instant; otherwise its torque is held over a period.
    progress
        Called with the fraction done.

    Raises
    ------
    RobotError
        The motion runs away.

    """
    trace = Trace()
    period, steps, h, periods = clock.period, clock.steps, clock.step, clock.periods
    stages = 2 * steps if continuous else 1
    for _, system in phases:
        system.prepare(4 * steps * periods)
        if not continuous:
            system.hold(period, steps, clock.accuracy)
    for first in range(0, periods, _CHUNK):
        count = min(_CHUNK, periods - first)
        asked = controller.wanted(period * (first + np.arange(count * stages + 1) / stages))
        x, done = _looped(phases, controller, asked, x, range(first, first + count), clock, trace)
        plan = list(zip(*(values.tolist() for values in asked), strict=True)) if done < count else []
        for k in range(done, count):
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


def _looped(
    phases: Sequence[tuple[float, System]],
    controller: Controller,
    asked: tuple[Array, Array, Array],
    x: list[float],
    chunk: range,
    clock: Clock,
    trace: Trace,
) -> tuple[list[float], int]:
    """Return the state after as many periods of a chunk as run in one compiled loop, and how many: often all or none.

    What the loop does not get through is left to be done, and to be told, period by period.
    """
    system = phases[0][1]
    if len(phases) > 1 or system.looped is None or controller.law is None:
        return x, 0
    count, half = len(chunk), system.size // 2
    noted = np.empty((count, 2 * half)), np.empty((count, half)), np.empty((count, system.dynamics.robot.n))
    state, moving = np.array(x), min(count, clock.periods - 1 - chunk.start)
    done = system.looped.follow(state, asked, controller.law, noted, moving, RUNAWAY)
    logged = slice(-chunk.start % clock.held, done, clock.held)
    states, rates, commands = (values[logged] for values in noted)
    q, dq, theta, dtheta = system.split_all(states)
    ddq, _, ddtheta, _ = system.split_all(np.hstack([rates, rates]))
    time, transmitted = clock.period * np.array(chunk[logged]), system.dynamics.stiffness * (theta - q)
    trace.note_all(time, q, dq, ddq, theta, dtheta, ddtheta, commands, commands, transmitted)
    return state.tolist(), done


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
    q, dq, theta, dtheta = system.split(x)
    ddq, motors, _ = system.accelerations(t, x, acting)
    ddtheta = list(ddq)
    for k, value in zip(system.dynamics.elastic, motors, strict=True):
        ddtheta[k] = value
    trace.note(t, q, dq, ddq, theta, dtheta, ddtheta, command, acting, system.transmitted(t, x, acting))


def _runaway(dynamics: Dynamics, t: float) -> RobotError:
    return RobotError(
        f"{dynamics.robot.name}: the simulated motion runs away at {t:.3g} s",
        detail="its parameters or effects make the controlled robot unstable",
        hint="lower gains (--kp, --kd), a higher --rate, or smaller effects",
    )
