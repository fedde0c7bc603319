"""The last judgement of a diagnosis: each quarter of the log, predicted by a model that never saw it.

Every effect about to be named is taken out of the model; the model with it and the one without it are fitted to three
quarters of the log and compared on the fourth, in turn. An effect that makes some quarter worse is not named. Shapes
(a Stribeck velocity, an order) stay as found; whatever is linear is fitted anew. Effects that live in a part of the
log (contact, payload, saturation) cannot be predicted from the other parts: the quarters are then those of the
instants at which they act. A quarter in which an effect does nothing, or for which the others leave its size open,
cannot tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.evidence.moments import acting
from elid_cli.diagnosis.fit.state import State, fit, refreshed, without
from elid_cli.diagnosis.search.acceptance import touched
from elid_cli.diagnosis.search.encoder_skew import link_load
from elid_cli.diagnosis.search.event_times import INSTANT
from elid_cli.diagnosis.search.steps import Found, dropped
from elid_cli.errors import DataError
from elid_cli.estimation.regression.covariance import long_run, residuals
from elid_cli.estimation.regression.least_squares import Solution, solve
from elid_cli.estimation.regression.triangles import to_triangles
from elid_cli.estimation.stretches import QUARTERS, quarter_of
from elid_cli.model.effects import effect_classes, effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.relations import in_deflection
from elid_cli.model.regressor import EstimationRow

SPEAKS = 0.01
"""Part of a quarter's squared error that an effect must move for the quarter to speak about it."""
TOLERATED = 0.05
"""Loss, as a part of a quarter's squared error, that noise may excuse …"""
QUIET = 2.0
"""… or as a part of all quarters' mean, where a quarter's mean square is less than this without it, in noise floors."""


@dataclass(frozen=True)
class Survival:
    """What an effect is worth on each quarter, predicted from the other three."""

    effect: str
    joint: str | None
    gains: tuple[float, ...]
    """Part of the squared error that it takes away, per quarter; NaN where the quarter cannot tell."""
    whole: float
    """The same of the squared errors of all quarters together."""
    lost: tuple[bool, ...]
    """In which quarters it makes the prediction worse by more than the noise of the comparison allows."""
    kept: bool = False
    """Whether it fails but stays in the model as a nuisance."""
    cutoff: float | None = None
    """Identification's cut-off, Hz, where it fails at that one alone."""

    @property
    def survives(self) -> bool:
        """Whether it is lost in no quarter, and helps on the whole where any quarter can tell."""
        silent = all(np.isnan(gain) for gain in self.gains)
        return not any(self.lost) and (silent or self.whole > 0)

    @property
    def words(self) -> str:
        """What it takes from each quarter, in words."""
        return ", ".join("cannot tell" if np.isnan(g) else f"{100 * g:.0f} %" for g in self.gains)


@dataclass(frozen=True)
class _Compared:
    """Squared errors of one quarter without and with an effect, the noise of their difference, and what it moves."""

    before: float
    after: float
    noise: float
    moved: float
    known: bool = True
    local: bool = False
    count: int = 0
    """Residuals in it."""
    usual: float = 0.0
    """Mean squared error of all quarters without the effect: one that hardly shows any error has little to lose."""

    @property
    def speaks(self) -> bool:
        """Whether the quarter can tell anything about the effect: it acts there, and no loss is such as noise makes.

        Of an effect that is local nothing but these few instants speaks, so none of them may speak against it.
        """
        size = max(self.before, self.usual) if self.before < QUIET * self.count else self.before
        loss, excused = self.after - self.before, min(self.noise, TOLERATED * size)
        excusable = 0 < loss <= excused and not self.local
        return self.known and self.before > 0 and self.moved > SPEAKS * self.before and not excusable

    @property
    def gain(self) -> float:
        """Part of the squared error that the effect takes away; NaN where the quarter cannot tell."""
        return 1.0 - self.after / self.before if self.speaks else float("nan")

    @property
    def lost(self) -> bool:
        """Whether the effect makes the prediction worse by more than noise excuses."""
        return self.speaks and self.after > self.before


_SILENT = _Compared(0.0, 0.0, 0.0, 0.0, known=False)


