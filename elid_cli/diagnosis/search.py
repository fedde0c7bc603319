"""The search: forward steps with re-fit of everything, ambiguity kept as a set, backward pruning."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.diagnosis.screen import Candidate, score, screen
from elid_cli.diagnosis.state import Log, State, fit, refreshed
from elid_cli.effects import Declared, fit_declared
from elid_cli.reduction import Extra
from elid_cli.robot import EffectSpec
from elid_cli.terms.effect import Effect

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

NET = 12.0
"""Net log-likelihood an effect must gain."""
NET_AT_FLOOR = 60.0
"""The same when no row is above its floor: noise that enters columns imitates effects by up to 45."""
FLOOR_RATIO = 1.1
"""Residual over floor below which a row holds noise only."""
SMALLEST_DROP = 0.01
"""Least relative drop of some row's residual rms."""
SMALLEST_VARIANCE = 0.015
"""Least relative drop of some row's whitened variance, where the rms does not show it."""
SMALLEST_TORQUE = 3e-4
"""Least torque of an effect, as a part of the row's torque."""
NEAR = 10.0
"""Effects whose net gain is this near to the best cannot be told apart from it …"""
NEAR_SHARE = 0.01
"""… or whose gain differs by this part: then the form of the curve decides, which a log can only hint at."""
STEPS = 8


@dataclass(frozen=True)
class Step:
    """One accepted effect and what could not be told apart from it."""

    candidate: Candidate
    rivals: tuple[Candidate, ...]


@dataclass(frozen=True)
class Found:
    """Outcome of a search."""

    before: State
    after: State
    steps: tuple[Step, ...]
    remaining: tuple[Candidate, ...]
    """Best candidates that were not accepted, best first."""
    tried: int
    notes: tuple[str, ...] = field(default=())


def search(
    log: Log,
    declared: Sequence[Effect],
    library: Mapping[str, type[Effect]],
    progress: Progress | None = None,
) -> Found:
    """Search a log for effects that the model lacks.

    Parameters
    ----------
    log
        The log, divided in training and held-out stretches.
    declared
        Effects that the robot file already declares.
    library
        Effects to try.
    progress
        Called with a label and the finished part.
    """
    before = refreshed(fit(log, declared))
    state = before
    steps: list[Step] = []
    remaining: list[Candidate] = []
    tried = 0
    refused: set[tuple[str, int]] = set()
    for number in range(STEPS):
        candidates = screen(state, library, progress, f"screening, step {number + 1}")
        tried = max(tried, len(candidates))
        chosen = _choose(state, [c for c in candidates if c.key not in refused])
        remaining = candidates
        if chosen is None:
            break
        grown = refreshed(fit(log, (*state.effects, chosen.candidate.effect), state.scene))
        if not _worthwhile(state, grown, chosen.candidate):
            refused.add(chosen.candidate.key)
            if len(refused) > 3:
                break
            continue
        state = grown
        steps.append(chosen)
    state, steps = _pruned(state, steps, len(declared))
    state = _polished(state, len(declared))
    return Found(before, state, tuple(steps), tuple(remaining[:5]), tried)


def at_floor(state: State) -> bool:
    """Whether no row is above its noise floor."""
    return max(state.ratios().values()) < FLOOR_RATIO


def _choose(state: State, candidates: Sequence[Candidate]) -> Step | None:
    """Return the best supported candidate with its rivals, or None when nothing deserves a name."""
    threshold = NET_AT_FLOOR if at_floor(state) else NET
    able = [c for c in candidates if c.supported and c.net > threshold]
    if not able:
        return None
    best = able[0]
    margin = max(NEAR, NEAR_SHARE * best.net)
    rivals = tuple(c for c in able[1:] if c.net > best.net - margin)
    return Step(best, rivals)


def _worthwhile(old: State, new: State, candidate: Candidate) -> bool:
    """Whether the refitted model improves some row the effect acts on by a size that matters in practice."""
    for row in candidate.columns.rows:
        if row not in old.triangles.rows:
            continue
        before, after = old.rms(row), new.rms(row)
        gone = np.sqrt(max(before**2 - after**2, 0.0))
        if after < (1 - SMALLEST_DROP) * before and gone > SMALLEST_TORQUE * old.triangles.torque_rms(row):
            return True
    gained = candidate.gain.likelihood / max(candidate.gain.count, 1)
    torque = [
        float(np.sqrt(np.mean((candidate.gain.coefficients @ values) ** 2))) / old.triangles.torque_rms(row)
        for row, values in candidate.columns.rows.items()
        if row in old.triangles.rows
    ]
    return gained > 0.5 * SMALLEST_VARIANCE and max(torque, default=0.0) > SMALLEST_TORQUE


def _pruned(state: State, steps: list[Step], declared: int) -> tuple[State, list[Step]]:
    """Drop accepted effects that the others made unnecessary, the least needed first."""
    while len(steps) > 1:
        losses = []
        for k in range(len(steps)):
            others = [e for i, e in enumerate(state.effects) if i != declared + k]
            without = fit(state.log, others, state.scene)
            again = score(without, state.effects[declared + k], steps[k].candidate.shapes, 1)
            losses.append(-np.inf if again is None else again.net)
        worst = int(np.argmin(losses))
        if losses[worst] > NET:
            break
        kept = [e for i, e in enumerate(state.effects) if i != declared + worst]
        state = refreshed(fit(state.log, kept, state.scene))
        steps = [s for i, s in enumerate(steps) if i != worst]
    return state, steps


def _polished(state: State, declared: int) -> State:
    """Refine the shapes of all found effects together, and fit once more."""
    if not any(e.shape for e in state.effects):
        return state
    items = [Declared(EffectSpec(e.name, None), e) for e in state.effects]
    others: Sequence[Extra] = state.nuisances
    fitted = fit_declared(
        state.log.training, state.log.signals, state.scene, items, state.solution.weights, others, spread=0.5
    )
    effects = [item.effect for item in fitted.effects]
    polished = refreshed(fit(state.log, effects, state.scene))
    better = sum(polished.triangles.rms(polished.solution.values, r) / state.rms(r) for r in state.triangles.rows)
    return polished if better < len(state.triangles.rows) + 1e-9 else state


def with_rivals(step: Step, rivals: Sequence[Candidate]) -> Step:
    """Return the step with other rivals."""
    return replace(step, rivals=tuple(rivals))
