"""From figures to verdicts: supported, weak or refused, with the gates that a joint did not pass.

The thresholds were frozen before they were tried on fresh simulated logs (docs/how-to/motor-side.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elid_cli.estimation.motor_side.best_end import CLOSE, CREEPS, FALL
from elid_cli.estimation.motor_side.columns import EXPLAINED, MISFIT, UNFIT
from elid_cli.estimation.motor_side.refits import GAIN, Figures, Moves
from elid_cli.estimation.motor_side.result import LACKS
from elid_cli.estimation.result import Verdict

CRAWLS = 1e-4
"""Fall of the cost in further steps, share of it, that asks for a look at the valley; `FALL` is the most allowed."""
STILL = 0.1
"""Share of `MOVE` to which a compliance has settled where they may lower it by `CREEPS`. Such a fit's valley is looked
at, too."""
SURE = 5.0
"""Compliance over its standard error, at least; the standard error over the compliance, at most: `CLOSE`."""
NEGATIVE = 3.0
"""Standard errors beyond which a compliance below zero is impossible, as for all parameters (`validation.verdicts`)."""
QUIET_GAIN = 1.5
"""The same as `GAIN` where the fit leaves the sensors' noise alone: no rigid joint leaves half as much again by chance,
and what a compliance could imitate would leave more than noise itself."""
LOWEST = 0.98
"""Least cost of any rigid joint over the cost; of the joint itself: `GAIN`."""
MOVE, HALVES = 0.03, 0.05
"""Most that the compliance may move in a refit, and on half of the log."""
DOUBT = 3.0
"""Standard errors of the refit to low frequencies that are allowed beyond that."""
FRICTION_GAIN, FRICTION_MOVE = 1.6, 0.01
"""Where richer friction lowers the cost by this factor, most that the compliance may move."""
PULL, PULL_OTHER = 2.5, 5.0
"""Most that a rotor's inertia may differ from what was told, own and others, in standard deviations."""
SENSITIVITY = 0.02
TIGHT = 0.003
"""Standard error, share of the compliance, from which on its valley is looked at away from its bottom."""
RISES = {"supported": (0.05, 4.0), "weak": (0.1, 9.0)}
"""By verdict: a share off the compliance, and how much the cost must rise there, in squared standard deviations."""
REACH = 1.05
"""Least ratio of the band's end and the antiresonance."""
OTHER, OTHER_COST = 0.05, 1.2
DELAY = 3e-3
DAMPING = 0.3
"""Most of 2π antiresonance D/K: beyond, the second order of the damper does not suffice."""
LOAD = (0.01, 0.3)
"""Load friction brakes, and stays a friction."""
SPRINGLESS, SHARED = frozenset({"sign", "sure"}), frozenset({"other_rotor", "negative", "others", "mass"})
"""Gates that a joint whose spring does not show fails; those that one fails for what was found of other joints."""

WORDS = {
    "sign": "a rigid joint fits as well",
    "gain": "a rigid joint fits nearly as well",
    "band": "the motion ends below the antiresonance",
    "misfit": "the fit leaves far more than the sensors' noise: the model lacks something, or the search ended beside "
    "the best fit",
    "noise": "the torque is fitted to some 0.3 %, but not to 0.1 % or the sensors' noise",
    "sharper": "it moves with how closely the torque must be fitted",
    "sure": "the compliance is within its error of none",
    "close": "its standard error is above 3 %",
    "settled": "the fit does not settle",
    "lowest": "a rigid joint fits better than what was found",
    "cut": "it moves with the frequencies that are used",
    "knots": "it moves with the spline's knots",
    "friction": "it moves with the form of friction",
    "spring": "it moves with lost motion in the transmission",
    "halves": "halves of the log disagree",
    "rotor": "the rotor's inertia contradicts the robot file",
    "other_rotor": "another joint's rotor inertia contradicts the robot file, so the fit as a whole is wrong",
    "rotor_told": "it follows the rotor's inertia in the robot file",
    "other_end": "another stiffness fits as well",
    "valley": "values further off fit nearly as well",
    "delay": "the torques' delay is too long",
    "damping": "the transmission's damping is too strong",
    "load": "load friction has no possible value",
    "mass": "the links' inertia is not positive",
    "others": "another joint moves with the part of the log that is used, may be rigid or have another stiffness, so "
    "the fit is not the best",
    "negative": "a joint's compliance comes out negative beyond its error, so the fit as a whole is wrong",
}
"""Why a gate was not passed, the weightiest first."""


def verdict_of(failed: Sequence[str]) -> Verdict:
    """Return the verdict that failed gates mean."""
    if not failed:
        return "supported"
    return "weak" if list(failed) == ["band"] else "refused"


def suffices(failed: Sequence[str], band: float, antiresonance: float) -> bool:
    """Return whether a motion shows all that one can: it passes the antiresonance, Hz, and the model lacks more."""
    return bool(LACKS & set(failed)) and band >= REACH * antiresonance


