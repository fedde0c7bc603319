"""Noise floor: the residual that the sensors' noise alone would leave in each row.

The noise of each position channel, as estimated from what the splines left over, is added to the smooth motion and
sent through the same splines, regressor and filter; what the present parameters then predict differently is the
propagated noise. White noise of the torques, motors' and joint sensors', estimated from sixth differences, goes through
the same filter. The resulting
series also serve as the model of the noise's colour: whitening by the residual's own colour would remove effects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.observation import Observation, RowGroup, observe
from elid_cli.model.regressor import SENSOR_KINDS, EstimationRow, Regressor
from elid_cli.signals.command_torque import loop_gains
from elid_cli.signals.motion import Motion
from elid_cli.signals.signals import Signals
from elid_cli.signals.spline_fit import fit_spline


@dataclass(frozen=True)
class Floor:
    """Propagated noise of every row group."""

    rms: Mapping[EstimationRow, float]
    series: Mapping[EstimationRow, Array]
    """Noise series per row, (replicates, M), N·m."""
    pulled: frozenset[EstimationRow] = frozenset()
    """Rows of motors in whose deflection noise is large: it pulls their stiffness."""


@dataclass(frozen=True)
class PropagatedNoise:
    """What some noise histories change in a log's equations: everything of its floor that no parameter enters."""

    groups: tuple[RowGroup, ...]
    changes: tuple[tuple[Array, ...], ...]
    """By how much every group's columns differ, per history, each (p_r, M)."""
    torque: tuple[Array, ...]
    """Noise of the motor torques, per history (n, M), N·m."""
    reading: tuple[Array, ...]
    """The same of the joint torque sensors, zeros where none is used."""

    def floor(self, standard: Array) -> Floor:
        """Return the floor at standard parameters (p,)."""
        stacked = {
            group.row: np.array([self._moved(number, place, standard) for number in range(len(self.changes))])
            for place, group in enumerate(self.groups)
        }
        rms = {}
        for group in self.groups:
            used = stacked[group.row][:, group.use]
            rms[group.row] = float(np.sqrt(np.mean(used**2))) if used.size else float("nan")
        return Floor(rms, stacked)

    def _moved(self, number: int, place: int, standard: Array) -> Array:
        group = self.groups[place]
        kind, joint = group.row
        moved: Array = standard[group.index] @ self.changes[number][place]
        if kind not in ("link", "load", "spring"):
            moved = moved - self.torque[number][joint]
        if kind in SENSOR_KINDS:
            moved = moved + (1.0 if kind == "drive" else -1.0) * self.reading[number][joint]
        return moved


def noise_floor(model: Regressor, signals: Signals, observation: Observation, standard: Array) -> Floor:
    """Propagate sensor noise to the residuals of every row group (see `propagated`) at standard parameters (p,)."""
    return propagated(model, signals, observation).floor(standard)


def propagated(
    model: Regressor,
    signals: Signals,
    observation: Observation,
    replicates: int = 3,
    seed: int = 0,
    *,
    cut: bool = True,
) -> PropagatedNoise:
    """Send sensor noise through splines, regressor and filter.

    Parameters
    ----------
    model, signals
        As given to `observe`.
    observation
        What `observe` made of them.
    replicates
        Independent noise histories.
    seed
        Seed of the noise; the same seed gives the same floor.
    cut
        Whether what the splines cut off the motion counts as well (`perturbed`), or noise alone.
    """
    signals, generator = signals.alone(), np.random.default_rng(seed)
    sensed = any(group.row.kind in SENSOR_KINDS for group in observation.groups)
    changes, torques, readings = [], [], []
    for number in range(replicates):
        aside = (1 if number % 2 == 0 else -1) if cut else 0
        noisy = observe(model, replace(signals, motion=perturbed(signals, generator, aside)), mask=False)
        torque = np.nan_to_num(signals.decimate(_torque_noise(signals, generator).T))
        read = np.nan_to_num(signals.decimate(_reading_noise(signals, generator).T)) if sensed else 0.0 * torque
        for group, other in zip(observation.groups, noisy.groups, strict=True):
            np.subtract(other.columns, group.columns, out=other.columns)
        changes.append(tuple(group.columns for group in noisy.groups))
        torques.append(torque)
        readings.append(read)
    return PropagatedNoise(observation.groups, tuple(changes), tuple(torques), tuple(readings))


