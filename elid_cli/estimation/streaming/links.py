"""The link's own equation of every joint, reduced: what `link_equation` asks of a log, from small triangles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.covariance import in_unit_columns
from elid_cli.estimation.regression.filtered_rows import FilteredBlock
from elid_cli.estimation.regression.long_run import KernelSum, Persistence, small_sample, uncertain
from elid_cli.estimation.regression.triangles import factor_of
from elid_cli.estimation.stiffness.link_equation import LEAST, LinkStiffness, load_factors
from elid_cli.estimation.stiffness.noise import pull
from elid_cli.estimation.streaming.accumulate import GrowingTriangle
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import EstimationRow, Regressor, RegressorPlan

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


@dataclass(frozen=True)
class LinkBlock:
    """What the links' equations need of a block: filtered channels (`blocks.Block`) and the bodies' torques."""

    segment: int
    rows: Array
    """(5 n, m): channels (4 n), then the torques by the file's inertias, NaN for joints of which it does not give
    them."""


class LinkSums:
    """The links' equations of a log, gathered block by block.

    Parameters
    ----------
    model, base, reference
        The robot; the bodies' torque on every link is, by the robot file's inertias (`reference`), a multiple of the
        sum rows' columns.
    plan
        Rows and outputs of the blocks.
    single
        Keep in single precision what the standard errors need.
    """

    def __init__(
        self,
        model: Regressor,
        base: BaseParameters,
        reference: Array,
        plan: RegressorPlan | None = None,
        *,
        single: bool = False,
    ) -> None:
        plan = plan or model.estimation
        self._rows: list[tuple[slice, Array] | None] = []
        rows = {item.row: item for item in plan.rows}
        for joint in range(model.robot.n):
            item = rows[EstimationRow("sum", joint)]
            factors = load_factors(base, reference, joint, item.columns)
            known = model.robot.joints[joint].elastic and bool(np.isfinite(factors).all())
            self._rows.append((item.slots, factors) if known else None)
        n = model.robot.n
        self._picks = [
            [joint, n + joint, 2 * n + joint, *(3 * n + k for k in range(n) if k != joint)] for joint in range(n)
        ]
        self._growing = [GrowingTriangle(n + 4) for _ in range(n)]
        self._kind = np.float32 if single else np.float64
        self._kept: list[list[LinkBlock]] = []

    def add(self, block: FilteredBlock) -> None:
        """Add a block's equations."""
        n, count = len(self._rows), block.last - block.first
        known = [joint for joint, row in enumerate(self._rows) if row is not None]
        if not known:
            return
        rows = np.full((5 * n, count), np.nan)
        rows[: 4 * n] = block.channels
        factors = np.zeros((len(known), len(block.rows)))
        for number, joint in enumerate(known):
            slots, values = cast(tuple[slice, Array], self._rows[joint])
            np.add.at(factors[number], block.place[slots], values)
        rows[[4 * n + joint for joint in known]] = factors @ block.rows
        for joint in known:
            self._growing[joint].add(self._system(rows, joint))
        new = LinkBlock(block.segment, rows.astype(self._kind, copy=False))
        last = self._kept[-1] if self._kept else []
        if last and last[0].segment == new.segment and sum(b.rows.shape[1] for b in last) < TOGETHER:
            last.append(new)
        else:
            self._kept.append([new])

    def systems(self) -> tuple[LinkSystem | None, ...]:
        """Return every joint's system, None where there is none."""
        found: list[LinkSystem | None] = [None] * len(self._rows)
        factors = {}
        for joint, row in enumerate(self._rows):
            growing = self._growing[joint]
            if row is not None and growing.count >= LEAST and (factor := growing.factor())[:, -1].any():
                factors[joint] = factor
        memories = {joint: Persistence(factor.shape[1] - 1) for joint, factor in factors.items()}
        scores = {joint: _Scores(factor) for joint, factor in factors.items()}
        for system, joint, _ in self._again(factors):
            memories[joint].feed(scores[joint].of(system, scaled=True))
        totals = {joint: KernelSum(factors[joint].shape[1] - 1, memories[joint].bandwidth) for joint in factors}
        for system, joint, segment in self._again(factors):
            totals[joint].feed(scores[joint].of(system, scaled=False), segment)
        for joint, factor in factors.items():
            count, memory = self._growing[joint].count, memories[joint]
            found[joint] = LinkSystem(factor, count, totals[joint].total(), memory.bandwidth)
        return tuple(found)

    def _again(self, joints: Iterable[int]) -> Iterator[tuple[Array, int, int]]:
        """Yield (system, joint, segment) of all that was kept, many blocks at a time."""
        for several in self._kept:
            rows = several[0].rows if len(several) == 1 else np.concatenate([b.rows for b in several], axis=1)
            for joint in joints:
                yield self._system(rows, joint), joint, several[0].segment

    def _system(self, rows: Array, joint: int) -> Array:
        """Return a joint's equations, (n + 4, m), as far as they hold numbers."""
        picks, n = self._picks[joint], len(self._rows)
        system = np.empty((len(picks) + 2, rows.shape[1]), dtype=rows.dtype)
        system[:-2] = rows[picks]
        system[-2] = 1.0
        system[-1] = rows[4 * n + joint]
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
    return LinkStiffness(float(fitted[0]), math.hypot(spread, pulled), explained)


def _solved(factor: Array) -> tuple[Array, Array]:
    """Return the solution of a triangle's system and the inverse of its normal matrix."""
    _, scale, inverse, fitted = in_unit_columns(factor[:, :-1], factor[:, -1])
    return fitted / scale, inverse / np.outer(scale, scale)
