"""Derivatives of the equations' rows by what is unknown beside the links' motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.latent import Latent, Model


def by_unknowns(problem: Latent, now: Model, x: Array, friction: Array) -> tuple[Array, Array]:
    """Return d θ / d x, (N, n, size), and the derivatives of the low-passed rows by x, (rows, n + 3 m, size).

    `friction` are `Latent.friction_slopes` of the model `now` of x.
    """
    return _ByUnknowns(problem, now, x).rows(friction)


class _Carrying(NamedTuple):
    """Derivatives of a rotor's speed and acceleration, (N, used) each, by the unknowns that they depend on."""

    used: NDArray[np.intp]
    speed: Array
    acceleration: Array


class _ByUnknowns:
    def __init__(self, problem: Latent, now: Model, x: Array) -> None:
        self._problem, self._now, self._x = problem, now, x
        self._at = problem.unknowns.places

    def rows(self, friction: Array) -> tuple[Array, Array]:
        problem, at, n, size = self._problem, self._at, self._problem.log.n, self._problem.unknowns.size
        now, (first, second) = self._now, problem.log.rates
        theta = np.zeros((problem.log.count, n, size))
        low = np.zeros((len(problem.centres), len(problem.tau_noise), size))
        rate = first @ now.tau
        carrying: dict[int, _Carrying] = {}
        for i in reversed(range(n)):
            used, spring = self._spring(carrying, i)
            tau = problem.spring_share(now, self._x, i)[:, None] * spring
            if problem.link.elastic[i]:
                here = self._deflection(used, spring, i)
                theta[:, i, used] = here
                carrying[i] = _Carrying(used, first @ here, second @ here)
                tau += (self._x[at["J"][i]] + friction[1, :, i, None]) * carrying[i].acceleration
                tau += friction[0, :, i, None] * carrying[i].speed
                tau[:, _place(used, at["J"][i])] += now.acceleration[:, i] + now.terms.carried[:, i]
            low[:, i, used] = problem.rows @ tau
            own = self._own(i) | {int(at["delay"][0]): rate[:, i]}
            low[:, i, list(own)] += problem.rows @ np.stack(list(own.values()), axis=1)
        for k, row in enumerate(self._sensors(), n):
            low[:, k] = problem.rows @ row
        return theta, low

    def _spring(self, carrying: Mapping[int, _Carrying], i: int) -> tuple[NDArray[np.intp], Array]:
        """Return which unknowns the torque s_i depends on, in order, and its derivatives by them, (N, used).

        `carrying` are later joints' rotors: differentiated once, however many links each of them loads.
        """
        at, now, J = self._at, self._now, self._x[self._at["J"]]
        own = [np.asarray([at[name][j] for j in range(i, len(J))]) for name in ("J", "damping", "lost", "c")]
        used = np.concatenate([at["p"], *own])
        spring = np.zeros((self._problem.log.count, len(used)))
        spring[:, : len(at["p"])] = now.terms.columns[:, i]
        for j in self._problem.link.behind[i]:
            speed, acceleration = now.terms.by_speed[:, i, j], now.terms.by_acceleration[:, i, j]
            place = np.searchsorted(used, carrying[j].used)
            for load, rate in ((speed, carrying[j].speed), (acceleration, carrying[j].acceleration)):
                if load.any():
                    spring[:, place] += (J[j] * load)[:, None] * rate
            spring[:, _place(used, at["J"][j])] += speed * now.speed[:, j] + acceleration * now.acceleration[:, j]
        return used, spring

    def _deflection(self, used: NDArray[np.intp], spring: Array, i: int) -> Array:
        """Return d θ_i / d x, (N, used), from what `_spring` returns."""
        at, now, problem, (short, shorter) = self._at, self._now, self._problem, self._problem.log.short_rates
        c, T = self._x[at["c"][i]], self._x[at["damping"][i]]
        found: Array = c * problem.lag(spring, T) + problem.lost_slope(now, self._x, i)[:, None] * spring
        s = now.spring[:, i]
        found[:, _place(used, at["c"][i])] += now.lagged[:, i]
        found[:, _place(used, at["damping"][i])] += c * (-(short @ s) + 2 * T * (shorter @ s))
        found[:, _place(used, at["lost"][i])] += np.tanh(s / problem.lost_scale[i])
        return found

    def _own(self, i: int) -> dict[int, Array]:
        """Return the derivatives of a motor's torque by unknowns that act in it alone, (N,) each, by their places."""
        at, now, problem = self._at, self._now, self._problem
        found = {
            at["fv"][i]: now.speed[:, i],
            at["fs"][i]: now.sign[:, i],
            at["offset"][i]: np.ones(problem.log.count),
        }
        if len(now.rounded):
            found[at["load"][i]] = now.sign[:, i] * now.rounded[:, i]
        if len(now.bumps):
            found |= zip(at["bumps"].reshape(-1, problem.log.n)[:, i], now.bumps[:, :, i], strict=True)
        for place, further in zip(at["further"], problem.further, strict=True):
            if further.joint == i:
                found[place] = further.values(now.speed[:, i])
        return {int(place): values for place, values in found.items()}

    def _sensors(self) -> Iterator[Array]:
        """Yield the derivatives of what every sensor on a link measures about every axis, (N, size) each."""
        problem = self._problem
        for kind, felt in zip(problem.link.sensed, self._now.felt, strict=True):
            places = self._at[kind.kind.name]
            for part, slopes in kind.by_unknowns(felt, self._x[places], problem.log.short_rates):
                row = np.zeros((problem.log.count, problem.unknowns.size))
                row[:, places[part]] = slopes
                yield row


def _place(used: NDArray[np.intp], unknown: int) -> int:
    return int(np.searchsorted(used, unknown))
