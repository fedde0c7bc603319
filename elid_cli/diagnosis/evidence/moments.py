"""Does what acts for a moment stand out; near standstill.

A joint that slows down into sticking, or creeps to rest at the end of a log, is held by a friction that no model has
exactly: anything between the Coulomb friction of one direction and that of the other. On a rigid joint a push on the
link is the same torque in the same row. Behind a spring it is not: friction stands in the motor's row, a push does not.

A push from outside happens once. Where the rest of the log holds residuals of the same size that nothing explains, the
moment is one of many, and a name for it alone would be a wrong one: a stop that is touched at every pass, a friction
that builds up at every reversal.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.state import State, without
from elid_cli.diagnosis.residuals import standing
from elid_cli.estimation.regression.covariance import long_run, residuals
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.parameter import StandardParameter

HELD = 2.0
"""Torque that friction may hold back near standstill, in units of Coulomb friction: from one direction to the other."""
MOVING = 0.5
"""Least part of what an effect explains that must not be friction near standstill."""
LINKWARD = 0.5
"""Part of an effect's torque that the motor's row may show, two standard deviations included, for it to be none of
the motor's friction."""


_Residuals = dict[tuple[str, int], Array]
"""Residual of every row, (M,)."""


def friction_at_rest(state: State, number: int) -> bool:
    """Whether friction near standstill could be most of what effect `number`, a push or load on links, explains."""
    if state.effects[number].place not in ("link", "chain"):
        return False
    explained = doubtful = 0.0
    for row, unit, before, after in _changes(state, number):
        use = state.log.training.group(row).use
        gone = np.where(use, before[row] ** 2 - after[row] ** 2, 0.0) / unit**2
        explained += float(gone.sum())
        doubtful += float(gone[use & _held(state, number, row, after)].sum())
    return explained > 0 and doubtful > (1.0 - MOVING) * explained


def _changes(state: State, number: int) -> Iterator[tuple[EstimationRow, float, _Residuals, _Residuals]]:
    """Yield every row that effect `number` acts on, its unit (its noise), and all residuals without and with it."""
    lacking = without(state, number)
    before = residuals(lacking.log.observation, lacking.solution.values, lacking.extras)
    after = residuals(state.log.observation, state.solution.values, state.extras)
    for row in state.columns[number].rows:
        if row in state.triangles.rows:
            yield row, max(state.floor.rms[row], 1e-4 * state.triangles.torque_rms(row)), before, after


def _held(state: State, number: int, row: EstimationRow, left: _Residuals) -> NDArray[np.bool_]:
    """Return the instants at which friction can be what an effect explains in a row, (M,)."""
    log, joint = state.log, row.joint
    nowhere = np.zeros(log.observation.instants, dtype=bool)
    if row.kind != "sum":  # a torque sensor behind the motor's friction reads none of it
        return nowhere
    torque = state.coefficients(number) @ state.columns[number].rows[row]
    coulomb = float(state.standard[log.model.index[StandardParameter("fs", joint)]])
    held = standing(state, joint, log.training.group(row).use) & (np.abs(torque) <= HELD * coulomb)
    motor = EstimationRow("motor", joint)
    if motor in state.triangles.rows:
        here = held & log.training.group(motor).use
        if _linkward(torque * here, left[motor] * here, log.observation.segment):
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


ACTS = 0.01
"""Part of its largest power from which an effect acts."""
MOMENT = 0.25
"""Part of the log up to which an effect is one of a moment."""
STANDS_OUT = 3.0
"""Ratio of its residual to that of any other moment of the same length."""


def acting(state: State, number: int) -> NDArray[np.bool_]:
    """Return the instants at which an effect acts, (M,)."""
    size = np.zeros(state.log.observation.instants)
    for row, values in state.columns[number].rows.items():
        power = np.sum(values**2, axis=0) * state.log.observation.group(row).use
        size = np.maximum(size, power / max(float(power.max(initial=0.0)), 1e-300))
    return size > ACTS


def one_of_many(state: State, number: int) -> bool:
    """Whether effect `number` takes from a moment what other moments hold unexplained, too."""
    inside = acting(state, number)
    length = int(np.count_nonzero(inside))
    if not 0 < length < MOMENT * len(inside):
        return False
    ratios = []
    for row, unit, before, after in _changes(state, number):
        use = state.log.observation.group(row).use
        own = float(np.sqrt(np.mean(np.square(before[row][inside & use])))) if (inside & use).any() else 0.0
        others = _windows(np.square(after[row]), use & ~inside, length)
        ratios.append(own / max(float(np.sqrt(others)), unit))
    return bool(ratios) and max(ratios) < STANDS_OUT


def _windows(squares: Array, use: NDArray[np.bool_], length: int) -> float:
    """Return the largest mean of squares over windows of `length` instants that are used at least by half."""
    window = np.ones(length)
    count = np.convolve(use.astype(float), window, mode="valid")
    total = np.convolve(np.where(use, squares, 0.0), window, mode="valid")
    full = count >= 0.5 * length
    return float(np.max(total[full] / count[full], initial=0.0))