def taken_as_rigid(failed: Sequence[Sequence[str]], asked: Sequence[int]) -> list[int]:
    """Return the joints that are to be taken as rigid: no spring shows there, and others are refused for that alone."""
    springless = [k for k in asked if SPRINGLESS & set(failed[k])]
    waiting = [k for k in asked if k not in springless and failed[k] and set(failed[k]) <= SHARED]
    return springless if waiting else []


def failed_gates(told: Figures, joint: int) -> list[str]:
    """Return the names of the gates that a joint does not pass, as in `WORDS`."""
    stable = _stable(told.moves, joint, told.chi) if told.moves else []
    return [*_seen(told, joint), *stable, *_possible(told, joint), *_shared(told, joint)]


def _seen(told: Figures, i: int) -> list[str]:
    """Return failed gates about what the log shows at all."""
    c, error = told.compliance[i], told.error[i]
    if not (np.isfinite(c) and c > 0):
        return ["sign"]
    checks = {
        "sure": c >= SURE * error,
        "close": error <= CLOSE * c,
        "band": told.watched[i] or told.band[i] >= REACH * told.antiresonance[i],
        "misfit": told.chi <= MISFIT,
        "noise": told.borne,
        "sharper": told.sharper is None or abs(told.sharper[i]) < MOVE,
        "gain": told.gain[i] >= (QUIET_GAIN if told.chi <= EXPLAINED else GAIN),
        "settled": told.fall < FALL or (told.fall < CREEPS and told.moved[i] < STILL * MOVE),
        "lowest": told.gain.min() > LOWEST,
    }
    return [name for name, passed in checks.items() if not passed]


def _stable(asked: Moves, i: int, chi: float) -> list[str]:
    """Return failed gates about whether other rows, models and starts say the same.

    Where the best end of a search is far from noise, its starts must agree, whatever the others cost: a search that
    found nothing better may not have found the valley.
    """
    moves = {"friction": asked.friction, "spring": asked.spring}
    failed = _rows_disagree(asked, i) + [name for name, move in moves.items() if not abs(move[i]) < MOVE]
    if asked.friction_gain > FRICTION_GAIN and not abs(asked.friction[i]) < FRICTION_MOVE and "friction" not in failed:
        failed.append("friction")
    if any(far[i] > OTHER and (cost < OTHER_COST or chi > UNFIT) for far, cost in asked.other_ends):
        failed.append("other_end")
    return failed


def _rows_disagree(asked: Moves, i: int) -> list[str]:
    """Return failed gates about whether other rows of the same model say the same."""
    low, low_error = asked.low
    moves = {"cut": asked.cut, "knots": asked.knots}
    failed = [name for name, move in moves.items() if not abs(move[i]) < MOVE]
    if not abs(low[i]) < MOVE + DOUBT * low_error[i] and "cut" not in failed:
        failed.append("cut")
    (one, one_error), (two, two_error) = asked.halves
    apart = max(HALVES, 4 * float(np.hypot(one_error[i], two_error[i])))
    if not (max(abs(one[i]), abs(two[i])) < HALVES and abs(one[i] - two[i]) < apart):
        failed.append("halves")
    return failed


def _shared(told: Figures, i: int) -> list[str]:
    """Return the failed gate about the other joints.

    Where a fit leaves more than noise and a joint that is elastic beyond doubt moves with the rows that are used, or
    may be rigid, or has another stiffness that fits as well, the whole is not the valley's bottom, and the others have
    made up for it.
    """
    if told.moves is None or told.chi <= EXPLAINED:
        return []
    sure = told.compliance >= SURE * told.error
    others = [k for k in np.flatnonzero(sure).tolist() if k != i]
    doubtful = any(told.gain[k] < GAIN or _rows_disagree(told.moves, k) for k in others)
    rival = any(far[k] > OTHER and cost < OTHER_COST for far, cost in told.moves.other_ends for k in others)
    return ["others"] if doubtful or rival else []


def _possible(told: Figures, i: int) -> list[str]:
    """Return failed gates about whether the other unknowns have possible values, those of other joints included."""
    pull = np.abs(told.rotor_pull)
    others = np.delete(pull, i)
    load, load_error = told.load_friction[i], told.load_friction_error[i]
    checks = {
        "rotor": pull[i] <= PULL,
        "other_rotor": others.max(initial=0.0) <= PULL_OTHER,
        "rotor_told": told.rotor_sensitivity[i] <= SENSITIVITY,
        "delay": abs(told.delay) <= DELAY,
        "damping": abs(told.damping[i]) * 2 * np.pi * told.antiresonance[i] <= DAMPING,
        "load": -LOAD[0] - 3 * load_error < load < LOAD[1],
        "mass": told.least_mass > 0,
        "negative": not np.any(told.compliance < -NEGATIVE * told.error),
    }
    return [name for name, passed in checks.items() if not passed]
