"""Whether an effect is worth its parameters: what it takes from folds that were left out, and whether that matters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from elid_cli.diagnosis.fit.state import State
from elid_cli.diagnosis.search.candidate import FOLDS_LOST, Candidate
from elid_cli.diagnosis.search.event_times import INSTANT
from elid_cli.diagnosis.search.screening import sensible
from elid_cli.estimation.stretches import STRETCHES
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.parameter import StandardParameter

FLOOR_RATIO = 1.1
"""Residual over floor below which a row holds noise only."""
SMALLEST_DROP = 0.01
"""Least relative drop of some row's residual rms."""
SMALLEST_VARIANCE = 0.015
"""Least relative drop of some row's whitened variance, where the rms does not show it."""
SMALLEST_TORQUE = 3e-4
"""Least torque of an effect, as a part of the row's torque."""
SMALLEST_FRICTION = 0.03
"""The same for friction, as a part of the joint's friction: a robot may carry a hundred times what it loses."""
ELSEWHERE = 0.05
"""Relative drop of a residual from which an effect counts as helping a row that it does not act on."""
MOST_ELSEWHERE = 0.5
"""Part of the squared residual that an effect must take from other rows where its own hold nothing but noise."""
MUCH_LEFT = 5.0
"""Ratio to the floor from which what is left in such a row is another matter than the effect's."""


def is_change(effect: Effect) -> bool:
    """Whether an effect acts from an instant on: one fold may hold nearly all of the log before it, or after."""
    return effect.local and any(shape.name == INSTANT for shape in effect.shapes)


def predicted_better(old: State, new: State, rows: Sequence[EstimationRow], *, change: bool = False) -> float | None:
    """Return by which part the error of left-out folds falls, or None unless it falls in nearly every fold.

    Both models are fitted anew without each fold; rows count in units of their present residual. Of a `change`, one
    fold that is predicted worse does not count: without it nothing may tell what was before, and by how much that is
    then missed says nothing.
    """
    before, after = np.zeros(STRETCHES), np.zeros(STRETCHES)
    for row in rows:
        if row in old.triangles.rows:
            unit = old.rms(row) ** -2 if old.rms(row) > 0 else 0.0
            before += unit * old.left_out[row]
            after += unit * new.left_out[row]
    live = before > 0
    lost = live & (after >= before)
    if change and np.count_nonzero(lost) == 1:
        before[lost], after[lost] = 0.0, 0.0
    won = int(np.sum(after[live] < before[live]))
    if won < max(int(live.sum()) - FOLDS_LOST, 1) or after.sum() >= before.sum():
        return None
    return float(1.0 - after.sum() / before.sum())


def left_out_error(state: State, unit: State, rows: Sequence[EstimationRow]) -> float:
    """Return the squared error of left-out folds in some rows, each in units of its residual in another state."""
    return sum(float(state.left_out[row].sum()) / max(unit.rms(row), 1e-300) ** 2 for row in rows)


def left_behind(state: State, other: State) -> float:
    """Return by how much log-likelihood another model explains the log worse, independent equations alone counted."""
    counts = {row: float(np.count_nonzero(state.log.training.group(row).use)) for row in state.triangles.rows}
    ratios = {row: max(other.rms(row), 1e-300) / max(state.rms(row), 1e-300) for row in counts}
    worse = sum(count * float(np.log(ratios[row])) for row, count in counts.items())
    return state.projected.independent * worse


def worthwhile(old: State, new: State, candidate: Candidate) -> bool:
    """Whether the refitted model improves some row the effect acts on by a size that matters in practice."""
    last = len(new.effects) - 1
    if not sensible(new.effects[last], new.scene, new.named(last)) or not new.impossible <= old.impossible:
        return False
    judged = not candidate.effect.local or bool(candidate.gain.acting.all())
    rows = touched(old, new, candidate.columns.rows)
    if judged and predicted_better(old, new, rows, change=is_change(candidate.effect)) is None:
        return False
    if _strays(old, new, candidate, rows):
        return False
    if any(improves(old, new, row, candidate.effect) for row in rows):
        return True
    gained = candidate.gain.likelihood / max(candidate.gain.count, 1)
    torque = [
        float(np.sqrt(np.mean((candidate.gain.coefficients @ values) ** 2))) / _least_torque(old, row, candidate.effect)
        for row, values in candidate.columns.rows.items()
        if row in old.triangles.rows
    ]
    return gained > 0.5 * SMALLEST_VARIANCE and max(torque, default=0.0) > 1.0


def _strays(old: State, new: State, candidate: Candidate, rows: Sequence[EstimationRow]) -> bool:
    """Whether an effect is nothing but a help to unexplained rows elsewhere, of which it leaves the most.

    A gain of one joint's torque shows in other joints alone, and explains all that is wrong there. What does not, while
    its own rows hold noise only, bends parameters that joints share towards something else.
    """
    before, after = old.ratios(), new.ratios()
    own = [row for row in candidate.columns.rows if row in before]
    helped = [row for row in rows if row not in own and before[row] >= FLOOR_RATIO]
    if not helped or any(before[row] >= FLOOR_RATIO for row in own):
        return False
    if min(after[row] for row in helped) < MUCH_LEFT:
        return False
    # of what is there beyond noise
    beyond = {row: old.rms(row) ** 2 * (1.0 - before[row] ** -2) for row in helped}
    return not any(old.rms(row) ** 2 - new.rms(row) ** 2 > MOST_ELSEWHERE * beyond[row] for row in helped)


def touched(old: State, new: State, own: Iterable[EstimationRow]) -> list[EstimationRow]:
    """Return the rows that an effect acts on and those that it helps elsewhere, through parameters that rows share.

    A gain of one joint's torque scales that joint's parameters until its own rows fit; what does not fit then is the
    joints that share the bodies with it.
    """
    rows = [row for row in own if row in old.triangles.rows]
    before, after = old.ratios(), new.ratios()
    # a row that holds noise only, with and without the effect, has nothing to say about it
    rows = [r for r in rows if max(before[r], after[r]) >= FLOOR_RATIO] or rows
    return rows + [r for r in old.triangles.rows if r not in rows and new.rms(r) < (1 - ELSEWHERE) * old.rms(r)]


def improves(old: State, new: State, row: EstimationRow, effect: Effect | None = None) -> bool:
    """Whether a row group's residual falls by a part of itself and of the torque (of the friction) that matters."""
    if row not in old.triangles.rows:
        return False
    before, after = old.rms(row), new.rms(row)
    gone = np.sqrt(max(before**2 - after**2, 0.0))
    return after < (1 - SMALLEST_DROP) * before and bool(gone > _least_torque(old, row, effect))


def _least_torque(state: State, row: EstimationRow, effect: Effect | None) -> float:
    """Return the torque below which an effect does not matter: of the row's, for friction of the joint's friction."""
    least = SMALLEST_TORQUE * state.triangles.torque_rms(row)
    if effect is None or effect.place != "motor":
        return least
    model, joint = state.log.model, effect.joint
    coulomb, viscous = (float(state.standard[model.index[StandardParameter(kind, joint)]]) for kind in ("fs", "fv"))
    speed = state.scene.motion.dtheta[:, joint]
    friction = float(np.sqrt(np.mean((coulomb * np.sign(speed) + viscous * speed) ** 2)))
    return min(least, SMALLEST_FRICTION * friction) if friction > 0 else least
