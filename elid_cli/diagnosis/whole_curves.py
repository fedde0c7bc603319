"""Whole friction curves: the terms that hide behind the one that the search has found.

Friction that falls and rises again (eq. 43) is a curve of two terms. Under sensor noise the search sees one of them:
the other differs from it by less than the noise of the smoothed accelerations. The collocation, which holds the
trajectory to the equations of motion, is far sharper. It is asked here, on the training stretches only, whether the
whole curve lets the log obey its model to within the noise, and the held-out stretches have to confirm it. Where a log
does not come near to its noise (a real robot, whose model lacks more than a term) nothing is said.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.accurate import LOWEST_SIGNAL, from_start, signal_to_noise, values_of, widening
from elid_cli.collocation import Iterate
from elid_cli.collocation_setup import Setup
from elid_cli.diagnosis.search import Found, Term
from elid_cli.diagnosis.state import Log, State, fit
from elid_cli.fitting import Fit, fit_log
from elid_cli.gauss_newton import Outcome, iterate
from elid_cli.identification import EstimateOptions
from elid_cli.model import Model
from elid_cli.recording import Segment
from elid_cli.robot import EffectSpec
from elid_cli.shape_scan import other_valleys
from elid_cli.signals import Signals
from elid_cli.terms.effect import Effect

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]
Shapes = tuple[tuple[float, ...], ...]

WORK = 120_000
"""Samples times the square of the joints up to which the collocation is run unasked."""
WITHIN_NOISE = 0.1
"""Cost beyond that of noise alone, as a part of it, up to which a log obeys its model."""
NEARLY, REST = 0.3, 0.3
"""The same, where no more than the second of what the terms alone leave beyond noise remains: splines round off the
jump of friction at every reversal, which no curve mends."""
ROUNDS = 2
"""Times that other valleys of the shapes are looked for."""
NET = 60.0
"""Gain in log-likelihood that the whole curve needs on the held-out stretches."""
SHOWN = 5.0
"""Standard errors, at the shapes that were found, by which the amplitude of a term must differ from 0."""
PINNED = 1e-3
"""Standard deviation of parameters that are held, in standard errors."""
STEPS = 12
LABEL = "collocation: whole friction curves"


@dataclass(frozen=True)
class _Collocated:
    """A collocation on the training stretches and how it fares on the held-out ones."""

    fit: Fit
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


def with_whole_curves(found: Found, declared: int, progress: Progress | None = None, *, asked: bool = False) -> Found:
    """Return the outcome of a search with friction curves completed where the log shows their other terms.

    Parameters
    ----------
    found
        What the search found.
    declared
        Number of effects that the robot file declares; they come first and are left alone.
    progress
        Called with a label and the finished part.
    asked
        Whether the user asked for it: else only logs that take little time are looked at.
    """
    state = found.after
    curves = {
        k: shapes
        for k, effect in enumerate(state.effects)
        if k >= declared and (shapes := type(effect).whole_curves(state.scene, effect.joint, effect.shape))
    }
    work = len(state.log.signals.motion.t) * state.log.model.robot.n**2
    if not curves or not (asked or work <= WORK) or not _possible(state.log):
        return found
    tell = progress or (lambda label, part: None)
    tell(LABEL, 0.0)
    alone = _collocated(state, state.effects, _known(state))
    while alone is not None and curves:
        tell(LABEL, 0.3)
        kept, whole = _best(state, alone, curves, lambda part: tell(LABEL, 0.3 + 0.7 * part))
        if whole is None or not _within(whole, alone) or 0.5 * (alone.cost - whole.cost) < NET:
            return found
        missing = _missing(whole, state, kept)
        if not missing:
            return _told(found, alone, whole, kept)
        curves = {k: shapes for k, shapes in curves.items() if k not in missing}
    return found


def _best(
    state: State, alone: _Collocated, curves: Mapping[int, tuple[Shapes, ...]], tell: Callable[[float], None]
) -> tuple[dict[int, Shapes], _Collocated | None]:
    """Return the curve of every joint, and the collocation with them: other forms only where the usual do not do."""
    kept = {k: shapes[0] for k, shapes in curves.items()}
    whole = _collocated(state, *_completed(state, kept), alone)
    others = [(k, shape) for k, shapes in curves.items() for shape in shapes[1:]]
    for number, (k, shape) in enumerate(others):
        if whole is not None and _within(whole, alone):
            break
        tell((number + 1) / (len(others) + 1))
        trial = _collocated(state, *_completed(state, {**kept, k: shape}), alone)
        if trial is not None and (whole is None or trial.training < whole.training):
            kept, whole = {**kept, k: shape}, trial
    return kept, whole


def _within(whole: _Collocated, alone: _Collocated) -> bool:
    """Whether whole curves let the training stretches obey the model to within their noise."""
    return whole.excess <= max(WITHIN_NOISE, min(NEARLY, REST * alone.excess))


def _possible(log: Log) -> bool:
    """Whether the raw log can be collocated as it stands: no channel moved in time, no torque sensor, enough signal."""
    raw = log.signals.recording is not None and not log.shifts and not np.any(log.tilt)
    independent = len(log.observation.independent) == len(log.observation.groups)
    return raw and independent and signal_to_noise(log.signals, log.model) > LOWEST_SIGNAL


def _known(state: State) -> list[EffectSpec]:
    names = state.log.model.robot.joint_names
    return [
        EffectSpec(e.name, None if e.whole_robot else names[e.joint], state.named(k))
        for k, e in enumerate(state.effects)
    ]


def _completed(state: State, curves: Mapping[int, Shapes]) -> tuple[list[Effect], list[EffectSpec]]:
    """Return the effects with whole curves, those found in their old places, and their descriptions to start from."""
    effects, specs = list(state.effects), _known(state)
    for k, shapes in curves.items():
        old = state.effects[k]
        kind, joint = type(old), state.log.model.robot.joint_names[old.joint]
        terms = [kind(old.joint, shape) for shape in shapes]
        described = [
            EffectSpec(old.name, joint, dict(zip((p.name for p in kind.shapes), shape, strict=True)))
            for shape in shapes
        ]
        effects[k], specs[k] = terms[0], described[0]
        effects += terms[1:]
        specs += described[1:]
    return effects, specs


def _collocated(
    state: State, effects: Sequence[Effect], specs: Sequence[EffectSpec], alone: _Collocated | None = None
) -> _Collocated | None:
    """Return the collocation of the training stretches with some effects, or None where it fails.

    With whole curves it starts from the trajectory of the terms `alone`, which is near the truth already.
    """
    log = state.log
    model = Model(replace(log.model.robot, effects=tuple(specs)))
    signals = _stretch(log, log.fold >= 0)
    fitted = fit_log(model, log.base, signals, EstimateOptions(offsets=False, guards=False))
    if fitted.effects is None or len(fitted.effects.effects) != len(effects):
        return None
    setup = Setup(fitted)
    if not setup.pieces:
        return None
    outcome = from_start(setup, setup.start)[1] if alone is None else _from_terms(setup, alone)
    if not np.isfinite(outcome.p).all() or not np.isfinite(outcome.covariance).all() or len(outcome.costs) < 2:
        return None
    training, noise = setup.common_cost(outcome.end), setup.noise_cost()
    judge = Setup(replace(fitted, signals=_stretch(log, log.fold < 0)))
    if not judge.pieces:
        return None
    factor = widening(signal_to_noise(signals, model))
    held_out = _predicted(judge, outcome)
    return _Collocated(fitted, setup, outcome, factor, training, training / noise - 1.0, held_out, judge.noise_cost())


def _from_terms(setup: Setup, alone: _Collocated) -> Outcome:
    """Return the collocation with whole curves, looked for in all shapes about the trajectory of the terms alone."""
    now = Iterate(alone.outcome.coefficients, setup.start.p.copy(), setup.z_start.copy())
    found: tuple[float, Outcome] | None = None
    for _ in range(ROUNDS):
        trials = [from_start(setup, start) for start in other_valleys(setup, now)]
        best = min(trials, key=lambda item: item[0], default=None)
        if best is None or (found is not None and not best[0] < found[0]):
            break
        found, now = best, best[1].end
    return (found or from_start(setup, setup.start))[1]


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
    return replace(signals, segments=tuple(parts))


def _predicted(judge: Setup, outcome: Outcome) -> float:
    """Return the cost of stretches on which only the trajectory is free, parameters and shapes as they were found."""
    held = np.concatenate([outcome.p, outcome.z])
    deviation = PINNED * np.sqrt(np.maximum(np.diag(outcome.covariance), 0.0))
    weight = 1.0 / np.maximum(deviation, 1e-9 * np.maximum(np.abs(held), 1e-9)) ** 2

    def pinned(now: Iterate) -> tuple[float, Array, Array]:
        away = np.concatenate([now.p, now.z]) - held
        return float(np.sum(weight * away**2)), np.diag(weight), weight * away

    start = Iterate(judge.start.coefficients, outcome.p.copy(), outcome.z.copy())
    end = iterate(judge.problem, start, pinned, STEPS).end
    return judge.common_cost(Iterate(end.coefficients, outcome.p, outcome.z))


def _amplitudes(whole: _Collocated) -> list[slice]:
    """Return where each effect's amplitudes stand in the columns of the fit."""
    place, found = whole.setup.first_amplitude, []
    for extra in whole.fit.effects.extras if whole.fit.effects else ():
        found.append(slice(place, place + extra.width))
        place += extra.width
    return found


