"""Models before and after as identifications; what each effect is worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from elid_cli.diagnosis.evidence.held_out import held_out_triangles
from elid_cli.diagnosis.fit.state import State, without
from elid_cli.diagnosis.result import Diagnosis, FoundEffect
from elid_cli.diagnosis.stiffness_by_load import with_load
from elid_cli.estimation.assembly import assemble, judged
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.regression.standard_errors import covariance_of
from elid_cli.estimation.result import EstimateOptions, FittedEffect, Identification, JointError
from elid_cli.estimation.stretches import STRETCHES


def identified(state: State, error: Mapping[str, JointError], declared: int = 0) -> Identification:
    """Return what a state's fit to the training stretches says about the base parameters.

    Parameters
    ----------
    state
        The model before or after.
    error
        Its error on the held-out stretches.
    declared
        How many of the state's effects, the first ones, the robot file declares.
    """
    log = state.log
    options = EstimateOptions(folds=STRETCHES, offsets=False)
    data, triangles, solution = log.data, state.triangles, state.solution
    if state.known is not None:  # a collocation holds the trajectory to the equations: its deflections are no noise
        fit = DefaultFit(log.base, data, state.nuisances, None, triangles, solution, state.known)
        found = assemble(fit, options)
    else:
        covariance = covariance_of(data, state.extras, None, triangles, solution)
        fit = DefaultFit(log.base, data, state.nuisances, None, triangles, solution, covariance)
        _, _, found = judged(fit, options)
    whole = {"instants": log.observation.instants, "masked": [float(share) for share in log.observation.masked]}
    names = log.model.robot.joint_names
    effects = tuple(
        FittedEffect(e.name, None if e.whole_robot else names[e.joint], state.named(k), {})
        for k, e in enumerate(state.effects[:declared])
    )
    found = replace(found, error=error, settings={**found.settings, **whole}, effects=effects)
    return with_load(found, state)


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
