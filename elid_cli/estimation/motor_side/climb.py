"""A start for the links' motion: climb in frequency from rigid joints.

Put q = θ - c (s - T s') with s = τ(t - d) - motor row, and ask how far s is from what the link side needs, Y(q) p. That
residual is taken below a frequency that rises by steps of 1.4 from far below the antiresonance to the end of the band,
every step starting where the last one ended. All starts without the climb fail (docs/how-to/motor-side.md).

What it takes: signals are band-limited *before* they enter Y, else products rectify the noise of q''; each frequency
counts by the noise that it would have (Sanathanan and Koerner 1963); friction takes the speed of the whole band; the
prior on the rotors grows with the misfit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import KINDS
from elid_cli.estimation.motor_side.link_side import LinkTerms
from elid_cli.estimation.motor_side.motor_log import MotorLog
from elid_cli.estimation.motor_side.operators import KnotSpline, filtered, taper
from elid_cli.estimation.motor_side.rungs import FIRST_RUNG, ClimbEnd, highest, met, rungs
from elid_cli.estimation.motor_side.unknowns import (
    DAMPING_SPREAD,
    DELAY_SPREAD,
    LOAD_FRICTION_SPREAD,
    RotorPrior,
    Unknowns,
)
from elid_cli.estimation.regression.normal_equations import descend

LAST_RUNG = 1.1
"""The last cut-off over the end of the band."""
SOFT_START = 7.0, 8.0
"""Locked frequency of all joints in a second climb, and up to which cut-off it is held, Hz."""
_BEYOND = 1.35
"""Band limit of the signals over the cut-off."""
_MODEL_ERROR = 0.003
"""Error of the equations, share of the torque."""
_LEAST_MASS = 0.05
"""Least link inertia over the rotor's that weights assume."""
_RATE = 12.0
"""Sample rate of the misfit over the signals' band limit: none of its products reach the half of it."""
_STEPS = 6
"""Most steps of a rung, and most dampings that each tries."""
_SAME = 0.10
"""Two ends are one where no compliance differs by more than this share."""


_Misfit = tuple[Array, LinkTerms, list[Array], list[Array]]


@dataclass
class _Band:
    """Signals and four derivatives below one frequency, (N, n) each."""

    theta: list[Array]
    tau: list[Array]
    sign: list[Array]
    load: list[Array]
    carried: list[Array]

    def every(self, stride: int) -> _Band:
        """Return every `stride`-th sample."""
        return _Band(*([values[::stride] for values in signal] for signal in vars(self).values()))