def _missing(whole: _Collocated, state: State, curves: Mapping[int, Shapes]) -> set[int]:
    """Return the curves of which some term's amplitude does not differ from 0."""
    owners = [*range(len(state.effects)), *(k for k, shapes in curves.items() for _ in shapes[1:])]
    values, basis = values_of(whole.setup, whole.outcome), whole.fit.solution.basis
    size, covariance = len(whole.outcome.p), whole.outcome.covariance
    across = covariance[:size, size:]
    given = covariance[:size, :size] - across @ np.linalg.pinv(covariance[size:, size:], hermitian=True) @ across.T
    spread = whole.widened * np.sqrt(np.maximum(np.diag(given), 0.0))
    missing = set()
    for k, place in zip(owners, _amplitudes(whole), strict=True):
        if k not in curves:
            continue
        index = np.flatnonzero(np.isin(basis, np.arange(place.start, place.stop)))
        if len(index) == 0 or np.max(np.abs(values[basis[index]]) / np.maximum(spread[index], 1e-300)) < SHOWN:
            missing.add(k)
    return missing


def _told(found: Found, alone: _Collocated, whole: _Collocated, curves: Mapping[int, Shapes]) -> Found:
    """Return the outcome with the collocation's effects and values."""
    shapes = whole.setup.equations.final_effects(whole.outcome.z)
    if shapes is None:
        return found
    state = fit(found.after.log, [item.effect for item in shapes.effects], found.after.scene)
    values = values_of(whole.setup, whole.outcome)
    if [extra.rows.keys() for extra in state.nuisances] != [extra.rows.keys() for extra in whole.fit.nuisances]:
        return found  # a delay that the one fit finds and the other does not: rare, and not worth two truths
    solution = replace(state.solution, values=values)
    # values in the basis of the one solution, told in that of the other
    spread = np.zeros((len(values), len(solution.basis)))
    spread[solution.basis, np.arange(len(solution.basis))] = 1.0
    spread[solution.others] = solution.dependence.T
    turn = spread[whole.fit.solution.basis]
    size = len(whole.outcome.p)
    known = whole.widened**2 * turn.T @ whole.outcome.covariance[:size, :size] @ turn
    gain = (alone.cost - whole.cost) / max(alone.cost - whole.noise, alone.cost - whole.cost)
    term = Term(gain, 0.5 * (alone.cost - whole.cost))
    further = range(len(found.after.effects), len(state.effects))
    return replace(
        found,
        after=replace(state, solution=solution, known=known),
        terms=dict.fromkeys([*curves, *further], term),
    )
