"""Whether an effect explains most of what its rows lack, or only helps.

A log with something that no effect of the library is gives some effect a gain: a spring fits part of a stop that
yields, friction that fades with speed part of friction that builds up over a distance. Such a helper leaves most of it,
and what it leaves follows the motion. What is missing there is not known, and the helper's name would be a wrong one.
"""

from __future__ import annotations

from elid_cli.diagnosis.fit.state import State, without
from elid_cli.diagnosis.residuals import HIGH, REVERSALS, follows_motion, organise
from elid_cli.diagnosis.search.acceptance import touched
from elid_cli.estimation.validation.too_quiet import LEAST, MATTERS
from elid_cli.model.regressor import EstimationRow

MOST = 0.5
"""Part of the held-out residual variance from which an effect explains most of it."""
STICKS = 0.1
"""Part of what is left, beyond what as many other instants hold, near standstill: the motor sticks."""


def only_helps(state: State, number: int, gain: float) -> bool:
    """Whether effect `number`, of a gain, leaves more than it takes of a row that does not obey the model even so.

    `gain` is the part of the held-out residual variance that the effect takes (`held_out_gain`); of what acts for a
    moment, which need not be one that is held out, it is taken from the stretches of the search. An effect is one of
    several where its rows come down to the noise with all of them. Faults between encoders are judged in the
    deflection.
    """
    effect = state.effects[number]
    if effect.in_deflection or (gain >= MOST and not effect.local):
        return False
    ratios, own, lacking = state.ratios(), state.columns[number].rows, without(state, number)
    rows = [row for row in touched(lacking, state, own) if row in own and ratios[row] > HIGH]
    if effect.local:
        rows = [row for row in rows if state.rms(row) ** 2 > (1.0 - MOST) * lacking.rms(row) ** 2]
    return any(follows_motion(state, row) or _sticks(state, row) for row in rows)


def silences(state: State, number: int) -> bool:
    """Whether effect `number` brings a row that obeys its model well below what its sensors' noise alone leaves.

    The noise of a row is believed as far as rows of its kind show it that the effect does not touch: where those are
    below it without any fault, it is taken for too large in this one as well.
    """
    lacking, touching = without(state, number), state.columns[number].rows
    rows = state.triangles.rows
    ratios = {row: lacking.rms(row) / lacking.floor.rms[row] for row in rows if lacking.floor.rms[row] > 0}
    for row in touching:
        if row in ratios and state.floor.rms[row] > MATTERS * state.triangles.torque_rms(row):
            others = [value for other, value in ratios.items() if other.kind == row.kind and other not in touching]
            least = LEAST * min([1.0, *others])
            if state.rms(row) / state.floor.rms[row] < least <= ratios[row]:
                return True
    return False


def _sticks(state: State, row: EstimationRow) -> bool:
    """Whether what a row leaves is a motor's sticking, which bends any friction curve."""
    return any(item.variable == REVERSALS and item.share > STICKS for item in organise(state, row))
