"""The accurate estimator: collocation started from the default fit, and accepted only if it proves itself."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.collocation import Iterate
from elid_cli.collocation_setup import Setup
from elid_cli.effects import FittedEffects
from elid_cli.fitting import Fit
from elid_cli.gauss_newton import Outcome, iterate
from elid_cli.model import Model
from elid_cli.nuisance import DELAY
from elid_cli.shape_scan import other_valleys
from elid_cli.signals import Signals

Array = NDArray[np.float64]

STEPS = 16
MOVED = 10.0
"""Standard errors of the default estimate that no parameter may move by."""
LOWEST_SIGNAL = 30.0
"""Signal-to-noise ratio of the positions, dB, below which the iteration is not started."""
UNBENT = 84.0
"""Signal-to-noise ratio of the positions, dB, from which on the covariance at the end holds."""
AGREE = 4.0
"""Combined standard errors between default and accurate estimate beyond which the larger error stands."""
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
    setup = Setup(fit)
    if not setup.pieces:
        return Refusal("no segment is long enough")
    answer = judged(setup, best_of(setup))
    if isinstance(answer, Refusal):
        return answer
    factor = max(widening(ratio), _disagreement(fit, answer))
    return replace(answer, covariance=factor**2 * answer.covariance, widened=factor)


def widening(ratio: float) -> float:
    """Return the factor on standard errors at a signal-to-noise ratio of the positions, dB.

    An empirical rule: on eight logs of the paper's robot (plain friction, motions 1-4) errors were 2.8 standard errors
    at 60 dB, 1.9 at 70 dB and 1.25 at 80 dB, rms; not calibrated elsewhere. Answers to logs made anew from the fit do
    not scatter so, which points to the spline at the jumps of friction.
    """
    return float(max(1.0, 10.0 ** ((UNBENT - ratio) / 50.0)))


def _disagreement(fit: Fit, answer: Accurate) -> float:
    """Return the factor on standard errors that lets the answer agree with the default estimate within their errors."""
    used = fit.transform[:, fit.solution.basis]
    known = fit.solution.estimable(fit.transform)
    default, accurate = (
        np.sqrt(np.maximum(np.diag(used @ c @ used.T), 0.0))[known] for c in (fit.covariance, answer.covariance)
    )
    moved = np.abs(fit.transform @ (answer.values - fit.solution.values))[known]
    apart = (moved > AGREE * np.hypot(default, accurate)) & (accurate > 0)
    return float(np.max(default[apart] / accurate[apart], initial=1.0))


def best_of(setup: Setup) -> Outcome:
    """Return the outcome of least cost among those that start from several valleys of the shapes of effects."""
    found = from_start(setup, setup.start)
    if setup.z_start.size:  # noise leads the default fit far astray at times
        start = Iterate(setup.start.coefficients, setup.start.p.copy(), setup.z_start.copy())
        found = min(found, from_start(setup, start), key=lambda item: item[0])
    for _ in range(ROUNDS):
        others = [from_start(setup, start) for start in other_valleys(setup, found[1].end)]
        better = min(others, key=lambda item: item[0], default=found)
        if not better[0] < found[0]:
            break
        found = better
    return found[1]


def from_start(setup: Setup, start: Iterate) -> tuple[float, Outcome]:
    """Return the cost, to compare by, and the outcome of an iteration."""
    setup.problem.rho = setup.first_rho()
    outcome = iterate(setup.problem, start, setup.prior, STEPS)
    return setup.common_cost(outcome.end), outcome


def signal_to_noise(signals: Signals, model: Model) -> float:
    """Return the signal-to-noise ratio of the worst joint's positions, dB."""
    worst = np.inf
    for k in range(model.robot.n):
        if signals.still[k]:
            continue
        size = float(np.nanstd(signals.motion.q[:, k]))
        noise = float(np.nanmax([signals.noise.q[k], signals.noise.theta[k], 1e-12]))
        worst = min(worst, 20 * np.log10(max(size, 1e-300) / noise))
    return float(worst)


def values_of(setup: Setup, outcome: Outcome) -> Array:
    """Return an outcome in the columns of the fit it started from, (p + e,); torque delays stay as they were fitted."""
    fit = setup.fit
    values = np.zeros(fit.triangles.width)
    values[setup.p_columns] = outcome.p
    for k, extra in enumerate(fit.nuisances):
        if extra.name == DELAY:
            values[fit.model.parameters + k] = fit.solution.values[fit.model.parameters + k]
    return values


def judged(setup: Setup, outcome: Outcome) -> Accurate | Refusal:
    """Accept or refuse an outcome."""
    fit = setup.fit
    if len(outcome.costs) < 2 or not np.isfinite(outcome.costs[-1]):
        return Refusal("its cost did not fall")
    covariance = outcome.covariance[: len(outcome.p), : len(outcome.p)]
    if not np.isfinite(outcome.p).all() or not np.isfinite(covariance).all() or np.any(np.diag(covariance) < 0):
        return Refusal("its errors are not finite")
    values = values_of(setup, outcome)
    transform = fit.transform
    known = fit.solution.estimable(transform)
    used = transform[:, fit.solution.basis]
    before = np.sqrt(np.maximum(np.diag(used @ fit.covariance @ used.T), 0.0))
    moved = np.abs(transform @ (values - fit.solution.values))
    far = known & (moved > MOVED * before)
    if far.any():
        worst = int(np.argmax(np.where(far, moved / np.maximum(before, 1e-300), 0.0)))
        return Refusal(f"{fit.base.names[worst]} moved by {moved[worst] / before[worst]:.0f} standard errors")
    effects = setup.equations.final_effects(outcome.z)
    return Accurate(values, covariance, effects, len(outcome.costs) - 1, setup.setting.width)
