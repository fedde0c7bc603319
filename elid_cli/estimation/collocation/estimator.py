"""The accurate estimator: collocation started from the default fit, and accepted only if it proves itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.collocation.gauss_newton import Outcome
from elid_cli.estimation.collocation.knots import astray, between_valleys, with_knots
from elid_cli.estimation.collocation.setup import Setup, signal_to_noise
from elid_cli.estimation.collocation.starts import values_of
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.estimation.regression.other_shapes import REACH, in_other_valleys, own_shapes
from elid_cli.model.effects.effect import Effect

MOVED = 10.0
"""Standard errors of the default estimate from which on a move must be borne out by held-out torque."""
LOWEST_SIGNAL = 30.0
"""Signal-to-noise ratio of the positions, dB, below which the iteration is not started."""
NOISY_TORQUES = 0.5
"""Part of the equations' variance that is noise of the torques from which on, where positions are noisy, too, nothing
but noise leads the iteration."""
SHARPER = 0.9
"""Standard errors as a part of the default estimate's, geometric mean over all parameters, above which an answer is no
sharper. The likelihood takes noise of the torque for white: in noise that remembers 50 ms (planar arm, 70 to 90 dB, 0.1
to 1 %, 64 logs) errors were 1.05 to 1.9 times the default's above 0.9, and the standard errors did not know it.
"""
COLLAPSED = 0.2
"""Part of the default estimate below which a stiffness has collapsed."""


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


def collocate(fit: DefaultFit) -> Accurate | Refusal:
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
    best = with_knots(coarse)
    answer = judged(best.setup, best.outcome)
    if isinstance(answer, Refusal):
        return answer
    factor = astray(ratio) ** (1.0 if coarse.noisy else 1.0 - share)
    apart = best.apart[fit.solution.basis]
    covariance = factor**2 * (answer.covariance + np.outer(apart, apart))
    if not coarse.noisy:  # what has wide knots and soft equations has few valleys
        covariance += between_valleys(ratio) ** 2 * _along_inertias(fit)
    effects, others = answer.effects, list[Mapping[int, Effect]]()
    for rival in best.rivals:
        moved = (values_of(best.setup, rival) - answer.values)[fit.solution.basis] / REACH
        covariance += np.outer(moved, moved)
        shapes = best.setup.equations.final_effects(rival.z)
        if effects is not None and shapes is not None:
            others += in_other_valleys(effects, own_shapes(shapes)).others
    return replace(answer, covariance=covariance, widened=factor, others=tuple(others))


def _along_inertias(fit: DefaultFit) -> Array:
    """Return the part of the default estimate's covariance that lies along the elastic joints' rotor inertias."""
    names = [fit.model.robot.rotor_names[k] for k in np.flatnonzero(fit.model.robot.elastic)]
    basis = [int(column) for column in fit.solution.basis]
    places = [basis.index(fit.model.index[name]) for name in names if fit.model.index[name] in basis]
    along = fit.covariance[:, places]
    return np.asarray(along @ np.linalg.pinv(along[places], hermitian=True) @ along.T)


def _collapsed(fit: DefaultFit, values: Array) -> str:
    """Return the stiffness that fell to a small part of the default estimate, if one did."""
    before = fit.solution.values
    for k, name in enumerate(fit.model.names):
        if name.kind == "K" and k in fit.solution.basis and before[k] > 0 and values[k] < COLLAPSED * before[k]:
            return name
    return ""


def judged(setup: Setup, outcome: Outcome) -> Accurate | Refusal:
    """Accept or refuse an outcome."""
    fit = setup.fit
    if len(outcome.costs) < 2 or not np.isfinite(outcome.costs[-1]):
        return Refusal("its cost did not fall")
    covariance = outcome.covariance[: len(outcome.p), : len(outcome.p)]
    rounding = 1e-9 * np.diag(fit.covariance)
    if not (
        np.isfinite(outcome.p).all() and np.isfinite(covariance).all() and np.all(np.diag(covariance) >= -rounding)
    ):
        return Refusal("its errors are not finite")
    values = values_of(setup, outcome)
    fallen = _collapsed(fit, values)
    if fallen:
        return Refusal(f"{fallen} fell towards 0, where with all inertias 0 the link's equation holds for any motion")
    transform = fit.transform
    known = fit.solution.estimable(transform)
    before, after = fit.deviations(fit.covariance), fit.deviations(covariance)
    both = known & (before > 0) & (after > 0)
    ratio = float(np.exp(np.mean(np.log(after[both] / before[both])))) if both.any() else 0.0
    if ratio > SHARPER:
        return Refusal(f"its standard errors are {ratio:.2g} times the default's")
    moved = np.abs(transform @ (values - fit.solution.values))
    far = known & (moved > MOVED * before)
    said = ""
    if far.any():
        worst = int(np.argmax(np.where(far, moved / np.maximum(before, 1e-300), 0.0)))
        said = f"{fit.base.names[worst]} moved by {moved[worst] / before[worst]:.0f} standard errors"
    effects = setup.equations.final_effects(outcome.z)
    return Accurate(values, covariance, effects, len(outcome.costs) - 1, setup.setting.width, far=said)
