"""The link's own equation of every joint, reduced: what `link_equation` asks of a log, from small triangles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli.base import BaseParameters
from elid_cli.blocks import Block
from elid_cli.link_equation import LEAST, LinkStiffness, TwoWays
from elid_cli.longrun import KernelSum, Persistence, small_sample
from elid_cli.merged_fit import MergedFit, Stock
from elid_cli.model import Model, Row
from elid_cli.reduction import factor_of

Array = NDArray[np.float64]


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
    """What the links' equations need of a block: filtered channels (`observation.Block`) and the bodies' torques."""

    stretch: int
    channels: Array
    torque: Array
    """By the file's inertias, (n, m); NaN for joints of which the file does not give them."""


class LinkTorque:
    """The bodies' torque on every link by the robot file's inertias, as a multiple of the sum rows' columns."""

    def __init__(self, model: Model, base: BaseParameters, reference: Array) -> None:
        self._rows: list[tuple[slice, Array] | None] = []
        values = dict(zip(base.leaders.tolist(), base.values(reference), strict=True))
        rows = {item.row: item for item in model.estimation.rows}
        for joint in range(model.robot.n):
            item = rows[Row("sum", joint)]
            own = {f"{kind}{joint + 1}" for kind in ("Jm", "fs", "fv", "K")}
            factors = np.array(
                [values[k] if k in values and base.parameters[k] not in own else 0.0 for k in item.columns.tolist()]
            )
            known = model.robot.joints[joint].elastic and bool(np.isfinite(factors).all())
            self._rows.append((item.slots, factors) if known else None)

    def of(self, block: Block) -> LinkBlock:
        """Return what the links' equations need of a block."""
        nothing = np.full(block.last - block.first, np.nan)
        torque = np.stack([nothing if row is None else row[1] @ block.columns[row[0]] for row in self._rows])
        return LinkBlock(block.stretch, block.channels.copy(), torque)

    @property
    def known(self) -> list[bool]:
        """Whether the file gives the inertias of a joint's equation."""
        return [row is not None for row in self._rows]


def reduce_links(torque: LinkTorque, blocks: Sequence[LinkBlock]) -> tuple[LinkSystem | None, ...]:
    """Return every joint's system, None where there is none."""
    return tuple(_reduced(blocks, joint) if known else None for joint, known in enumerate(torque.known))


def _reduced(blocks: Sequence[LinkBlock], joint: int) -> LinkSystem | None:
    n = len(blocks[0].torque) if blocks else 0
    picked = [joint, n + joint, 2 * n + joint, *(3 * n + k for k in range(n) if k != joint)]

    def systems() -> Iterable[tuple[Array, int]]:
        for block in blocks:
            ones = np.ones((1, block.torque.shape[1]))
            system = np.concatenate([block.channels[picked], ones, block.torque[joint][None]])
            yield system[:, np.isfinite(system).all(axis=0)], block.stretch

    factor, count = np.zeros((0, n + 4)), 0
    for system, _ in systems():
        factor = factor_of(np.concatenate([factor, system.T]))
        count += system.shape[1]
    if count < LEAST or not factor[:, -1].any():
        return None
    fitted, _ = _solved(factor)
    scale = np.linalg.norm(factor[:, :-1], axis=0)[:, None]
    scale[scale == 0] = 1.0
    memory = Persistence(n + 3)
    for system, _ in systems():
        memory.feed(system[:-1] * (system[-1] - fitted @ system[:-1]) / scale)
    total = KernelSum(n + 3, memory.bandwidth)
    for system, stretch in systems():
        total.feed(system[:-1] * (system[-1] - fitted @ system[:-1]), stretch)
    return LinkSystem(factor, count, total.total(), memory.bandwidth)


def merged_stiffness(systems: Sequence[LinkSystem]) -> LinkStiffness | None:
    """Return the stiffness that the links' equations of several logs give together."""
    if not systems:
        return None
    factor = factor_of(np.concatenate([s.factor for s in systems]))
    count = sum(s.count for s in systems)
    bandwidth = float(np.average([s.bandwidth for s in systems], weights=[s.count for s in systems]))
    fitted, inverse = _solved(factor)
    width = int(np.count_nonzero(np.any(factor[:, :-1], axis=0)))
    factor_small = small_sample(count, width, bandwidth)
    meat: Array = sum((s.gram for s in systems), np.zeros_like(inverse)) * factor_small
    spread = float(np.sqrt(max((inverse @ meat @ inverse)[0, 0], 0.0)))
    rest = factor @ np.append(fitted, -1.0)
    torque, ones = factor[:, -1], factor[:, -2]
    variance = float(torque @ torque) / count - (float(torque @ ones) / count) ** 2
    left = float(rest @ rest) / count - (float(rest @ ones) / count) ** 2
    return LinkStiffness(float(fitted[0]), spread, 1.0 - left / variance if variance > 0 else 0.0)


def merged_ways(model: Model, stock: Stock, fit: MergedFit, standard: Array, joint: int) -> TwoWays | None:
    """Return a joint's stiffness by both regressions of its motor row (`link_equation.two_ways`), from triangles."""
    chosen = stock.chosen(fit.gliding, stock.nuisances).of(Row("motor", joint))
    count = sum(t.count for t in chosen)
    spring = model.index.get(f"K{joint + 1}")
    if count < LEAST or spring is None or spring not in chosen[0].index:
        return None
    index = chosen[0].index
    factor = np.concatenate([t.factor for t in chosen])
    own = np.flatnonzero((index < model.parameters) & (index != spring))
    ones = factor[:, np.flatnonzero(index == model.parameters + stock.nuisances.index(model.robot.n + joint))[0]]
    x = factor[:, np.flatnonzero(index == spring)[0]]
    y = factor[:, -1] - factor[:, own] @ standard[index[own]]

    def product(a: Array, b: Array) -> float:
        return float(a @ b) - float(a @ ones) * float(b @ ones) / count

    xx, yy, xy = product(x, x), product(y, y), product(x, y)
    return TwoWays(xy / xx, yy / xy) if xx > 0 and xy > 0 else None


def _solved(factor: Array) -> tuple[Array, Array]:
    """Return the solution of a triangle's system and the inverse of its normal matrix."""
    columns, torque = factor[:, :-1], factor[:, -1]
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    unit = columns / scale
    inverse = np.linalg.pinv(unit.T @ unit, rcond=1e-12)
    return inverse @ (unit.T @ torque) / scale, inverse / np.outer(scale, scale)
