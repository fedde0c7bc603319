"""The accurate estimator: collocation started from the default fit, and accepted only if it proves itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.bordered import driven, variance_apart
from elid_cli.collocation import Iterate
from elid_cli.collocation_errors import astray, lost, told_by_coarse
from elid_cli.collocation_rows import free_shapes
from elid_cli.collocation_setup import Setup, signal_to_noise
from elid_cli.effects import FittedEffects
from elid_cli.fitting import Fit
from elid_cli.gauss_newton import Outcome, iterate
from elid_cli.nuisance import DELAY
from elid_cli.shape_scan import other_valleys
from elid_cli.terms.effect import Effect
from elid_cli.valleys import APART, REACH, explains_as_well, in_other_valleys, own_shapes

Array = NDArray[np.float64]

STEPS = 16
MOVED = 10.0
"""Standard errors of the default estimate from which on a move must be borne out by held-out torque."""
LOWEST_SIGNAL = 30.0
"""Signal-to-noise ratio of the positions, dB, below which the iteration is not started."""
NOISY_TORQUES = 0.5
"""Part of the equations' variance that is noise of the torques from which on, where positions are noisy, too, nothing
but noise leads the iteration."""
COLLAPSED = 0.2
"""Part of the default estimate below which a stiffness has collapsed."""
LEAST_PRICE = 0.2
"""Fall of minus twice the log-likelihood that each unknown of finer knots must bring, at least; 1 in noisy torques."""
ROUNDS = 1
"""Times that other valleys of the effects' shapes are looked for."""


@dataclass(frozen=True)
class Accurate:
    """A collocation's answer in the columns of the fit it started from."""

    values: Array
    """Solution over all columns of the fit, (p + e,)."""
    covariance: Array
    """Covariance of the fit's basis, (r, r)."""
    effects: FittedEffects | None
    steps: int
    knots: float
    widened: float = 1.0
    """Factor by which standard errors were widened beyond the covariance at the end."""
    others: tuple[Mapping[int, Effect], ...] = ()
    """Shapes of the effects in other valleys of the cost that explain the log as well (`FittedEffects.others`)."""
    far: str = ""
    """What moved by more than `MOVED` standard errors of the default estimate, which may not know its own bias: such
    an answer needs better evidence."""


@dataclass(frozen=True)
class Refusal:
    """Why the default answer stands."""

    reason: str


def collocate(fit: Fit) -> Accurate | Refusal:
    """Refine a fit by collocation."""
    signals = fit.signals
    if signals.recording is None:
        return Refusal("the raw log is not at hand")
    ratio = signal_to_noise(signals, fit.model)
    if ratio < LOWEST_SIGNAL:
        return Refusal(f"positions are {ratio:.0f} dB above their noise, less than the {LOWEST_SIGNAL:g} dB it needs")
    coarse = Setup(fit, coarse=True)
    if not coarse.pieces:
        return Refusal("no segment is long enough")
    share = coarse.torque_share()
    if coarse.noisy and share > NOISY_TORQUES:
        return Refusal(f"positions are {ratio:.0f} dB above their noise, too few for torques as noisy as these")
    best = _with_knots(coarse)
    answer = judged(best.setup, best.outcome)
    if isinstance(answer, Refusal):
        return answer
    factor = astray(ratio) ** (1.0 if coarse.noisy else 1.0 - share)
    apart = best.apart[fit.solution.basis]
    covariance = factor**2 * (answer.covariance + np.outer(apart, apart))
    effects, others = answer.effects, list[Mapping[int, Effect]]()
    for rival in best.rivals:
        moved = (values_of(best.setup, rival) - answer.values)[fit.solution.basis] / REACH
        covariance += np.outer(moved, moved)
        shapes = best.setup.equations.final_effects(rival.z)
        if effects is not None and shapes is not None:
            others += in_other_valleys(effects, own_shapes(shapes)).others
    return replace(answer, covariance=covariance, widened=factor, others=tuple(others))


@dataclass(frozen=True)
class _Knotted:
    """An outcome and the problem with the knots that the data speak for."""

    setup: Setup
    outcome: Outcome
    apart: Array
    """What the knots decide: what is doubtful in fine ones' answer minus coarse ones', (p + e,)."""
    rivals: tuple[Outcome, ...] = ()
    """Outcomes in other valleys of the shapes that explain the log as well."""


def _with_knots(coarse: Setup) -> _Knotted:
    """Return the outcome with coarse knots, or with fine ones where they are worth their number (Akaike).

    Between two knots a trajectory is free in as many ways as torques are noisy: where none is, the equations of motion
    decide all of it, and finer knots cost little.
    """
    found, rivals = best_of(coarse)
    if coarse.coarser == 1 or coarse.noisy:  # finer ones would follow the positions' noise
        return _Knotted(coarse, found, np.zeros(coarse.fit.triangles.width), rivals)
    fine = Setup(coarse.fit)
    start = fine.start_from(coarse, found.end)
    outcome = from_start(fine, start)[1]
    counts = [sum(piece.size for piece in place) for place in (start.coefficients, found.coefficients)]
    least = fine.first_rho()
    gain = fine.problem.deviance(start, least) - fine.problem.deviance(outcome.end, least)
    share = fine.torque_share()
    exact = np.array([row.kind == "link" for row in coarse.rows], dtype=bool)
    left = lost(outcome.residual[exact], found.residual[exact])
    if gain < max(LEAST_PRICE, share) * (counts[0] - counts[1]):
        noise = np.zeros(coarse.fit.triangles.width)
        alone = variance_apart(outcome.influence, found.influence, driven(coarse.problem))
        noise[coarse.p_columns] = alone[: len(found.p)]
        apart = values_of(fine, outcome) - values_of(coarse, found)
        return _Knotted(coarse, found, apart * told_by_coarse(apart, noise, share, left), rivals)
    rivals = ()
    if fine.z_start.size:
        outcome, rivals = best_of(fine, outcome)
    apart = values_of(fine, outcome) - values_of(coarse, found)
    return _Knotted(fine, outcome, apart, rivals)


