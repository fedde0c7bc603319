"""The iteration of a collocation problem: Gauss-Newton with step halving."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
_ROUGHLY = 3e-4
"""The same as a part of the cost, where an end is wanted only to go on from and to compare large costs by."""
_SHORTEST = 0.02
"""Part of a step from which on it is halved no more."""
_FARTHEST = 16.0
"""Most times that a step is taken where only the trajectory is free: equations whose residual is beyond `HUBER` count
ever less, and each step then falls short in the same direction."""


@dataclass(frozen=True)
class Outcome:
    """The end of the iteration."""

    p: Array
    z: Array
    coefficients: list[Array]
    covariance: Array
    """Covariance of (p, z) from autocorrelation-aware scores; empty where the end is a rough one."""
    costs: tuple[float, ...]
    rho: Array
    residual: Array
    """Root mean square of the rows' residuals, (rows,)."""
    influence: list[Array]
    """What each interval of knots moves (p, z) by, (intervals, p + z) per piece; none where the end is a rough one."""

    @property
    def end(self) -> Iterate:
        """The unknowns at the end."""
        return Iterate(self.coefficients, self.p, self.z)


Prior = Callable[[Iterate], tuple[float, Array, Array]]
"""Cost, matrix and gradient of what is known of (p, z)."""


def iterate(problem: Problem, start: Iterate, prior: Prior, steps: int, *, roughly: bool = False) -> Outcome:
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
    roughly
        Whether the end need not be closer than a small part of its cost, and its errors are not wanted.
    """
    now, costs = _descend(problem, start, prior, steps, _ROUGHLY if roughly else 1e-6)
    covariance, influence = np.zeros((0, 0)), list[Array]()
    if not roughly:
        covariance, influence = covariance_at(problem, now, prior(now)[1:])
    end = now.p, now.z, now.coefficients, covariance
    return Outcome(*end, tuple(costs), problem.rho, problem.spread(now), influence)


def follow(problem: Problem, start: Iterate, steps: int) -> Iterate:
    """Return the trajectory that obeys the equations best with p and z as they are; the rest as `iterate`."""
    nothing = 0.0, np.zeros((0, 0)), np.zeros(0)
    return _descend(problem, start, lambda now: nothing, steps, _ROUGHLY)[0]


def _descend(problem: Problem, start: Iterate, prior: Prior, steps: int, least: float) -> tuple[Iterate, list[float]]:
    """Return the end of the iteration and the costs with rho as assumed; it ends where they fall by less than `least`.

    That is a part of the cost.
    """
    now, first = start, problem.rho
    shown = problem.spread(start)
    eased = int(np.ceil(np.log(max(1.0, float(np.max(shown / first)))) / -np.log(_EASE)))
    reversals = _Reversals(problem, eased + _TRUSTING)
    costs: list[float] = []
    for number in range(eased + steps):
        reversals.decide(now, number)
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
        if number > eased + _GROW and before - cost < max(least * cost, _SETTLED):
            break
    return now, costs


class _Reversals:
    """Where motors reverse, decided anew from step to step, up to the step `last`.

    Where it goes to and fro between two answers, that is what the last step would decide, at once.
    """

    def __init__(self, problem: Problem, last: int) -> None:
        self._problem, self._last = problem, last
        self._seen: list[tuple[Iterate, list[Array]]] = []

    def decide(self, now: Iterate, number: int) -> None:
        """Decide where motors reverse, from the trajectory as it is at a step."""
        if number > self._last:
            return
        self._problem.trust(now)
        here, seen = self._problem.trusted, self._seen
        if len(seen) > 1 and _same(here, seen[-2][1]) and not _same(here, seen[-1][1]):
            if (self._last - number) % 2:
                self._problem.trust(seen[-1][0])
            self._last = number
        self._seen = [*seen[-1:], (now, here)]


def _same(one: Sequence[Array], other: Sequence[Array]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def _step(problem: Problem, now: Iterate, prior: Prior, before: float) -> tuple[Iterate, float]:
    """Return the end of a Gauss-Newton step and its cost, the step halved until it falls below the cost before.

    Where only the trajectory is free, it is doubled as long as the cost falls.
    """
    _, matrix, gradient = prior(now)
    left = eliminate_trajectory(problem, now, (matrix, gradient))

    def tried(size: float, move: Iterate) -> tuple[Iterate, float]:
        trial = now.moved(size, move)
        return trial, problem.cost(trial) + prior(trial)[0]

    size = 1.0
    trial, cost = tried(size, move := left.move(now, _LONGEST))
    while not len(gradient) and cost < before and size < _FARTHEST:
        farther, less = tried(2.0 * size, move)
        if not less < cost:
            break
        size, trial, cost = 2.0 * size, farther, less
    while not cost < before and size >= _SHORTEST:
        size *= 0.5
        trial, cost = tried(size, left.move(now, _LONGEST * size))
    return trial, cost
