"""Stretches of a log to be simulated: measured motion, the state that they start from, and what drove them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from elid_cli._types import Array
from elid_cli.model.coordinates import chains_of
from elid_cli.model.drives import Drives, Stepped, parts_of_loops
from elid_cli.model.rollout import STEP
from elid_cli.model.told_by_log import check_any, either, told_by_log
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import integrals
from elid_cli.signals.recording import Recording

SHORTEST = 5
"""Samples of the shortest stretch that is simulated."""
WINDOW, MOSTLY = 1e-2, 0.95
"""s over which speeds of a motion are looked at, and part of them that are no larger."""
FAR = 2e-2
"""rad (m) that the fastest joint goes from one instant at which equations are taken to the next. Measured on arms of 3
to 6 joints under commands that step every 20 ms: the motion is off by 0.05 to 0.2 mrad then."""
STARTING, LEAST, MOST = 0.03, 3, 7
"""s whose positions give the velocity at the start, where none is logged, and how many samples these are."""


@dataclass(frozen=True)
class Run:
    """One stretch, or several of one length side by side (then every array has an axis of S stretches before n)."""

    t: Array
    """Time, s, (N,)."""
    measured: Array
    """Measured positions of the driven side, rad (m), (N, n); NaN where missing."""
    start: tuple[Array, Array]
    """Positions and velocities of the coordinates at the start, (m,)."""
    near: Array
    """The measured motion of the coordinates, gaps filled, (N, m)."""
    drives: Drives
    dt: float
    """Sample time, s."""
    source: int = 0
    """Number of the file that it is from."""
    told: Array | None = None
    """What the log told the drives at every sample, N·m (N), (N, n)."""
    seen: Array | None = None
    """Measured positions of the coordinates, rad (m), (N, m); NaN where missing."""
    extra: Array | float = 0.0
    """How much later than the others each drive acts, s, (n,)."""
    aim: Array | None = None
    """Integral of the commanded positions at every sample, less that of the measured ones before the stretch, rad·s
    (m·s), (N, n): what drives with an integral term are told."""

    parts: tuple[Array, Array] | None = None
    """What kp and kd make of `told`, kp q_des and kd dq_des, N·m (N), (N, n) each; the rest is tau_ff."""
    smooth: bool | None = None
    """Whether commands change smoothly from sample to sample: the drives were told more than the log holds."""
    interpolated: bool = False
    """Whether commands change on a line from sample to sample."""
    begun: float = 0.0
    """Samples from the start of the recording to that of the stretch."""
    quick: int = 1
    """How often in a sample the equations of motion must be taken, at least: `quickness` of its motion."""

    @property
    def finer(self) -> int:
        """How often in a sample the equations of motion are taken: a whole number of steps lies between."""
        steps = len(self.drives.told) // (len(self.t) - 1)
        return next(each for each in range(min(self.quick, steps), steps + 1) if steps % each == 0)

    def later(self, extra: Array) -> Run:
        """Return the run with drives that act later than the others by `extra`, s, (n,), once it is `delayed`."""
        return replace(self, extra=extra)

    def delayed(self, late: Array, *, commanded: bool = True, finer: int = 1) -> Run:
        """Return the run with drives that act later than logged by `late`, s, (n,), in steps `finer` times shorter."""
        if self.told is None:
            return self
        steps = finer * len(self.drives.told) // (len(self.t) - 1)
        way, samples, lag = _way(commanded, self.smooth, self.interpolated), (late + self.extra) / self.dt, None
        if self.drives.held is not None:  # a loop is told commands at its samples, the rest passes before it acts
            parts = parts_of_loops(self.drives.held)
            whole = np.where(self.drives.held > 0, np.round(samples * parts) / parts, samples)
            samples, lag = whole, self.dt * (samples - whole)
        at = 0.5 if self.drives.held is None else np.where(self.drives.held > 0, 0.0, 0.5)
        acting = _between(self.told, steps, samples, way, at)
        if self.drives.ki is not None and self.aim is not None:
            acting += self.drives.ki * _between(self.aim, steps, samples, "line")
        return replace(self, drives=replace(self.drives, told=acting, lag=lag))

    def integrating(self, rate: Array, late: Array | float = 0.0) -> Run:
        """Return the run with drives whose integral gain is `rate` (n,), 1/s, times kp; they act later by `late`."""
        of_drives = replace(self, drives=replace(self.drives, ki=rate * self.drives.kp))
        return of_drives.delayed(np.zeros(len(rate)) + late)

    def filtered(self, times: Array) -> Run:
        """Return the run with drives that filter the velocity with time constants (n,), s."""
        return replace(self, drives=replace(self.drives, smoothing=times))

    def holding(self, often: Array, late: Array | float = 0.0) -> Run:
        """Return the run with drives that compute their torque `often` times per sample and hold it.

        Those of (n,) that are 0 act all the time. All act later than logged by `late`, s.
        """
        held = np.asarray(often, dtype=float)
        steps, every = len(self.drives.told) // (len(self.t) - 1), math.lcm(*map(int, parts_of_loops(held).tolist()))
        again = self if self.drives.stepped else self._in_steps(every * math.ceil(steps / every))
        since = np.where(held > 0, self.begun % (1.0 / np.where(held > 0, held, 1.0)), 0.0)
        drives = replace(again.drives, held=held, since=since)
        return replace(again, drives=drives).delayed(np.zeros(len(held)) + late)

    def stepping(self, how: Stepped, step: float, late: Array | float = 0.0) -> Run:
        """Return the run of a simulator that steps by `step`, s, a whole part of a sample, with drives `late` s."""
        again = self._in_steps(max(round(self.dt / step), 1))
        late = np.zeros(self.drives.kp.shape[-1]) + late
        return replace(again, drives=replace(again.drives, stepped=how)).delayed(late)

    def _in_steps(self, each: int) -> Run:
        """Return the run in so many steps per sample, once it is `delayed`."""
        told = np.zeros((each * (len(self.t) - 1), *self.drives.told.shape[1:]))
        return replace(self, drives=replace(self.drives, told=told))

    def pushed(self, torque: Array) -> Run:
        """Return the run whose drives are told a further torque, N·m (N), (n,), once it is `delayed`."""
        return replace(self, told=None if self.told is None else self.told + torque)

    def delivering(self, ratio: Array) -> Run:
        """Return the run with drives that deliver the computed torque over a ratio (n,)."""
        drives = self.drives
        ki = None if drives.ki is None else drives.ki / ratio
        less = replace(drives, told=drives.told / ratio, kp=drives.kp / ratio, kd=drives.kd / ratio, ki=ki)
        if self.told is None or self.parts is None:
            return replace(self, drives=less)
        parts = self.parts[0] / ratio, self.parts[1] / ratio
        return replace(self, drives=less, told=self.told / ratio, parts=parts)

    def tuned(self, kp: Array, kd: Array, late: Array | float = 0.0) -> Run:
        """Return the run with drives whose gains are the logged ones over ratios (n,); they act later by `late`, s."""
        if self.told is None or self.parts is None:
            return self
        parts, own = (self.parts[0] / kp, self.parts[1] / kd), self.drives
        told = self.told + sum(new - old for new, old in zip(parts, self.parts, strict=True))
        drives = replace(own, kp=own.kp / kp, kd=own.kd / kd, ki=None if own.ki is None else own.ki / kp)
        return replace(self, drives=drives, told=told, parts=parts).delayed(np.zeros(len(kp)) + late)

    def within(self, limit: Array) -> Run:
        """Return the run with drives of other torque limits, N·m (N), (n,)."""
        return replace(self, drives=replace(self.drives, limit=limit))

    @classmethod
    def together(cls, runs: Sequence[Run]) -> Run:
        """Return runs of one length side by side."""
        first = runs[0].drives
        told = np.stack([run.drives.told for run in runs], axis=1)
        kp, kd = np.stack([run.drives.kp for run in runs]), np.stack([run.drives.kd for run in runs])
        ki = None if first.ki is None else np.stack([run.drives.ki for run in runs if run.drives.ki is not None])
        times = [run.drives.smoothing for run in runs if run.drives.smoothing is not None]
        holds = [run.drives.held for run in runs if run.drives.held is not None]
        lags = [run.drives.lag for run in runs if run.drives.lag is not None]
        since = [run.drives.since for run in runs if run.drives.since is not None]
        drives = Drives(
            told, kp, kd, first.limit, ki, np.stack(times) if times else None, np.stack(holds) if holds else None,
            np.stack(lags) if lags else None, first.stepped, np.stack(since) if since else None,
        )  # fmt: skip
        start = (np.stack([run.start[0] for run in runs]), np.stack([run.start[1] for run in runs]))
        near = np.stack([run.near for run in runs], axis=1)
        measured = np.stack([run.measured for run in runs], axis=1)
        return cls(runs[0].t, measured, start, near, drives, runs[0].dt, quick=max(run.quick for run in runs))


def runs_of(recording: Recording, robot: Robot, horizon: float | None, delays: Array, *, commanded: bool) -> list[Run]:
    """Return the stretches of a log, cut every `horizon` s.

    Parameters
    ----------
    recording, robot
        The log and its robot, of n joints.
    horizon
        s; None: whole stretches.
    delays
        How much later than logged each drive acts, s, (n,).
    commanded
        Whether commands drive the robot, else its measured torques.

    Raises
    ------
    LogError
        A joint has no position, or nothing that drives it.
    """
    link = either(recording.q, recording.theta)
    motor = either(recording.theta, recording.q)
    check_any(link, robot, "position")
    told, parts, kp, kd = told_by_log(recording, robot, commanded=commanded)
    aims, before = integrals(recording, link) if commanded else (None, None)
    limit = robot.torque_limits
    elastic = np.array([joint.elastic for joint in robot.joints])
    speed = either(recording.dq, recording.dtheta), either(recording.dtheta, recording.dq)
    both, chain = np.concatenate([link, motor[:, elastic]], axis=1), chains_of(robot)
    coupled = np.bincount(chain, minlength=len(chain))[chain] > 1  # what moves alone has one inertia everywhere
    quick = quickness([both[own.start : own.stop, coupled] for own in recording.segments], recording.dt)
    steps = quick * math.ceil(recording.dt / STEP / quick)
    way = _way(commanded, recording.smooth, recording.interpolated)
    begun = (recording.t - _first_times(recording)) / recording.dt
    piece = None if horizon is None else max(round(horizon / recording.dt), SHORTEST)
    runs = []
    for segment in recording.segments:
        edges = (
            [segment.start, segment.stop]
            if piece is None
            else [*range(segment.start, segment.stop, piece), segment.stop]
        )
        for a, b in pairwise(edges):
            stop = min(b + 1, segment.stop) if piece is not None else b
            part = slice(a, stop)
            usable = np.isfinite(link[part]).all(axis=0).all() or _mostly(link[part])
            if stop - a < SHORTEST or not usable or not np.isfinite(told[part]).all():
                continue
            t = recording.t[part]
            seen = both[part]
            x = _filled(seen)
            v = np.concatenate(
                [_speed(speed[0], link, part, recording.dt), _speed(speed[1], motor, part, recording.dt)[elastic]]
            )
            acting = _between(told[part], steps, delays / recording.dt, way)
            drives = Drives(acting, kp[a], kd[a], limit)
            runs.append(Run(t, link[part], (x[0], v), x, drives, recording.dt, segment.source, told[part], seen,
                            aim=None if aims is None or before is None else aims[part] - before[a],
                            parts=None if parts is None else (parts[0][part], parts[1][part]), smooth=recording.smooth,
                            interpolated=recording.interpolated, begun=float(begun[a]), quick=quick))  # fmt: skip
    return runs


def quickness(stretches: Sequence[Array], dt: float) -> int:
    """Return how often in a sample the equations of motion change, along the motion of joints that couple, (N, m) each.

    Between two instants the equations are on a line, and the motion that they are about: its error falls with the
    square of the time between them. Speeds are those over a window: those of a sample are noise.
    """
    wide = max(1, round(WINDOW / dt))
    ways = [np.abs(x[wide:] - x[:-wide]) for x in stretches if len(x) > wide and x.shape[1]]
    fast = np.concatenate(ways) if ways else np.zeros((1, 1))
    known = np.where(np.isfinite(fast), fast, 0.0)
    speed = float(np.quantile(known, MOSTLY, axis=0).max()) / (wide * dt)
    return int(np.clip(np.ceil(dt * speed / FAR), 1, np.ceil(dt / STEP)))


def _mostly(values: Array) -> bool:
    return bool((np.isfinite(values).mean(axis=0) > 0.9).all() and np.isfinite(values[0]).all())


def _filled(values: Array) -> Array:
    filled = values.copy()
    for column in filled.T:
        bad = np.isnan(column)
        if bad.any():
            column[bad] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), column[~bad])
    return filled


def _speed(logged: Array, position: Array, part: slice, dt: float) -> Array:
    """Return the velocity at a stretch's start, (n,): as logged, or of a parabola through the first samples."""
    first = position[part][: starting(dt)]
    time = np.arange(len(first)) * dt
    ok = np.isfinite(first).all(axis=1)
    slope: Array = np.polyfit(time[ok], first[ok], min(2, int(np.count_nonzero(ok)) - 1))[-2]
    if logged.shape != position.shape:
        return slope
    return np.where(np.isfinite(logged[part.start]), logged[part.start], slope)


