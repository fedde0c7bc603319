"""A fit turned into a collocation problem: knots, samples, right-hand sides, noise and what is known beforehand."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.collocation.equations import RobotEquations
from elid_cli.estimation.collocation.layout import UnknownsLayout, free_shapes, given_effects
from elid_cli.estimation.collocation.problem import CollocationSegment, Iterate, Problem, Setting
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.model.effects.declared import amplitude_prior
from elid_cli.model.regressor import Regressor
from elid_cli.robot.parameter import StandardParameter
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import Signals
from elid_cli.signals.spline_fit import fit_spline
from elid_cli.signals.splines import DEGREE, basis

FINE, COARSE = 0.005, 0.02
"""Knot spacings, s: one that follows the jump of friction where a motor reverses, and one for where noise hides it.

Every knot is an unknown, and at the finest frequencies nothing but noise decides it: a trajectory that follows the
torque's noise there bends what the torque is divided by, the inertias.
"""
MODEL_ERROR = 2e-5
"""Standard deviation of the equations' own error, as a share of the rms torque of the joint."""
NOISE_SHARE = 4e-4
"""The same as a share of the spring's torque noise: a trajectory known so badly cannot obey the equations closer."""
NOISY = 57.0
"""Signal-to-noise ratio of the positions, dB, below which the cost has many valleys along an inertia …"""
WIDER, SOFTER = 1.5, 2.5
"""… so that coarse knots are so much wider, and the equations so much softer, that few of them are left."""
SHAPE_SPREAD = 0.7
"""Prior standard deviation of a shape's logarithm about what the robot file gives."""
FOLLOWED, FOLLOWED_LOOSELY = 1.4, 1.1
"""Noise of the torques that fine knots assume, as a share of what is measured. A trajectory so free follows that noise:
with the share 1 a rotor's inertia came out 1.4 standard errors too large on a planar arm at 90 dB and 1 % (1.25: 0.5,
1.5: -0.2, 2: -1.4), 2.3 at 80 dB; with loose equations 1.4 is too much (-2.1)."""
LOOSE, LOOSE_LINK = 10.0, 0.03
"""Factor on the equations' own error, and share of the torques' noise in links' equations, where a spline follows the
motion less well than is assumed: the jump of a motor's friction makes links of stiff, light joints ring at 60 Hz."""
_WINDOWS, _NOISY = (5, 11, 21, 41, 81), 0.1
"""Samples that a torque's rate is taken over, and how much of it may be noise."""
_POINTS, _FEWEST = 15, 5
"""Points per knot interval, at most and at least."""
_SHORTEST = 12
"""Knot intervals that a segment needs."""


def _points(stride: int) -> int:
    """Return the collocation points of a knot interval: equally many samples lie around each."""
    return max(d for d in range(1, min(_POINTS, stride) + 1) if stride % d == 0)


