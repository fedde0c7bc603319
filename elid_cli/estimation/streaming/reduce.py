"""From the signals of one log to its triangles, block by block: the regressor is never held.

What is kept while the blocks pass are the filtered, decimated columns, which the standard errors need once the
residual is known; of a long log they are kept in single precision, which is plenty for that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.regression.filtered_rows import observed_blocks
from elid_cli.estimation.stiffness.noise import deflection_noise
from elid_cli.estimation.streaming.accumulate import ReductionBlock, TriangleAccumulator, kept
from elid_cli.estimation.streaming.fit import MergedTriangles, fit_stock
from elid_cli.estimation.streaming.links import LinkSums
from elid_cli.estimation.streaming.reduced_log import ReducedLog, SignalFacts, hollow
from elid_cli.estimation.streaming.scores import LogScores
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import EstimationRow, Regressor, RegressorPlan
from elid_cli.robot.robot import Robot
from elid_cli.robot.text import fingerprint
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

Progress = Callable[[float], None]

FOLDS = 6
"""Contiguous stretches of a log, each in turn predicted by a fit to the others."""
POSES = 200
"""Link positions kept to say where a log did not go."""
SINGLE = 64 << 20
"""Bytes of filtered columns above which they are kept in single precision."""


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
    model = Regressor(robot.stiffened(signals.missing_link))
    base = find_base(model)
    plan = model.estimation
    layout = _layout(model, plan)
    pile = TriangleAccumulator(layout, len(signals.outputs), FOLDS)
    blocks: list[ReductionBlock] = []
    reference = model.robot.reference()
    single = plan.program.outputs * len(signals.outputs) * 8 > SINGLE
    links = LinkSums(model, base, reference, plan, single=single)
    for block in observed_blocks(model, signals, plan):
        whole = kept(block, plan, signals)
        pile.add(whole)
        links.add(block)
        blocks.append(whole.single() if single else whole)
        if progress is not None:
            progress(block.last / len(signals.outputs))
    stock = MergedTriangles(model.parameters, model.robot.n, FOLDS, *pile.triangles())
    scores = LogScores(layout, stock, blocks)
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
        links.systems(),
        reference,
    )


def facts_of(signals: Signals, blocks: Sequence[ReductionBlock]) -> SignalFacts:
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
        torque=np.any([block.known.any(axis=1) for block in blocks], axis=0),
        unlinked=signals.missing_link,
        velocity_used=bool(signals.velocity_used.any()),
        known=np.sum([block.known.sum(axis=1) for block in blocks], axis=0, dtype=np.intp),
        poses=np.nan_to_num(np.array([signals.motion.positions(slice(k, k + 1))[0, :, 0] for k in outputs.tolist()])),
    )


def _layout(model: Regressor, plan: RegressorPlan) -> tuple[tuple[EstimationRow, NDArray[np.intp]], ...]:
    """Return each row group's columns: its standard parameters, then delay and offset of its torque channel."""
    first, n = model.parameters, model.robot.n
    return tuple(
        (item.row, np.concatenate([item.columns, [first + item.row.joint, first + n + item.row.joint]]).astype(np.intp))
        for item in plan.rows
    )
