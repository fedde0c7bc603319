"""Coarse or fine knots; what knots and valleys add to standard errors.

Three problems are solved, each more robust than the one before: coarse knots; fine knots with equations that hold as
closely as of slow links; fine knots with loose equations. The more efficient answer stands while it agrees with the
more robust one (Hausman 1978).

Empirical rules, each with the logs that it was read off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.collocation.bordered_banded import driven, variance_apart
from elid_cli.estimation.collocation.gauss_newton import Outcome
from elid_cli.estimation.collocation.problem import Iterate
from elid_cli.estimation.collocation.setup import FOLLOWED, FOLLOWED_LOOSELY, Setup, signal_to_noise
from elid_cli.estimation.collocation.starts import best_of, from_start, lowest, values_of

UNBENT, STRAIGHT = 84.0, 60.0
"""Signal-to-noise ratios of the positions, dB, from which on `widening` and `astray` have nothing to add."""


FEW_VALLEYS, MANY_VALLEYS = 70.0, 64.0
"""Signal-to-noise ratios, dB, between which `between_valleys` rises from 0 to …"""
VALLEYS = 0.45
"""… this part of the default estimate's standard errors."""
FOLLOWING, LAGGING = 80.0, 70.0
"""Signal-to-noise ratios, dB, between which `between_knots` rises from 0 to 1."""


def between_knots(ratio: float) -> float:
    """Return how far fine knots' standard errors have to reach towards coarse ones' answer, beyond what noise explains.

    At a signal-to-noise ratio of the positions, dB. Of 12 logs each of a planar arm (motions 1-4 and 5-8, 0.03 % of
    torque noise) errors were 1.4 to 2 standard errors rms at 66 and 70 dB in the worst parameter without it, 0.9 to 1.5
    with it; at 80 dB and above they are 1 without it, and of stiff arms coarse knots' answer is good for nothing.
    """
    return float(np.clip((FOLLOWING - ratio) / (FOLLOWING - LAGGING), 0.0, 1.0))


def between_valleys(ratio: float) -> float:
    """Return the part of the default's standard errors along rotor inertias that the collocation's have to contain.

    At a signal-to-noise ratio of the positions, dB. An inertia makes the motor ring against its link at a frequency,
    and the cost has a valley for every whole number of periods in the log, each narrow and as far apart as a part of
    the default's standard error: with positions so noisy, the lowest is the wrong one of one log in five.
    """
    return VALLEYS * float(np.clip((FEW_VALLEYS - ratio) / (FEW_VALLEYS - MANY_VALLEYS), 0.0, 1.0))


def widening(ratio: float) -> float:
    """Return the factor on standard errors of fine knots alone, at a signal-to-noise ratio of the positions, dB.

    An empirical rule, for who does not compare with coarse knots: on eight logs of the paper's robot (plain friction,
    motions 1-4) errors were 2.8 standard errors at 60 dB, 1.9 at 70 dB and 1.25 at 80 dB, rms.
    """
    return float(max(1.0, 10.0 ** ((UNBENT - ratio) / 50.0)))


def astray(ratio: float) -> float:
    """Return the factor on standard errors at a signal-to-noise ratio of the positions, dB, knots accounted for.

    An empirical rule for positions so noisy that the cost has several valleys along an inertia, each narrower than
    they lie apart: on motions 1-8 of the paper's robot, with nothing but position noise, errors were one standard error
    at 60 dB, rms, and twice that at 40 dB. Noise of the torque fills the valleys: above 57 dB the rule fades with it.
    """
    return float(max(1.0, 10.0 ** ((STRAIGHT - ratio) / 66.0)))


LEAST_PRICE = 0.2
"""Fall of minus twice the log-likelihood that each unknown of finer knots must bring, at least; 1 in noisy torques."""
AGREE, AGREE_LOOSELY = 2.25, 3.0
"""Standard deviations of what noise alone takes two answers apart, up to which they agree: of coarse and fine knots,
and of fine ones with close and loose equations. Measured (planar arm, 80 dB, 0.1 % of torque noise, 40 logs): where
coarse knots stand up to 3, errors are 1.6 of their standard errors and a quarter larger; up to 2.25 they are 1.1 of
them. Loose equations cost more: without noise, errors five times larger where close ones stand up to 2.25 only."""


