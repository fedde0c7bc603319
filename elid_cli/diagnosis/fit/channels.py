"""Delays and offsets of the torque channels as unknowns of a model with effects."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from elid_cli.estimation.data import SampledData, Solved, sum_row
from elid_cli.estimation.regression.nuisances import SIGNIFICANT
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.model.effects.effect import Effect, Nuisance

Fault = tuple[Nuisance, int]
"""A fault of a torque channel, and the joint."""


def unknowns_of_channels(
    data: SampledData, effects: Sequence[Effect], columns: Sequence[ExtraColumns], but: Collection[Fault]
) -> list[ExtraColumns]:
    """Return delay and offset of every torque channel, as identification estimates them along.

    Not those that effects of the model are: a late channel, a constant torque in the rows of the channel.
    """
    late = {e.joint for e in effects if e.corrects == "torque"} | {joint for kind, joint in but if kind == "delay"}
    delays = [extra for extra in data.delays if sum_row(extra).joint not in late]
    offsets = [extra for extra in data.offsets if ("offset", sum_row(extra).joint) not in but]
    return delays + [extra for extra in offsets if not any(_constant(own, extra) for own in columns)]


def without_idle_offsets(found: Solved) -> list[ExtraColumns]:
    """Return the nuisances without offsets that are none.

    Some stood out only as long as others were beside them. One larger than the torque itself is made up for by gravity
    or friction, and stands for what another row lacks, such as the zero of an encoder.
    """
    covariance = found.data.covariance(found.solution, found.extras)
    deviation = dict(zip(found.solution.basis.tolist(), np.sqrt(np.maximum(np.diag(covariance), 0.0)), strict=True))
    first = found.model.parameters

    def stands(column: int, extra: ExtraColumns) -> bool:
        size = abs(float(found.solution.values[column]))
        sure = size > SIGNIFICANT * deviation.get(column, np.inf)
        return sure and size < found.triangles.torque_rms(sum_row(extra))

    return [e for k, e in enumerate(found.nuisances) if e.nuisance != "offset" or stands(first + k, e)]


def _constant(own: ExtraColumns, offset: ExtraColumns) -> bool:
    """Whether an effect holds the offset of a torque channel: one of its columns is a constant in the same rows.

    A column of zeros is none: what a member of a family lacks.
    """
    if own.rows.keys() != offset.rows.keys():
        return False
    return any(
        all(0 < np.abs(values[k]).max() >= 1e9 * np.ptp(values[k]) for values in own.rows.values())
        for k in range(own.width)
    )
