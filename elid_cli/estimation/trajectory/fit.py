"""Gauss-Newton on simulated motion: drive parameters of every joint, the bodies held at the robot file's values.

The simulated motion under the commands (output error, as in DIDIM: Gautier, Janot, Vandanjon 2013) holds no measured
position on its right-hand side: noise of the encoders, which enters both sides of least squares on a torque that was
computed from them, does not bias it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.regression.long_run import beyond_normal
from elid_cli.estimation.trajectory.normal_equations import Equations, Tracked, passed
from elid_cli.estimation.trajectory.unknowns import KINDS, Chains
from elid_cli.model.rollout import Linearised
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

ROUNDS = 14
"""Most Gauss-Newton steps."""
FAR = 0.5
"""Part of itself by which an inertia or friction changes in one step at most."""
SETTLED = 1e-3
"""Relative change of the error below which the fit ends: the standard errors are far larger than what is left."""
LEAST = np.array([1e-6, 0.0, 0.0, -np.inf])
"""Least values of the unknowns."""
COARSE = 0.005
"""Part of itself by which steps of 1 ms and what happens within a sample move a value."""
DAMPING = 1e-6
"""Of the normal equations' diagonal: directions that the motion does not show stay where they are."""


@dataclass(frozen=True)
class TrajectoryFit:
    """What a trajectory fit found."""

    values: Array
    """Unknowns of every joint (`unknowns.KINDS`), (n, 4)."""
    covariance: tuple[Array, ...]
    """Of the unknowns of every chain, joint by joint, (4 s, 4 s)."""
    between: Array
    """Spread between recordings beyond that, as a standard deviation, (n, 4); 0 of one recording."""
    rms: Array
    """Error of the simulated positions, rad (m), (n,)."""
    rms_before: Array
    """The same with the values that the fit started from."""
    steps: int
    chains: Chains
    left_out: Array
    """Unknowns without each block of time in turn, (B, n, 4)."""
    spans: tuple[tuple[int, float, float], ...]
    """Recording, first and last time of every block, s."""

    def deviation(self) -> Array:
        """Return the standard errors of the unknowns, (n, 4)."""
        found = np.zeros_like(self.values)
        for chain, covariance in zip(self.chains.joints, self.covariance, strict=True):
            found[chain] = np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(len(chain), len(KINDS))
        return found


def fit_trajectory(robot: Robot, runs: list[Run], start: Array) -> TrajectoryFit:
    """Fit the drive parameters of a robot to stretches of logs.

    Parameters
    ----------
    robot
        Its bodies' parameters must be known.
    runs
        Stretches driven by commands, of one or more recordings.
    start
        Values to start from, (n, 4).

    Raises
    ------
    RobotError
        Parameters of bodies are unknown.
    DataError
        The simulated motion runs away from the measured one.
    """
    equations = Linearised(robot, without=("Ja", "fs", "fv"))
    chains = Chains.of(robot)
    tracked = [Tracked(run, run.near, np.gradient(run.near, run.dt, axis=0)) for run in runs]
    values = np.maximum(start, LEAST)
    weights = np.ones(robot.n)
    before: Array | None = None
    best: tuple[float, Array, Equations] | None = None
    shrink, number = 1.0, 0
    for number in range(1, ROUNDS + 1):
        found = passed(equations, tracked, values, chains, weights)
        if not np.isfinite(found.rms).all():
            raise DataError("the simulated motion runs away from the measured one", hint="are the gains right?")
        before = found.rms if before is None else before
        cost = float(np.sum(np.log(found.size)))
        if best is not None and cost > best[0] + 1e-3 and number > 3:
            shrink *= 0.5
            values = best[1] + shrink * (values - best[1])
            if shrink < 0.1:
                break
            continue
        weights = 1.0 / np.maximum(found.size, 1e-7)
        done = best is not None and abs(best[0] - cost) < SETTLED * robot.n
        best, shrink = (cost, values, found), 1.0
        if done:
            break
        values = _moved(values, found, chains)
    if best is None or before is None:
        raise DataError("the log has nothing to fit")
    _, values, final = best
    covariance, between, left = _spread(final, values, chains)
    return TrajectoryFit(values, covariance, between, final.rms, before, number, chains, left, final.spans)


