"""From the signals of one log to its triangles, block by block: the regressor is never held.

What is kept while the blocks pass are the filtered, decimated columns, which the standard errors need once the
residual is known; of a long log they are kept in single precision, which is plenty for that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from elid_cli.base import find_base
from elid_cli.blocks import Block, observed_blocks
from elid_cli.link_reduction import LinkTorque, reduce_links
from elid_cli.longrun import KernelSum, Persistence, small_sample
from elid_cli.merged_fit import Stock, fit_stock
from elid_cli.model import Model, Plan, Row
from elid_cli.observation import REVERSAL_SHARE
from elid_cli.recording import Recording
from elid_cli.reduced_log import ReducedLog, Scores, SignalFacts, hollow
from elid_cli.reduction import Triangle, factor_of
from elid_cli.robot import Robot
from elid_cli.robot_text import fingerprint
from elid_cli.signals import Signals
from elid_cli.solve import Solution
from elid_cli.stiffness import deflection_noise

Array = NDArray[np.float64]
Progress = Callable[[float], None]

FOLDS = 6
"""Contiguous stretches of a log, each in turn predicted by a fit to the others."""
WAITING = 2000
"""Equations that are reduced at a time."""
POSES = 200
"""Link positions kept to say where a log did not go."""
SINGLE = 64 << 20
"""Bytes of filtered columns above which they are kept in single precision."""


@dataclass
class _Kept:
    """A block as it is kept for the scores."""

    block: Block
    use: NDArray[np.bool_]
    """Instants away from reversals, (n, m)."""
    known: NDArray[np.bool_]


def reduce_log(
    robot: Robot,
    signals: Signals,
    recording: Recording,
    options: Mapping[str, object],
    progress: Progress | None = None,
) -> ReducedLog:
    """Reduce one log.

    Parameters
    ----------
    robot
        The robot as described.
    signals, recording
        The log.
    options
        How the signals were conditioned, as asked for.
    progress
        Told the share of the log that is done.
    """
    model = Model(robot.stiffened(signals.unlinked))
    base = find_base(model)
    plan = model.estimation
    layout = _layout(model, plan)
    pile = _Pile(model, layout, len(signals.outputs))
    blocks: list[_Kept] = []
    reference = model.robot.reference()
    torque, links = LinkTorque(model, base, reference), []
    single = plan.program.outputs * len(signals.outputs) * 8 > SINGLE
    for block in observed_blocks(model, signals, plan):
        kept = _marked(block, signals)
        pile.add(kept, plan)
        links.append(torque.of(block))
        if single:
            kept = _Kept(_single(block), kept.use, kept.known)
        blocks.append(kept)
        if progress is not None:
            progress(block.last / len(signals.outputs))
    stock = Stock(model.parameters, model.robot.n, FOLDS, *pile.triangles())
    scores = _ScoreMaker(model, plan, layout, stock, blocks)
    fit_stock(stock, base.count, signals.dt, scores.covariance)
    return ReducedLog(
        fingerprint(robot),
        dict(options),
        hollow(recording),
        facts_of(signals, blocks),
        layout,
        stock.steady,
        stock.reversing,
        tuple(scores.made),
        reduce_links(torque, links),
        reference,
    )


def facts_of(signals: Signals, blocks: Sequence[_Kept]) -> SignalFacts:
    """Return what later questions ask of the signals."""
    outputs = signals.outputs[:: max(1, len(signals.outputs) // POSES)]
    n = signals.n
    return SignalFacts(
        dt=signals.dt,
        rate=signals.rate,
        cutoff=signals.filter.cutoff,
        instants=len(signals.outputs),
        knots=np.asarray(signals.knots, dtype=float),
        min_velocity=np.asarray(signals.min_velocity, dtype=float),
        noise=np.stack([signals.noise.q, signals.noise.theta, signals.noise.tau]),
        deflection_noise=np.array([deflection_noise(signals, k) for k in range(n)]),
        still=signals.still,
        torque=np.any([kept.known.any(axis=1) for kept in blocks], axis=0),
        unlinked=signals.unlinked,
        velocity_used=bool(signals.velocity_used.any()),
        known=np.sum([kept.known.sum(axis=1) for kept in blocks], axis=0, dtype=np.intp),
        poses=np.nan_to_num(np.array([signals.motion.positions(slice(k, k + 1))[0, :, 0] for k in outputs.tolist()])),
    )


def _layout(model: Model, plan: Plan) -> tuple[tuple[Row, NDArray[np.intp]], ...]:
    """Return each row group's columns: its standard parameters, then delay and offset of its torque channel."""
    first, n = model.parameters, model.robot.n
    return tuple(
        (item.row, np.concatenate([item.columns, [first + item.row.joint, first + n + item.row.joint]]).astype(np.intp))
        for item in plan.rows
    )