@dataclass(frozen=True)
class Knotted:
    """An outcome and the problem with the knots that the data speak for."""

    setup: Setup
    outcome: Outcome
    apart: Array
    """What the knots decide: fine ones' answer minus coarse ones' as far as noise does not explain it, (p + e,)."""
    rivals: tuple[Outcome, ...] = ()
    """Outcomes in other valleys of the shapes that explain the log as well."""


def with_knots(coarse: Setup) -> Knotted:
    """Return the outcome with coarse knots, or with fine ones where they are worth their number (Akaike).

    Between two knots a trajectory is free in as many ways as torques are noisy: where none is, the equations of motion
    decide all of it, and finer knots cost little. Coarse ones that are not worth less stand where fine ones' answer
    agrees with theirs: otherwise they bend a motion that they cannot follow.
    """
    found, rivals = best_of(coarse)
    stands = Knotted(coarse, found, np.zeros(coarse.fit.triangles.width), rivals)
    if coarse.coarser == 1 or coarse.noisy:  # finer ones would follow the positions' noise
        return stands
    fine = Setup(coarse.fit, followed=FOLLOWED)
    start = fine.start_from(coarse, found.end)
    outcome = from_start(fine, start)
    if not _agree(fine, outcome, coarse, found):
        outcome = lowest(fine, [outcome, from_start(fine, fine.start)])
    worth = _worth_it(fine, start, outcome)
    loose = Setup(coarse.fit, followed=FOLLOWED_LOOSELY, loose=True)
    looser = from_start(loose, outcome.end)
    apart, noise = _apart(loose, looser, fine, outcome)
    own = np.zeros(len(apart))
    own[loose.p_columns] = np.diag(looser.covariance)[: len(looser.p)]
    if np.any(apart**2 > np.maximum(AGREE_LOOSELY**2 * noise, own)):
        fine, outcome = loose, looser
    if not worth and _agree(fine, outcome, coarse, found):
        return stands
    rivals = ()
    if fine.z_start.size:
        outcome, rivals = best_of(fine, outcome)
    way = between_knots(signal_to_noise(coarse.fit.signals, coarse.fit.model))
    return Knotted(fine, outcome, way * _beyond_noise(fine, outcome, coarse, found), rivals)


def _apart(one: Setup, this: Outcome, other: Setup, that: Outcome) -> tuple[Array, Array]:
    """Return one answer minus another, which has no finer knots, and the variance of it by noise alone, (p + e,)."""
    apart = values_of(one, this) - values_of(other, that)
    noise = np.zeros(len(apart))
    alone = variance_apart(this.influence, that.influence, driven(other.problem))
    noise[other.p_columns] = alone[: len(that.p)]
    return apart, noise


def _agree(one: Setup, this: Outcome, other: Setup, that: Outcome) -> bool:
    """Whether two answers lie no further apart than noise takes them."""
    apart, noise = _apart(one, this, other, that)
    return bool(np.all(apart**2 <= AGREE**2 * noise))


def _beyond_noise(one: Setup, this: Outcome, other: Setup, that: Outcome) -> Array:
    """Return what noise does not explain of one answer minus another, (p + e,)."""
    apart, noise = _apart(one, this, other, that)
    return np.asarray(np.sign(apart) * np.sqrt(np.maximum(apart**2 - noise, 0.0)))


def _worth_it(fine: Setup, start: Iterate, outcome: Outcome) -> bool:
    """Whether fine knots gain what their number costs, from the coarse ones' trajectory on."""
    least, problem = fine.first_rho(), fine.problem
    problem.trust(start, outcome.end)
    gain = problem.deviance(start, least) - problem.deviance(outcome.end, least)
    more = sum(own.size for own in start.coefficients) * (1.0 - 1.0 / fine.coarser)
    return bool(gain >= max(LEAST_PRICE, fine.torque_share()) * more)
