"""The best fit asked again: other rows, knots, halves of the log, richer friction, lost motion, joints made rigid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.best_end import Search
from elid_cli.estimation.motor_side.columns import FLOORS, LOST_SHARE, MISFIT
from elid_cli.estimation.motor_side.iteration import Iteration
from elid_cli.estimation.motor_side.latent import Friction, Latent
from elid_cli.estimation.motor_side.latent_fit import LatentFit, fit
from elid_cli.estimation.motor_side.link_sensors import watched
from elid_cli.estimation.motor_side.motor_log import MotorLog, Samples
from elid_cli.estimation.motor_side.unknowns import Unknowns

LOWER_CUT, FINER = 0.75, 0.75
"""Cut-off of the torque rows over the end of the band, and distance of knots over the first one, of two refits."""
LOWEST_CUT = 0.3
"""The same of a third one: what bends further up, a link's own mode for one, hardly acts there."""
GAIN = 2.0
"""Least cost of a rigid joint over the cost."""
WIDTHS = (0.4, 2.5)
"""Factors on the speed within which friction changes its sign, of refits of motion below an antiresonance."""
PATIENT = Iteration(60, 1e-5)
"""How a fit iterates along a flat valley, where the cost falls little in a step."""
MOVED = Iteration(15, np.inf, settle=True, least=3, near=2e-4)
ROUGHLY = replace(MOVED, near=0.003, least=2)
"""How a fit iterates of which the compliances alone are asked, and where they are held against a gate of percents."""
WATCHED = 25
"""Every so many samples are looked at for what sensors on links tell."""
CLEAR = 3.0
"""Least rise of a foreseen cost over the one that is asked about that settles the question."""
_SHARPER = 0.4
"""Torque over which lost motion is passed where the model has some already, share of the transmission's."""


@dataclass(frozen=True)
class Moves:
    """How far the compliances move in refits, shares of them, (n,) each."""

    cut: Array
    low: tuple[Array, Array]
    """With the lowest cut-off: move and standard error."""
    knots: Array
    halves: tuple[tuple[Array, Array], ...]
    """Per half of the stretch: move and standard error."""
    friction: Array
    friction_gain: float
    """Cost over that with richer friction."""
    spring: Array
    other_ends: tuple[tuple[Array, float], ...]
    """Distances of other ends' compliances, as logarithms, and their costs over the best one's."""


@dataclass(frozen=True)
class Figures:
    """What the gates look at; arrays are (n,)."""

    compliance: Array
    error: Array
    chi: float
    delay: float
    damping: Array
    """T = D/K, s."""
    rotor: Array
    """J at the joint, kg·m²."""
    rotor_pull: Array
    """Distance of J from what was known, in its standard deviations."""
    rotor_sensitivity: Array
    """Share by which the compliance moves with a standard deviation of what was known of a rotor."""
    load_friction: Array
    load_friction_error: Array
    band: Array
    antiresonance: Array
    """sqrt(K (M^-1)_ii) / 2π, Hz: this motor locked, all other links free; the antiresonance at most."""
    least_mass: float
    """Smallest eigenvalue of the links' mass matrix."""
    gain: Array
    """Cost with one joint made rigid, over the cost; infinite where the misfit refuses every joint already."""
    fall: float
    """Share by which further steps lowered the cost."""
    moved: Array
    """Share by which they moved the compliance."""
    watched: NDArray[np.bool_]
    """Whether sensors on links tell a link's own motion: then it need not pass its antiresonance."""
    borne: bool = True
    """Whether it fits with a third of the torque rows' usual least noise."""
    sharper: Array | None = None
    """Share by which the compliance moved with the least noise of the torque rows that was tried."""
    moves: Moves | None = None
    """None where the rest refuses every joint already."""