def perturbed(signals: Signals, generator: np.random.Generator, aside: int = 0) -> Motion:
    """Return the motion with white sensor noise of the estimated size, smoothed as the signals were.

    Parameters
    ----------
    signals
        The log's signals.
    generator
        Source of the noise.
    aside
        By how many samples the knots lie wider than the signals' own. Other knots cannot follow the motion exactly, as
        the signals' own could not follow the true one: what the splines cut off becomes part of the noise.
    """
    motion = signals.motion
    arrays = [a.copy() for a in motion.states]
    same = np.array_equal(motion.q, motion.theta, equal_nan=True)
    for k in range(signals.n):
        if signals.still[k]:
            continue
        own = max(2, round(float(signals.knots[k]) / signals.dt)) if np.isfinite(signals.knots[k]) else 20
        stride = max(2, own + aside)
        rigid = same or np.array_equal(motion.q[:, k], motion.theta[:, k])
        for segment in signals.segments:
            part = slice(segment.start, segment.stop)
            link = generator.standard_normal(len(segment)) * np.nan_to_num(signals.noise.q[k])
            motor = generator.standard_normal(len(segment)) * np.nan_to_num(signals.noise.theta[k])
            smooth = (motion.q[part, k], motion.theta[part, k])
            if stride != own:
                link, motor = link + smooth[0], motor + smooth[1]
            rates = _rates(signals, k, part, generator, smooth=stride != own)
            sides = [motor] if rigid and not rates else [motor if rigid else link, motor]
            fit = fit_spline(np.array(sides), stride, signals.dt, rates)
            for derivative, change in enumerate(fit.spline.between(0, len(segment))):
                for place, values in ((derivative, change[0]), (3 + derivative, change[-1])):
                    kept = 0.0 if stride != own else arrays[place][part, k]
                    arrays[place][part, k] = values + kept
    return Motion(motion.t, *arrays)


def _rates(
    signals: Signals, joint: int, part: slice, generator: np.random.Generator, *, smooth: bool
) -> list[tuple[int, Array, Array]]:
    """Return the measured derivatives that joined a joint's splines, link and motor, with white noise of their size."""
    motion = signals.motion
    exact = {1: (motion.dq, motion.dtheta), 2: (motion.ddq, motion.ddtheta)}
    drawn = []
    for derivative, ratios in signals.rates:
        ratio = ratios[[joint, signals.n + joint]]
        spread = np.nan_to_num([signals.noise.q[joint], signals.noise.theta[joint]]) / np.where(
            ratio > 0, ratio, np.inf
        )
        noise = spread[:, None] * generator.standard_normal((2, part.stop - part.start))
        base = np.array([side[part, joint] for side in exact[derivative]]) if smooth else 0.0
        drawn.append((derivative, np.where(ratio[:, None] > 0, base + noise, np.nan), ratio))
    return drawn


def _torque_noise(signals: Signals, generator: np.random.Generator) -> Array:
    """Return noise of the torques, (N, n): white, but in torques computed from positions what white noise of these is.

    That is far from white, and counts little below the filter's cut-off.
    """
    noise = generator.standard_normal(signals.tau.shape) * np.nan_to_num(signals.noise.tau)
    kp, kd = loop_gains(signals.recording)
    for k in np.flatnonzero((kp > 0) | (kd > 0)):
        size = float(np.nan_to_num(signals.noise.q[k] if np.isfinite(signals.noise.q[k]) else signals.noise.theta[k]))
        positions = size * generator.standard_normal(len(noise))
        noise[:, k] = kp[k] * positions + kd[k] * np.gradient(positions, signals.dt)
    return noise


def _reading_noise(signals: Signals, generator: np.random.Generator) -> Array:
    return generator.standard_normal(signals.tau.shape) * np.nan_to_num(signals.noise.tau_link)
