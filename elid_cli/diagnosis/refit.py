"""The model before or after a diagnosis as an identification: base parameters with errors, verdicts and classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from elid_cli.diagnosis.fit.state import State
from elid_cli.diagnosis.fit.stretches import FOLDS
from elid_cli.diagnosis.stiffness_by_load import with_load
from elid_cli.estimation.identify import Fit, assemble
from elid_cli.estimation.result import EstimateOptions, FittedEffect, Identification, JointError
from elid_cli.estimation.stiffness.noise import deflections_noise, with_pull


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
    fit = Fit(
        log.model,
        log.base,
        log.signals,
        log.training,
        state.nuisances,
        None,
        state.triangles,
        state.solution,
        state.covariance,
    )
    if state.known is None:  # a collocation holds the trajectory to the equations: its deflections are no noise
        noise = deflections_noise(fit)
        fit = replace(fit, covariance=with_pull(fit.model, fit.triangles, fit.solution, fit.covariance, noise))
    found = assemble(fit, EstimateOptions(folds=FOLDS, offsets=False))
    whole = {"instants": log.observation.instants, "masked": [float(share) for share in log.observation.masked]}
    names = log.model.robot.joint_names
    effects = tuple(
        FittedEffect(e.name, None if e.whole_robot else names[e.joint], state.named(k), {})
        for k, e in enumerate(state.effects[:declared])
    )
    found = replace(found, error=error, settings={**found.settings, **whole}, effects=effects)
    return with_load(found, state)
