"""The link's own equation of every joint, from blocks of a log: small triangles, and the stiffness that they give."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.facts import deflection_noise
from elid_cli.estimation.regression.covariance import in_unit_columns
from elid_cli.estimation.regression.long_run import KernelSum, Persistence, beyond_normal, small_sample, uncertain
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import factor_of
from elid_cli.estimation.stiffness.link_equation import LEAST, LinkStiffness
from elid_cli.estimation.stiffness.noise import pull
from elid_cli.estimation.streaming.accumulate import GrowingTriangle
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.parameter import POSITIVE, StandardParameter
from elid_cli.signals.signals import Signals

Loads = Mapping[int, Array]
"""By joint, what the columns (k,) of its sum row are multiplied by to give its bodies' torque."""
DOUBT = 1e-3
"""Probability with which logs that agree on a stiffness are said to disagree."""
TOGETHER = 16_000
"""Instants that are taken at a time where blocks are passed over again."""


@dataclass(frozen=True)
class LinkSystem:
    """Equation of one link in one log: bodies' torque by the file's inertias = what spring, damping, friction give.

    Columns: deflection, its rate, link velocity, accelerations of the other joints, one; then the bodies' torque.
    """

    factor: Array
    """R factor of the columns and the torque, (k + 1, k + 1) or flatter."""
    count: int
    gram: Array
    """Long-run covariance of the scores, (k, k)."""
    bandwidth: float


def load_factors(base: BaseParameters, reference: Array, columns: Mapping[EstimationRow, NDArray[np.intp]]) -> Loads:
    """Return what makes the sum row of an elastic joint the torque of its bodies by reference values (p,).

    `columns` are those of every row. There are none for joints of whose bodies these values are not known.
    """
    values = dict(zip(base.leaders.tolist(), base.values(reference), strict=True))
    found = {}
    for row, joint in columns:
        if row == "motor":
            own = {StandardParameter(kind, joint) for kind in POSITIVE}
            index = columns[EstimationRow("sum", joint)].tolist()
            factors = np.array([0.0 if base.parameters[k] in own else values.get(k, 0.0) for k in index])
            if np.isfinite(factors).all():
                found[joint] = factors
    return found


class LinkSums:
    """The links' equations of a log, gathered block by block.

    Parameters
    ----------
    joints
        Those whose bodies' torque is known, ascending.
    n
        Number of all joints.
    single
        Keep in single precision what the standard errors need.
    """

    def __init__(self, joints: Iterable[int], n: int, *, single: bool = False) -> None:
        self._joints, self._n = list(joints), n
        self._growing = {joint: GrowingTriangle(n + 4) for joint in self._joints}
        self._kind = np.float32 if single else np.float64
        self._kept: list[list[tuple[int, Array]]] = []

    def add(self, segment: int, channels: Array, loads: Array) -> None:
        """Add filtered channels (4 n, m) of a segment (`FilteredBlock.channels`) and the bodies' torques (joints, m).

        The blocks of a segment follow each other.
        """
        if not self._joints:
            return
        rows = np.concatenate([channels, loads])
        for place, joint in enumerate(self._joints):
            self._growing[joint].add(self._system(rows, place))
        block: Array = rows.astype(self._kind, copy=False)
        last = self._kept[-1] if self._kept else []
        if last and last[0][0] == segment and sum(rows.shape[1] for _, rows in last) < TOGETHER:
            last.append((segment, block))
        else:
            self._kept.append([(segment, block)])

    def systems(self) -> tuple[LinkSystem | None, ...]:
        """Return every joint's system, None where there is none."""
        found: list[LinkSystem | None] = [None] * self._n
        factors = {}
        for place, joint in enumerate(self._joints):
            growing = self._growing[joint]
            if growing.count >= LEAST and (factor := growing.factor())[:, -1].any():
                factors[place] = factor
        memories = {place: Persistence(factor.shape[1] - 1) for place, factor in factors.items()}
        scores = {place: _Scores(factor) for place, factor in factors.items()}
        for system, place, _ in self._again(factors):
            memories[place].feed(scores[place].of(system, scaled=True))
        totals = {place: KernelSum(factor.shape[1] - 1, memories[place].bandwidth) for place, factor in factors.items()}
        for system, place, segment in self._again(factors):
            totals[place].feed(scores[place].of(system, scaled=False), segment)
        for place, factor in factors.items():
            joint = self._joints[place]
            total, bandwidth = totals[place].total(), memories[place].bandwidth
            found[joint] = LinkSystem(factor, self._growing[joint].count, total, bandwidth)
        return tuple(found)

    def _again(self, places: Iterable[int]) -> Iterator[tuple[Array, int, int]]:
        """Yield (system, place of its joint, segment) of all that was kept, many blocks at a time."""
        for several in self._kept:
            rows = several[0][1] if len(several) == 1 else np.concatenate([block for _, block in several], axis=1)
            for place in places:
                yield self._system(rows, place), place, several[0][0]

    def _system(self, rows: Array, place: int) -> Array:
        """Return a joint's equations, (n + 4, m), as far as they hold numbers."""
        n, joint = self._n, self._joints[place]
        others = [3 * n + k for k in range(n) if k != joint]
        system = np.empty((n + 4, rows.shape[1]), dtype=rows.dtype)
        system[:-2] = rows[[joint, n + joint, 2 * n + joint, *others]]
        system[-2] = 1.0
        system[-1] = rows[4 * n + place]
        if np.isfinite(system.sum()):
            return system
        return system[:, np.isfinite(system).all(axis=0)]


