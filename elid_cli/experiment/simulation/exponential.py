"""Steps under held torques in which springs are exact: stiff elastic modes then cost no short steps.

The state obeys x' = L x + N(x) with L the springs and viscous friction at a mass matrix near the present one, and N all
that is left: slow, but for rounded friction near standstill. Krogstad's exponential Runge-Kutta scheme of order four
("Generalized integrating factor methods for stiff PDEs", J. Comput. Phys. 203, 2005) solves L exactly and takes N as
the classical scheme does; with L = 0 it is the classical scheme.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from elid_cli._types import Array
from elid_cli.experiment.simulation.compiled_periods import DONE, STUCK, TURNED
from elid_cli.experiment.simulation.kernel import Kernel
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.parameter import StandardParameter

TURN = 0.02
"""rad or m; a link that has moved further is given a new mass matrix in L."""
LONGEST, FINEST = 1e-3, 2.5e-4
"""s; longest step, and longest one while a motor passes the rounded zone of friction."""
ZONE = 5.0
"""Widths of rounded friction within which a motor counts as passing its zone: beyond, its slope is below 2e-4 of
the steepest."""
FRICTION_STEP = 0.9
"""Step in time constants of the friction that is passed (stable below 2.8)."""
DEGREE, REACH = 12, 0.5
"""Terms of the exponential's series, and the norm up to which they suffice."""

SERIES = np.zeros((3, 5))
"""Coefficients of φ3: row i holds those of A^(4 i) to A^(4 i + 3), the last row one more."""
SERIES[:, :4] = np.reshape([1.0 / math.factorial(j + 3) for j in range(DEGREE)], (3, 4))
SERIES[2, 4] = 1.0 / math.factorial(DEGREE + 3)
HALVED = np.array([0.5, 0.25, 0.125])[:, None, None]
CARRIED = np.array([[0.5, 0.0, 0.0], [0.25, 0.25, 0.0], [0.0625, 0.125, 0.125]])
"""What φ1 to φ3 of 2 A are made of: exp(A) times their own at A, and those at A."""
INNER = np.array([[0.5, 0.0, 0.0], [0.5, -1.0, 0.0], [0.0, 1.0, 0.0]])
"""Rows of φ1 to φ3 of half a step: weights of N in the first stage, then in the second."""
OUTER = np.array([[1.0, -2.0, 0.0], [0.0, 0.0, 0.0], [0.0, 2.0, 0.0],
                  [1.0, -3.0, 4.0], [0.0, 2.0, -4.0], [0.0, 2.0, -4.0], [0.0, -1.0, 4.0]])  # fmt: skip
"""The same of a whole step: three weights in the third stage, four at its end."""

Arrays = tuple[Array, ...]


