"""How large columns are beside all parameters of a fit, where their size says what is left of them in noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.estimation.data import Solved
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.judgement import NotExcluded
from elid_cli.estimation.regression.standard_errors import covariance_of
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.estimation.stiffness.noise import LARGEST_SHARE, shares_of_noise, with_pull
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.harmonics import PHASE
from elid_cli.model.regressor import EstimationRow

TAKEN_UP = "the bodies' parameters would have taken it up"
"""By what a note that marks such parameters is known."""
COUNTS, FAR_OFF = 1e-3, 8.0
"""Part of the torque from which it is worth saying what a log would not show, and by how many of its standard errors
some base parameter must be off with that."""
SAME = 1e-9
"""Part of a column that may be left beside others that hold it."""
MOVED = 2.0
"""Standard errors by which a gain moves a base parameter that may be biased."""


class Size(NamedTuple):
    """What a fit says of a column beside all its parameters."""

    values: Array
    """Coefficients, (d,)."""
    covariance: Array
    """Of them, (d, d)."""
    sure: float
    """By how many standard errors they differ from 0 together."""
    shift: Array
    """By how many of their standard errors they move base parameters, (b,)."""
    loose: Array
    """The same by which base parameters may be off, as the size has an error of its own, (b,)."""
    slopes: Array
    """The same by which coefficients of 1 would move them, (b, d)."""

    @property
    def errors(self) -> Array:
        """Standard errors of the coefficients, (d,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def moved(self) -> NDArray[np.bool_]:
        """Base parameters that they move by several of their standard errors, (b,)."""
        moved: NDArray[np.bool_] = self.shift > MOVED
        return moved


def bound_of(fit: DefaultFit, effect: Effect, extra: ExtraColumns, asked: Size, least: float) -> NotExcluded | None:
    """Return up to which size an effect would not show, if that is a part of some torque and moves a parameter.

    Of amplitudes that are of one kind it is the one that is known worst: of a tilt that angle, of a sine any phase.

    Parameters
    ----------
    fit
        The fit beside which it was asked.
    effect
        The effect. What is told is its first amplitude where the others are of another kind.
    extra
        Its columns.
    asked
        What the fit says of its size.
    least
        Standard errors by which it must differ from 0 to be told.
    """
    joint, kinds = fit.model.robot.joints[effect.joint], effect.amplitudes
    which = int(np.argmax(asked.errors)) if effect.whole_robot else 0
    squares, directions = np.linalg.eigh(asked.covariance)
    any_phase = len(kinds) == 2 and kinds[1] == PHASE
    worst = directions[:, -1] if any_phase else np.eye(len(kinds))[which]
    size = least * (float(np.sqrt(max(squares[-1], 0.0))) if any_phase else float(asked.errors[which]))
    moves = size * float(np.abs(asked.slopes @ worst).max(initial=0.0))
    groups = [g for g in fit.observation.groups if g.row.kind == "sum" and g.row in extra.rows and g.use.any()]
    shares = [_rms(worst @ extra.rows[g.row][:, g.use]) / max(_rms(g.target[g.use]), 1e-300) for g in groups]
    share = size * max(shares, default=0.0)
    if not (COUNTS <= share <= 1.0 and moves > FAR_OFF):
        return None
    unit = kinds[which].unit_at(slides=not (joint.revolute or effect.whole_robot))
    return NotExcluded(effect.name, effect.joint_name(fit.model.robot), kinds[which].name, size, unit, moves)


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def askable(fit: DefaultFit) -> bool:
    """Whether sizes may be asked of a fit: of logged torques, and beside columns that are certain."""
    return not fit.data.facts.computed.any() and (fit.effects is None or fit.effects.certain)


def size_beside(fit: DefaultFit, extra: ExtraColumns, quiet: Mapping[EstimationRow, float]) -> Size | None:
    """Return how large columns are beside all parameters; None where they do not show, or more than noise is left.

    Parameters
    ----------
    fit
        The fit, whose samples are at hand.
    extra
        The columns.
    quiet
        Residual of the rows, N·m (N), up to which noise is all that is left.
    """
    within = {k: held for k, n in enumerate(fit.nuisances) if (held := _within(n, extra)) is not None}
    kept = tuple(nuisance for k, nuisance in enumerate(fit.nuisances) if k not in within)
    solved = Solved.of(fit.base, fit.data, (*kept, extra), fit.effects)
    first = fit.model.parameters + len(kept)
    columns = range(first, first + extra.width)
    basis = solved.solution.basis
    rest = {row: solved.triangles.rms(solved.solution.values, row) for row in quiet if row in solved.triangles.rows}
    shown = all(column in basis and solved.solution.determined(column) for column in columns)
    if not shown or any(rest[row] > quiet[row] for row in rest) or _for_noisy_deflection(solved, extra):
        return None
    where = [int(np.flatnonzero(basis == column)[0]) for column in columns]
    values: Array = solved.solution.values[columns]
    facts = fit.data.facts
    whole = with_pull(fit.model, solved.triangles, solved.solution, covariance_of(solved), facts.deflection_noise)
    covariance = whole[np.ix_(where, where)]
    beyond = _beyond(len(values), list(within.values()))  # what is no more than the fault that they hold is none
    square = float(beyond @ values @ np.linalg.pinv(beyond @ covariance @ beyond.T) @ beyond @ values)
    sure = float(np.sqrt(max(square, 0.0)))
    shift = np.abs(solved.transform @ solved.solution.values - fit.transform @ fit.solution.values)
    before = fit.deviations(fit.covariance)
    grown = np.maximum(solved.deviations(whole) ** 2 - before**2, 0.0)
    shift, loose = (_over(size, before) for size in (shift, np.sqrt(shift**2 + grown)))
    together = solved.transform[:, basis] @ whole[:, where] @ np.linalg.pinv(covariance)
    slopes = np.stack([_over(np.abs(column), before) * np.sign(column) for column in together.T], axis=1)
    return Size(values, covariance, sure, shift, loose, slopes)


def size_in_words(fit: DefaultFit, effect: Effect, asked: Size) -> str:
    """Return the sizes of an effect's amplitudes with their standard errors and units."""
    joint = fit.model.robot.joints[effect.joint]
    return in_words([
        f"{p.name} {value:.3g} ± {error:.2g} {p.unit_at(slides=not (joint.revolute or effect.whole_robot))}"
        for p, value, error in zip(effect.amplitudes, asked.values, asked.errors, strict=True)
    ])  # fmt: skip


def _within(nuisance: ExtraColumns, extra: ExtraColumns) -> Array | None:
    """Return the coefficients with which columns are a fault of the measurement, (d,); None where they hold it not.

    The angle of rest of a spring is an offset of the torque, too.
    """
    if nuisance.width != 1 or not nuisance.rows or not set(nuisance.rows) <= set(extra.rows):
        return None
    own = np.concatenate([np.atleast_2d(nuisance.rows[row]) for row in nuisance.rows], axis=1).T
    held = np.concatenate([np.atleast_2d(extra.rows[row]) for row in nuisance.rows], axis=1).T
    coefficients: Array = np.linalg.lstsq(held, own, rcond=None)[0]
    left = float(np.linalg.norm(own - held @ coefficients))
    return coefficients[:, 0] if left <= SAME * float(np.linalg.norm(own)) else None


def _beyond(count: int, held: list[Array]) -> Array:
    """Return directions of `count` coefficients that are none of those given, (r, count)."""
    if not held:
        return np.eye(count)
    _, sizes, rows = np.linalg.svd(np.array(held))
    return rows[int(np.count_nonzero(sizes > SAME * sizes.max())) :]


def _over(sizes: Array, deviations: Array) -> Array:
    """Return sizes over standard errors, (b,)."""
    return np.divide(sizes, deviations, out=np.where(sizes > 0, np.inf, 0.0), where=deviations > 0)


def _for_noisy_deflection(solved: Solved, extra: ExtraColumns) -> bool:
    """Whether columns stand for a deflection in which noise decides beside them: without it, for the spring's torque.

    A predicted torque is free of the encoders' noise, and explains a motor's row better than a deflection near their
    step: by a gain of 1, and no stiffness.
    """
    noise = solved.data.facts.deflection_noise
    shares = shares_of_noise(solved.model, solved.triangles, solved.solution, noise)
    return any(row.kind == "motor" and shares.get(row.joint, 0.0) > LARGEST_SHARE for row in extra.rows)
