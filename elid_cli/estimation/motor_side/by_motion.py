"""Derivatives of the equations' rows by the links' motion: how every row reaches the coefficients.

A row that takes θ of a joint takes q there and, through the yielding transmission, the torque through it; one that
takes that torque takes what the link side makes of all links' motion and the deflections of coupled rotors, and so on.
All of it acts on samples around the row's own (`Pieces`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.latent import Latent, Model
from elid_cli.estimation.motor_side.operators import SHORT_WIDTH, centred
from elid_cli.estimation.motor_side.pieces import Pieces, summed
from elid_cli.model.link_vectors import AXES

_Target = tuple[str, int]


class ByMotion:
    """Derivatives of θ, and of the low-passed τ and sensors on links, at one model of x.

    `friction` are its `Latent.friction_slopes`.
    """

    def __init__(self, problem: Latent, now: Model, x: Array, friction: Array) -> None:
        self._problem, self._now, self._x, self._n = problem, now, x, problem.log.n
        self._friction = friction
        self._at, link, dt = problem.unknowns.places, problem.link, problem.log.dt
        slopes = link.slopes(now.q, x[self._at["p"]], x[self._at["J"]], (now.speed, now.acceleration))
        self._six = {("spring", i): problem.on_knots(self._on_knots(slopes.torque, i)) for i in range(self._n)}
        if link.coupled:
            self._six |= {("carried", i): problem.on_knots(slopes.carried[:, :, i]) for i in range(self._n)}
        self._six |= {("sensor", r): problem.on_knots(slopes) for r, slopes in enumerate(self._sensors())}
        self._rates = centred(1, dt), centred(2, dt)
        self._short_rates = centred(1, dt, SHORT_WIDTH), centred(2, dt, SHORT_WIDTH)

    def rows(self, pieces: Pieces, part: slice) -> Array:
        """Return the derivatives of some groups' rows by the coefficients of their windows, (C, rows, W n)."""
        every = self._positions if pieces is self._problem.positions else self._torques
        basis, n = pieces.basis[part], self._n
        spread = {name: pieces.spread(six, part) for name, six in self._six.items()}
        found = np.zeros((len(basis), pieces.rows.shape[1], len(every), pieces.knots * n))
        for i, targets in enumerate(every):
            for name, taps in targets.items():
                kind, j = name
                samples, knots = pieces.touched(taps.shape[1], part)
                columns = slice(knots.start * n, knots.stop * n)
                if kind == "own":
                    found[:, :, i, columns][:, :, j::n] += pieces.dense(taps, part) @ basis[:, samples, knots]
                else:
                    found[:, :, i, columns] += pieces.dense(taps, part) @ spread[name][:, samples, columns]
        return found.reshape(len(found), -1, found.shape[3])

    @cached_property
    def _positions(self) -> list[dict[_Target, Array]]:
        """Of every joint, the taps of θ's rows on what they reach."""
        one = np.ones((self._problem.log.count, 1))
        return [self._reached(i, one, None) for i in range(self._n)]

    @cached_property
    def _torques(self) -> list[dict[_Target, Array]]:
        """The same of the low-passed torques and sensors on links."""
        problem, now, at, x = self._problem, self._now, self._at, self._x
        found = []
        low_pass = np.tile(problem.kernel, (len(problem.centres), 1))
        first, second = self._rates
        for i in range(self._n):
            inertia = x[at["J"][i]] + self._friction[1, :, i]
            rates = self._moved(low_pass, self._friction[0, :, i], first) + self._moved(low_pass, inertia, second)
            share = low_pass * problem.spring_share(now, x, i)[self._samples(low_pass)]
            targets = self._reached(i, rates, share)
            if problem.link.coupled and problem.link.elastic[i]:
                targets["carried", i] = x[at["J"][i]] * low_pass
            found.append(targets)
        first, second = self._short_rates
        one = np.ones(problem.log.count)
        delays = np.concatenate([kind.delay for kind in problem.mounted(x)]).tolist()
        for k, delay in enumerate(delays):
            taps = summed(self._moved(low_pass, one, 0.5 * delay**2 * second - delay * first), low_pass)
            found += [{("sensor", AXES * k + axis): taps} for axis in range(AXES)]
        return found

    def _sensors(self) -> Iterator[Array]:
        """Yield the derivatives of every axis of sensors on links by q and its rates, (orders, N, n) each."""
        for kind, felt in zip(self._problem.link.sensed, self._now.felt, strict=True):
            yield from kind.by_motion(felt, self._x[self._at[kind.kind.name]])

    def _reached(self, i: int, theta: Array, spring: Array | None) -> dict[_Target, Array]:
        """Return what rows reach that take θ_i and, with `spring`, the torque through its transmission by taps.

        That torque takes deflections of the rotors that load its link, `levels` of them in a row.
        """
        targets: dict[_Target, Array] = {("own", i): theta}
        if self._problem.link.elastic[i]:
            yielding = self._yielding(i, theta)
            spring = yielding if spring is None else summed(spring, yielding)
        if spring is None:
            return targets
        targets["spring", i] = spring
        reached = {i: spring}
        for _ in range(self._problem.levels):
            ahead, reached = reached, {}
            for j, taps in ahead.items():
                for k in self._problem.link.behind[j]:
                    loads = zip(self._loads(j, k), self._rates, strict=True)
                    moved = [self._moved(taps, load, rate) for load, rate in loads if load.any()]
                    if moved:
                        _add(reached, k, self._yielding(k, sum(moved[1:], moved[0])))
            for k, taps in reached.items():
                _add(targets, ("spring", k), taps)
        return targets

    def _on_knots(self, torque: Array, i: int) -> Array:
        """Return derivatives of the torque through a transmission by q and its rates, without deflections.

        What the spectrum's upper end does to a coupled rotor must be there, too: without, a fit does not find its path.
        """
        found = torque[:, :, i].copy()
        for j in self._problem.link.behind[i]:
            speed, acceleration = self._loads(i, j)
            found[1, :, j] += speed
            found[2, :, j] += acceleration
        return found

    def _loads(self, i: int, j: int) -> tuple[Array, Array]:
        """Return the torque through transmission i per speed and per acceleration of rotor j, (N,) each."""
        J, terms = self._x[self._at["J"][j]], self._now.terms
        return J * terms.by_speed[:, i, j], J * terms.by_acceleration[:, i, j]

    def _yield(self, i: int) -> Array:
        """Return a deflection's derivative by the torque, without damper, (N,)."""
        found: Array = self._x[self._at["c"][i]] + self._problem.lost_slope(self._now, self._x, i)
        return found

    def _yielding(self, i: int, taps: Array) -> Array:
        """Return rows of θ_i as rows of the torque through its transmission."""
        c, T = (self._x[self._at[name][i]] for name in ("c", "damping"))
        own = taps * self._yield(i)[self._samples(taps)]
        first, second = self._short_rates
        one = np.ones(self._problem.log.count)
        return summed(own, self._moved(taps, one, c * T * (T * second - first)))

    def _moved(self, taps: Array, share: Array, stencil: Array) -> Array:
        """Return rows of share (N,) times what a stencil gives, none near the ends, as rows of what it is given."""
        reach = len(stencil) // 2
        inside = share.copy()
        inside[:reach] = inside[len(share) - reach :] = 0.0
        found: Array = (taps * inside[self._samples(taps)]) @ _shifts(stencil, taps.shape[1])
        return found

    def _samples(self, taps: Array) -> NDArray[np.intp]:
        """Return the samples that taps stand on; beyond the ends, where they are zero, the last ones."""
        problem = self._problem
        rows = problem.positions if len(taps) == problem.log.count else problem.torques
        return rows.samples(taps.shape[1])


def _shifts(stencil: Array, size: int) -> Array:
    """Return the matrix that turns `size` taps on a stencil's results into taps on what it is given."""
    place, found = np.arange(size)[:, None], np.zeros((size, size + len(stencil) - 1))
    found[place, place + np.arange(len(stencil))] = stencil
    return found


def _add(targets: dict[Any, Array], name: Any, taps: Array) -> None:
    targets[name] = summed(targets[name], taps) if name in targets else taps
