"""Screening: what every effect of the library, at every joint and shape, would gain."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array, Progress
from elid_cli.diagnosis.fit.gain import JUDGED, Gain, settled
from elid_cli.diagnosis.fit.state import State, fit, refreshed
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.side_by_side import side_by_side
from elid_cli.estimation.regression.effect_columns import extra_of, scene_of
from elid_cli.estimation.regression.known_columns import Fresh
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene

REFINED = 8
"""Best groups whose shapes are refined."""
FORMS = 3
"""Most forms of an effect (exponents, partners) whose shapes are refined."""
NEXT = 1.25
"""Factor between a shape and the next one that is looked at beyond what is plausible."""
REFITTED = 12
"""Best groups whose values are taken from a full fit where the stiffness matters."""


def screen(
    state: State, library: Mapping[str, type[Effect]], jobs: int = 1, joints: Container[int] | None = None
) -> list[Candidate]:
    """Return one candidate per effect and joint, best first (`best_of`)."""
    return best_of(state, library, jobs=jobs, joints=joints, least=-np.inf)[0]


def best_of(
    state: State,
    library: Mapping[str, type[Effect]],
    progress: Progress | None = None,
    label: str = "screening",
    jobs: int = 1,
    joints: Container[int] | None = None,
    least: float = 0.0,
) -> tuple[list[Candidate], int]:
    """Return the candidates, one per effect and joint, that may gain more than `least`, best first, and their number.

    The number is that of all; the best `REFITTED` are returned whatever they gain.

    Parameters
    ----------
    state
        The present model.
    library
        Effects to try.
    progress
        Called with `label`, effect and joint, and the finished part, 0 to 1.
    label
        What is being done, for the progress.
    jobs
        Processes that try effects side by side; the result is the same for any number.
    joints
        Joints at which effects are tried, besides those of the whole robot; None: all.
    least
        Net gain.
    """
    groups = [
        (kind, joint)
        for kind, joint in _groups(state, library)
        if joints is None or kind.whole_robot or joint in joints
    ]
    known = state.log.columns
    # joint by joint: columns that act in the same rows are whitened and projected together
    order = sorted(range(len(groups)), key=lambda k: groups[k][1])
    parts = [order[first : first + JUDGED] for first in range(0, len(order), JUDGED)]
    if not groups:
        return [], 0
    state.projected.prepared()  # what all parts share must be there before they part

    def tried(number: int) -> tuple[list[tuple[int, Candidate]], Fresh]:
        if progress is not None:
            kind, joint = groups[parts[number][0]]
            name = state.log.model.robot.joint_names[joint]
            progress(f"{label}, {kind.name.replace('_', ' ')} at {name}", number / len(parts))
        with known.fresh() as fresh:
            best = zip(parts[number], _best_shapes(state, [groups[k] for k in parts[number]], len(groups)), strict=True)
            return [(k, replace(c, gain=replace(c.gain, source=None))) for k, c in best if c is not None], fresh

    numbered: list[tuple[int, Candidate]] = []
    for candidates, fresh in side_by_side(tried, len(parts), jobs):
        known.learn(fresh)
        numbered += candidates
    count = len(numbered)
    waiting = [
        replace(c, gain=replace(c.gain, source=(state.projected, c.columns.rows)))
        for _, c in sorted(numbered, key=lambda item: item[0])
    ]
    waiting.sort(key=lambda c: c.most)
    found = _judged([], waiting, least)
    best = found[:REFINED]
    found[:REFINED] = side_by_side(
        lambda k: refine(state, best[k], len(groups)) if best[k].effect.shape else best[k], len(best), jobs
    )
    found = _judged(found, waiting, least)
    high = found[:REFITTED]
    found[:REFITTED] = side_by_side(lambda k: _fitted(state, high[k]), len(high), jobs)
    return sorted(found, key=lambda c: -c.net), count


def _judged(found: list[Candidate], waiting: list[Candidate], least: float) -> list[Candidate]:
    """Return candidates by their net gain, with those that wait, most last, as far as they may be among the best."""
    while waiting:
        most = waiting[-1].most
        if most <= least and sum(c.net >= most for c in found) >= REFITTED:
            break
        found = [*found, *_settled(waiting[-JUDGED:])]
        del waiting[-JUDGED:]
    return sorted(found, key=lambda c: -c.net)


def _fitted(state: State, candidate: Candidate) -> Candidate:
    """Return the candidate with what only a fit tells of it, where its columns at the present model do not."""
    if candidate.effect.turns_gravity:
        return _leaning(state, candidate)
    return refitted(state, candidate) if candidate.effect.place in ("spring", "encoder") else candidate


def _leaning(state: State, candidate: Candidate) -> Candidate:
    """Return a tilt of the base with the torque that it has for the parameters of a model that leans so.

    On level ground some first moments never show. What a tilt makes of them may be most of its torque, and the present
    parameters know nothing of it; each of them is a parameter that the tilt costs.
    """
    log, effect = state.log, candidate.effect
    grown = refreshed(fit(log, (*state.effects, effect), state.scene, but=state.but))
    values = grown.named(len(grown.effects) - 1)
    scene = scene_of(log.model, log.signals, grown.standard, grown.scene.rotors)
    columns = extra_of(effect, scene, log.signals)
    gain = state.projected.gain(columns.rows)
    if gain is None or not sensible(effect, grown.scene, values):
        return candidate
    (gain,) = settled([gain])
    shown = max(grown.log.base.count - log.base.count, 0)
    choice = candidate.choice + 0.5 * shown * float(np.log(max(gain.count * gain.share, 2.0)))
    leaning = replace(candidate, columns=columns, gain=gain, choice=choice, values=values, plausible=True)
    return max(candidate, leaning, key=lambda c: (c.supported, c.net))


def refitted(state: State, candidate: Candidate) -> Candidate:
    """Return the candidate with its values taken from a fit that includes it.

    What an effect of the spring path means in physical units depends on the stiffness, which the effect's absence
    may have falsified.
    """
    grown = fit(state.log, (*state.effects, candidate.effect), state.scene)
    again = scene_of(state.log.model, state.log.signals, grown.standard, grown.scene.rotors)
    values = candidate.effect.named(again, grown.coefficients(len(grown.effects) - 1))
    return replace(candidate, values=values, plausible=sensible(candidate.effect, again, values))


def sensible(effect: Effect, scene: Scene, values: Mapping[str, float]) -> bool:
    """Whether an effect's values are finite and physically possible."""
    finite = all(np.isfinite(v) for v in values.values() if isinstance(v, (int, float)))
    return finite and type(effect).plausible(scene, effect.joint, values)


