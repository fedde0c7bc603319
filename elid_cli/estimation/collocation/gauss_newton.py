"""The iteration of a collocation problem: Gauss-Newton with step halving."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.collocation.bordered_banded import covariance_at, eliminate_trajectory
from elid_cli.estimation.collocation.problem import Iterate, Problem

_EASE = 0.2
"""Factor from step to step by which the equations' noise falls from what the start shows to what is assumed: a rough
start that had to obey the equations at once would end in the nearest valley."""
_LONGEST = 0.5
"""Most that the logarithm of a shape moves by in a step."""
_GROW = 3
"""Further step at which the equations' noise is raised to what their residual shows."""
_TRUSTING = 6
"""Further steps at which it is decided anew where motors reverse: decided at every step, the iteration can go round."""
_SETTLED = 0.2
"""Fall of the cost, in units of one squared standard deviation, below which the iteration ends."""


@dataclass(frozen=True)
class Outcome:
    """The end of the iteration."""

    p: Array
    z: Array
    coefficients: list[Array]
    covariance: Array
    """Covariance of (p, z) from autocorrelation-aware scores."""
    costs: tuple[float, ...]
    rho: Array
    residual: Array
    """Root mean square of the rows' residuals, (rows,)."""
    influence: list[Array]
    """What each interval of knots moves (p, z) by, (intervals, p + z) per piece."""

    @property
    def end(self) -> Iterate:
        """The unknowns at the end."""
        return Iterate(self.coefficients, self.p, self.z)


Prior = Callable[[Iterate], tuple[float, Array, Array]]
"""Cost, matrix and gradient of what is known of (p, z)."""


def iterate(problem: Problem, start: Iterate, prior: Prior, steps: int) -> Outcome:
    """Run Gauss-Newton with step halving.

    Parameters
    ----------
    problem
        The problem; its rho starts large and may grow once, where the rows' residual shows more than expected.
    start
        First unknowns.
    prior
        Returns (cost, matrix, gradient) of what is known of (p, z).
    steps
        Most steps with rho as assumed.
    """
    now, costs = _descend(problem, start, prior, steps)
    _, matrix, gradient = prior(now)
    covariance, influence = covariance_at(problem, now, (matrix, gradient))
    end = now.p, now.z, now.coefficients, covariance
    return Outcome(*end, tuple(costs), problem.rho, problem.spread(now), influence)


def follow(problem: Problem, start: Iterate, steps: int) -> Iterate:
    """Return the trajectory that obeys the equations best with p and z as they are; the rest as `iterate`."""
    nothing = 0.0, np.zeros((0, 0)), np.zeros(0)
    return _descend(problem, start, lambda now: nothing, steps)[0]


def _descend(problem: Problem, start: Iterate, prior: Prior, steps: int) -> tuple[Iterate, list[float]]:
    """Return the end of the iteration and the costs with rho as assumed."""
    now, first = start, problem.rho
    shown = problem.spread(start)
    eased = int(np.ceil(np.log(max(1.0, float(np.max(shown / first)))) / -np.log(_EASE)))
    costs: list[float] = []
    for number in range(eased + steps):
        if number <= eased + _TRUSTING:
            problem.trust(now)
        if number <= eased:
            problem.rho = np.maximum(first, shown * _EASE**number)
        elif number == eased + _GROW:
            problem.rho = np.maximum(first, problem.spread(now))
        before = problem.cost(now) + prior(now)[0]
        if number == eased:
            costs = [before]
        trial, cost = _step(problem, now, prior, before)
        if cost < before:
            now = trial
        if number < eased:
            continue
        if not cost < before:
            break
        costs.append(cost)
        if number > eased + _GROW and before - cost < max(1e-6 * cost, _SETTLED):
            break
    return now, costs


def _step(problem: Problem, now: Iterate, prior: Prior, before: float) -> tuple[Iterate, float]:
    """Return the end of a Gauss-Newton step and its cost, the step halved until it falls below the cost before."""
    _, matrix, gradient = prior(now)
    left = eliminate_trajectory(problem, now, (matrix, gradient))
    size = 1.0
    while True:
        move = left.move(now, _LONGEST * size)
        trial = Iterate(
            [c + size * d for c, d in zip(now.coefficients, move.coefficients, strict=True)],
            now.p + size * move.p,
            now.z + size * move.z,
        )
        cost = problem.cost(trial) + prior(trial)[0]
        if cost < before or size < 0.02:
            return trial, cost
        size *= 0.5
