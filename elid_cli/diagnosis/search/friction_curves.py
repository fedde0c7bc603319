"""Whole friction curves: the terms that hide behind the one that the search has found.

Friction that falls and rises again (eq. 43) is a curve of two terms. Under sensor noise the search sees one of them:
the other differs from it by less than the noise of the smoothed accelerations. The collocation, which holds the
trajectory to the equations of motion, is far sharper. It is asked here, on the training stretches only, whether the
whole curve lets the log obey its model to within the noise, and the held-out stretches have to confirm it. Where a log
does not come near to its noise (a real robot, whose model lacks more than a term) nothing is said.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Progress
from elid_cli.diagnosis.evidence.held_out import held_out_share
from elid_cli.diagnosis.fit.state import State, fit
from elid_cli.diagnosis.search.by_collocation import Collocated, collocated, possible
from elid_cli.diagnosis.search.steps import Found, Term
from elid_cli.estimation.collocation.starts import values_of
from elid_cli.model.effects.effect import Effect, Shapes
from elid_cli.robot.robot import EffectSpec

WORK = 120_000
"""Samples times the square of the joints up to which the collocation is run unasked."""
WITHIN_NOISE = 0.1
"""Cost beyond that of noise alone, as a part of it, up to which a log obeys its model."""
NEARLY, REST = 0.3, 0.3
"""The same, where no more than the second of what the terms alone leave beyond noise remains: splines round off the
jump of friction at every reversal, which no curve mends."""
OBEYED = 0.03
"""The same that terms alone may leave to be all there is."""
FAR_OFF, HOPELESS = 5.0, 1.0
"""The same of the terms alone, and with a whole curve at every joint, from which on other forms need not be tried: what
the log lacks is something else, or its jumps are too sharp for the splines …"""
HARDLY = 0.9
"""… or they leave more than this part of what the terms alone leave beyond noise: it is no friction of these joints."""
NET = 60.0
"""Gain in log-likelihood that the whole curve needs on the held-out stretches."""
SHOWN = 5.0
"""Standard errors, at the shapes that were found, by which the amplitude of a term must differ from 0."""
RESOLVED = 3.0
"""Samples, by the speed that the motor gains in one, within which a term may not fade."""
HARM = 0.2
"""Part by which a joint's squared held-out error may grow: values of the collocation are not those of least squares."""
LABEL = "collocation: whole friction curves"


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
    terms = {
        k: shapes
        for k, effect in enumerate(state.effects)
        if k >= declared and (shapes := type(effect).whole_curves(state.scene, effect.joint, effect.shape))
    }
    places = [(type(state.effects[k]), state.effects[k].joint) for k in terms]
    # a joint at which the search has found more than one term has its curve already
    curves = {k: shapes for (k, shapes), place in zip(terms.items(), places, strict=True) if places.count(place) == 1}
    hidden = _hidden(state, [kind for kind, _ in places])
    work = len(state.log.signals.motion.t) * state.log.model.robot.n**2
    if not (curves or hidden) or not (asked or work <= WORK) or not possible(state.log):
        return found
    tell = progress or (lambda label, part: None)
    tell(LABEL, 0.0)
    alone = collocated(state, state.effects, state.specs)
    if alone is None or alone.excess > FAR_OFF or _obeyed(alone):
        return found
    # what one joint of a robot shows another may have as well, too faint for the search
    for tried in [{**curves, **hidden}, curves] if hidden and curves else [{**curves, **hidden}]:
        kept, whole = _best(state, alone, tried, lambda part: tell(LABEL, 0.2 + 0.8 * part))
        kept, whole = _needed(state, alone, kept, whole)
        if whole is not None and kept and _supported(whole, alone):
            told = _told(found, alone, whole, kept)
            if not _harms(told.after, found.after):
                return told
        if whole is not None and _hopeless(whole, alone):
            break
    return found