class _Scores:
    """Scores of a link's equation under its own fit."""

    def __init__(self, factor: Array) -> None:
        self._fitted = _solved(factor)[0]
        self._scale = np.linalg.norm(factor[:, :-1], axis=0)[:, None]
        self._scale[self._scale == 0] = 1.0

    def of(self, system: Array, *, scaled: bool) -> Array:
        """Return column times residual, (k, m)."""
        kind = system.dtype
        scores: Array = system[:-1] * (system[-1] - self._fitted.astype(kind) @ system[:-1])
        if scaled:
            scores /= self._scale.astype(kind)
        return scores


def link_stiffness(
    base: BaseParameters, observation: Observation, signals: Signals, reference: Array, joint: int
) -> LinkStiffness | None:
    """Return the stiffness of one joint from its link's equation, or None where the file's inertias do not suffice.

    Parameters
    ----------
    base
        Base parameters.
    observation, signals
        The log.
    reference
        Reference values of the standard parameters, (p,); NaN where unknown.
    joint
        Joint number from 0.
    """
    loads = load_factors(base, reference, {group.row: group.index for group in observation.groups})
    if joint not in loads or signals.still[joint]:
        return None  # of a joint that is held the deflection is one more constant
    sums = LinkSums([joint], signals.n)
    load = loads[joint] @ observation.group(EstimationRow("sum", joint)).columns
    for segment in np.unique(observation.segment).tolist():
        here = observation.segment == segment
        sums.add(segment, observation.channels[:, here], load[None, here])
    return merged_stiffness([s for s in sums.systems() if s is not None], deflection_noise(signals, joint))


def merged_stiffness(systems: Sequence[LinkSystem], noise: float) -> LinkStiffness | None:
    """Return the stiffness that the links' equations of several logs give together.

    `noise` is the standard deviation of the encoders' in the filtered deflection, rad (m).
    """
    if not systems:
        return None
    factor = factor_of(np.concatenate([s.factor for s in systems]))
    count = sum(s.count for s in systems)
    bandwidth = float(np.average([s.bandwidth for s in systems], weights=[s.count for s in systems]))
    fitted, inverse = _solved(factor)
    width = int(np.count_nonzero(np.any(factor[:, :-1], axis=0)))
    wider = small_sample(count, width, bandwidth) * uncertain(count, bandwidth)
    meat: Array = sum((s.gram for s in systems), np.zeros_like(inverse)) * wider
    spread = float(np.sqrt(max((inverse @ meat @ inverse)[0, 0], 0.0)))
    rest = factor @ np.append(fitted, -1.0)
    torque, ones = factor[:, -1], factor[:, -2]
    variance = float(torque @ torque) / count - (float(torque @ ones) / count) ** 2
    left = float(rest @ rest) / count - (float(rest @ ones) / count) ** 2
    pulled = pull(float(fitted[0]), noise, 1.0 / (float(inverse[0, 0]) * count) if inverse[0, 0] > 0 else 0.0)
    explained = 1.0 - left / variance if variance > 0 else 0.0
    return LinkStiffness(float(fitted[0]), math.hypot(max(spread, _between(systems)), pulled), explained)


def _between(systems: Sequence[LinkSystem]) -> float:
    """Return the standard error that the difference between logs alone gives a stiffness; 0 where they agree."""
    if len(systems) < 2:
        return 0.0
    from scipy.special import chdtri

    values, errors = np.empty((2, len(systems)))
    for k, system in enumerate(systems):
        fitted, inverse = _solved(system.factor)
        values[k], errors[k] = fitted[0], max(float((inverse @ system.gram @ inverse)[0, 0]), 1e-300) ** 0.5
    weights = 1.0 / errors**2
    apart = (values - float(np.average(values, weights=weights))) / errors
    if apart @ apart <= float(chdtri(len(systems) - 1, DOUBT)):
        return 0.0
    return beyond_normal(len(systems) - 1) * float(np.std(values, ddof=1)) / math.sqrt(len(systems))


def _solved(factor: Array) -> tuple[Array, Array]:
    """Return the solution of a triangle's system and the inverse of its normal matrix."""
    _, scale, inverse, fitted = in_unit_columns(factor[:, :-1], factor[:, -1])
    return fitted / scale, inverse / np.outer(scale, scale)