class Climb:
    """The substitution residual of one log and its ascent."""

    def __init__(self, log: MotorLog, unknowns: Unknowns, rotors: RotorPrior, band: float) -> None:
        self.log, self.unknowns, self.link = log, unknowns, unknowns.link
        self.rotors, self._end = rotors, band
        self._spline = KnotSpline(log.t, 2.0 * log.dt)
        smooth, _ = filtered(log.theta, log.dt, 1.3 * band, 1.6)
        whole = self._spline.fit(smooth)
        self._direction = log.direction(*(self._spline.matrices[d] @ whole for d in (1, 2)))
        self._cut = 0.0
        self._whole: _Band
        self._band: _Band
        """Every `_stride`-th sample."""
        self.with_load = True
        """Whether load friction is an unknown."""
        self._traces: dict[bool, list[list[ClimbEnd]]] = {True: [], False: []}
        """Rungs of all climbs, with load friction and without."""
        self.tops: list[ClimbEnd] = []
        """Last rungs of all climbs, whether they fit or not: what dither rectifies is missing from all below."""

    # ---- signals below a frequency

    def _limit(self, cutoff: float) -> None:
        """Band-limit all signals for a cut-off, Hz."""
        cut = max(_BEYOND * cutoff, 5.0)
        if abs(cut - self._cut) < 0.02 * self._cut:
            return
        self._cut, matrices = cut, self._spline.matrices
        theta, reach = filtered(self.log.theta, self.log.dt, cut)
        tau, sign = (filtered(y, self.log.dt, cut)[0] for y in (self.log.tau, self._direction))
        inner = self._spline.fit(theta)
        rates = [B @ inner for B in matrices]
        rates.append(matrices[1] @ self._spline.fit(rates[4]))
        still = [np.zeros_like(theta)] * 4
        self._whole = _Band(rates, self._derivatives(tau, 5), self._derivatives(sign), still, still)
        self._stride = max(1, int(1 / (_RATE * cut * self.log.dt)))
        self._reach = reach
        self._window = taper(self.log.count, reach)[:: self._stride]
        from scipy.fft import next_fast_len

        self._size = next_fast_len(len(self._window), real=True)
        self._frequencies = np.fft.rfftfreq(self._size, self._stride * self.log.dt)
        self._scale = self._stride / np.sqrt(0.95 * self.log.count / 2)
        self._band = self._whole.every(self._stride)

    def _derivatives(self, values: Array, count: int = 4) -> list[Array]:
        coefficients = self._spline.fit(values)
        return [B @ coefficients for B in self._spline.matrices[:count]]

    def _follow(self, x: Array) -> None:
        """Take what is not linear in the unknowns from where they stand: load friction, what carries the rotors."""
        for _ in range(2 if self.with_load or self.link.coupled else 0):
            spring, q = self._parts(x, self._whole)
            if self.with_load:
                load, _ = filtered(self._direction * np.abs(spring[0]), self.log.dt, self._cut)
                self._whole.load = self._derivatives(load)
            if self.link.coupled:
                self._whole.carried = self._derivatives(self.link.terms(q[0], q[1], q[2]).carried)
            self._band = self._whole.every(self._stride)

    # ---- residual

    def _columns(self, band: _Band) -> dict[str, list[Array]]:
        """Return the motor row's columns and their three derivatives by the unknown they belong to."""
        one = np.ones_like(band.sign[0])
        constant = [one, 0 * one, 0 * one, 0 * one]
        rotor = [a + b for a, b in zip(band.theta[2:6], band.carried, strict=True)]
        return {
            "J": rotor, "fv": band.theta[1:5], "fs": band.sign, "offset": constant, "delay": band.tau[1:5],
            "load": band.load,
        }  # fmt: skip

    def _parts(self, x: Array, band: _Band) -> tuple[list[Array], list[Array]]:
        """Return the torque through the transmissions with three derivatives, and q with two."""
        at, columns = self.unknowns.places, self._columns(band)
        spring = [
            band.tau[d] - sum((x[at[name]] * rows[d] for name, rows in columns.items()), np.zeros(())) for d in range(4)
        ]
        c, damping = x[at["c"]], x[at["damping"]]
        q = [band.theta[d] - c * (spring[d] - damping * spring[d + 1]) for d in range(3)]
        return spring, q

    def _misfit(self, x: Array) -> _Misfit:
        """Return Y(q) p - s, (N, n), the link side's terms, s and q."""
        spring, q = self._parts(x, self._band)
        terms, at, band = self.link.terms(q[0], q[1], q[2]), self.unknowns.places, self._band
        needed = terms.columns @ x[at["p"]] + self.link.loads(terms, x[at["J"]], band.theta[1], band.theta[2])
        return needed - spring[0], terms, spring, q

    def _slopes(self, x: Array, free: NDArray[np.bool_], at_x: _Misfit) -> Array:
        """Return the derivatives of the misfit by the free unknowns, (free, n, N): instants side by side in memory.

        `at_x`: what `_misfit` returns at x.
        """
        _, terms, spring, q = at_x
        at, band, n = self.unknowns.places, self._band, self.link.n
        J, c, damping = x[at["J"]], x[at["c"]], x[at["damping"]]
        by_motion = self.link.slopes(q, x[at["p"]], J, (band.theta[1], band.theta[2])).torque
        motions = np.ascontiguousarray(by_motion.transpose(3, 0, 2, 1))
        found = np.zeros((self.unknowns.size, n, len(spring[0])))
        found[at["p"]] = terms.columns.transpose(2, 1, 0)
        if len(terms.by_speed):
            loads = terms.by_speed * band.theta[1][:, None] + terms.by_acceleration * band.theta[2][:, None]
            found[at["J"]] = loads.transpose(2, 1, 0)
        columns = {name: [row.T.copy() for row in rows] for name, rows in self._columns(band).items()}
        twisted = [row.T.copy() for row in spring]
        for i in range(n):
            for name, rows in columns.items():
                place = at[name][0 if name == "delay" else i]
                if not free[place]:
                    continue
                found[place, i] += rows[0][i]
                if c[i]:
                    found[place] += c[i] * _chain(motions[i], _lagged(rows, i, damping[i]))
            if free[at["c"][i]]:
                found[at["c"][i]] -= _chain(motions[i], _lagged(twisted, i, damping[i]))
            if free[at["damping"][i]] and c[i]:
                found[at["damping"][i]] += _chain(motions[i], [c[i] * twisted[d + 1][i] for d in range(3)])
        return found[free]

    def mass(self, x: Array) -> Array:
        """Return each link's mean inertia about its joint, kg·m², (n,), kept positive."""
        _, q = self._parts(x, self._band)
        mean = np.diag(self.link.mass(q[0][:: max(1, 40 // self._stride)], x[self.unknowns["p"]]).mean(axis=0))
        acceleration = np.maximum(self._band.theta[2].std(axis=0), 1e-9)
        least = np.maximum(self.rotors.value, 0.01 * self.log.torque / acceleration)
        mass: Array = np.maximum(mean, _LEAST_MASS * least)
        return mass

    def _weights(self, x: Array, cutoff: float) -> Array:
        """Return one over the noise that the misfit would have at every frequency, (F, n), low-passed."""
        log, at = self.log, self.unknowns.places
        c, J, mass = x[at["c"]], x[at["J"]], self.mass(x)
        f = self._frequencies[:, None]
        square = (2 * np.pi * f) ** 2
        by_theta = square * (mass + J) - c * mass * J * square**2
        by_tau = 1 - c * mass * square
        variance = (by_theta * log.theta_noise) ** 2 + (by_tau * log.tau_noise) ** 2
        variance += (_MODEL_ERROR * log.torque) ** 2 * (1 + by_tau**2)
        weight: Array = 1 / np.sqrt(variance * (1 + (f / cutoff) ** 12))
        weight[self._frequencies > 1.5 * cutoff] = 0
        weight[0] *= 0.7
        return weight

    def _prior(self, x: Array, strength: float, soft: Array | None) -> tuple[Array, Array]:
        """Return residuals of what is known beforehand, and the unknowns' factors in them, (size,) each."""
        at = self.unknowns.places
        factor, mean = np.zeros(self.unknowns.size), np.zeros(self.unknowns.size)
        factor[at["J"]], mean[at["J"]] = strength / self.rotors.spread, self.rotors.value
        factor[at["delay"]], factor[at["damping"]] = strength / DELAY_SPREAD, strength / DAMPING_SPREAD
        factor[at["load"]] = 1 / LOAD_FRICTION_SPREAD
        if soft is not None:
            factor[at["c"]] = soft
        return factor * (x - mean), factor

    def rung(
        self, x: Array, cutoff: float, free: NDArray[np.bool_], strength: float, soft: Array | None = None
    ) -> tuple[Array, float]:
        """Return the unknowns that fit best below a cut-off, and their cost, by Gauss-Newton with damping.

        Parameters
        ----------
        x
            Where to start, (size,).
        cutoff
            Hz.
        free
            Which unknowns may move.
        strength
            How many times as strong as told the prior on rotors, delay and damping is.
        soft
            One over the spread of the compliances about zero, (n,), where they are held.
        """
        self._limit(cutoff)
        self._follow(x)
        bins = max(8, int(np.searchsorted(self._frequencies, 1.5 * cutoff)))
        weight = self._weights(x, cutoff)[:bins]

        window, scale = self._window[:, 0], (self._scale * weight).T

        def spectrum(values: Array) -> Array:
            """Return the weighted spectra of signals (..., n, N), real parts and imaginary ones, (..., n 2 bins)."""
            parts = np.fft.rfft(values * window, self._size)[..., :bins] * scale
            found: Array = np.concatenate([parts.real, parts.imag], axis=-1).reshape(*values.shape[:-2], -1)
            return found

        last: list[tuple[Array, _Misfit]] = []  # a step's slopes are asked for where its misfit was

        def residual(at: Array) -> Array:
            last[:] = [(at, self._misfit(at))]
            misfit = np.ascontiguousarray(last[0][1][0].T)
            found: Array = np.concatenate([spectrum(misfit), self._prior(at, strength, soft)[0]])
            return found

        def slopes(at: Array) -> Array:
            factor = self._prior(at, strength, soft)[1]
            there = last[0][1] if last and last[0][0] is at else self._misfit(at)
            columns: Array = np.concatenate([spectrum(self._slopes(at, free, there)), np.diag(factor)[free]], axis=1)
            return columns.T

        x, cost = descend(x, free, residual, slopes, _STEPS)
        return x, cost / (2 * self.link.n * bins)

    # ---- the climb

    def ascend(
        self, locked: float | None = None, told: Array | None = None, *, held_to: float = 0.0
    ) -> tuple[ClimbEnd, ClimbEnd]:
        """Climb from rigid joints, from the compliance that a locked frequency, Hz, means, or at compliances `told`.

        Those of a locked frequency are held below the cut-off `held_to`, Hz: far below antiresonances the equations'
        own errors would drive them off. Returns the highest rung that fits, and the one that fits best.
        """
        unknowns, elastic = self.unknowns, self.link.elastic
        idle = ["lost", "bumps", "further", *(kind.name for kind in KINDS), *(() if self.with_load else ("load",))]
        x = np.zeros(unknowns.size)
        x[unknowns["J"]], x[unknowns["p"]] = np.where(elastic, self.rotors.value, 0.0), 1e-3
        x, cost = self.rung(x, FIRST_RUNG, unknowns.free(*idle, "c"), 100.0)
        if told is not None:
            x[unknowns["c"]] = told
        elif locked is not None:
            x[unknowns["c"]] = np.where(elastic, 1 / (self.mass(x) * (2 * np.pi * locked) ** 2), 0.0)
        cost, trace = 1.0, []
        for cutoff in rungs(LAST_RUNG * self._end):
            held = cutoff < 3 * FIRST_RUNG and locked is None and told is None
            soft = 0.5 * self.mass(x) * (2 * np.pi * cutoff) ** 2 if held else None
            rows = 2 * self.link.n * max(8, int(np.searchsorted(self._frequencies, 1.5 * cutoff)))
            strength = float(np.sqrt(max(1.0, cost) * max(rows, 20) / 20))
            kept = told is not None or cutoff < held_to
            x, cost = self.rung(x, cutoff, unknowns.free(*idle, *(("c",) if kept else ())), strength, soft)
            trace.append(ClimbEnd(x, cost, float(cutoff)))
            if not kept and (earlier := met(trace[-1], self._traces[self.with_load], unknowns.apart)):
                trace = earlier
                break
        best = min((rung for rung in trace if rung.top >= held_to), key=lambda rung: rung.cost)
        if told is not None:  # no compliance was climbed to
            return best, best
        self._traces[self.with_load].append(trace)
        self.tops.append(trace[-1])
        return highest(trace), best

    def ends(self) -> Iterator[ClimbEnd]:
        """Yield distinct ends of climbs from rigid and soft joints and from the robot file's K, as asked for."""
        found: list[ClimbEnd] = []
        told, (soft, held_to) = self.link.told_compliance, SOFT_START
        for locked, known in ((None, None), (soft, None), *([] if told is None else [(None, told)])):
            try:
                ends = self.ascend(locked, known, held_to=held_to if locked else 0.0)
            except (np.linalg.LinAlgError, ValueError):
                continue
            for end in ends if locked else ends[:1]:
                apart = all(self.unknowns.apart(end.x, other.x) > _SAME for other in found)
                if np.all(np.isfinite(end.x)) and apart:
                    found.append(end)
                    yield end

    def motion(self, end: ClimbEnd, t: Array) -> Array:
        """Return the links' positions that an end means at instants t (M,), (M, n)."""
        self._limit(end.top)
        self._follow(end.x)
        _, (q, *_) = self._parts(end.x, self._whole)
        # near the ends differences of high order know nothing: the deflection stays what it is further in
        inside = np.flatnonzero(taper(self.log.count, self._reach)[:, 0])
        place = np.clip(np.arange(len(q)), inside[0], inside[-1])
        theta = self._whole.theta[0]
        return self._spline.at(t, self._spline.fit(theta + (q - theta)[place]))


def _lagged(rows: list[Array], i: int, damping: float) -> list[Array]:
    """Return what a damper leaves of a joint's torques (n, N) and their derivatives, three of (N,)."""
    return [rows[d][i] - damping * rows[d + 1][i] for d in range(3)]


def _chain(motions: Array, moves: list[Array]) -> Array:
    """Return what moves (N,) of q, q', q'' of one joint do to all rows, (n, N), by their derivatives (3, n, N)."""
    found: Array = motions[0] * moves[0]
    found += motions[1] * moves[1] + motions[2] * moves[2]
    return found