def judged(found: Found, declared: int) -> tuple[Found, Survival | None]:
    """Return the outcome with what each effect is worth on each quarter, less the effect that fails worst, if any.

    Parameters
    ----------
    found
        The outcome of a search.
    declared
        How many of the state's effects, the first ones, the robot file declares.

    Returns
    -------
    The outcome, fitted anew where an effect failed, and that effect; None where all survive.
    """
    state = found.after
    fits = left_out(state) if found.steps or found.skews else []
    late = effect_that(corrects="link")
    skews = [_in_positions(state, late, skew.joint, fits) for skew in found.skews]
    steps = [survival(state, declared + k, fits) for k in range(len(found.steps))]
    failing = [s for s in (*skews, *steps) if not s.survives]
    if not failing:
        seen = [replace(skew, quarters=s.gains) for skew, s in zip(found.skews, skews, strict=True)]
        named = [replace(step, quarters=s.gains) for step, s in zip(found.steps, steps, strict=True)]
        return replace(found, steps=tuple(named), skews=tuple(seen)), None
    worst = min(failing, key=lambda s: min((g for g in s.gains if np.isfinite(g)), default=s.whole))
    for k, item in enumerate(steps):
        if item is worst:
            if effect_classes()[worst.effect].always_fitted and worst.whole > 0:
                # not named, but left out stiffness and friction would have to stand in for it
                effects = list(state.effects)
                effects.insert(declared, effects.pop(declared + k))
                state = refreshed(fit(state.log, effects, state.scene))
                rest = (*found.steps[:k], *found.steps[k + 1 :])
                return replace(found, after=state, steps=rest, kept=found.kept + 1), replace(worst, kept=True)
            after, left = dropped(state, found.steps, declared, k)
            return replace(found, after=after, steps=tuple(left)), worst
    k = next(k for k, item in enumerate(skews) if item is worst)
    gone, shifts = found.skews[k], state.log.shifts
    log = state.log.seen_late(gone.joint, shifts.of("link", gone.joint) - gone.skew)
    state = refreshed(fit(log, state.effects, state.scene))
    return replace(found, after=state, skews=(*found.skews[:k], *found.skews[k + 1 :])), worst


def survival(state: State, number: int, fits: Sequence[Solution | None]) -> Survival:
    """Return what effect `number` of a state is worth; `fits`: the state's model without each quarter."""
    effect = state.effects[number]
    if in_deflection(effect, state.log.model.robot, effect.joint):
        return _in_positions(state, type(effect), effect.joint, fits)
    lacking = without(state, number)
    rows = touched(lacking, state, state.columns[number].rows)
    fold = _quarters(state)
    if effect.local:
        fold = _acting(state, number)
        fits = left_out(state, fold)
    compared = []
    for quarter, (inside, outside) in enumerate(zip(fits, left_out(lacking, fold), strict=True)):
        if inside is None or outside is None:
            compared.append(_SILENT)
            continue
        chosen = fold == quarter
        pairs = [_pair(state, lacking, inside, outside, row, chosen) for row in rows]
        known = _known(state, inside, number, rows, chosen)
        told = _compared(pairs, state.log.observation.segment[chosen], known)
        compared.append(replace(told, local=effect.local))
    return _survival(effect.name, state.joint_of(effect), compared)


def _survival(effect: str, joint: str | None, compared: Sequence[_Compared]) -> Survival:
    before, after = sum(c.before for c in compared), sum(c.after for c in compared)
    compared = [replace(c, usual=before / len(compared)) for c in compared]
    whole = 1.0 - after / before if before > 0 else 0.0
    return Survival(effect, joint, tuple(c.gain for c in compared), whole, tuple(c.lost for c in compared))


def _acting(state: State, number: int) -> NDArray[np.intp]:
    """Return the quarter of every instant at which an effect acts, (M,): of the time it acts; others belong to none."""
    acts = np.flatnonzero(acting(state, number))
    fold = np.full(state.log.observation.instants, QUARTERS, dtype=np.intp)
    fold[acts] = quarter_of(len(acts))
    return fold


def _quarters(state: State) -> NDArray[np.intp]:
    """Return the quarter of every instant, (M,), -1 within reach of the filter from a change of the whole robot.

    A load that is gripped makes torques and deflections jump, which no smoothed motion does: what is left there says
    nothing of the other effects.
    """
    log, signals = state.log, state.log.signals
    fold = quarter_of(log.observation.instants)
    reach = signals.dt * (signals.margin + signals.filter.half)
    for effect in state.effects:
        for value, shape in zip(effect.shape, effect.shapes, strict=True):
            if shape.name == INSTANT and effect.whole_robot:
                fold[np.abs(log.observation.t - value) < reach] = -1
    return fold


def left_out(state: State, fold: NDArray[np.intp] | None = None) -> list[Solution | None]:
    """Return the state's model fitted without each quarter in turn; None where the rest of the log holds nothing."""
    log = state.log
    fold = _quarters(state) if fold is None else fold
    triangles = replace(to_triangles(log.observation, state.extras, fold), prior=state.triangles.prior)
    found: list[Solution | None] = []
    for quarter in range(QUARTERS):
        others = [k for k in range(triangles.folds) if k != quarter]
        try:
            found.append(solve(triangles, state.solution.weights, others, len(state.solution.basis)))
        except DataError:
            found.append(None)
    return found