def _hidden(state: State, kinds: Sequence[type[Effect]]) -> dict[int, tuple[Shapes, ...]]:
    """Return curves of the joints at which the search has found no such effect, numbered -1 - joint."""
    hidden = {}
    for kind in set(kinds):
        taken = {effect.joint for effect in state.effects if isinstance(effect, kind)}
        for joint in range(state.log.model.robot.n):
            if joint not in taken and not state.log.signals.still[joint] and kind.applies(state.log.model.robot, joint):
                hidden[-1 - joint] = kind.whole_curves(state.scene, joint, (1.0, 1.0))
    return {k: shapes for k, shapes in hidden.items() if shapes}


def _obeyed(alone: Collocated) -> bool:
    """Whether the terms alone let training and held-out stretches obey the model: there is nothing to complete."""
    return alone.excess < OBEYED and 0.5 * (alone.cost - alone.noise) < NET


def _supported(whole: Collocated, alone: Collocated) -> bool:
    return _within(whole, alone) and 0.5 * (alone.cost - whole.cost) >= NET


def _needed(
    state: State, alone: Collocated, kept: dict[int, Shapes], whole: Collocated | None
) -> tuple[dict[int, Shapes], Collocated | None]:
    """Return the curves that the log shows, each on its own, and the collocation with them."""
    while whole is not None and _supported(whole, alone) and (missing := _missing(whole, state, kept)):
        kept = {k: shapes for k, shapes in kept.items() if k not in missing}
        whole = collocated(state, *_completed(state, kept), alone) if kept else None
    for k in [k for k in kept if k < 0]:
        if whole is None or not _supported(whole, alone):
            break
        fewer = {other: shapes for other, shapes in kept.items() if other != k}
        without = collocated(state, *_completed(state, fewer), alone)
        if without is not None and 0.5 * (without.cost - whole.cost) < NET:
            kept, whole = fewer, without
    return kept, whole


def _best(
    state: State, alone: Collocated, curves: Mapping[int, tuple[Shapes, ...]], tell: Callable[[float], None]
) -> tuple[dict[int, Shapes], Collocated | None]:
    """Return the curve of every joint, and the collocation with them: other forms only where the usual do not do."""
    kept = {k: shapes[0] for k, shapes in curves.items()}
    whole = collocated(state, *_completed(state, kept), alone)
    others = [(k, shape) for k, shapes in curves.items() for shape in shapes[1:]]
    for number, (k, shape) in enumerate(others):
        if whole is not None and (_within(whole, alone) or _hopeless(whole, alone)):
            break
        tell((number + 1) / (len(others) + 1))
        trial = collocated(state, *_completed(state, {**kept, k: shape}), alone)
        if trial is not None and (whole is None or trial.training < whole.training):
            kept, whole = {**kept, k: shape}, trial
    return kept, whole


def _within(whole: Collocated, alone: Collocated) -> bool:
    """Whether whole curves let the training stretches obey the model to within their noise."""
    return whole.excess <= max(WITHIN_NOISE, min(NEARLY, REST * alone.excess))


def _hopeless(whole: Collocated, alone: Collocated) -> bool:
    """Whether whole curves leave so much that other forms of them, or fewer, need not be tried."""
    return not _within(whole, alone) and whole.excess > min(HOPELESS, HARDLY * alone.excess)


def _completed(state: State, curves: Mapping[int, Shapes]) -> tuple[list[Effect], list[EffectSpec]]:
    """Return the effects with whole curves, those found in their old places, and their descriptions to start from."""
    effects, specs = list(state.effects), state.specs
    names = state.log.model.robot.joint_names
    for k, shapes in curves.items():
        kind, joint = _place(state, k)
        terms = [kind(joint, shape) for shape in shapes]
        described = [
            EffectSpec(kind.name, names[joint], dict(zip((p.name for p in kind.shapes), shape, strict=True)))
            for shape in shapes
        ]
        if k >= 0:
            effects[k], specs[k] = terms.pop(0), described.pop(0)
        effects += terms
        specs += described
    return effects, specs