class ExactSprings:
    """Motion of a robot without effects under torques that are held over a period.

    Parameters
    ----------
    dynamics
        The robot.
    kernel
        The same as functions of states of `System`.
    period
        s.
    accuracy
        Factor by which steps are finer than the default.
    """

    def __init__(self, dynamics: Dynamics, kernel: Kernel, period: float, accuracy: float = 1.0) -> None:
        n, elastic = dynamics.robot.n, dynamics.elastic
        self._dynamics, self._kernel, self._period = dynamics, kernel, period
        self._n, self._half = n, n + len(elastic)
        self._motors = np.array([n + elastic.index(k) if k in elastic else k for k in range(n)])
        self._widths = np.array(dynamics.widths)
        self._springs = np.zeros((self._half, self._half))
        for place, k in enumerate(elastic, n):
            pair = np.ix_([k, place], [k, place])
            self._springs[pair] += dynamics.stiffness[k] * np.array([[1.0, -1.0], [-1.0, 1.0]])
        coulomb, viscous = (
            np.array([dynamics.value(StandardParameter(kind, k)) for k in range(n)]) for kind in ("fs", "fv")
        )
        self._damping = np.zeros(self._half)
        self._damping[self._motors] = viscous
        self._steepest = np.abs(coulomb) / self._widths
        self._accuracy = accuracy
        self._coarse = _power(period * accuracy / LONGEST)
        self.longest = period / self._coarse
        """s."""
        self._about = np.full(n, math.nan)
        self._linear = np.zeros((self._half, 2 * self._half))
        self._fine = np.full(n, self._coarse)
        self._ready(1)

    def advance(self, x: Sequence[float], tau: Sequence[float], first: Sequence[float]) -> list[float]:
        """Return the state after a period, given its accelerations at the start; not finite where there are none."""
        now, start = np.array(x), np.array(first)
        if not np.abs(now[: self._n] - self._about).max() <= TURN:
            self._linearise(now[: self._n])
        steps = self._steps(now, start)
        weights = self._weights(steps)
        with np.errstate(all="ignore"):  # a motion that runs away is told by what comes out
            if self._kernel.through is not None:
                found = self._kernel.through(now, np.array(tau), start, self._linear, *weights, steps)
            else:
                found = self._stepped(now, tau, start, weights, steps)
        return found.tolist()  # type: ignore[no-any-return]

    def follow(self, x: Array, wanted: Arrays, law: Arrays, noted: Arrays, moving: int, runaway: float) -> int:
        """Return how many periods the compiled loop got through; the state x is moved on.

        Parameters
        ----------
        x
            The state, written to.
        wanted
            (θ, θ', feed-forward torque) of every period, each of shape (N, n).
        law
            (kp, kd, torque limits), each of shape (n,).
        noted
            Written to: states (N, 2 h), accelerations (N, h) and commands (N, n) at the start of every period.
        moving
            Periods that are integrated; the last sample of a log is only noted.
        runaway
            Link positions that are too far.
        """
        periods, begin, end, why = self._kernel.periods, 0, len(noted[0]), TURNED
        assert periods is not None
        bounds = (self._period, TURN, ZONE * self._widths, runaway, self._coarse)
        while why not in (DONE, STUCK):
            begin, why = periods(
                begin, end, moving, x, wanted, law, self._motors, bounds,
                self._about, self._fine, self._known, self._linear, self._matrices, noted,
            )  # fmt: skip
            if why == TURNED:
                self._linearise(x[: self._n])
            elif why > 0:
                self._weights(why)
        return begin

    def _stepped(self, x: Array, tau: Sequence[float], start: Array, weights: Sequence[Array], steps: int) -> Array:
        """Return the state after some steps; `Kernel.through` is the same, compiled."""
        half, size, linear = self._half, len(x), self._linear
        inner, last = tuple((size + k * half, weight) for k, weight in enumerate(weights[:3], 1)), weights[3]
        z = np.empty(size + 4 * half)
        for number in range(steps):
            z[:size] = x
            if number:
                start = np.array(self._kernel.accelerations(x.tolist(), tau))
            z[size : size + half] = start - linear @ x
            for end, weight in inner:
                at = weight @ z[:end]
                z[end : end + half] = np.array(self._kernel.accelerations(at.tolist(), tau)) - linear @ at
            x = last @ z
        return x

    def _steps(self, x: Array, accelerations: Array) -> int:
        """Return the steps of the period: more where motors pass the zone in which friction turns."""
        speed = x[self._half + self._motors]
        later = speed + self._period * accelerations[self._motors]
        passing = (speed * later <= 0) | (np.minimum(np.abs(speed), np.abs(later)) < ZONE * self._widths)
        needed = self._fine[passing]
        return int(needed.max()) if needed.size else self._coarse

    def _linearise(self, q: Array) -> None:
        """Take the springs and viscous friction at a position as the linear part."""
        half = self._half
        inverse = np.linalg.inv(self._dynamics.mass_matrix(q.tolist()))
        self._linear = np.hstack([-inverse @ self._springs, -inverse * self._damping])
        rates = np.diag(inverse)[self._motors] * self._steepest
        needed = self._period * self._accuracy * np.maximum(1.0 / FINEST, rates / FRICTION_STEP)
        self._fine = np.array([
            max(_power(count), self._coarse) if rate > 0 else self._coarse
            for count, rate in zip(needed.tolist(), rates.tolist(), strict=True)
        ])  # fmt: skip
        # velocities in units of the fastest mode's: L is then no larger than that mode's frequency asks for
        self._unit = max(math.sqrt(float(np.abs(self._linear[:, :half]).sum(axis=1).max(initial=0.0))), 1.0)
        self._about = q.copy()
        self._ready(int(self._fine.max(initial=1)) // self._coarse)

    def _ready(self, finest: int) -> None:
        """Make room for the step's matrices at 1, 2, 4 … `finest` times the least number of steps."""
        levels, half = finest.bit_length(), self._half
        self._known = np.zeros(levels, dtype=np.bool_)
        self._matrices: Arrays = tuple(np.empty((levels, 2 * half, (k + 2) * half)) for k in (1, 2, 3, 4))

    def _weights(self, steps: int) -> list[Array]:
        """Return the matrices of a step, that many of which make a period."""
        level = (steps // self._coarse).bit_length() - 1
        if not self._known[level]:
            for room, found in zip(self._matrices, self._scheme(self._period / steps), strict=True):
                room[level] = found
            self._known[level] = True
        return [room[level] for room in self._matrices]

    def _scheme(self, h: float) -> list[Array]:
        """Return what the three inner stages and the end of a step are made of: weights of x and of N at the stages."""
        half, size = self._half, 2 * self._half
        scale = np.concatenate([np.ones(half), np.full(half, 1.0 / self._unit)])
        back = scale / scale[:, None]
        linear = np.zeros((size, size))
        linear[:half, half:] = np.eye(half)
        linear[half:] = self._linear
        (e2, inner), (e, outer) = _phi(0.5 * h * linear / back, slice(half, None))
        e2, e, last = e2 * back, e * back, h * back[:, half:]
        ahead, to = _mixed(INNER, inner) * last, _mixed(OUTER, outer) * last
        return [np.concatenate([e2, ahead[0]], 1), np.concatenate([e2, *ahead[1:]], 1),
                np.concatenate([e, *to[:3]], 1), np.concatenate([e, *to[3:]], 1)]  # fmt: skip


def _power(steps: float) -> int:
    """Return the least power of two that is no smaller."""
    return 1 << max(math.ceil(math.log2(max(steps, 1.0)) - 1e-9), 0)


def _phi(matrix: Array, columns: slice) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return exp(A) and columns of φ1(A), φ2(A), φ3(A), and the same of 2 A; φk(A) is the sum over j of A^j / (j + k)!.

    The series of a small part of A, doubled: 2^k φk(2A) is exp(A) φk(A) + the sum over j = 1 … k of φj(A) / (k-j)!.
    The series of φ3 is summed in powers of A⁴ (Paterson and Stockmeyer, 1973).
    """
    norm = float(np.abs(matrix).sum(axis=1).max(initial=0.0))
    doublings = max(math.ceil(math.log2(norm / REACH)), 0) if norm > REACH else 0
    small, unit = matrix / 2.0**doublings, np.eye(len(matrix))
    square = small @ small
    fourth = square @ square
    low, middle, high = _mixed(SERIES, np.stack([unit, small, square, square @ small, fourth]))
    third = fourth @ (fourth @ high + middle) + low
    second = small @ third + 0.5 * unit
    first = small @ second + unit
    e, found = small @ first + unit, np.stack([first[:, columns], second[:, columns], third[:, columns]])
    for _ in range(doublings):
        e, found = _doubled(e, found)
    return (e, found), _doubled(e, found)


def _doubled(e: Array, found: Array) -> tuple[Array, Array]:
    return e @ e, (e @ found) * HALVED + _mixed(CARRIED, found)


def _mixed(weights: Array, matrices: Array) -> Array:
    """Return sums of matrices (k, …), one for each row of weights (m, k): `numpy.tensordot` in half its time."""
    return (weights @ matrices.reshape(len(matrices), -1)).reshape(-1, *matrices.shape[1:])