def _rate(torque: Array, noise: float, dt: float) -> Array:
    """Return the rate of a torque (N,) by local cubics, as short as its noise lets them be and no longer than it."""
    rate = np.zeros_like(torque)
    for width in (w for w in _WINDOWS if w <= len(torque)):
        slopes = _slopes(width) / dt
        middle, half = slopes[width // 2], width // 2
        rate = np.concatenate([
            slopes[:half] @ torque[:width], np.convolve(torque, middle[::-1], "valid"), slopes[-half:] @ torque[-width:]
        ])  # fmt: skip
        scatter = noise * float(np.linalg.norm(middle))
        if scatter < _NOISY * float(np.sqrt(np.mean(rate**2))):
            break
    return rate


def _slopes(width: int) -> Array:
    """Return what gives the slopes of a cubic through so many samples at each of them, (width, width).

    In its middle row they are those of Savitzky and Golay (1964). SciPy has them too, in a package that takes longer to
    import than a collocation of a short log takes.
    """
    at = np.arange(width) - 0.5 * (width - 1)
    scale = max(float(np.abs(at).max()), 1.0)
    powers = (at / scale)[:, None] ** np.arange(4)
    slope = np.zeros_like(powers)
    slope[:, 1:] = np.arange(1, 4) * powers[:, :3] / scale
    return np.asarray(slope @ np.linalg.pinv(powers))


def signal_to_noise(signals: Signals, model: Regressor) -> float:
    """Return the signal-to-noise ratio of the worst joint's positions, dB."""
    worst = np.inf
    for k in range(model.robot.n):
        if signals.still[k]:
            continue
        size = float(np.nanstd(signals.motion.q[:, k]))
        noise = float(np.nanmax([signals.noise.q[k], signals.noise.theta[k], 1e-12]))
        worst = min(worst, 20 * np.log10(max(size, 1e-300) / noise))
    return float(worst)


class Setup:
    """A fit turned into a collocation problem, its knots as fine as they may be or coarser by a whole number.

    Parameters
    ----------
    fit
        The default estimator's fit.
    coarse
        Whether its knots are coarse.
    followed
        Factor on the torques' noise in the equations that a torque drives (`FOLLOWED`).
    loose
        Whether equations hold only as closely as splines follow fast links (`LOOSE`).
    """

    def __init__(self, fit: DefaultFit, *, coarse: bool = False, followed: float = 1.0, loose: bool = False) -> None:
        self.fit = fit
        self._followed, self._loose = followed, loose
        self.noisy = signal_to_noise(fit.signals, fit.model) < NOISY
        finest = self._finest(fit.signals.dt)
        wanted = COARSE * (WIDER if self.noisy else 1.0) / (finest * fit.signals.dt)
        self.coarser = max(1, round(wanted) if self.noisy else int(wanted + 1e-9))
        self._stride = finest * self.coarser if coarse else finest
        signals, robot = fit.signals, fit.model.robot
        channels = [("q", k) for k in range(robot.n) if not signals.still[k]]
        channels += [("theta", k) for k in range(robot.n) if robot.joints[k].elastic and not signals.still[k]]
        self.channels = tuple(channels)
        self.rows = tuple(item.row for item in fit.model.equations.rows)
        self.p_columns = fit.solution.basis
        self.setting = self._setting()
        self._delay, self._free = self._delays()
        self.pieces = [p for s in signals.segments if (p := self._piece(s)) is not None]
        rates = tuple(p.rate for p in self.pieces)
        layout = UnknownsLayout(fit, self.channels, self.rows, self.p_columns, self.setting, rates)
        self.equations = RobotEquations(layout)
        self.effects = given_effects(fit)
        self.z_start = free_shapes(self.effects)
        self.start = Iterate(
            [p.start for p in self.pieces], fit.solution.values[self.p_columns].copy(), free_shapes(fit.effects)
        )
        self.problem = Problem(self.setting, self.pieces, self.equations, self.first_rho())
        self.problem.followed = self._rho(1.0) / self.first_rho()

    def _setting(self) -> Setting:
        signals, stride = self.fit.signals, self._stride
        points = _points(stride)
        motion = signals.motion
        scale = np.array(
            [
                [max(float(np.nanstd(getattr(motion, "d" * d + side)[:, k])), 1e-9) for side, k in self.channels]
                for d in range(3)
            ]
        )
        return Setting(signals.dt, stride, points, scale)

    @staticmethod
    def _finest(dt: float) -> int:
        """Return the finest stride of knots, samples."""
        stride = max(4, round(FINE / dt))
        return stride if _points(stride) >= _FEWEST else stride + 1  # a prime stride: the next even one

    def _intervals(self, segment: Segment) -> int:
        """Return the knot intervals of a segment, as many as cover what the coarse knots cover."""
        whole = self._finest(self.fit.signals.dt) * self.coarser
        return len(segment) // whole * (whole // self.setting.stride)

    def start_from(self, other: Setup, now: Iterate) -> Iterate:
        """Return unknowns of a problem with coarser knots as unknowns of this one: the same trajectory."""
        ratio, setting = other.setting.stride // self.setting.stride, self.setting
        u = np.arange(ratio * setting.stride) / other.setting.stride
        coefficients = []
        for own in now.coefficients:
            windows = np.lib.stride_tricks.sliding_window_view(own, DEGREE + 1, axis=0)
            values = np.einsum("jcl,sl->cjs", windows, basis(u), optimize=True).reshape(own.shape[1], -1)
            end = windows[-1] @ basis(np.ones(1))[0]
            spline = fit_spline(np.column_stack([values, end]), setting.stride, setting.dt).spline
            coefficients.append(np.ascontiguousarray(spline.coefficients.T))
        return Iterate(coefficients, now.p.copy(), now.z.copy())

    def _delays(self) -> tuple[Array, NDArray[np.bool_]]:
        """Return every torque channel's delay in the fit, s, and whether it is an unknown here too, (n,) each."""
        delays, free = np.zeros(self.fit.model.robot.n), np.zeros(self.fit.model.robot.n, dtype=bool)
        for k, extra in enumerate(self.fit.nuisances):
            if extra.nuisance == "delay":
                joint, column = next(iter(extra.rows)).joint, self.fit.model.parameters + k
                delays[joint], free[joint] = self.fit.solution.values[column], column in self.p_columns
        return delays, free

    def _piece(self, segment: Segment) -> CollocationSegment | None:
        intervals = self._intervals(segment)
        # the same stretches whatever the knots: answers of coarse and of fine ones are compared piece by piece
        if intervals * self.setting.stride < _SHORTEST * self._finest(self.fit.signals.dt) * self.coarser:
            return None
        signals, recording, stride = self.fit.signals, self.fit.signals.recording, self.setting.stride
        assert recording is not None
        part = slice(segment.start, segment.start + intervals * stride)
        measured = np.empty((len(self.channels), intervals * stride))
        weight = np.zeros_like(measured)
        smooth = np.empty_like(measured)
        for c, (side, k) in enumerate(self.channels):
            raw = (recording.q if side == "q" else recording.theta)[part, k]
            noise = (signals.noise.q if side == "q" else signals.noise.theta)[k]
            if not self.fit.model.robot.joints[k].elastic and not np.isfinite(raw).any():
                raw, noise = recording.theta[part, k], signals.noise.theta[k]
            measured[c] = raw
            smooth[c] = getattr(signals.motion, side)[part, k]
            sigma = max(float(noise), 1e-9 * float(np.nanstd(smooth[c])) + 1e-15)
            weight[c] = np.where(np.isfinite(raw), 1.0 / sigma, 0.0)
        start = fit_spline(smooth, stride, signals.dt).spline.coefficients[:, : intervals + 5].T
        torque, mask, rate = self._right_side(part)
        shape = (len(self.channels), intervals, stride)
        return CollocationSegment(
            measured.reshape(shape),
            weight.reshape(shape),
            torque.reshape(len(self.rows), intervals, self.setting.points),
            mask.reshape(len(self.rows), intervals, self.setting.points),
            np.ascontiguousarray(start),
            rate,
        )

    def _right_side(self, part: slice) -> tuple[Array, Array, Array]:
        """Return torque averaged over the samples around each point, the rows' weights there and the torque's rate.

        The rate is 0 but where the delay is an unknown: u(t - delay) is taken at the fit's delay and to first order
        about it.
        """
        signals = self.fit.signals
        every = self.setting.stride // self.setting.points
        instants = (part.stop - part.start) // every
        torque, mask, rate = np.zeros((3, len(self.rows), instants))
        for number, row in enumerate(self.rows):
            if row.kind == "link":
                mask[number] = 1.0
                continue
            raw, delay = signals.delayed[part, row.joint], self._delay[row.joint]
            known = np.isfinite(raw)
            t = np.arange(len(raw)) * signals.dt
            acting = np.interp(t - delay, t[known], raw[known]) if known.any() else np.zeros(len(raw))
            mask[number] = known.reshape(-1, every).all(axis=1)
            at_once = np.nan_to_num(signals.tau[part, row.joint] - raw)
            torque[number] = (acting + at_once).reshape(-1, every).mean(axis=1)
            if self._free[row.joint]:
                noise = float(np.nan_to_num(signals.noise.tau[row.joint]))
                rate[number] = _rate(acting, noise, signals.dt).reshape(-1, every).mean(axis=1)
                torque[number] += delay * rate[number]
        return torque, mask, rate

    def first_rho(self) -> Array:
        """Return the noise of every row that is assumed at first, N·m (N), (rows,)."""
        return self._rho(self._followed)

    def _rho(self, followed: float) -> Array:
        signals = self.fit.signals
        every = self.setting.stride // self.setting.points
        share = NOISE_SHARE * (SOFTER if self.noisy else 1.0)
        rho = []
        for row in self.rows:
            torque = signals.tau[:, row.joint]
            size = float(np.sqrt(np.nanmean(torque**2))) if np.isfinite(torque).any() else 1.0
            noise = float(np.nan_to_num(signals.noise.tau[row.joint])) / np.sqrt(every)
            noise *= (LOOSE_LINK if self._loose else 0.0) if row.kind == "link" else followed
            own = max(MODEL_ERROR * size, share * self._spring_noise(row.joint)) * (LOOSE if self._loose else 1.0)
            rho.append(np.hypot(own, noise))
        return np.asarray(np.maximum(np.array(rho), 1e-9))

    def torque_share(self) -> float:
        """Return how much of the equations' assumed variance is noise of the torques, 0 to 1, on average."""
        every = self.setting.stride // self.setting.points
        shares = [
            (self._followed * float(np.nan_to_num(self.fit.signals.noise.tau[row.joint])) / rho) ** 2 / every
            for row, rho in zip(self.rows, self.first_rho(), strict=True)
            if row.kind != "link"
        ]
        return float(np.mean(shares)) if shares else 0.0

    def _spring_noise(self, joint: int) -> float:
        """Return the torque that one sample's encoder noise makes in the spring, N·m (N)."""
        model, noise = self.fit.model, self.fit.signals.noise
        if not model.robot.joints[joint].elastic:
            return 0.0
        stiffness = abs(float(self.fit.solution.values[model.index[StandardParameter("K", joint)]]))
        return stiffness * float(np.hypot(np.nan_to_num(noise.q[joint]), np.nan_to_num(noise.theta[joint])))

    def prior(self, now: Iterate) -> tuple[float, Array, Array]:
        """Return (cost, matrix, gradient) of the priors on amplitudes and shapes."""
        size = len(now.p) + len(now.z)
        matrix, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        if self.effects is None:
            return cost, matrix, gradient
        k = len(now.p) + np.arange(len(now.z))
        matrix[k, k] = 1.0 / SHAPE_SPREAD**2
        gradient[k] = (now.z - self.z_start) / SHAPE_SPREAD**2
        cost += float(np.sum((now.z - self.z_start) ** 2)) / SHAPE_SPREAD**2
        rows = self._amplitudes
        if rows is not None:
            here = rows[:, self.p_columns]
            miss = here @ now.p - rows[:, -1]
            matrix[: len(now.p), : len(now.p)] += here.T @ here
            gradient[: len(now.p)] += here.T @ miss
            cost += float(miss @ miss)
        return cost, matrix, gradient

    @cached_property
    def _amplitudes(self) -> Array | None:
        """What is known of the effects' amplitudes, equations [columns | target]."""
        assert self.effects is not None
        return amplitude_prior(self.effects.effects, self.fit.first_amplitude, self.fit.triangles.width)

    def common_cost(self, now: Iterate) -> float:
        """Return the cost of unknowns with the noise and the weights that were assumed at first, to compare by."""
        with self._as_assumed(self.start):
            return self.problem.cost(now) + self.prior(now)[0]

    def common_costs(self, *several: Iterate) -> list[list[Array]]:
        """Return what `common_cost` sums, of every knot interval, (intervals,) of each piece, without the priors.

        Of several, to compare them: where a motor reverses in any of them, equations count as little in all. A jump of
        friction at another instant costs more than what else tells two apart.
        """
        with self._as_assumed(self.start, *several):
            return [self.problem.costs(now) for now in several]

    @contextmanager
    def _as_assumed(self, *trusted: Iterate) -> Iterator[None]:
        held = self.problem.rho
        self.problem.rho = self.first_rho()
        self.problem.trust(*trusted)
        yield
        self.problem.rho = held

    def noise_cost(self) -> float:
        """Return the cost that noise alone makes: of the positions, and of the torques where they are noisy."""
        every = self.setting.stride // self.setting.points
        rho = self.first_rho()
        white = np.array([np.nan_to_num(self.fit.signals.noise.tau[row.joint]) for row in self.rows])
        white = np.where([row.kind == "link" for row in self.rows], 0.0, white) / np.sqrt(every)
        used = sum(piece.mask.sum(axis=(1, 2)) for piece in self.pieces)
        seen = sum(int(np.count_nonzero(piece.weight)) for piece in self.pieces)
        return seen + float(np.sum(used * (white / rho) ** 2))
