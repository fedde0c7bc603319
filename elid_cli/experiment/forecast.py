"""Standard errors that a log of a planned motion will give, seen through estimation's own filter and masks.

The motion is played in thought: torques and deflections follow from the reference values, the log goes the way that
every log goes (smoothing, low-pass, reversals left out, a delay per torque channel), and the residual that is expected
of each torque is carried through the weighted least squares. The noise of a torque is the same in its sum row and its
motor row, so the two rows together are worth little more than one; what a motor row bears beyond that is its own.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.experiment.information import Information, States
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare

RATE = 250.0
"""Samples per second of the log in thought."""
TOLERANCE = 1e-7
"""Pivot below which a column depends on others, columns of unit norm."""


def forecast(information: Information, base: BaseParameters, states: States, residual: Array) -> Array:
    """Return the expected standard deviations of the base parameters, (b,); infinite where the motion shows nothing.

    Parameters
    ----------
    information
        Holds the model and the parameters that give the torques.
    base
        The robot's base parameters.
    states
        The motion at `RATE` samples per second.
    residual
        Expected rms of the residuals of sum and motor rows after filtering, (2, n).

    """
    robot = information.model.robot
    recording = _played(information, robot, states)
    # noise is what limits a real log's bandwidth; this one has none, so the usual filter is asked for
    try:
        signals = prepare(recording, robot, SignalOptions())
    except LogError as error:
        told = f"a motion of {recording.duration:.3g} s is too short to identify anything from"
        raise UsageError(told, detail=error.detail, hint="give a longer duration") from error
    seen = observe(Regressor(robot), signals)
    rows, noise = _weighted(seen, base, residual)
    taps = signals.filter.taps / signals.filter.taps.sum()
    repeats = max(seen.rate / (float(np.sum(taps**2)) / signals.dt), 1.0)  # instants per independent sample
    return np.asarray(_spread(rows, noise, base) * np.sqrt(repeats))


def _played(information: Information, robot: Robot, states: States) -> Recording:
    """Return the log of a motion: motors ahead of their links by the deflection under the load."""
    q = states[0]
    load, torque = information.loads(states)
    names = robot.parameter_names()
    stiffness = np.full(robot.n, np.inf)
    for k in np.flatnonzero(robot.elastic):
        stiffness[k] = information.parameters[names.index(StandardParameter("K", int(k)))]
    theta = q + load / stiffness
    t = np.arange(len(q)) / RATE
    return Recording(robot.joint_names, 1.0 / RATE, t, q, theta, torque, segments=(Segment(0, len(q)),))


def _weighted(seen: Observation, base: BaseParameters, residual: Array) -> tuple[Array, Array]:
    """Return (rows, noise): weighted rows, and the same put together by the noise that they bear, (r, p + n)."""
    n, p = seen.robot.n, len(base.parameters)
    rows, noise = [], []
    for k in range(n):
        shared = np.zeros((seen.instants, p + n))
        common = min(residual[0, k] / residual[1, k], 1.0)  # share of a motor row's noise that is the torque's
        for own, size, share in (
            (EstimationRow("sum", k), residual[0, k], 1.0),
            (EstimationRow("motor", k), residual[1, k], common),
        ):
            group = next((g for g in seen.groups if g.row == own), None)
            if group is None:
                continue
            row = np.zeros_like(shared)
            row[:, group.index] = group.columns.T
            row[:, p + k] = seen.tau_rate[k]
            row = np.where(group.use[:, None], row, 0.0) / size
            rows.append(row)
            shared += share * row
            if share < 1.0:
                noise.append(np.sqrt(1.0 - share**2) * row)
        noise.append(shared)
    return np.concatenate(rows), np.concatenate(noise)


def _spread(rows: Array, noise: Array, base: BaseParameters) -> Array:
    """Return standard deviations of weighted least squares whose rows' noise is that of the torques."""
    from scipy.linalg import qr, solve_triangular

    norms = np.linalg.norm(rows, axis=0)
    live = np.flatnonzero(norms > 1e-13 * norms.max())
    factor, order = qr(rows[:, live] / norms[live], mode="r", pivoting=True)
    pivots = np.abs(np.diag(factor))
    most = base.count + rows.shape[1] - len(base.parameters)
    count = min(int(np.sum(pivots > TOLERANCE * pivots[0])), most)
    kept = live[order[:count]]
    inverse = solve_triangular(factor[:count, :count], np.eye(count)) / norms[kept][:, None]
    root = (noise[:, kept] @ inverse) @ inverse.T
    transform = np.zeros((base.count, rows.shape[1]))
    transform[:, : len(base.parameters)] = base.transform
    spread: Array = np.linalg.norm(root @ transform[:, kept].T, axis=0)
    # a base parameter that dropped columns belong to as well is not determined by the kept ones
    dropped = live[order[count:]]
    alike = solve_triangular(factor[:count, :count], factor[:count, count:])
    # rounding must not look like a dependence: these coefficients are between columns of unit norm
    dependence = np.where(np.abs(alike) < 1e-9, 0.0, alike) * norms[dropped] / norms[kept][:, None]
    gap = np.abs(transform[:, dropped] - transform[:, kept] @ dependence)
    size = np.abs(transform[:, kept]) @ np.abs(dependence) + np.abs(transform[:, dropped])
    unseen = np.any(gap > 1e-5 * np.maximum(size, 1e-300), axis=1)
    return np.where(unseen | (spread == 0), np.inf, spread)
