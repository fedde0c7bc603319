"""From the signals of one log to its triangles, block by block: the regressor is never held.

What is kept while the blocks pass are the filtered, decimated columns, which the standard errors need once the
residual is known; of a long log they are kept in single precision, which is plenty for that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array, Progress
from elid_cli.estimation.cutoff import at_best_cutoff
from elid_cli.estimation.data import Solved
from elid_cli.estimation.default_fit import DefaultFit, fit_data
from elid_cli.estimation.facts import facts_of
from elid_cli.estimation.regression.filtered_rows import FilteredBlock, observed_blocks
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.result import EstimateOptions
from elid_cli.estimation.stiffness.links import LinkSums, Loads, load_factors
from elid_cli.estimation.streaming.accumulate import ReductionBlock, TriangleAccumulator, kept
from elid_cli.estimation.streaming.merged import MergedTriangles, TriangleData, numbers_of
from elid_cli.estimation.streaming.reduced_log import ReducedLog, hollow
from elid_cli.estimation.streaming.scores import LogScores
from elid_cli.estimation.stretches import STRETCHES
from elid_cli.estimation.validation.sufficiency import judge_model
from elid_cli.logs.mapping.resolve import RATE
from elid_cli.memory import Recent
from elid_cli.model.base_parameters import BaseParameters, find_base
from elid_cli.model.regressor import EstimationRow, Regressor, RegressorPlan
from elid_cli.robot.robot import Robot
from elid_cli.robot.text import fingerprint
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

SINGLE = 64 << 20
"""Bytes of filtered columns above which they are kept in single precision."""


def asked_of(options: SignalOptions) -> dict[str, object]:
    """Return what of a log's conditioning a user may ask for, as JSON values; None: chosen from the log."""
    keys = ("cutoff", "rate", "min_velocity", "measured_velocity", "knots", "slow_motion", "commands")
    return {key: getattr(options, key) for key in keys}


def reduce_each(
    robot: Robot, signals: Signals, asked: Mapping[str, object], progress: Progress | None = None
) -> list[ReducedLog]:
    """Reduce signals whose samples are at hand, log by log of those that they were read from (ValueError without)."""
    recording = signals.recording
    if recording is None:
        raise ValueError("signals that were not made from a recording")
    sources = sorted({segment.source for segment in signals.segments})
    tell = None if progress is None else lambda share: progress("reducing", share)
    if len(sources) == 1:
        return [reduce_log(robot, signals, recording, asked, tell)]
    logs = []
    for source in sources:
        segments = tuple(segment for segment in signals.segments if segment.source == source)
        files, digests = recording.files[source : source + 1], recording.sha256[source : source + 1]
        part = replace(recording, segments=segments, files=files, sha256=digests)
        logs.append(reduce_log(robot, replace(signals, segments=segments), part, asked))
    return logs


def reduce_log(
    robot: Robot,
    signals: Signals,
    recording: Recording,
    options: Mapping[str, object],
    progress: Callable[[float], None] | None = None,
) -> ReducedLog:
    """Reduce one log, at the cut-off that its standard errors prefer where the user chose none.

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
    rates = recording.sources.get("dq_des")
    _, model, base, reference = _model_of(robot, signals)
    signals, shown = at_best_cutoff(model, base, signals, EstimateOptions())
    judgement = None if shown is None else judge_model(shown)
    whole = shown if shown is not None and _fits_all(shown, signals) else None
    asked = [] if whole is None else [_asked_of(one) for one in whole.scored]
    facts = None if whole is None else whole.data.facts
    seen = () if whole is None else whole.observation.blocks
    del shown, whole  # they hold their columns
    plan = model.estimation
    layout = _layout(model, plan)
    pile = TriangleAccumulator(layout, len(signals.outputs), STRETCHES)
    blocks: list[ReductionBlock] = []
    single = plan.program.outputs * len(signals.outputs) * 8 > SINGLE
    loads = load_factors(base, reference, {item.row: item.columns for item in plan.rows})
    loads = {joint: factors for joint, factors in loads.items() if not signals.still[joint]}
    links = LinkSums(loads, model.robot.n, single=single)
    for block in seen or observed_blocks(model, signals, plan):
        rows = kept(block, plan, signals)
        pile.add(rows)
        links.add(block.segment, block.channels, _torques(loads, plan, block))
        blocks.append(rows.single() if single else rows)
        if progress is not None:
            progress(block.last / len(signals.outputs))
    facts = facts or facts_of(signals, np.sum([block.known.sum(axis=1) for block in blocks], axis=0))
    merged = MergedTriangles(model.parameters, model.robot.n, STRETCHES, *pile.triangles())
    scores = LogScores(layout, merged, blocks)
    # the fit asks for the scores of every solution that a fit to the stored triangles will come to
    for one in asked:
        scores.covariance(*one)
    if not asked:
        none = np.zeros(model.robot.n, dtype=bool)
        slow = signals.slow_left_out
        data = TriangleData(model, facts, merged, scores.covariance, lambda joint: None, none, slow)
        fit_data(base, data, EstimateOptions())
    return ReducedLog(
        fingerprint(robot),
        {**options, "commands": "smooth" if recording.smooth else None, "dq_des": rates if rates == RATE else None},
        hollow(recording),
        facts,
        layout,
        merged.steady,
        merged.reversing,
        tuple(scores.made),
        links.systems(),
        reference,
        judgement,
    )


def _torques(loads: Loads, plan: RegressorPlan, block: FilteredBlock) -> Array:
    """Return the torque of joints' bodies at the instants of a block, (joints, m)."""
    weights = np.zeros((len(loads), len(block.rows)))
    slots = {item.row.joint: item.slots for item in plan.rows if item.row.kind == "sum"}
    for number, (joint, factors) in enumerate(loads.items()):
        np.add.at(weights[number], block.place[slots[joint]], factors)
    return np.asarray(weights @ block.rows)


_MODELS: Recent[tuple[Robot, Regressor, BaseParameters, Array]] = Recent(4)
"""Models by robot, which is kept with them so that its identity stands for it, and by what the logs lack."""


def _model_of(robot: Robot, signals: Signals) -> tuple[Robot, Regressor, BaseParameters, Array]:
    """Return a robot, its model as a log shows it, base parameters and reference values; logs of one robot share it."""

    def made() -> tuple[Robot, Regressor, BaseParameters, Array]:
        model = Regressor(robot.stiffened(signals.missing_link).read_behind(signals.link_torque))
        return robot, model, find_base(model), model.robot.reference()

    return _MODELS.of((id(robot), signals.missing_link.tobytes(), signals.link_torque.tobytes()), made)


def _asked_of(fit: Solved) -> tuple[Solution, list[int], NDArray[np.bool_]]:
    """Return what scores are kept of: a solution, the numbers of its nuisances, the joints whose reversals count."""
    return fit.solution, numbers_of(fit.nuisances, fit.model.robot.n), fit.observation.gliding


def _fits_all(fit: DefaultFit, signals: Signals) -> bool:
    """Return whether a fit is to the equations that the triangles hold: the whole log, its motor torques alone."""
    return fit.effects is None and fit.signals.segments == signals.segments and not fit.samples.rows_of_sensors()


def _layout(model: Regressor, plan: RegressorPlan) -> tuple[tuple[EstimationRow, NDArray[np.intp]], ...]:
    """Return each row group's columns: its standard parameters, then delay and offset of its torque channel."""
    first, n = model.parameters, model.robot.n
    return tuple(
        (item.row, np.concatenate([item.columns, [first + item.row.joint, first + n + item.row.joint]]).astype(np.intp))
        for item in plan.rows
    )
