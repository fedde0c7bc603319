"""Effects that base parameters absorb: hardly any residual, false parameters.

A weak balancing spring, one joint's torque gain or the zero of its encoder are nearly what other first moments,
frictions and rotor inertias would be. The fit takes them for these, and what it leaves is too little to matter: a
search by the residual passes by while parameters are off by many of their standard errors. Of such an effect its size
is asked instead: beside all parameters, is it surely not 0? That is an answer only where nothing but noise is left, for
then standard errors are what they say.

What there is of such an effect is spread over the log, as little as it is: all stretches are asked together, each
predicted by the others, those as well that the search did not see.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.evidence.quarters import Survival, left_out, survival
from elid_cli.diagnosis.fit.state import State, agreed, fit, refreshed, without
from elid_cli.diagnosis.search.acceptance import SMALLEST_TORQUE
from elid_cli.diagnosis.search.candidate import FOLDS_LOST, Candidate
from elid_cli.diagnosis.search.screening import screen, sensible
from elid_cli.diagnosis.search.steps import Found, Step, best_step
from elid_cli.estimation.data import Solved
from elid_cli.estimation.regression.standard_errors import covariance_of, freedom
from elid_cli.estimation.stretches import stretch_of
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.posed import turns_model
from elid_cli.model.effects.relations import in_deflection

QUIET = 1.3
"""Residual over the noise floor of every row up to which nothing but noise is left."""
LEAST = 5.0
"""Log-likelihood that an effect gains on three quarters of a log which surely shows it: half of what it has to."""
CHANCE = 1e-4
"""Chance at which some effect at some joint would seem as large in a log that lacks none."""
NOTHING = 0.05
"""The same from which an effect that was found before is as good as 0."""
NOISY = 1.4
"""Factor on standard errors where elastic joints have two encoders: their noise in the columns is in no standard error.
On 200 clean logs, with encoders of 13 to 16 bits, gains of torques were up to 4.7 of these errors from 0."""
MOVED = 4.0
"""Standard errors by which some base parameter is off without it, for an effect to be worth a name."""
TRIED = 3
"""Candidates that are fitted in full."""
NOISE_DECIDES = 2
"""Folds that may speak against an effect of a size near the noise."""
MOST = 6
"""Most of such effects in one log."""


def with_absorbed(found: Found, library: Mapping[str, type[Effect]]) -> Found:
    """Return the outcome with effects that base parameters absorb and the log shows none the less.

    Parameters
    ----------
    found
        What the search found.
    library
        Effects to try.
    """
    kinds = {name: kind for name, kind in library.items() if _by_size(kind)}
    for _ in range(MOST if kinds else 0):
        more = _next(found.after, kinds)
        if more is None:
            break
        state, step = more
        found = _without_outgrown(replace(found, after=state, steps=(*found.steps, step)))
    return found


def _without_outgrown(found: Found) -> Found:
    """Return the outcome without effects that the last one has left nothing of: they made up for its absence."""
    state, steps = found.after, list(found.steps)
    first = len(state.effects) - len(steps)
    for k in reversed(range(len(steps) - 1)):
        if _by_size(type(steps[k].candidate.effect)) and _chance(state, first + k) > NOTHING:
            state = refreshed(without(state, first + k))
            del steps[k]
    return found if state is found.after else replace(found, after=state, steps=tuple(steps))


def _by_size(kind: type[Effect]) -> bool:
    """Whether an effect acts all the time, by a size that is 0 where it does not, and by columns that are known well.

    The deflection is not: noise of encoders in it is not linear in what acts between motor and link.
    """
    between = (kind.in_deflection and kind.elastic_only) or kind.place == "spring"
    return not (kind.local or kind.shapes or kind.corrects or kind.nuisance or kind.quasi_static or between)


def _next(state: State, kinds: Mapping[str, type[Effect]]) -> tuple[State, Step] | None:
    """Return the state with the best of such effects as its last one, and the step to it; None where there is none."""
    if state.known is not None or max(state.ratios().values()) > QUIET or not _any_gains(state, kinds):
        return None
    log = replace(state.log, fold=stretch_of(state.log.observation.instants))
    whole = agreed(fit(log, state.effects, state.scene, but=state.but))
    candidates = [c for c in screen(whole, kinds) if not in_deflection(c.effect, whole.log.model.robot, c.effect.joint)]
    able = [c for c in candidates if _predicts(c) and c.net > 0 and not _scales_all(whole, c.effect)]
    for _ in range(min(TRIED, len(able))):
        step = best_step(able)
        effects, last = (*state.effects, step.candidate.effect), len(state.effects)
        grown = refreshed(fit(log, effects, whole.scene, but=state.but))
        if _there(whole, grown, len(candidates)):
            quarters = survival(grown, last, left_out(grown))
            if _mostly_helps(quarters):
                seen = refreshed(fit(state.log, effects, state.scene, but=state.but))
                return seen, replace(step, quarters=quarters.gains, absorbed=True)
        able = [c for c in able if c is not step.candidate]
    return None


def _predicts(candidate: Candidate) -> bool:
    """Whether data that did not fit an effect speak for it: on the whole, and in most of the folds.

    Where it is near the noise, this decides some of the folds, and by the effect's size what there is of it is judged.
    """
    folds = candidate.gain.folds
    return candidate.plausible and float(folds.sum()) > 0 and int(np.sum(folds < 0)) <= NOISE_DECIDES


def _any_gains(state: State, kinds: Mapping[str, type[Effect]]) -> bool:
    """Whether any of such effects gains something on the stretches of the search: else the rest need not be asked."""
    joints = range(state.log.model.robot.n)
    robot = state.log.model.robot
    effects = [kind(k) for kind in kinds.values() for k in joints if kind.applies(robot, k)]
    effects = [effect for effect in effects if not in_deflection(effect, robot, effect.joint)]
    gains = state.projected.gains([state.log.columns.of(effect, state.scene).rows for effect in effects])
    return any(gain is not None and gain.whole > LEAST for gain in gains)


def _scales_all(state: State, effect: Effect) -> bool:
    """Whether a torque's gain is that of the last joint without one: that scales all, which no log shows.

    With gains everywhere the least error is that of a robot without mass.
    """
    gains = {other.joint for other in (*state.effects, effect) if other.of_drive == effect.of_drive == "gain"}
    return bool(gains) and gains >= {row.joint for row in state.triangles.rows}


def _there(state: State, grown: State, tried: int) -> bool:
    """Whether the last effect of a grown state is possible, surely not 0, and a base parameter is off without it."""
    last = len(grown.effects) - 1
    possible = sensible(grown.effects[last], grown.scene, grown.named(last)) and grown.impossible <= state.impossible
    return possible and _matters(grown, last) and _chance(grown, last) < CHANCE / tried and _moves(state, grown)


def _matters(state: State, number: int) -> bool:
    """Whether an effect's torque is more than what no simulation or spline is exact to, in some row."""
    rows = {row: c for row, c in state.columns[number].rows.items() if row in state.triangles.rows}
    sizes = {row: float(np.sqrt(np.mean((state.coefficients(number) @ c) ** 2))) for row, c in rows.items()}
    turned = turns_model(type(state.effects[number]))  # its columns are what is left to turn
    return turned or any(size > SMALLEST_TORQUE * state.triangles.torque_rms(row) for row, size in sizes.items())