def _marked(block: Block, signals: Signals) -> _Kept:
    known = np.isfinite(block.tau)
    reversing = (block.reversal > REVERSAL_SHARE) & ~signals.still[:, None]
    return _Kept(block, known & ~reversing, known)


def _single(block: Block) -> Block:
    """Return what the scores need of a block, in little room; views would keep the whole block alive."""
    return Block(
        block.first,
        block.last,
        block.stretch,
        block.columns.astype(np.float32),
        block.tau.copy(),
        block.tau_rate.copy(),
        np.zeros((0, 0)),
        np.zeros((0, 0)),
        np.zeros((0, 0)),
    )


def _system(block: Block, slots: slice, joint: int) -> Array:
    """Return a row group's columns with those of the nuisances and the torque, (k + 3, m)."""
    extra = np.stack([block.tau_rate[joint], np.ones(block.tau.shape[1]), block.tau[joint]])
    return np.concatenate([block.columns[slots], extra])


class _Growing:
    """A triangle to which equations are added; they wait until there are enough of them for one QR."""

    def __init__(self) -> None:
        self.count = 0
        self.power = 0.0
        self._parts: list[Array] = []
        self._waiting = 0

    def add(self, system: Array) -> None:
        """Add equations, (columns + 1, m)."""
        self.count += system.shape[1]
        self.power += float(system[-1] @ system[-1])
        self._parts.append(system.T.copy())
        self._waiting += system.shape[1]
        if self._waiting > WAITING:
            self._parts, self._waiting = [self.factor()], 0

    def factor(self) -> Array:
        """Return the triangle of all that was added."""
        return factor_of(np.concatenate(self._parts))


class _Pile:
    """Triangles that grow block by block."""

    def __init__(self, model: Model, layout: Sequence[tuple[Row, NDArray[np.intp]]], instants: int) -> None:
        self._index = dict(layout)
        self._instants = max(instants, 1)
        self._found: tuple[dict[tuple[Row, int], _Growing], ...] = ({}, {})

    def add(self, kept: _Kept, plan: Plan) -> None:
        """Add the equations of a block."""
        block = kept.block
        fold = np.arange(block.first, block.last) * FOLDS // self._instants
        bounds = np.flatnonzero(np.diff(fold, prepend=-1, append=FOLDS))
        for item in plan.rows:
            system = _system(block, item.slots, item.row.joint)
            steady, known = kept.use[item.row.joint], kept.known[item.row.joint]
            for start, stop in pairwise(bounds.tolist()):
                for found, use in zip(self._found, (steady, known & ~steady), strict=True):
                    chosen = use[start:stop]
                    if chosen.any():
                        part = system[:, start:stop]
                        self._grow(found, item.row, int(fold[start]), part if chosen.all() else part[:, chosen])

    def _grow(self, found: dict[tuple[Row, int], _Growing], row: Row, fold: int, system: Array) -> None:
        growing = found.setdefault((row, fold), _Growing())
        growing.add(system)

    def triangles(self) -> tuple[tuple[Triangle, ...], tuple[Triangle, ...]]:
        """Return what has grown: away from reversals, and around them."""
        steady, reversing = (
            tuple(
                Triangle(row, fold, self._index[row], growing.factor(), growing.count, growing.power)
                for (row, fold), growing in found.items()
            )
            for found in self._found
        )
        return steady, reversing


