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
        self._about: Array | None = None

    def advance(self, x: Sequence[float], tau: Sequence[float], first: Sequence[float]) -> list[float]:
        """Return the state after a period, given its accelerations at the start; not finite where there are none."""
        now, start = np.array(x), np.array(first)
        if self._about is None or np.abs(now[: self._n] - self._about).max() > TURN:
            self._linearise(now[: self._n])
        steps = self._steps(now, start)
        if steps not in self._known:
            self._known[steps] = self._scheme(self._period / steps)
        with np.errstate(all="ignore"):  # a motion that runs away is told by what comes out
            if self._kernel.through is not None:
                found = self._kernel.through(now, np.array(tau), start, self._linear, *self._known[steps], steps)
            else:
                found = self._stepped(now, tau, start, self._known[steps], steps)
        return found.tolist()  # type: ignore[no-any-return]

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
        self._about, self._known = q.copy(), dict[int, list[Array]]()

    def _scheme(self, h: float) -> list[Array]:
        """Return what the three inner stages and the end of a step are made of: weights of x and of N at the stages."""
        half = self._half
        scale = np.concatenate([np.ones(half), np.full(half, 1.0 / self._unit)])
        linear = np.zeros((2 * half, 2 * half))
        linear[:half, half:] = np.eye(half)
        linear[half:] = self._linear
        (e2, *inner), (e, *outer) = _phi(0.5 * h * linear * scale[:, None] / scale)

        def real(matrix: Array) -> Array:
            found: Array = matrix / scale[:, None] * scale
            return found

        (q1, q2, _), (p1, p2, p3) = ([h * real(m)[:, half:] for m in found] for found in (inner, outer))
        e2, e, none = real(e2), real(e), np.zeros_like(p1)
        middle = 2 * p2 - 4 * p3
        return [
            np.hstack([e2, 0.5 * q1]),
            np.hstack([e2, 0.5 * q1 - q2, q2]),
            np.hstack([e, p1 - 2 * p2, none, 2 * p2]),
            np.hstack([e, p1 - 3 * p2 + 4 * p3, middle, middle, 4 * p3 - p2]),
        ]


def _power(steps: float) -> int:
    """Return the least power of two that is no smaller."""
    return 1 << max(math.ceil(math.log2(max(steps, 1.0)) - 1e-9), 0)


def _phi(matrix: Array) -> tuple[list[Array], list[Array]]:
    """Return exp(A), φ1(A), φ2(A), φ3(A), and the same of 2 A, with φk(A) = the sum over j of A^j / (j + k)!.

    The series of a small part of A, doubled: 2^k φk(2A) is exp(A) φk(A) + the sum over j = 1 … k of φj(A) / (k-j)!.
    """
    norm = float(np.abs(matrix).sum(axis=1).max(initial=0.0))
    doublings = max(math.ceil(math.log2(norm / REACH)), 0) if norm > REACH else 0
    small, unit = matrix / 2.0**doublings, np.eye(len(matrix))
    third = unit / math.factorial(DEGREE + 3)
    for k in range(DEGREE + 2, 2, -1):
        third = small @ third + unit / math.factorial(k)
    second = small @ third + 0.5 * unit
    first = small @ second + unit
    found = [small @ first + unit, first, second, third]
    for _ in range(doublings):
        found = _doubled(*found)
    return found, _doubled(*found)


def _doubled(e: Array, first: Array, second: Array, third: Array) -> list[Array]:
    return [
        e @ e,
        0.5 * (e @ first + first),
        0.25 * (e @ second + first + second),
        0.125 * (e @ third + 0.5 * first + second + third),
    ]