class _Refits:
    def __init__(self, found: Search) -> None:
        self.setting, self.best, self.floor = found.setting, found.best, found.floor
        self.n = self.setting.link.n

    def fitted(
        self, log: MotorLog | None = None, *, spacing: float = 0.0, cutoff: float = 0.0,
        further: Sequence[Friction] = (), lost_scale: Array | None = None, held: tuple[int, float] | None = None,
        how: Iteration = MOVED,
    ) -> LatentFit | None:  # fmt: skip
        """Return a refit from the best fit's end, or None where it fails; `held`: a joint at a compliance, 0 if rigid.

        With further friction, that of the load is free as well; with a scale of what is lost in springs, that part.
        """
        best, setting, log = self.best, self.setting, log or self.best.problem.log
        unknowns = Unknowns(setting.link, len(further))
        scale = best.problem.lost_scale if lost_scale is None else lost_scale
        parts = *(("load",) if further else ()), *(() if lost_scale is None else ("lost",))
        wanted = tuple(dict.fromkeys([*best.problem.parts, *parts]))
        problem = Latent(log, unknowns, spacing or setting.spacing, setting.rotors, wanted, scale, further)
        x, free = np.zeros(unknowns.size), unknowns.free()
        x[: len(best.x)] = best.x
        q = best.problem.spline.at(log.t, best.coefficients)
        same = log is best.problem.log and problem.spline is best.problem.spline
        if held is not None:
            joint, compliance = held
            x[unknowns["c"][joint]], free[unknowns["c"][joint]] = compliance, False
            if compliance == 0.0:
                q[:, joint], same = log.theta[:, joint], False
        problem.filter_torque(cutoff or setting.cutoff, self.floor)
        try:
            return fit(problem, x, best.coefficients if same else problem.spline.fit(q), free, how)
        except (np.linalg.LinAlgError, ValueError):
            return None

    def move(self, found: LatentFit | None) -> Array:
        """Return how far a refit moved every compliance, as a share of it, (n,); infinite where it failed."""
        if found is None:
            return np.full(self.n, np.inf)
        with np.errstate(all="ignore"):
            return np.asarray(found.compliance / self.best.compliance - 1)

    def low(self) -> tuple[Array, Array]:
        found = self.fitted(cutoff=LOWEST_CUT * self.setting.band)
        if found is None:
            return np.zeros(self.n), np.full(self.n, np.inf)
        return self.move(found), self._own_error(found)

    def halves(self) -> tuple[tuple[Array, Array], ...]:
        samples, log = self.setting.samples, self.best.problem.log
        middle = len(samples.t) // 2
        return tuple(self._half(samples.part(part), log) for part in (slice(0, middle), slice(middle, len(samples.t))))

    def _half(self, part: Samples, whole: MotorLog) -> tuple[Array, Array]:
        log = MotorLog(part, 2 / self.setting.spacing)
        log.sensed_noise, log.sensed_size = whole.sensed_noise, whole.sensed_size
        log.theta_noise, log.tau_noise, log.torque = whole.theta_noise, whole.tau_noise, log.torque
        found = self.fitted(log, how=ROUGHLY)
        if found is None:
            return np.full(self.n, np.inf), np.zeros(self.n)
        return self.move(found), self._own_error(found)

    def _own_error(self, found: LatentFit) -> Array:
        """Return the standard errors that a refit's noise gives its compliances, shares of the best fit's, (n,)."""
        variance = np.abs(np.diag(found.covariance)[found.problem.unknowns["c"]])
        error: Array = np.sqrt(variance * max(1.0, found.foreseen / found.freedom)) / np.abs(self.best.compliance)
        return error

    def frictions(self) -> list[Friction]:
        """Return a bump, a square and a wider friction of every joint."""
        width, found = self.best.problem.log.width, []
        for j in range(self.n):
            typical = 0.1 * float(np.sqrt(np.mean(self.best.model.speed[:, j] ** 2))) + 2 * width[j]
            found += [
                Friction(j, "bump", typical, float(width[j])),
                Friction(j, "square", 1.0, float(width[j])),
                Friction(j, "wide", 4 * float(width[j]), float(width[j])),
            ]
        return found


def first_figures(found: Search) -> Figures:
    """Return what the gates look at of a search's best end and of refits with one joint made rigid."""
    refits, best, setting = _Refits(found), found.best, found.setting
    at, x, n = best.problem.unknowns.places, best.x, setting.link.n
    gain = np.full(n, np.inf)
    for j in np.flatnonzero(setting.link.elastic).tolist() if best.chi <= MISFIT else ():
        rigid = refits.fitted(held=(j, 0.0), how=Iteration(12, high=GAIN * best.cost, above=CLEAR * GAIN * best.cost))
        gain[j] = 1.0 if rigid is None else rigid.cost / best.cost
    prior, V, J = setting.rotors, best.covariance, x[at["J"]]
    with np.errstate(all="ignore"):
        sensitivity = np.abs(V[np.ix_(at["c"], at["J"])] / prior.spread).max(axis=1) / np.abs(best.compliance)
        pull = np.where(setting.link.elastic, (J - prior.value) / prior.spread, 0.0)
    usual = found.usual.errors[at["c"]] / np.maximum(np.abs(found.usual.compliance), 1e-300)
    least = usual if found.stuck is None else np.maximum(usual, found.stuck)
    error = np.maximum(best.errors[at["c"]], least * np.abs(best.compliance))
    places = [mounted.places for mounted in best.problem.mounted(x)]
    return Figures(
        best.compliance, error, best.chi, float(x[at["delay"][0]]), x[at["damping"]], J, pull,
        sensitivity, x[at["load"]], best.errors[at["load"]], setting.bands, *_frequencies(best), gain, found.fall,
        found.moved, watched(best.problem.link.sensed, places, setting.link.elastic, best.model.q[0][::WATCHED]),
        borne=found.borne, sharper=found.sharper,
    )  # fmt: skip