class _ScoreMaker:
    """Long-run covariance of this log's scores, for the solutions that the fit asks about."""

    def __init__(
        self,
        model: Model,
        plan: Plan,
        layout: Sequence[tuple[Row, NDArray[np.intp]]],
        stock: Stock,
        blocks: Sequence[_Kept],
    ) -> None:
        self._plan, self._layout, self._stock, self._blocks = plan, layout, stock, blocks
        self.made: list[Scores] = []

    def covariance(self, solution: Solution, nuisances: Sequence[int], gliding: NDArray[np.bool_]) -> Array:
        """Return the covariance of a solution's basis, and keep what it was made of."""
        values, lift = lifted(solution, self._layout, self._stock, nuisances)
        live = live_columns(solution, self._stock, nuisances)
        memory = Persistence(len(live))
        for rows, _ in self._scores(values, gliding):
            memory.feed(self._summed(rows, solution, len(values))[live])
        bandwidth = memory.bandwidth
        total = KernelSum(len(lift), bandwidth)
        for rows, stretch in self._scores(values, gliding):
            total.feed(rows, stretch)
        self.made.append(Scores(total.total(), bandwidth, tuple(nuisances)))
        return spread_of(solution, lift.T @ self.made[-1].gram @ lift, memory.instants, bandwidth)

    def _summed(self, rows: Array, solution: Solution, width: int) -> Array:
        """Return weighted scores of every column, (p + 2n, m), summed over row groups."""
        summed = np.zeros((width, rows.shape[1]))
        place = 0
        for row, index in self._layout:
            summed[index] += solution.weights.get(row, 0.0) ** 2 * rows[place : place + len(index)]
            place += len(index)
        return summed

    def _scores(self, values: Array, gliding: NDArray[np.bool_]) -> Iterator[tuple[Array, int]]:
        """Yield (scores (s, m), stretch) block by block, unweighted."""
        width = sum(len(index) for _, index in self._layout)
        for kept in self._blocks:
            rows = np.empty((width, kept.block.last - kept.block.first))
            place = 0
            for item, (row, index) in zip(self._plan.rows, self._layout, strict=True):
                use = (kept.known if gliding[row.joint] else kept.use)[row.joint]
                block, joint, here = kept.block, row.joint, rows[place : place + len(index)]
                columns = block.columns[item.slots]
                own, delay, offset = values[index[:-2]], values[index[-2]], values[index[-1]]
                residual = block.tau[joint] - own @ columns - delay * block.tau_rate[joint] - offset
                residual = np.where(use, residual, 0.0)
                np.multiply(columns, residual, out=here[:-2])
                np.multiply(block.tau_rate[joint], residual, out=here[-2])
                here[-1] = residual
                if not use.all():
                    here[:, ~use] = 0.0  # what is not known must not spread
                place += len(index)
            yield rows, kept.block.stretch


def lifted(
    solution: Solution, layout: Sequence[tuple[Row, NDArray[np.intp]]], stock: Stock, nuisances: Sequence[int]
) -> tuple[Array, Array]:
    """Return the solution over all columns (p + 2n,), and what turns raw scores into whitened ones, (s, r)."""
    columns = _numbers(stock, nuisances)
    values = np.zeros(stock.parameters + 2 * stock.joints)
    values[columns] = solution.values
    inverse = np.zeros((len(values), len(solution.basis)))
    inverse[columns[solution.basis]] = solution.inverse
    parts = [solution.weights.get(row, 0.0) ** 2 * inverse[index] for row, index in layout]
    return values, np.concatenate(parts)


def live_columns(solution: Solution, stock: Stock, nuisances: Sequence[int]) -> NDArray[np.intp]:
    """Return the numbers of a solution's columns that are not zero, among all p + 2n."""
    return _numbers(stock, nuisances)[solution.live]


def _numbers(stock: Stock, nuisances: Sequence[int]) -> NDArray[np.intp]:
    first = stock.parameters
    return np.concatenate([np.arange(first), first + np.array(nuisances, dtype=np.intp)]).astype(np.intp)


def spread_of(solution: Solution, meat: Array, instants: int, bandwidth: float) -> Array:
    """Return the covariance of a solution's basis from the long-run covariance of its whitened scores."""
    factor = small_sample(instants, len(solution.basis), bandwidth)
    covariance: Array = solution.inverse @ (meat * factor) @ solution.inverse.T
    return covariance
