"""From the ends of a search to the fit that is believed: gone on with until it rests and bears what sensors tell."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.columns import EXPLAINED, FLOORS, MISFIT, UNFIT
from elid_cli.estimation.motor_side.iteration import Iteration
from elid_cli.estimation.motor_side.latent_fit import LatentFit, fit
from elid_cli.estimation.motor_side.setting import Setting

FURTHER, FALL, _RUNS = Iteration(20, 1e-4, least=1), 0.001, 4
"""How the best end is gone on from, the fall of its cost, share of it, that ends it, and the most times: a fit that
crawls has not found its valley's bottom, whatever it looks like."""
SHARPER_FLOORS, SHARPLY = (1e-3, 3e-4, 1e-4), Iteration(30, 1e-3, settle=True, least=3)
"""Least noises of the torque rows, shares of the torque, that the best end is asked to bear one after the other while
the sensors are finer, and how it iterates there: until its compliances have settled."""
BORNE = 1.25
"""Most misfit with the first of them, or with the sensors' own noise where that is larger. Measured: simulated logs at
their valleys up to 1.07, beside them from 1.3 on, with stiffnesses up to 9 % off."""
CREEPS, RESTS = 0.03, 1e-4
"""Most that further steps may lower the cost of a fit that leaves noise alone and whose compliances move by less than
this share: friction's kinks settle last."""
WIDTHS, QUIETEST, FAR = (0.5, 0.25, 2.0), 1.03, 1.05
"""Factors on the speed within which friction changes its sign, the misfit from which on they are tried, and the cost
over that of the usual one from which on no more of one is looked at."""


@dataclass(frozen=True)
class Search:
    """What a search found."""

    setting: Setting
    best: LatentFit
    """The end of least cost, gone on with."""
    floor: float
    """Least noise of the best end's torque rows, share of the torque."""
    borne: bool
    """Whether it fits with the first of `SHARPER_FLOORS`."""
    usual: LatentFit
    """The same with the last of `FLOORS`."""
    sharper: Array
    """Share by which its compliances moved with the last of these floors that was tried, (n,): as much may still be hid
    by it. 0 where the sensors' own noise hides more."""
    ends: tuple[LatentFit, ...]
    """All ends as they were found, the best first."""
    fall: float
    """Share by which the cost of the best end fell in further steps."""
    moved: Array
    """Share by which its compliances moved in them, (n,)."""
    stuck: Array | None = None
    """Least standard errors, shares of the compliances, (n,), of a fit that stayed where that of rougher sensors ended.
    """


def concluded(setting: Setting, ends: Sequence[LatentFit], hopeless: Sequence[LatentFit] = ()) -> Search:
    """Return a search with its best end gone on with, unless that is among the hopeless ones.

    Where that end leaves more than the sensors' noise, friction may turn its sign within another speed.
    """
    none = np.zeros(setting.link.n)
    if any(ends[0] is end for end in hopeless):
        return Search(setting, ends[0], FLOORS[-1][0], False, ends[0], none, tuple(ends), 0.0, none)
    found = _sharpest(setting, ends[0], ends)
    if (found.borne and found.best.chi <= QUIETEST) or found.best.chi > MISFIT:
        return found
    others = []
    for factor in WIDTHS:
        with suppress(np.linalg.LinAlgError, ValueError):
            other = replace(setting, samples=replace(setting.samples, width=factor * setting.samples.width))
            limit = found.usual.cost if found.borne else np.inf
            usual = _with_floor(other, found.best, FLOORS[-1][0], limit)
            if usual.cost > limit:
                continue
            others.append((_with_floor(other, usual, SHARPER_FLOORS[0]).chi, other, usual))
    if others:
        _, other, usual = min(others, key=lambda one: one[0])
        narrower = _sharpest(other, usual, ends)
        if narrower.borne and (not found.borne or narrower.usual.chi < found.usual.chi):
            return narrower
    return found


def _sharpest(setting: Setting, end: LatentFit, ends: Sequence[LatentFit]) -> Search:
    """Return an end gone on with to the least noise of the torque rows that it bears."""
    best, fall, moved = _gone_on(setting, end)
    floor, borne = FLOORS[-1][0], False
    usual, further = best, (none := np.zeros(setting.link.n))
    for finer in SHARPER_FLOORS if best.chi <= MISFIT else ():
        if not _hides(best, floor):
            borne = borne or best.chi <= BORNE
            break
        sharper = _with_floor(setting, best, finer)
        if sharper.chi > (EXPLAINED if borne else BORNE):
            further = _moved(best, sharper)
            break
        before, (best, fall, moved) = best, _gone_on(setting, sharper)
        floor, borne, further = finer, True, _moved(before, best)
    if not _hides(best, floor):
        further = none
    return Search(setting, best, floor, borne, usual, further, tuple(ends), fall, moved)


def _hides(found: LatentFit, floor: float) -> bool:
    """Return whether the least noise of a fit's torque rows, share of the torque, hides any of what they tell."""
    noise = found.problem.tau_noise[: found.problem.log.n]
    return bool(np.any(2 * (floor * found.problem.log.torque) ** 2 > noise**2))


def _moved(before: LatentFit, after: LatentFit) -> Array:
    """Return the shares by which compliances moved, (n,)."""
    found: Array = (after.compliance - before.compliance) / np.maximum(np.abs(before.compliance), 1e-300)
    return found


def _gone_on(setting: Setting, best: LatentFit) -> tuple[LatentFit, float, Array]:
    """Return a fit after further steps, and by which share its cost fell and its compliances moved in the last ones."""
    for _ in range(_RUNS):
        further = fit(best.problem, best.x, best.coefficients, setting.unknowns.free(), FURTHER)
        fall = (best.cost - further.cost) / further.cost
        moved = np.abs(_moved(best, further))
        best = further
        rests = best.chi <= EXPLAINED and fall < CREEPS and moved.max() < RESTS
        if abs(fall) < FALL or best.chi > UNFIT or rests:
            break
    return best, fall, moved


def _with_floor(setting: Setting, best: LatentFit, floor: float, limit: float = np.inf) -> LatentFit:
    """Return a fit from another one's end with some least noise of the torque rows; not to its end far above a limit.

    Where sensors are finer than the usual one, what it hides bends a stiffness that little else tells: measured on
    simulated arms with torques to 0.05 % up to 17 %, and 1.2 % after this. Standard errors shrink by more than that
    where positions are noisy (one joint in smooth motion, positions to 0.4 mrad: 11 % off at an error of 1.5 %), so
    those before it stand, and so does the valley.
    """
    problem = setting.problem(best.problem.parts, best.problem.lost_scale)
    problem.filter_torque(setting.cutoff, floor)
    how = replace(SHARPLY, high=limit, above=FAR * limit)
    return fit(problem, best.x, best.coefficients, setting.unknowns.free(), how)
