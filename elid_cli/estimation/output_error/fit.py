"""Gauss-Newton on windows that the logged torque drives: base parameters, offsets and a delay; states free.

Output error of the simulated motion under the torque (as in DIDIM: Gautier, Janot, Vandanjon 2013, without a
controller), with multiple shooting: open loop a motion drifts away from the measured one, so each window starts from a
state of its own, which is an unknown as well. How long the windows are is decided by the standard errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.output_error.normal_equations import SMALL, eliminated, left_out
from elid_cli.estimation.output_error.simulated import Simulated, Unknowns, simulate
from elid_cli.estimation.output_error.windows import Windows
from elid_cli.estimation.regression.long_run import at_least
from elid_cli.estimation.regression.normal_equations import jackknife, step_of, white_covariance
from elid_cli.model.runs import Run
from elid_cli.signals.signals import Signals

ROUNDS, RELAXED = 12, 8
"""Most steps of the unknowns, and of the windows' states between two of them."""
SETTLED = 0.05
"""Standard errors of a white residual by which no unknown moves any more at the end."""
SETTLED_STATES = 0.3
"""Weighted squared error that a step of a window's states must take away to be taken."""
LENGTHS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Lengths of windows that are tried, s, the shortest first, for as long as the standard errors fall …"""
SHARPER = 0.97
"""… to this part, in geometric mean."""
APART = 4.0
"""Standard errors by which the unknowns may move with the length of the windows."""
LOST = 0.1
"""Part of the motion's spread by which the simulated one may be off, rms."""
FEWEST = 8
"""Windows, at least, that a longer one is tried with: few blocks tell standard errors badly."""


@dataclass(frozen=True)
class OutputErrorFit:
    """What the fit found."""

    unknowns: Unknowns
    windows: Windows
    last: Simulated
    covariance: Array
    """Of the unknowns, (C, C)."""
    left_out: Array
    """Unknowns without each block of time in turn, (B, C)."""
    spans: tuple[tuple[int, float, float], ...]
    """Recording, first and last time of every block, s."""
    rms_before: Array
    """Error of the positions with the values that it started from, rad (m), (m,)."""
    steps: int

    @property
    def z(self) -> Array:
        """The unknowns, (C,)."""
        return self.last.z

    @property
    def seconds(self) -> float:
        """Length of a window, s."""
        return self.windows.length * self.windows.each * self.windows.h


def relaxed(own: Unknowns, windows: Windows, now: Simulated, weights: Array) -> Simulated:
    """Return windows from the best states for the unknowns, each window by damped steps of its own.

    Where a motor nearly rests, a slightly other state lets it stick or turn round: some windows take many small steps.
    """
    damping = np.zeros(windows.count)
    for _ in range(RELAXED):
        free = eliminated(now.gram.sum(axis=1), own.count, damping)
        open_ = now.costs - free.square > SETTLED_STATES
        if not open_.any():
            break
        part = windows.of(open_)
        tried = simulate(own, part, now.z, now.start[open_] + free.back[open_, :, -1],
                         (now.x[:, open_], now.v[:, open_]), weights)  # fmt: skip
        better = np.zeros(windows.count, dtype=bool)
        better[open_] = tried.costs < now.costs[open_]
        now = now.with_windows(better, tried.of(better[open_]))
        damping = np.where(better, 0.2 * damping, np.where(open_, np.maximum(10 * damping, 1e-3), damping))
    return now


def settled(own: Unknowns, windows: Windows, now: Simulated, weights: Array) -> tuple[Simulated, int]:
    """Return windows with the unknowns that bring them nearest to what was measured, and the number of steps."""
    damping = 0.0
    now = relaxed(own, windows, now, weights)
    number = 0
    while number < ROUNDS:
        number += 1
        free = eliminated(now.gram.sum(axis=1), own.count)
        matrix, load = free.matrix.sum(axis=0), free.load.sum(axis=0)
        deviation = np.sqrt(np.diag(white_covariance(matrix, SMALL)))
        z = own.possible(now.z + step_of(matrix, load, SMALL + damping))
        moved = float(np.max(np.abs(z - now.z) / deviation))
        if moved < SETTLED:
            break
        about = (now.x, now.v)
        tried = simulate(own, windows, z, now.start + free.back[:, :, :-1] @ (z - now.z), about, weights)
        tried = relaxed(own, windows, tried, weights)
        if tried.costs.sum() <= now.costs.sum():
            now, damping = tried, 0.1 * damping if damping > 1e-6 else 0.0
        else:
            damping = max(10 * damping, 1e-3)
            if damping > 1e3:
                break
    return now, number


def fit_output_error(
    own: Unknowns, runs: Sequence[Run], signals: Signals, z: Array, lengths: Sequence[float] = LENGTHS
) -> OutputErrorFit:
    """Fit base parameters, offsets and a delay to stretches of logs that their torques drive.

    Parameters
    ----------
    own
        What is unknown.
    runs
        Stretches of one or more recordings, whole.
    signals
        The same logs, smooth: the motion that the first equations are linear about.
    z
        Unknowns to start from, (C,).
    lengths
        Lengths of windows to try, s, the shortest first.

    Raises
    ------
    DataError
        No window in which the motors keep moving, or no simulated motion stays near the measured one.
    """
    best: OutputErrorFit | None = None
    for seconds in lengths:
        windows = Windows.cut(runs, own.equations.robot, signals, seconds)
        if windows.count < (FEWEST if best is not None else 1):
            break
        fit = _of_length(own, windows, z if best is None else best.z)
        if fit is None:
            break
        if best is not None:
            ratio = np.sqrt(np.diag(fit.covariance) / np.diag(best.covariance))
            apart = (fit.z - best.z) / np.sqrt(np.diag(fit.covariance) + np.diag(best.covariance))
            if not (np.exp(np.mean(np.log(ratio))) < SHARPER and np.abs(apart).max() < APART):
                break
            fit = replace(fit, steps=fit.steps + best.steps, rms_before=best.rms_before)
        best = fit
    if best is None:
        raise DataError(
            "--fit trajectory: with the values of least squares the simulated motion runs away from the measured one "
            "within a window; values that this log does not tell well make no motion like it",
            hint="leave --fit out: the torque is fitted",
        )
    return best


def _of_length(own: Unknowns, windows: Windows, z: Array) -> OutputErrorFit | None:
    """Return the fit to windows, or None where the simulated motion runs away."""
    weights = 1.0 / np.maximum(np.nanstd(windows.seen - windows.x[:: windows.each], axis=(0, 1)), 1e-9)
    start = np.concatenate([windows.x[0], windows.v[0]], axis=1)
    try:
        now = simulate(own, windows, z, start, (windows.x, windows.v), weights)
        before = relaxed(own, windows, now, weights)
        now, steps = settled(own, windows, before, weights)
        # the errors themselves tell what they weigh
        weights = 1.0 / np.maximum(now.rms, 1e-9)
        now, more = settled(own, windows, simulate(own, windows, now.z, now.start, (now.x, now.v), weights), weights)
    except np.linalg.LinAlgError:
        return None
    near = bool(np.isfinite(now.z).all() and (now.rms < LOST * np.nanstd(windows.seen, axis=(0, 1))).all())
    if not near:
        return None
    blocks, spans = windows.blocks()
    left = left_out(now.gram, own.count, blocks)
    # no smaller than that of a residual without memory
    white = np.diag(white_covariance(eliminated(now.gram.sum(axis=1), own.count).matrix.sum(axis=0), SMALL))
    return OutputErrorFit(own, windows, now, at_least(jackknife(left), white), left + now.z, spans, before.rms,
                          steps + more)  # fmt: skip
