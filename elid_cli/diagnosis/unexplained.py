"""Rows that obey the model where the search looks, and not on the held-out stretches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.diagnosis.fit.state import State
from elid_cli.diagnosis.residuals import HIGH, MATTERS, RowState
from elid_cli.diagnosis.result import Unexplained
from elid_cli.diagnosis.search.event_times import INSTANT
from elid_cli.estimation.identify import JointError
from elid_cli.estimation.validation.prediction import Validation
from elid_cli.model.regressor import EstimationRow, Kind

UNSEEN = 3.0
"""Held-out error over the floor from which a row that is quiet elsewhere is not."""
TAKEN_UP = 0.2
"""s before and after a payload's start in which what is held out is not judged."""
HELD_OUT = "held-out stretches"
"""What such a row's residual follows."""


def away_from_changes(
    errors: Mapping[str, JointError], validation: Validation, state: State, chosen: NDArray[np.bool_]
) -> dict[str, JointError]:
    """Return held-out errors without the moments in which a load is being taken up: that takes a time of its own."""
    starts = [
        float(e.shape[k])
        for e in state.effects
        for k, p in enumerate(e.shapes)
        if p.name == INSTANT and e.local and chosen.any()
    ]
    if not starts:
        return dict(errors)
    away = chosen & np.all([np.abs(validation.observation.t - start) > TAKEN_UP for start in starts], axis=0)

    def rms(kind: Kind, joint: int, given: float | None) -> float | None:
        group = next((g for g in validation.observation.groups if g.row == EstimationRow(kind, joint)), None)
        if given is None or group is None or not (group.use & away).any():
            return given
        return float(np.sqrt(np.mean(np.square(validation.residual[group.row][group.use & away]))))

    return {
        name: replace(e, rms=rms("sum", k, e.rms) or 0.0, spring_rms=rms("motor", k, e.spring_rms))
        for k, (name, e) in enumerate(errors.items())
    }


def unseen(
    errors: Mapping[str, JointError], rows: Sequence[RowState], told: Sequence[Unexplained]
) -> tuple[Unexplained, ...]:
    """Return rows that obey the model where the search looks, and not on the held-out stretches.

    Something that happens within a held-out stretch alone is for nobody to find, but it must not be called noise. Where
    a motor's sticking is left in a row everywhere, it is more than that.
    """
    sticking = {(r.joint, r.rows): r.rms for r in rows if not r.high and r.ratio > HIGH}
    known = {(item.joint, item.rows) for item in told} | {(r.joint, r.rows) for r in rows if r.high}
    found = []
    for name, error in errors.items():
        sides: tuple[tuple[Kind, float | None, float | None], ...] = (
            ("sum", error.rms, error.floor),
            ("motor", error.spring_rms, error.spring_floor),
        )
        for kind, rms, floor in sides:
            elsewhere = max(floor or 0.0, sticking.get((name, kind), 0.0))
            if rms is None or not floor or rms <= UNSEEN * elsewhere or rms <= MATTERS * error.torque_rms:
                continue
            if not known & {(name, kind), (name, "link"), (name, "sum")}:
                found.append(Unexplained(name, kind, HELD_OUT, 0.0, rms, rms / floor, ()))
    return tuple(found)
