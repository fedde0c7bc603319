"""Whether an effect explains most of what its rows lack, or only helps.

A log with something that no effect of the library is gives some effect a gain: a spring fits part of a stop that
yields, friction that fades with speed part of friction that builds up over a distance. Such a helper leaves most of it,
and what it leaves follows the motion. What is missing there is not known, and the helper's name would be a wrong one.
"""

from __future__ import annotations

from elid_cli.diagnosis.fit.state import State, without
from elid_cli.diagnosis.residuals import (
    HIGH,
    REVERSALS,
    came_in_bursts,
    followed_by,
    following,
    follows_motion,
    judged_rows,
    organise,
)
from elid_cli.diagnosis.search.acceptance import touched
from elid_cli.estimation.validation.following import LEAST as LEAST_SHARE
from elid_cli.estimation.validation.too_quiet import LEAST, MATTERS
from elid_cli.model.effects.relations import in_deflection
from elid_cli.model.regressor import EstimationRow

MOST = 0.5
"""Part of the held-out residual variance from which an effect explains most of it."""
NEARLY_ALL = 0.98
"""Part of what is beyond noise that an effect must take where the rest follows the same curves as the effect itself."""
MOST_STUCK = 0.9
"""The same where the motor sticks: near standstill that bends any curve, and is left of the right one as well."""
STICKS = 0.1
"""Part of what is left, beyond what as many other instants hold, near standstill: the motor sticks."""
LOUD = 3.0
"""Times its noise from which a row does not obey its model, and what takes it down is no fit of the noise."""
SAME = {"deflection": "load", "link speed": "motor speed"}
"""Groups of curves that are nearly those of another."""
PLACE = ("position",)
"""Curves by which what acts at a place is told from what acts at a time."""


def only_helps(state: State, number: int, gain: float) -> bool:
    """Whether effect `number`, of a gain, is no more than a help to something else that is missing.

    It is where it leaves more than it takes of a row, and that joint does not obey the model even so; where what it
    leaves follows the very curves that it follows itself, and is not small beside what it takes; and, of what acts for
    a moment, where the place predicts it from other times, and what it leaves as well: a stop that yields acts once in
    a log that comes there once.

    `gain` is the part of the held-out residual variance that the effect takes (`held_out_gain`); of what acts for a
    moment, which need not be one that is held out, it is taken from the stretches of the search. An effect is one of
    several where its rows come down to the noise with all of them. Faults between encoders are judged in the
    deflection, and must take most of their rows.
    """
    effect = state.effects[number]
    ratios, own, lacking = state.ratios(), state.columns[number].rows, without(state, number)
    rows = [row for row in touched(lacking, state, own) if row in own and ratios[row] > HIGH]
    between = in_deflection(effect, state.log.model.robot, effect.joint)
    if between:  # a late link bends other joints' equations too, but it is its own that show it
        rows = [row for row in rows if row.joint == effect.joint]
    if between and effect.in_deflection in ("position", "turn"):  # all else of it is little beside the spring's strain
        rows = [row for row in rows if row == state.log.observation.spring_row(effect.joint)]
    if effect.local:
        if any(_recurs(lacking, state, row) for row in rows):
            return True
    elif gain >= MOST and not between:
        return any(_fits_poorly(lacking, state, number, row) for row in rows)
    if effect.local or between:
        rows = [row for row in rows if not _takes(MOST, lacking, state, row)]
    joints = {row.joint for row in rows}
    rows += [row for row in judged_rows(state) if row.joint in joints and row not in rows and ratios[row] > HIGH]
    return any(follows_motion(state, row) or _sticks(state, row) for row in rows)


def _takes(part: float, lacking: State, state: State, row: EstimationRow) -> bool:
    """Whether an effect takes a part of what is beyond noise in a row, each over the noise of its own model.

    A fault between encoders changes the stiffness, and the noise with it.
    """
    before, after = lacking.ratios()[row] ** 2, state.ratios()[row] ** 2
    return before - after >= part * (before - 1.0)


def _recurs(lacking: State, state: State, row: EstimationRow) -> bool:
    """Whether what acts for a moment in a row, and what is left of it, is predicted by the place at other times."""
    if _takes(NEARLY_ALL, lacking, state, row) or not came_in_bursts(state, row):
        return False
    return followed_by(lacking, row, PLACE).beyond and followed_by(state, row, PLACE).share > LEAST_SHARE


def _fits_poorly(lacking: State, state: State, number: int, row: EstimationRow) -> bool:
    """Whether an effect leaves a part of a row, not small beside what it takes, that follows the curves it follows.

    The best curves of what is left count: what follows others is another effect's.
    """
    if _takes(NEARLY_ALL, lacking, state, row) or (_takes(MOST_STUCK, lacking, state, row) and _sticks(state, row)):
        return False
    left = followed_by(state, row)
    torque = state.coefficients(number) @ state.columns[number].rows[row]
    return left.beyond and _kind(left.groups[0]) in map(_kind, following(lacking, row, torque).groups)


def _kind(group: str) -> str:
    return SAME.get(group, group)


def silences(state: State, number: int) -> bool:
    """Whether effect `number` brings a row that obeys its model well below what its sensors' noise alone leaves.

    The noise of a row is believed as far as rows of its kind show it that the effect does not touch: where those are
    below it without any fault, it is taken for too large in this one as well. Motors that jump through a gap are no
    noise. A channel that is moved in time hides none either, nor do a load, gravity or transmissions that yield, whose
    torque follows from the motion of all joints together: they leave no row of their kind to ask.
    """
    effect = state.effects[number]
    if effect.corrects is not None or effect.whole_robot or effect.quasi_static:
        return False
    lacking, touching = without(state, number), state.columns[number].rows
    rows = state.triangles.rows
    ratios = {row: lacking.rms(row) / lacking.floor.rms[row] for row in rows if lacking.floor.rms[row] > 0}
    for row in touching:
        if row in ratios and state.floor.rms[row] > MATTERS * state.triangles.torque_rms(row):
            others = [value for other, value in ratios.items() if other.kind == row.kind and other not in touching]
            least = LEAST * min([1.0, *others])
            if state.rms(row) / state.floor.rms[row] < least <= ratios[row] < LOUD:
                return state.rms(row) < least * state.log.noise_alone.floor(state.standard).rms[row]
    return False


def _sticks(state: State, row: EstimationRow) -> bool:
    """Whether what a row leaves is a motor's sticking, which bends any friction curve."""
    return any(item.variable == REVERSALS and item.share > STICKS for item in organise(state, row))