def _place(state: State, number: int) -> tuple[type[Effect], int]:
    """Return the kind and the joint of a curve; one that is hidden is of the kind that another joint has."""
    if number >= 0:
        return type(state.effects[number]), state.effects[number].joint
    scene = state.scene
    return next(type(e) for e in state.effects if type(e).whole_curves(scene, e.joint, e.shape)), -1 - number


def _missing(whole: Collocated, state: State, curves: Mapping[int, Shapes]) -> set[int]:
    """Return the curves of which some term's amplitude does not differ from 0."""
    owners = [*range(len(state.effects)), *(k for k, shapes in curves.items() for _ in shapes[k >= 0 :])]
    values, basis = values_of(whole.setup, whole.outcome), whole.fit.solution.basis
    size, covariance = len(whole.outcome.p), whole.outcome.covariance
    across = covariance[:size, size:]
    given = covariance[:size, :size] - across @ np.linalg.pinv(covariance[size:, size:], hermitian=True) @ across.T
    spread = whole.widened * np.sqrt(np.maximum(np.diag(given), 0.0))
    missing = set()
    for k, place in zip(owners, whole.fit.amplitude_places, strict=True):
        if k not in curves:
            continue  # an effect that is no term of these curves
        index = np.flatnonzero(np.isin(basis, np.arange(place.start, place.stop)))
        if len(index) == 0 or np.max(np.abs(values[basis[index]]) / np.maximum(spread[index], 1e-300)) < SHOWN:
            missing.add(k)
    return missing


def _told(found: Found, alone: Collocated, whole: Collocated, curves: Mapping[int, Shapes]) -> Found:
    """Return the outcome with the collocation's effects and values."""
    shapes = whole.setup.equations.final_effects(whole.outcome.z)
    if shapes is None:
        return found
    state = fit(found.after.log, [item.effect for item in shapes.effects], found.after.scene)
    values = values_of(whole.setup, whole.outcome)
    one, other = ([(extra.name, extra.rows.keys()) for extra in n] for n in (state.nuisances, whole.fit.nuisances))
    if one != other:
        return found  # a delay that the one fit finds and the other does not: rare, and not worth two truths
    solution = replace(state.solution, values=values)
    # values in the basis of the one solution, told in that of the other
    spread = np.zeros((len(values), len(solution.basis)))
    spread[solution.basis, np.arange(len(solution.basis))] = 1.0
    spread[solution.others] = solution.dependence.T
    turn = spread[whole.fit.solution.basis]
    size = len(whole.outcome.p)
    covariance = whole.widened**2 * turn.T @ whole.outcome.covariance[:size, :size] @ turn
    gain = (alone.cost - whole.cost) / max(alone.cost - whole.noise, alone.cost - whole.cost)
    term = Term(gain, 0.5 * (alone.cost - whole.cost))
    further = range(len(found.after.effects), len(state.effects))
    told = [*(k for k in curves if k >= 0), *further]
    state = replace(state, solution=solution, known=covariance)
    return replace(found, after=state, terms=dict.fromkeys(told, term)) if _real(state, found.after, told) else found


def _harms(state: State, before: State) -> bool:
    """Whether curves predict some joint's held-out torque worse than it was predicted without them.

    The collocation moves the trajectory as well, and may follow with it what the curves do not explain.
    """
    joints = {row.joint for row in before.triangles.rows}
    rows = {joint: [row for row in before.triangles.rows if row.joint == joint] for joint in joints}
    return any(held_out_share(before, state, own) < -HARM for own in rows.values())


def _real(state: State, before: State, terms: Sequence[int]) -> bool:
    """Whether terms are resolved by the log, and no parameter is impossible for them.

    Splines round off the jump of friction at a reversal. A term that fades within a few samples of it, or two that
    cancel but there, take that up.
    """
    for k in terms:
        effect = state.effects[k]
        gained = float(np.median(np.abs(np.diff(state.scene.motion.dtheta[:, effect.joint]))))
        if effect.of_motor_speed and effect.shape[0] < RESOLVED * gained:
            return False
    return not state.impossible - before.impossible
