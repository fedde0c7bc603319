"""Smooth curves over the variable that a row's residual follows most, for structure that no named effect explains."""

from __future__ import annotations

from elid_cli.diagnosis.fit.state import State, fit
from elid_cli.diagnosis.residuals import HIGH
from elid_cli.diagnosis.search.acceptance import predicted_better
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.screening import score
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.kinds import CurveEffect, CurveRows
from elid_cli.model.regressor import EstimationRow, Kind

MOST = 3
"""Curves in one model."""
NET = 12.0
"""Net log-likelihood that a curve must gain."""
FITTED = 3
"""Best curves that are fitted and judged."""


def best_curve(state: State) -> Effect | None:
    """Return the curve that explains most of what is left above the floor, or None where none is supported.

    Every joint with a row above its floor is tried with every variable, in the rows where its residual sits; the best
    ones are fitted, and must predict the folds from one another.
    """
    robot = state.log.model.robot
    kinds = [kind for kind in effect_classes().values() if issubclass(kind, CurveEffect)]
    choices = [(kind, variable) for kind in kinds for variable in kind.variables]
    found: list[Candidate] = []
    for joint in range(robot.n):
        rows = residual_rows(state, joint)
        for kind, variable in choices if rows is not None else ():
            assert rows is not None
            curve = kind.over(state.scene, joint, variable, rows)
            candidate = None if curve is None else score(state, curve, 1, len(choices) * robot.n)
            if candidate is not None and candidate.net > NET:
                found.append(candidate)
    for candidate in sorted(found, key=lambda c: -c.net)[:FITTED]:
        grown = fit(state.log, (*state.effects, candidate.effect), state.scene)
        if predicted_better(state, grown, list(candidate.columns.rows)) is not None:
            return candidate.effect
    return None


def residual_rows(state: State, joint: int) -> CurveRows | None:
    """Return where the residual of a joint sits, or None where all its rows are at their floors."""
    ratios = state.ratios()
    if EstimationRow("spring", joint) in ratios:
        sides: tuple[tuple[Kind, CurveRows], ...] = (("drive", "motor"), ("spring", "transmission"), ("load", "link"))
        level, where = max((ratios.get(EstimationRow(kind, joint), 0.0), name) for kind, name in sides)
        return where if level > HIGH else None
    total, motor = ratios.get(EstimationRow("sum", joint), 0.0), ratios.get(EstimationRow("motor", joint))
    if motor is None or (motor > HIGH and total > HIGH):
        return "motor" if total > HIGH else None
    if motor > HIGH:
        return "transmission"
    return "link" if total > HIGH else None