def best_of(setup: Setup, *known: Outcome) -> tuple[Outcome, tuple[Outcome, ...]]:
    """Return the outcome of least cost among those known and those that start from several valleys of the shapes.

    With it those in other valleys that explain the log as well.
    """
    tried = [(setup.common_cost(outcome.end), outcome) for outcome in known]
    tried.append(from_start(setup, setup.start))
    if setup.z_start.size:  # noise leads the default fit far astray at times
        start = Iterate(setup.start.coefficients, setup.start.p.copy(), setup.z_start.copy())
        tried.append(from_start(setup, start))
        tried += [from_start(setup, replace(start, z=z)) for z in _named_by(setup.fit)]
    for _ in range(ROUNDS):
        found = min(tried, key=lambda item: item[0])
        others = [from_start(setup, start) for start in other_valleys(setup, found[1].end)]
        tried += others
        if not min(others, key=lambda item: item[0], default=found)[0] < found[0]:
            break
    best = min(tried, key=lambda item: item[0])[1]
    return best, tuple(_rivals(setup, best, [outcome for _, outcome in tried]))


def _named_by(fit: Fit) -> list[Array]:
    """Return the shapes in other valleys that a fit could not tell from its own."""
    if fit.effects is None:
        return []
    found = []
    for other in fit.effects.others:
        items = [replace(e, effect=other.get(k, e.effect)) for k, e in enumerate(fit.effects.effects)]
        found.append(free_shapes(replace(fit.effects, effects=tuple(items))))
    return found


def _rivals(setup: Setup, best: Outcome, tried: Sequence[Outcome]) -> list[Outcome]:
    """Return the outcomes in other valleys than the best one's that explain the log as well, one of each valley."""
    if not len(best.z):
        return []
    own = setup.common_costs(best.end)
    stretch = np.repeat(np.arange(len(own)), [len(part) for part in own])
    found: list[Outcome] = []
    for outcome in tried:
        known = [best, *found]
        if not np.isfinite(outcome.p).all() or min(float(np.max(np.abs(outcome.z - k.z))) for k in known) <= APART:
            continue
        theirs = setup.common_costs(outcome.end)
        if explains_as_well(np.concatenate(theirs) - np.concatenate(own), stretch):
            found.append(outcome)
    return found


def from_start(setup: Setup, start: Iterate) -> tuple[float, Outcome]:
    """Return the cost, to compare by, and the outcome of an iteration."""
    setup.problem.rho = setup.first_rho()
    outcome = iterate(setup.problem, start, setup.prior, STEPS)
    return setup.common_cost(outcome.end), outcome


def values_of(setup: Setup, outcome: Outcome) -> Array:
    """Return an outcome in the columns of the fit it started from, (p + e,)."""
    fit = setup.fit
    values = np.zeros(fit.triangles.width)
    values[setup.p_columns] = outcome.p
    for k, extra in enumerate(fit.nuisances):  # a delay that is no unknown stays as it was fitted
        if extra.name == DELAY and fit.model.parameters + k not in setup.p_columns:
            values[fit.model.parameters + k] = fit.solution.values[fit.model.parameters + k]
    return values


def _collapsed(fit: Fit, values: Array) -> str:
    """Return the stiffness that fell to a small part of the default estimate, if one did."""
    before = fit.solution.values
    for k, name in enumerate(fit.model.names):
        if name.startswith("K") and k in fit.solution.basis and before[k] > 0 and values[k] < COLLAPSED * before[k]:
            return name
    return ""


def judged(setup: Setup, outcome: Outcome) -> Accurate | Refusal:
    """Accept or refuse an outcome."""
    fit = setup.fit
    if len(outcome.costs) < 2 or not np.isfinite(outcome.costs[-1]):
        return Refusal("its cost did not fall")
    covariance = outcome.covariance[: len(outcome.p), : len(outcome.p)]
    if not np.isfinite(outcome.p).all() or not np.isfinite(covariance).all() or np.any(np.diag(covariance) < 0):
        return Refusal("its errors are not finite")
    values = values_of(setup, outcome)
    fallen = _collapsed(fit, values)
    if fallen:
        return Refusal(f"{fallen} fell towards 0, where with all inertias 0 the link's equation holds for any motion")
    transform = fit.transform
    known = fit.solution.estimable(transform)
    used = transform[:, fit.solution.basis]
    before = np.sqrt(np.maximum(np.diag(used @ fit.covariance @ used.T), 0.0))
    moved = np.abs(transform @ (values - fit.solution.values))
    far = known & (moved > MOVED * before)
    said = ""
    if far.any():
        worst = int(np.argmax(np.where(far, moved / np.maximum(before, 1e-300), 0.0)))
        said = f"{fit.base.names[worst]} moved by {moved[worst] / before[worst]:.0f} standard errors"
    effects = setup.equations.final_effects(outcome.z)
    return Accurate(values, covariance, effects, len(outcome.costs) - 1, setup.setting.width, far=said)