def starting(dt: float) -> int:
    """Return how many samples give the velocity at the start: over longer it changes, above all as a command does."""
    return int(np.clip(round(STARTING / dt) + 1, LEAST, MOST))


def _way(commanded: bool, smooth: bool | None, interpolated: bool) -> Literal["held", "smooth", "line"]:
    """Return how values go on between samples: commands are held for theirs or smooth, torques are on a line.

    As are commanded positions that drives interpolate.
    """
    if not commanded or interpolated:
        return "line"
    return "smooth" if smooth else "held"


def _first_times(recording: Recording) -> Array:
    """Return when the recording that each sample is of begins, s, (N,)."""
    found: Array = np.full(len(recording.t), recording.t[0])
    known: dict[int, float] = {}
    for segment in recording.segments:
        own = slice(segment.start, segment.stop)
        found[own] = known.setdefault(segment.source, float(recording.t[segment.start]))
    return found


def _between(
    told: Array, steps: int, late: Array, way: Literal["held", "smooth", "line"], at: Array | float = 0.5
) -> Array:
    """Return what is told at every step, (K, n), of values at samples; `at`: when in it, of values on a line."""
    count = (len(told) - 1) * steps
    place = np.arange(count) / steps
    found = np.empty((count, told.shape[1]))
    if way != "held":
        from scipy.interpolate import make_interp_spline

        samples, inside = np.arange(len(told), dtype=float), np.broadcast_to(at, told.shape[1])
        for k in range(told.shape[1]):
            when = np.clip(place + inside[k] / steps - late[k], 0.0, len(told) - 1.0)
            smooth = way == "smooth" and len(told) > 3
            values = told[:, k]
            found[:, k] = make_interp_spline(samples, values)(when) if smooth else np.interp(when, samples, values)
        return found
    # a command that changes within a step acts for its part of it
    samples = np.arange(len(told) + 1, dtype=float)
    so_far = np.concatenate([np.zeros((1, told.shape[1])), np.cumsum(told - told[0], axis=0)])
    for k in range(told.shape[1]):
        edges = np.arange(count + 1) / steps - late[k]
        found[:, k] = steps * np.diff(np.interp(np.maximum(edges, 0.0), samples, so_far[:, k])) + told[0, k]
    return found