def _chance(state: State, number: int) -> float:
    """Return the chance to find an effect as large as it is where it is 0, by standard errors that know correlation."""
    from scipy.special import fdtrc

    solved = Solved(state.log.base, state.log.data, state.extras, None, state.triangles, state.solution)
    place, basis = state.place(number), state.solution.basis
    inner = np.flatnonzero((basis >= place.start) & (basis < place.stop))
    if not len(inner):
        return 1.0
    values = _amplitudes(state, number)[basis[inner] - place.start]
    covariance = covariance_of(solved)[np.ix_(inner, inner)]
    if not np.all(np.linalg.eigvalsh(covariance) > 0):  # a log without noise says nothing of chance
        return 1.0
    elastic = any(joint.elastic for joint in state.log.model.robot.joints)
    size = float(values @ np.linalg.solve(covariance, values)) / len(inner) / (NOISY**2 if elastic else 1.0)
    degrees = freedom(state.log.data.facts, state.triangles, len(basis))
    return float(fdtrc(len(inner), min(degrees, 1e6), size))


def _amplitudes(state: State, number: int) -> Array:
    """Return an effect's coefficients, (d,); of angles by which the model is turned already, the angles."""
    effect = state.effects[number]
    if not turns_model(type(effect)):
        return state.coefficients(number)
    named = state.named(number)
    return np.array([named.get(parameter.name, 0.0) for parameter in effect.amplitudes])


def _moves(state: State, grown: State) -> bool:
    """Whether some base parameter is off by several of its standard errors in the state without an effect."""
    (before, errors, known), (after, _, still) = (one.base_values(state.log.base) for one in (state, grown))
    return bool(np.any(known & still & (np.abs(after - before) > MOVED * errors)))


def _mostly_helps(quarters: Survival) -> bool:
    """Whether an effect helps on the whole, and in all quarters but one where noise may speak against so little."""
    silent = all(np.isnan(gain) for gain in quarters.gains)
    return sum(quarters.lost) <= FOLDS_LOST and (silent or quarters.whole > 0)