def _compared(pairs: Sequence[tuple[Array, Array]], stretch: NDArray[np.intp], known: bool) -> _Compared:
    """Compare residuals without and with an effect, one pair (m,) per row group, all in the same unit."""
    before = sum(float(a @ a) for a, _ in pairs)
    after = sum(float(b @ b) for _, b in pairs)
    moved = sum(float((a - b) @ (a - b)) for a, b in pairs)
    # were the effect real, its own residual b would be noise: the difference a² - b² then scatters by 2 (a - b) b
    scores = np.sum([(a - b) * b for a, b in pairs], axis=0) if pairs else np.zeros(len(stretch))
    noise = 2.0 * float(np.sqrt(max(long_run(scores[:, None], stretch)[0, 0], 0.0))) if len(stretch) else 0.0
    return _Compared(before, after, noise, moved, known, count=sum(int(np.count_nonzero(a)) for a, _ in pairs))


def _pair(
    state: State, lacking: State, inside: Solution, outside: Solution, row: EstimationRow, chosen: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return the residuals of a row group in one quarter without and with an effect, in units of its noise floor."""
    use = np.logical_and.reduce([s.log.observation.group(row).use for s in (state, lacking)])[chosen]
    unit = 1.0 / max(state.floor.rms[row], 1e-4 * state.triangles.torque_rms(row))
    series = [
        residuals(model.log.observation, solution.values, model.extras)[row][chosen] * use * unit
        for model, solution in ((lacking, outside), (state, inside))
    ]
    return series[0], series[1]


def _known(
    state: State, solution: Solution, number: int, rows: Sequence[EstimationRow], chosen: NDArray[np.bool_]
) -> bool:
    """Whether the other quarters tell an effect's torque in one quarter to better than its own size."""
    place = state.place(number)
    columns = np.arange(place.start, place.stop)
    here = [np.flatnonzero(solution.basis == c) for c in columns]
    if not any(len(h) for h in here):
        return False
    factor = np.zeros((len(columns), solution.inverse.shape[1]))
    for k, where in enumerate(here):
        if len(where):
            factor[k] = solution.inverse[where[0]]
    # how much wider correlated residuals make the errors is told by the fit to the whole
    inner = [int(w[0]) for c in columns if len(w := np.flatnonzero(state.solution.basis == c))]
    plain = float(np.sum(state.solution.inverse[inner] ** 2))
    widened = float(np.trace(state.covariance[np.ix_(inner, inner)])) / plain if plain > 0 else 1.0
    spread = size = 0.0
    for row in rows:
        if row in state.columns[number].rows:
            use = chosen & state.log.observation.group(row).use
            x = state.columns[number].rows[row][:, use] * state.solution.weights.get(row, 0.0)
            spread += widened * float(np.sum((factor.T @ x) ** 2))
            size += float(np.sum((solution.values[place] @ x) ** 2))
    return spread < size


def _in_positions(state: State, kind: type[Effect], joint: int, fits: Sequence[Solution | None]) -> Survival:
    """Return what a fault between a joint's two encoders takes from the deflection that the load leaves.

    A row that predicts torque from the deflection is no judge of such a fault: without it the spring seems several
    times too soft, passes on that much less of all that is wrong in the deflection, and looks better wherever the load
    hardly varies. The deflection itself, theta - q = load / K + offset + scale theta + skew q', is fitted without each
    quarter, a scale where the joint has one.
    """
    log = state.log
    signals = log.raw if kind.corrects == "link" else log.signals
    theta = signals.motion.theta[:, joint]
    channels = (theta - signals.motion.q[:, joint], signals.motion.dq[:, joint], theta)
    deflection, speed, position = signals.decimate(np.array(channels))
    turn = np.array([np.sin(position), np.cos(position)])
    parts = {
        "velocity": speed[None],
        "constant": np.ones((1, len(deflection))),
        "position": position[None],
        "turn": turn,
    }
    present = {effect.in_deflection for effect in state.effects if effect.joint == joint} & {"position", "turn"}
    beside = [parts[part] for part in ("constant", *present) if part != kind.in_deflection]
    moving = ~log.observation.reversing[joint]
    fold, compared = quarter_of(len(deflection)), []
    for quarter, fitted in enumerate(fits):
        if fitted is None:
            compared.append(_SILENT)
            continue
        load = link_load(state, joint, fitted.values)
        columns = np.concatenate([parts[kind.in_deflection], load[None], *beside])
        known = moving & np.isfinite(deflection) & np.isfinite(columns).all(axis=0)
        train, test = known & (fold != quarter), known & (fold == quarter)
        if not train.any() or not test.any():
            compared.append(_SILENT)
            continue
        errors = []
        for used in (columns[len(parts[kind.in_deflection]) :], columns):
            scale = np.linalg.norm(used[:, train], axis=1)[:, None]
            unit = used / np.where(scale > 0, scale, 1.0)
            values = np.linalg.lstsq(unit[:, train].T, deflection[train], rcond=None)[0]
            errors.append((deflection - values @ unit)[test])
        compared.append(_compared([(errors[0], errors[1])], log.observation.segment[test], known=True))
    return _survival(kind.name, log.model.robot.joint_names[joint], compared)
