"""Collocation of the training stretches of a diagnosis, judged on the held-out ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.state import State
from elid_cli.errors import DataError
from elid_cli.estimation.collocation.estimator import LOWEST_SIGNAL
from elid_cli.estimation.collocation.gauss_newton import Outcome, follow
from elid_cli.estimation.collocation.knots import widening
from elid_cli.estimation.collocation.problem import Iterate
from elid_cli.estimation.collocation.setup import Setup, signal_to_noise
from elid_cli.estimation.collocation.starts import from_start, other_valleys
from elid_cli.estimation.default_fit import DefaultFit, fit_log
from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.estimation.regression.scene_with_effects import with_found
from elid_cli.estimation.result import EstimateOptions
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import Signals

FITTING, STEPS = 16, 12
ROUNDS = 2
"""Times that other valleys of the shapes are looked for."""


@dataclass(frozen=True)
class Collocated:
    """A collocation on the training stretches and how it fares on the held-out ones."""

    fit: DefaultFit
    setup: Setup
    outcome: Outcome
    widened: float
    training: float
    """Cost on the training stretches."""
    excess: float
    """Cost there beyond that of noise alone, as a part of it."""
    cost: float
    """Cost on the held-out stretches."""
    noise: float
    """Cost there of noise alone."""


def possible(log: Log) -> bool:
    """Whether the raw log can be collocated as it stands: no channel moved in time, no torque sensor, enough signal."""
    raw = log.signals.recording is not None and not log.shifts and not log.pose
    independent = len(log.observation.independent) == len(log.observation.groups)
    return raw and independent and signal_to_noise(log.signals, log.model) > LOWEST_SIGNAL


def collocated(
    state: State, effects: Sequence[Effect], specs: Sequence[EffectSpec], alone: Collocated | None = None
) -> Collocated | None:
    """Return the collocation of the training stretches with some effects, or None where it fails.

    With whole curves it starts from the trajectory of the terms `alone`, which is near the truth already.
    """
    try:
        return _collocated(state, effects, specs, alone)
    except (DataError, np.linalg.LinAlgError):  # stretches too short, or a log that the problem cannot hold
        return None


def _collocated(
    state: State, effects: Sequence[Effect], specs: Sequence[EffectSpec], alone: Collocated | None = None
) -> Collocated | None:
    log = state.log
    model = Regressor(replace(log.model.robot, effects=tuple(specs)))
    signals = _stretch(log, log.fold >= 0)
    # what the search found is in its valley; those of whole curves are looked for about the trajectory
    options = EstimateOptions(offsets=bool(state.offsets), valleys=False, guards=False)
    fitted = fit_log(model, log.base, signals, options)
    if fitted.effects is None or len(fitted.effects.effects) != len(effects):
        return None
    setup = Setup(fitted)
    if not setup.pieces:
        return None
    # of the terms alone nothing but the trajectory and the cost is wanted
    outcome = from_start(setup, setup.start, FITTING, roughly=True) if alone is None else _from_terms(setup, alone)
    if not np.isfinite(outcome.p).all() or not np.isfinite(outcome.covariance).all() or len(outcome.costs) < 2:
        return None
    training, noise = setup.common_cost(outcome.end), setup.noise_cost()
    # columns that come from torques must come from those of the stretches that are judged
    left = _stretch(log, log.fold < 0)
    rotors = fitted.effects.scene.rotors
    scene = scene_of(model, left, fitted.solution.values[: model.parameters], rotors)
    scene = with_found(scene, list(zip((e.effect for e in fitted.effects.effects), fitted.amplitudes(), strict=True)))
    held_back = replace(fitted.samples, signals=left)
    judge = Setup(replace(fitted, data=held_back, effects=replace(fitted.effects, scene=scene)))
    if not judge.pieces:
        return None
    factor = widening(signal_to_noise(signals, model))
    held_out = _predicted(judge, outcome)
    return Collocated(fitted, setup, outcome, factor, training, training / noise - 1.0, held_out, judge.noise_cost())


def _from_terms(setup: Setup, alone: Collocated) -> Outcome:
    """Return the collocation with whole curves, looked for in all shapes about the trajectory of the terms alone."""
    now = Iterate(alone.outcome.coefficients, setup.start.p.copy(), setup.z_start.copy())
    found: tuple[float, Outcome] | None = None
    for _ in range(ROUNDS):
        trials = [from_start(setup, start, FITTING) for start in other_valleys(setup, now)]
        costs = [setup.common_cost(trial.end) for trial in trials]
        if not trials or (found is not None and not min(costs) < found[0]):
            break
        found = min(costs), trials[int(np.argmin(costs))]
        now = found[1].end
    return from_start(setup, setup.start, FITTING) if found is None else found[1]


def _stretch(log: Log, chosen: NDArray[np.bool_]) -> Signals:
    """Return the signals of chosen instants only, (M,)."""
    signals = log.signals
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    spans = [(int(signals.outputs[a]), int(signals.outputs[b - 1]) + 1) for a, b in edges.reshape(-1, 2)]
    parts = [
        Segment(max(a, s.start), min(b, s.stop), s.source)
        for a, b in spans
        for s in signals.segments
        if min(b, s.stop) - max(a, s.start) > 2 * signals.filter.half + 2 * signals.filter.step
    ]
    # the motion is an unknown there, and torques must change smoothly with it
    return replace(signals, segments=tuple(parts), rounded=True)


def _predicted(judge: Setup, outcome: Outcome) -> float:
    """Return the cost of stretches on which only the trajectory is free, parameters and shapes as they were found."""
    start = Iterate(judge.start.coefficients, outcome.p, outcome.z)
    return judge.common_cost(follow(judge.problem, start, STEPS))
