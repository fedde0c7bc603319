"""Whether what acts for a moment speaks only where a motor is near standstill, from where friction says the same.

A joint that slows down into sticking, or creeps to rest at the end of a log, is held by a friction that no model has
exactly: anything between the Coulomb friction of one direction and that of the other. On a rigid joint a push on the
link is the same torque in the same row. Behind a spring it is not: friction stands in the motor's row, a push does not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elid_cli.diagnosis.fit.state import State, without
from elid_cli.diagnosis.residuals import standing
from elid_cli.estimation.regression.covariance import long_run, residuals
from elid_cli.model.regressor import Row

Array = NDArray[np.float64]

HELD = 2.0
"""Torque that friction may hold back near standstill, in units of Coulomb friction: from one direction to the other."""
MOVING = 0.5
"""Least part of what an effect explains that must not be friction near standstill."""
LINKWARD = 0.5
"""Part of an effect's torque that the motor's row may show, two standard deviations included, for it to be none of
the motor's friction."""


def friction_at_rest(state: State, number: int) -> bool:
    """Whether friction near standstill could be most of what effect `number`, a push or load on links, explains."""
    if state.effects[number].place not in ("link", "chain"):
        return False
    lacking = without(state, number)
    before = residuals(lacking.log.observation, lacking.solution.values, lacking.extras)
    after = residuals(state.log.observation, state.solution.values, state.extras)
    explained = doubtful = 0.0
    for row in state.columns[number].rows:
        if row not in state.triangles.rows:
            continue
        key, use = (row.kind, row.joint), state.log.training.group(row).use
        unit = max(state.floor.rms[row], 1e-4 * state.triangles.torque_rms(row))
        gone = np.where(use, before[key] ** 2 - after[key] ** 2, 0.0) / unit**2
        explained += float(gone.sum())
        doubtful += float(gone[use & _held(state, number, row, after)].sum())
    return explained > 0 and doubtful > (1.0 - MOVING) * explained


def _held(state: State, number: int, row: Row, left: dict[tuple[str, int], Array]) -> NDArray[np.bool_]:
    """Return the instants at which friction can be what an effect explains in a row, (M,)."""
    log, joint = state.log, row.joint
    nowhere = np.zeros(log.observation.instants, dtype=bool)
    if row.kind != "sum":  # a torque sensor behind the motor's friction reads none of it
        return nowhere
    torque = state.coefficients(number) @ state.columns[number].rows[row]
    coulomb = float(state.standard[log.model.index[f"fs{joint + 1}"]])
    held = standing(state, joint, log.training.group(row).use) & (np.abs(torque) <= HELD * coulomb)
    motor = Row("motor", joint)
    if motor in state.triangles.rows:
        here = held & log.training.group(motor).use
        if _linkward(torque * here, left["motor", joint] * here, log.observation.stretch):
            return nowhere
    return held


def _linkward(torque: Array, left: Array, stretch: NDArray[np.intp]) -> bool:
    """Whether what a motor's row leaves, (M,), is not the torque of an effect on the link, (M,): both 0 elsewhere."""
    power = float(torque @ torque)
    if power <= 0:
        return False
    share = float(left @ torque) / power
    scores = (left - share * torque) * torque
    deviation = float(np.sqrt(max(long_run(scores[:, None], stretch)[0, 0], 0.0))) / power
    return share + 2.0 * deviation < LINKWARD