def _groups(state: State, library: Mapping[str, type[Effect]]) -> Iterator[tuple[type[Effect], int]]:
    for kind in library.values():
        if kind.quasi_static and any(type(effect) is kind for effect in state.effects):
            continue  # all joints that can have it come together (`at_all_joints`)
        for joint in range(state.log.model.robot.n):
            if kind.applies(state.log.model.robot, joint):
                yield kind, joint


def _settled(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates with everything computed that their columns are needed for."""
    gains = settled([candidate.gain for candidate in candidates])
    return [replace(candidate, gain=gain) for candidate, gain in zip(candidates, gains, strict=True)]


def _best_shapes(state: State, places: Sequence[tuple[type[Effect], int]], groups: int) -> list[Candidate | None]:
    """Return the best shape of every effect at its joint; None where the model explains it already."""
    tried = []
    for kind, joint in places:
        present = [e.shape for e in state.effects if (e.name, e.joint) == (kind.name, joint)]
        shapes = [s for s in kind.grid(state.scene, joint) if kind.distinct(state.scene, joint, s, present)]
        tried.append([kind(joint, shape) for shape in shapes])
    columns = [state.log.columns.of(effect, state.scene) for effects in tried for effect in effects]
    gains = state.projected.gains([extra.rows for extra in columns])
    scored, found = zip(columns, gains, strict=True), list[Candidate | None]()
    for (kind, joint), effects in zip(places, tried, strict=True):
        looks = kind.looks(state.scene, joint)
        best: dict[tuple[float, ...], Candidate] = {}
        for effect, (extra, gain) in zip(effects, scored, strict=False):
            if gain is None:
                continue
            candidate = _candidate(state, effect, extra, gain, looks, groups)
            form = form_of(effect)
            if form not in best or candidate.rank > best[form].rank:
                best[form] = candidate
        order = sorted(best.values(), key=lambda c: c.rank, reverse=True)
        found.append(replace(order[0], forms=tuple(c.effect.shape for c in order[:FORMS])) if order else None)
    return found


def score(state: State, effect: Effect, shapes: int, groups: int) -> Candidate | None:
    """Return what an effect with a given shape gains, or None where the model explains it already.

    What one joint has the others are likely to have: such a candidate pays for the choice of the joint only.
    """
    columns = extra_of(effect, state.scene, state.log.signals)
    gain = state.projected.gain(columns.rows)
    return None if gain is None else _candidate(state, effect, columns, gain, shapes, groups)


def _candidate(state: State, effect: Effect, columns: ExtraColumns, gain: Gain, shapes: int, groups: int) -> Candidate:
    places = state.log.model.robot.n if any(e.name == effect.name for e in state.effects) else groups
    choice = float(np.log(max(shapes, 1)) + np.log(min(places, groups)))
    values = effect.named(state.scene, gain.coefficients)
    return Candidate(effect, columns, gain, choice, values, sensible(effect, state.scene, values), shapes)


def refine(state: State, candidate: Candidate, groups: int) -> Candidate:
    """Return the candidate with its positive shapes refined, in the form that then is best."""
    kind, joint = type(candidate.effect), candidate.effect.joint
    starts = [score(state, kind(joint, shape), candidate.shapes, groups) for shape in candidate.forms[1:]]
    found = [_refined(state, c, groups) for c in (candidate, *starts) if c is not None]
    best = max(found, key=lambda c: c.rank)
    return _settled([replace(best, plausible=best.plausible and not _beyond(state, best, groups))])[0]


def refined(state: State, candidate: Candidate) -> Candidate:
    """Return a candidate with its positive shapes refined, in its own form."""
    return _settled([_refined(state, candidate, 1)])[0]


def form_of(effect: Effect) -> tuple[float, ...]:
    """Return the shapes of an effect that are a choice: its form."""
    return tuple(value for k, value in enumerate(effect.shape) if _whole(type(effect), k))


def _beyond(state: State, candidate: Candidate, groups: int) -> bool:
    """Whether a shape that is not plausible would fit better still: then the best plausible one is only its shadow."""
    kind, joint = type(candidate.effect), candidate.effect.joint
    for k, value in enumerate(candidate.effect.shape):
        if value <= 0 or _whole(kind, k):
            continue
        for factor in (1.0 / NEXT, NEXT):
            shape = list(candidate.effect.shape)
            shape[k] = value * factor
            try:
                trial = score(state, kind(joint, tuple(shape)), candidate.shapes, groups)
            except (ValueError, FloatingPointError):
                continue
            if trial is not None and not trial.plausible and trial.gain.whole > candidate.gain.whole:
                return True
    return False


def _refined(state: State, candidate: Candidate, groups: int) -> Candidate:
    """Return the candidate with its positive shapes refined by a bounded search around the grid's best."""
    from scipy.optimize import minimize, minimize_scalar

    kind, joint = type(candidate.effect), candidate.effect.joint
    start = np.array(candidate.effect.shape)
    free = np.array([s > 0 and not _whole(kind, k) for k, s in enumerate(start)])
    if not free.any():
        return candidate
    span = kind.reach(state.scene, joint, candidate.effect.shape)
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
        if trial.rank > best.rank:
            best = trial
        return -trial.rank[1]

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
