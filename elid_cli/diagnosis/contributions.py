"""What every found effect is worth by itself: the held-out error of the rest without it and with it."""

from __future__ import annotations

from dataclasses import dataclass

from elid_cli.diagnosis.evidence.held_out import held_out_triangles
from elid_cli.diagnosis.fit.state import State, without
from elid_cli.diagnosis.result import Diagnosis, FoundEffect


@dataclass(frozen=True)
class Contribution:
    """Held-out error of one row group without an effect and with it, N·m (N); of the deflection in rad (m)."""

    effect: FoundEffect
    joint: str
    rows: str
    without: float
    with_it: float


def contributions(found: Diagnosis) -> tuple[Contribution, ...]:
    """Return, per effect and curve, the row group whose held-out error it lowers most."""
    state = found.state_after
    fitted = [e for e in (*found.effects, *found.curves) if e.deflection is None]
    first = len(state.effects) - len(fitted)
    seen = [_seen(effect) for effect in found.effects if effect.deflection is not None]
    return (*seen, *(_contribution(state, first + k, effect) for k, effect in enumerate(fitted)))


def _seen(effect: FoundEffect) -> Contribution:
    """Return what an effect seen in the positions takes from the deflection, rad."""
    outside, inside = effect.deflection or (float("nan"), float("nan"))
    return Contribution(effect, effect.joint or "", "deflection", outside, inside)


def _contribution(state: State, number: int, effect: FoundEffect) -> Contribution:
    lacking = without(state, number)
    outside, inside = held_out_triangles(lacking), held_out_triangles(state)
    present = [row for row in state.columns[number].rows if row in inside.rows]
    errors = {
        row: (outside.rms(lacking.solution.values, row), inside.rms(state.solution.values, row)) for row in present
    }
    row = min(errors, key=lambda r: errors[r][1] / max(errors[r][0], 1e-300))
    joint = state.log.model.robot.joint_names[row.joint]
    return Contribution(effect, joint, row.kind, *errors[row])
