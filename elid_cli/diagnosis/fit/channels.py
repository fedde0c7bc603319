"""Delays and offsets of the torque channels as unknowns of a model with effects."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from elid_cli.estimation.data import SampledData, Solved, sum_row
from elid_cli.estimation.regression.nuisances import SIGNIFICANT, beside_effects
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
    mays = [e for e in (*data.delays, *data.offsets) if e.nuisance and (e.nuisance, sum_row(e).joint) not in but]
    return beside_effects(mays, effects, columns)


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
