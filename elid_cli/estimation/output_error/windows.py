"""Windows of logs, of one length, that are simulated side by side from states of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

SHORTEST = 20
"""Samples of the shortest window."""
BLOCKS = 24
"""Blocks of time that the windows are cut into, each of which is left out in turn for the standard errors."""
SLOW, DWELL = 0.02, 0.1
"""Part of a motor's top speed below which it nearly rests, and of a window in which it may."""


@dataclass(frozen=True)
class Windows:
    """S windows of W samples and what drives them, K steps each."""

    length: int
    """Samples W."""
    each: int
    """Steps per sample."""
    h: float
    """Time of a step, s."""
    place: NDArray[np.intp]
    """First sample of every window in the log, (S,)."""
    source: NDArray[np.intp]
    """Recording of every window, (S,)."""
    t: Array
    """First and last time of every window, s, (S, 2)."""
    seen: Array
    """Measured positions, rad (m), (W + 1, S, m); NaN where missing, and at the end where another window goes on."""
    told: Array
    """Torque as logged in every step, N·m (N), (K, S, n)."""
    rate: Array
    """Its change with time, N·m/s (N/s), (K, S, n)."""
    resting: int
    """Further windows, in which a motor rests."""
    pieces: int
    """Pieces of time that each window counts in."""
    x: Array
    """Smooth motion in the steps, rad (m), (K + 1, S, m)."""
    v: Array

    @property
    def count(self) -> int:
        """Number of windows S."""
        return len(self.place)

    def of(self, use: NDArray[np.bool_]) -> Windows:
        """Return some of the windows."""
        parts = {name: getattr(self, name)[use] for name in ("place", "source", "t")}
        parts |= {name: getattr(self, name)[:, use] for name in ("seen", "told", "rate", "x", "v")}
        return replace(self, **parts)

    def blocks(self) -> tuple[NDArray[np.intp], tuple[tuple[int, float, float], ...]]:
        """Return the block of time of every piece, (S, P), and recording, first and last time of every block, s."""
        count = self.count * self.pieces
        of = np.arange(count) * min(BLOCKS, count) // count
        at = self.t[:, :1] + (self.t[:, 1:] - self.t[:, :1]) * np.arange(self.pieces + 1) / self.pieces
        first, last, source = at[:, :-1].ravel(), at[:, 1:].ravel(), np.repeat(self.source, self.pieces)
        spans = []
        for block in range(int(of.max()) + 1):
            own = np.flatnonzero(of == block)
            spans.append((int(source[own[0]]), float(first[own[0]]), float(last[own[-1]])))
        return of.reshape(self.count, self.pieces), tuple(spans)

    @classmethod
    def cut(cls, runs: Sequence[Run], robot: Robot, signals: Signals, seconds: float) -> Windows:
        """Cut stretches of a log into windows of about `seconds`; all of one length, so that little is left over.

        Raises
        ------
        DataError
            A motor rests in every window.
        """
        recording = signals.recording
        assert recording is not None
        dt = recording.dt
        longest = max(len(run.t) for run in runs) - 1
        length = max(longest // max(round(longest * dt / seconds), 1), min(SHORTEST, longest))
        elastic = np.array([joint.elastic for joint in robot.joints])
        motion = signals.motion
        own = (np.concatenate([motion.q, motion.theta[:, elastic]], axis=1),
               np.concatenate([motion.dq, motion.dtheta[:, elastic]], axis=1))  # fmt: skip
        each = len(runs[0].drives.told) // (len(runs[0].t) - 1)
        resting = 0
        top = np.quantile(np.abs(motion.dtheta), 0.98, axis=0)
        place, source, t, seen, told, rate, x, v = [], [], [], [], [], [], [], []
        for run in runs:
            assert run.seen is not None
            first = int(np.argmin(np.abs(recording.t - run.t[0])))
            change = np.gradient(run.drives.told, dt / each, axis=0)
            last = (len(run.t) - 1) // length * length
            for a in range(0, last, length):
                samples = slice(a, a + length + 1)
                speed = np.abs(motion.dtheta[first + a : first + a + length])
                if ((speed < SLOW * top).mean(axis=0) > DWELL).any():
                    resting += 1
                    continue
                steps = slice(a * each, (a + length) * each)
                part = run.seen[samples].copy()
                if a + length < last:
                    part[-1] = np.nan
                place.append(first + a)
                source.append(run.source)
                t.append((run.t[a], run.t[a + length - 1]))
                seen.append(part)
                told.append(run.drives.told[steps])
                rate.append(change[steps])
                smooth = own[0][first + a : first + a + length + 1], own[1][first + a : first + a + length + 1]
                x.append(_finer(smooth[0], each))
                v.append(_finer(smooth[1], each))
        if not place:
            raise DataError(
                "no window in which all motors keep moving: their rest tells nothing under a torque alone",
                hint="leave --fit out: the torque is fitted",
            )
        return cls(
            length, each, dt / each, np.array(place), np.array(source), np.array(t), np.stack(seen, axis=1),
            np.stack(told, axis=1), np.stack(rate, axis=1), resting,
            max(1, -(-BLOCKS // len(place))), np.stack(x, axis=1), np.stack(v, axis=1),
        )  # fmt: skip


def _finer(values: Array, each: int) -> Array:
    """Return values of samples (W + 1, m) at steps between them, on lines."""
    if each == 1:
        return values
    at = np.arange((len(values) - 1) * each + 1) / each
    return np.stack([np.interp(at, np.arange(len(values)), column) for column in values.T], axis=1)
