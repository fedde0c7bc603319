"""Derivatives of the equations' rows by the links' motion: how every row reaches the coefficients.

A row that takes θ of a joint takes q there and, through the yielding transmission, the torque through it; one that
takes that torque takes what the link side makes of all links' motion and the deflections of coupled rotors, and so on.
All of it acts on samples around the row's own (`Pieces`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

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
        rows, own, shared = self._positions if pieces is self._problem.positions else self._torques
        n, (count, many) = self._n, pieces.rows[part].shape
        found = np.zeros((count, rows, many, pieces.knots * n))
        spreads = pieces.spread((self._six[name] for name in shared), part)
        for (first, kinds), spread in zip(shared.values(), spreads, strict=True):
            samples, columns = self._touched(pieces, kinds, part)
            moved = pieces.dense(kinds, part) @ spread[:, samples, columns]
            found[:, first : first + len(kinds), :, columns] += moved.reshape(count, len(kinds), many, -1)
        for i, taps in enumerate(own):
            samples, columns = self._touched(pieces, [taps], part)
            moved = pieces.dense([taps], part) @ pieces.basis[part, samples, columns.start // n : columns.stop // n]
            found[:, i, :, columns][:, :, i::n] += moved
        return found.reshape(count, -1, pieces.knots * n)

    def _touched(self, pieces: Pieces, taps: Sequence[Array], part: slice) -> tuple[slice, slice]:
        samples, knots = pieces.touched(max(own.shape[1] for own in taps), part)
        return samples, slice(knots.start * self._n, knots.stop * self._n)

    @cached_property
    def _positions(self) -> _Reached:
        """What the rows of θ reach."""
        pieces = self._problem.positions
        one = pieces.taps(np.ones(1))
        return self._reached(pieces, [one] * self._n, [None] * self._n)

    @cached_property
    def _torques(self) -> _Reached:
        """What the low-passed torques and sensors on links reach."""
        problem, now, at, x, n = self._problem, self._now, self._at, self._x, self._n
        pieces, (first, second) = problem.torques, self._rates
        low_pass = pieces.taps(problem.kernel)
        theta, spring = [], []
        for i in range(n):
            inertia = x[at["J"][i]] + self._friction[1, :, i]
            theta.append(
                self._moved(pieces, low_pass, self._friction[0, :, i], first)
                + self._moved(pieces, low_pass, inertia, second)
            )
            spring.append(low_pass * pieces.around(problem.spring_share(now, x, i), low_pass.shape[1]))
        found = self._reached(pieces, theta, spring)
        if problem.link.coupled:
            for i in np.flatnonzero(problem.link.elastic).tolist():
                found.shared["carried", i] = i, [x[at["J"][i]] * low_pass]
        first, second = self._short_rates
        one = np.ones(problem.log.count)
        delays = np.concatenate([kind.delay for kind in problem.mounted(x)]).tolist()
        for k, delay in enumerate(delays):
            taps = summed(self._moved(pieces, low_pass, one, 0.5 * delay**2 * second - delay * first), low_pass)
            for axis in range(AXES * k, AXES * (k + 1)):
                found.shared["sensor", axis] = n + axis, [taps]
        return found._replace(rows=n + AXES * len(delays))

    def _sensors(self) -> Iterator[Array]:
        """Yield the derivatives of every axis of sensors on links by q and its rates, (orders, N, n) each."""
        for kind, felt in zip(self._problem.link.sensed, self._now.felt, strict=True):
            yield from kind.by_motion(felt, self._x[self._at[kind.kind.name]])

    def _reached(self, pieces: Pieces, theta: Sequence[Array], spring: Sequence[Array | None]) -> _Reached:
        """Return what rows reach of which the i-th takes θ_i and, with `spring`, the torque through its transmission.

        That torque takes deflections of the rotors that load its link, `levels` of them in a row.
        """
        link = self._problem.link
        through: dict[int, dict[int, Array]] = {}
        """Of every transmission, by the row, the taps on its torque."""
        for i, (own, taps) in enumerate(zip(theta, spring, strict=True)):
            if link.elastic[i]:
                yielding = self._yielding(pieces, i, own)
                through[i] = {i: yielding if taps is None else summed(yielding, taps)}
            elif taps is not None:
                through[i] = {i: taps}
        ahead = through
        for _ in range(self._problem.levels):
            loaded = ((k, self._loaded(pieces, ahead, k)) for k in range(self._n))
            ahead = {k: by_row for k, by_row in loaded if by_row}
            through = {k: _both(through.get(k, {}), ahead.get(k, {})) for k in sorted({*through, *ahead})}
        shared: dict[_Target, tuple[int, list[Array]]] = {}
        for k, by_row in through.items():
            first, last = min(by_row), max(by_row)
            none = pieces.taps(np.zeros(1))
            shared["spring", k] = first, [by_row.get(i, none) for i in range(first, last + 1)]
        return _Reached(self._n, theta, shared)

    def _loaded(self, pieces: Pieces, ahead: Mapping[int, Mapping[int, Array]], k: int) -> dict[int, Array]:
        """Return taps on the torque through transmission k by rows that reach the links that its rotor loads."""
        rates: list[dict[int, Array]] = [{}, {}]
        for j in (j for j in ahead if k in self._problem.link.behind[j]):
            for by_row, load in zip(rates, self._loads(j, k), strict=True):
                if not load.any():
                    continue
                inside = _inside(load, len(self._rates[0]) // 2)
                for i, taps in ahead[j].items():
                    share = taps * pieces.around(inside, taps.shape[1])
                    by_row[i] = by_row[i] + share if i in by_row else share
        speed, acceleration = (
            {i: taps @ _shifts(stencil, taps.shape[1]) for i, taps in by_row.items()}
            for by_row, stencil in zip(rates, self._rates, strict=True)
        )
        return {i: self._yielding(pieces, k, taps) for i, taps in _both(speed, acceleration).items()}

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

    def _yielding(self, pieces: Pieces, i: int, taps: Array) -> Array:
        """Return rows of θ_i as rows of the torque through its transmission."""
        c, T = (self._x[self._at[name][i]] for name in ("c", "damping"))
        own = taps * pieces.around(self._yield(i), taps.shape[1])
        first, second = self._short_rates
        one = np.ones(self._problem.log.count)
        return summed(own, self._moved(pieces, taps, one, c * T * (T * second - first)))

    def _moved(self, pieces: Pieces, taps: Array, share: Array, stencil: Array) -> Array:
        """Return rows of share (N,) times what a stencil gives, none near the ends, as rows of what it is given."""
        inside = pieces.around(_inside(share, len(stencil) // 2), taps.shape[1])
        found: Array = (taps * inside) @ _shifts(stencil, taps.shape[1])
        return found


class _Reached(NamedTuple):
    """What the rows of one kind reach."""

    rows: int
    """How many of them an instant has."""
    own: Sequence[Array]
    """Taps of the first ones on the positions of the links of the same number."""
    shared: dict[_Target, tuple[int, list[Array]]]
    """By what they reach: the first row's number, and the taps of that and the next ones."""


def _inside(values: Array, reach: int) -> Array:
    """Return values (N,), none near the ends."""
    found = values.copy()
    found[:reach] = found[len(values) - reach :] = 0.0
    return found


def _shifts(stencil: Array, size: int) -> Array:
    """Return the matrix that turns `size` taps on a stencil's results into taps on what it is given."""
    place, found = np.arange(size)[:, None], np.zeros((size, size + len(stencil) - 1))
    found[place, place + np.arange(len(stencil))] = stencil
    return found


def _both(one: Mapping[int, Array], other: Mapping[int, Array]) -> dict[int, Array]:
    """Return the sums of two sets of taps."""
    found = dict(one)
    for name, taps in other.items():
        found[name] = summed(found[name], taps) if name in found else taps
    return found