def _moved(values: Array, found: Equations, chains: Chains) -> Array:
    """Return the unknowns after one step."""
    result = values.copy()
    for chain, matrix, load in zip(chains.joints, found.matrix, found.load, strict=True):
        step = _solved(matrix.sum(axis=0), load.sum(axis=0)).reshape(len(chain), len(KINDS))
        reach = FAR * np.maximum(np.abs(values[chain]), 0.2 * np.median(np.abs(values), axis=0))
        reach[:, 3] = np.inf
        result[chain] = np.maximum(values[chain] + np.clip(step, -reach, reach), LEAST)
    return result


def _solved(matrix: Array, load: Array) -> Array:
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(scale, scale) + DAMPING * np.eye(len(matrix))
    step: Array = -np.linalg.solve(scaled, load / scale) / scale
    return step


def _spread(found: Equations, values: Array, chains: Chains) -> tuple[tuple[Array, ...], Array, Array]:
    """Return the covariance of every chain's unknowns, the spread between recordings, and values without each block.

    One block of time after the other is left out of one linear step: the residual's memory is in what that changes.
    It counts where it is larger than white noise would have it; of three recordings and more, the scatter of what each
    says alone counts where it is larger still. Few blocks tell a variance badly: it is that of a normal distribution
    whose 95 % interval is Student's.
    """
    covariances, between = [], np.zeros_like(values)
    source = np.array([number for number, _, _ in found.spans])
    recordings = np.unique(source)
    without = np.repeat(values[None], len(source), axis=0)
    for chain, matrix, load in zip(chains.joints, found.matrix, found.load, strict=True):
        whole, pull = matrix.sum(axis=0), load.sum(axis=0)
        left = np.array([_solved(whole - m, pull - g) for m, g in zip(matrix, load, strict=True)])
        without[:, chain] += left.reshape(len(left), len(chain), len(KINDS))
        count = len(left)
        offset = left - left.mean(axis=0)
        covariance = beyond_normal(count - 1) ** 2 * (count - 1) / count * offset.T @ offset
        covariance = _at_least(covariance, np.diag(_white(whole, found, chain)))
        if len(recordings) > 1:
            alone = np.array([
                _solved(matrix[own].sum(axis=0), load[own].sum(axis=0))
                for own in (source == r for r in recordings)
            ])  # fmt: skip
            scatter = np.diag(np.cov(alone.T))
            spread = np.maximum(scatter - len(recordings) * np.diag(covariance), 0.0)
            between[chain] = np.sqrt(spread).reshape(len(chain), len(KINDS))
            if len(recordings) > 2:
                covariance = _at_least(covariance, beyond_normal(len(recordings) - 1) ** 2 * scatter / len(recordings))
        coarse = np.abs(values[chain])
        coarse[:, 3] = coarse[:, 1]  # an offset is told on the scale of the friction
        covariances.append(covariance + np.diag((COARSE * coarse.ravel()) ** 2))
    return tuple(covariances), between, np.maximum(without, LEAST)


def _at_least(covariance: Array, variance: Array) -> Array:
    """Return a covariance whose diagonal is no smaller than variances, correlations kept."""
    size = np.sqrt(np.maximum(variance / np.maximum(np.diag(covariance), 1e-300), 1.0))
    larger: Array = covariance * np.outer(size, size)
    return larger


def _white(whole: Array, found: Equations, chain: NDArray[np.intp]) -> Array:
    """Return the covariance that a residual without memory would leave; weights make each joint's error 1."""
    samples = found.counts.sum()
    size = float(np.mean(found.lighter.sum(axis=0)[chain] / samples / np.maximum(found.size[chain], 1e-12) ** 2))
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    scaled = whole / np.outer(scale, scale) + DAMPING * np.eye(len(whole))
    inverse: Array = size * np.linalg.inv(scaled) / np.outer(scale, scale)
    return inverse