def with_moves(found: Search, told: Figures) -> Figures:
    """Return figures with how far the compliances move in refits of other rows, knots, stretches and models."""
    refits, best, setting = _Refits(found), found.best, found.setting
    finer = setting.spacing * FINER
    share = _SHARPER if "lost" in best.problem.parts else LOST_SHARE
    friction = refits.fitted(further=refits.frictions())
    spring = refits.fitted(lost_scale=share * best.model.spring.std(axis=0))
    moves = Moves(
        cut=refits.move(refits.fitted(cutoff=LOWER_CUT * setting.band, how=ROUGHLY)),
        low=refits.low(),
        knots=refits.move(refits.fitted(MotorLog(setting.samples, 2 / finer), spacing=finer, how=ROUGHLY)),
        halves=refits.halves(),
        friction=refits.move(friction),
        friction_gain=0.0 if friction is None else best.foreseen / friction.foreseen,
        spring=refits.move(spring),
        other_ends=_other_ends(found),
    )
    return replace(told, moves=moves)


def rise(found: Search, joint: int, share: float, least: float) -> float:
    """Return the least rise of the cost, in units of the misfit, with a compliance held off by ± a share of it.

    No more than is needed to tell whether it is above `least`.

    Where a valley of the cost is bent or has neighbours, a standard error from its curvature promises too much.
    """
    refits, best = _Refits(replace(found, best=found.usual, floor=FLOORS[-1][0])), found.usual
    unit = max(1.0, best.chi)
    lowest, limit = np.inf, best.cost + least * unit
    how = replace(PATIENT, low=limit, high=limit, above=best.cost + CLEAR * least * unit)
    for sign in (-1, 1):
        held = joint, float(best.compliance[joint]) * (1 + sign * share)
        end = refits.fitted(held=held, how=how)
        lowest = min(lowest, np.inf if end is None else (end.cost - best.cost) / unit)
        if lowest < least:
            break
    return float(lowest)


def friction_width(found: Search) -> Array:
    """Return how far the compliances move where friction changes its sign within other speeds, (n,)."""
    refits, setting = _Refits(found), found.setting
    moves = []
    for factor in WIDTHS:
        samples = replace(setting.samples, width=factor * setting.samples.width)
        log = MotorLog(samples, 2 / setting.spacing)
        log.theta_noise, log.tau_noise = found.best.problem.log.theta_noise, found.best.problem.log.tau_noise
        moves.append(np.abs(refits.move(refits.fitted(log, how=ROUGHLY))))
    return np.asarray(np.max(moves, axis=0))


def _other_ends(found: Search) -> tuple[tuple[Array, float], ...]:
    """Return how far the compliances of other ends lie away, as logarithms, and their costs over the best one's."""
    best, *others = found.ends
    least = np.maximum(best.compliance, 1e-15)
    return tuple((np.abs(np.log(np.maximum(end.compliance, 1e-15) / least)), end.cost / best.cost) for end in others)


def _frequencies(best: LatentFit) -> tuple[Array, float]:
    """Return the antiresonance of every joint, Hz, and the mass matrix's smallest eigenvalue."""
    problem = best.problem
    M = problem.link.mass(best.model.q[0][::25], best.x[problem.unknowns["p"]])
    inverse = np.linalg.pinv(M).diagonal(axis1=1, axis2=2).mean(axis=0)
    anti = np.sqrt(np.maximum(inverse, 0) / np.maximum(best.compliance, 1e-300)) / (2 * np.pi)
    return anti, float(np.linalg.eigvalsh(M).min())
