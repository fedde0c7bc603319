"""Screening: what every effect of the library, at every joint and shape, would gain."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.diagnosis.projected import Gain
from elid_cli.diagnosis.state import State
from elid_cli.effects import extra_of
from elid_cli.reduction import Extra
from elid_cli.terms.effect import Effect

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

FOLDS_NEEDED = 5
"""Folds of six in which an effect must help, unless it lives in a part of the log only."""
REFINED = 8
"""Best groups whose shapes are refined."""


@dataclass(frozen=True)
class Candidate:
    """An effect at one joint with its best shape."""

    effect: Effect
    columns: Extra
    gain: Gain
    net: float
    """Gain in log-likelihood minus the price of its parameters and of the search."""
    values: Mapping[str, float]
    plausible: bool
    shapes: int
    """Shapes that were tried."""

    @property
    def key(self) -> tuple[str, int]:
        """Effect name and joint."""
        return self.effect.name, self.effect.joint

    @property
    def folds_won(self) -> int:
        """Number of folds in which it helps."""
        return int(np.sum(self.gain.folds > 0))

    @property
    def supported(self) -> bool:
        """Whether data that did not fit it support it."""
        if self.effect.local:
            return self.plausible
        needed = min(FOLDS_NEEDED, len(self.gain.folds))
        return self.plausible and self.folds_won >= needed and float(np.sum(self.gain.folds)) > 0


def screen(
    state: State, library: Mapping[str, type[Effect]], progress: Progress | None = None, label: str = "screening"
) -> list[Candidate]:
    """Return one candidate per effect and joint, best first.

    Parameters
    ----------
    state
        The present model.
    library
        Effects to try.
    progress
        Called with `label` and the finished part, 0 to 1.
    label
        What is being done, for the progress.
    """
    groups = list(_groups(state, library))
    found = []
    for number, (kind, joint) in enumerate(groups):
        if progress is not None:
            progress(label, number / len(groups))
        candidate = _best_shape(state, kind, joint, len(groups))
        if candidate is not None:
            found.append(candidate)
    found.sort(key=lambda c: -c.net)
    refined = [refine(state, c, len(groups)) if c.effect.shape else c for c in found[:REFINED]]
    found[:REFINED] = refined
    found.sort(key=lambda c: -c.net)
    return found


def _groups(state: State, library: Mapping[str, type[Effect]]) -> Iterator[tuple[type[Effect], int]]:
    present = {(e.name, e.joint) for e in state.effects}
    for name, kind in library.items():
        for joint in range(state.log.model.robot.n):
            repeatable = bool(kind.shapes) and kind.place in ("motor", "spring", "link") and _periodic(kind)
            if kind.applies(state.log.model.robot, joint) and ((name, joint) not in present or repeatable):
                yield kind, joint


def _periodic(kind: type[Effect]) -> bool:
    return kind.shapes[0].name in ("harmonic", "periods", "order", "frequency")


def _best_shape(state: State, kind: type[Effect], joint: int, groups: int) -> Candidate | None:
    best: Candidate | None = None
    shapes = kind.grid(state.scene, joint)
    for shape in shapes:
        candidate = score(state, kind(joint, shape), len(shapes), groups)
        if candidate is None:
            continue
        better = best is None or (candidate.plausible, candidate.net) > (best.plausible, best.net)
        if better:
            best = candidate
    return best


def score(state: State, effect: Effect, shapes: int, groups: int) -> Candidate | None:
    """Return what an effect with a given shape gains, or None where the model explains it already."""
    columns = extra_of(effect, state.scene, state.log.signals)
    gain = state.projected.gain(columns.rows)
    if gain is None:
        return None
    free = gain.width + len(effect.shape)
    price = 0.5 * free * np.log(max(gain.count, 2)) + np.log(max(shapes, 1)) + np.log(groups)
    values = effect.named(state.scene, gain.coefficients)
    plausible = all(np.isfinite(v) for v in values.values() if isinstance(v, float)) and type(effect).plausible(
        state.scene, effect.joint, values
    )
    return Candidate(effect, columns, gain, gain.likelihood - float(price), values, plausible, shapes)


def refine(state: State, candidate: Candidate, groups: int) -> Candidate:
    """Return the candidate with its positive shapes refined by a bounded search around the grid's best."""
    from scipy.optimize import minimize, minimize_scalar

    kind, joint = type(candidate.effect), candidate.effect.joint
    start = np.array(candidate.effect.shape)
    free = np.array([s > 0 and not _whole(kind, k) for k, s in enumerate(start)])
    if not free.any():
        return candidate
    narrow = _periodic(kind)
    span = 0.08 if narrow else 0.7
    best = candidate

    def cost(logs: Array) -> float:
        nonlocal best
        shape = start.copy()
        shape[free] = start[free] * np.exp(np.clip(logs, -span, span))
        try:
            trial = score(state, kind(joint, tuple(shape)), candidate.shapes, groups)
        except (ValueError, FloatingPointError):
            return 0.0
        if trial is None:
            return 0.0
        if (trial.plausible, trial.net) > (best.plausible, best.net):
            best = trial
        return -trial.net

    if int(free.sum()) == 1:
        minimize_scalar(lambda z: cost(np.array([z])), bounds=(-span, span), method="bounded", options={"maxiter": 14})
    else:
        size = int(free.sum())
        simplex = np.vstack([np.zeros(size), 0.35 * span * np.eye(size)])
        minimize(cost, np.zeros(size), method="Nelder-Mead", options={"maxfev": 40, "initial_simplex": simplex})
    return best


def _whole(kind: type[Effect], number: int) -> bool:
    """Whether a shape is a choice (another joint's number, an exponent) and not to be refined."""
    return bool(getattr(kind.shapes[number], "fixed", False))


def rescored(state: State, candidates: Sequence[Candidate], groups: int) -> list[Candidate]:
    """Return candidates scored against another state, best first."""
    found = [score(state, c.effect, c.shapes, groups) for c in candidates]
    return sorted((replace(c) for c in found if c is not None), key=lambda c: -c.net)
