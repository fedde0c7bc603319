"""From a log to the best fit: climbs, the links' motion first, then everything, and the columns that pay.

Load friction is free from the first floor on; it, Stribeck bumps and lost motion stay only where the cost falls by more
than they could by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.climb import FIRST_RUNG, RATIO, Climb, ClimbEnd
from elid_cli.estimation.motor_side.latent import Latent
from elid_cli.estimation.motor_side.latent_fit import Iteration, LatentFit, fit
from elid_cli.estimation.motor_side.link_side import LinkSide
from elid_cli.estimation.motor_side.motor_log import MotorLog, Samples, band_of
from elid_cli.estimation.motor_side.unknowns import RotorPrior, Unknowns

LOWEST_BAND = 4.0
"""Hz; knots for less would not follow friction."""
FLOORS = ((0.03, 10), (0.01, 10), (0.003, 15))
"""Least noise of the torque rows, share of the torque, and most steps with it: with none the fit crawls."""
TORQUE_CUT = 1.2
"""Cut-off of the torque rows over the end of the band."""
KNOT_SHARE, KNOTS = 0.2, (0.003, 0.012)
"""Distance of knots in periods of the band's end, and its limits, s."""
LOST_SHARE = 0.15
"""Torque over which lost motion is passed, share of the transmission's."""
_PAYS = 20.0
"""Fall of the cost, per further unknown and unit of misfit, from which on a column stays."""
_STRIBECK_FROM, _LOST_FROM, _CORNERED, UNFIT = 1.1, 1.3, 2.5, 2.0
"""Misfits from which on are tried: Stribeck's columns, lost motion, all from the start, a climb without load."""
FURTHER, FALL, _RUNS = Iteration(20, 1e-4, least=1), 0.001, 4
"""How the best end is gone on from, the fall of its cost, share of it, that ends it, and the most times: a fit that
crawls has not found its valley's bottom, whatever it looks like."""
LOST, LOST_AT_ONCE = 5000.0, 100.0
"""Cost from which on a climb leads nowhere, and that of one that gets no further than its first rung: what follows
mends friction, and not equations that fail. Measured: simulated logs with every friction up to 115, 14."""
HOPELESS = 15.0
"""Misfit at the first floor from which on no more is tried: equations that leave over a tenth of the torque lack more
than a shape of friction. Measured: simulated logs with every friction up to 3.4, a flexible arm that refuses 20."""
NO_PATH = 50.0
"""Misfit of a start's path, to a tenth of the torque, from which on its parameters explain nothing. Measured: starts
that led somewhere up to 5, arms whose motion goes on far above the highest band 100 to 10^6."""
MISFIT = 3.0
"""Most cost per degree of freedom of a model that is believed."""
_SAME_COST, _SAME_PLACE = 1e-3, 0.003
"""Share of the cost, and logarithm of the compliances, within which two ends are one."""
_ENDS = 2
_CLIMB_RATE = 16.0
"""Sample rate of the climb over the end of the band."""


@dataclass(frozen=True)
class Setting:
    """A stretch of log, its robot's link side and what is known of the rotors."""

    samples: Samples
    link: LinkSide
    rotors: RotorPrior

    @cached_property
    def bands(self) -> Array:
        """Highest frequency at which each joint's position exceeds its noise, Hz, (n,)."""
        return band_of(self.samples)

    @property
    def band(self) -> float:
        """The highest of them, Hz, for knots and filters."""
        return max(float(self.bands.max()), LOWEST_BAND)

    @property
    def spacing(self) -> float:
        """Distance of knots, s."""
        return float(np.clip(KNOT_SHARE / self.band, *KNOTS))

    @property
    def cutoff(self) -> float:
        """Cut-off of the torque rows, Hz."""
        return TORQUE_CUT * self.band

    @cached_property
    def log(self) -> MotorLog:
        """The stretch with two samples per knot."""
        return MotorLog(self.samples, 2 / self.spacing)

    @cached_property
    def unknowns(self) -> Unknowns:
        """The unknowns."""
        return Unknowns(self.link)

    def problem(self, parts: Sequence[str], lost_scale: Array | None = None) -> Latent:
        """Return the latent problem with some of the columns that are optional."""
        return Latent(self.log, self.unknowns, self.spacing, self.rotors, parts, lost_scale)


@dataclass(frozen=True)
class Search:
    """Ends of the search, the best first."""

    setting: Setting
    ends: tuple[LatentFit, ...]
    fall: float
    """Share by which the cost of the best end fell in further steps."""
    moved: Array
    """Share by which its compliances moved in them, (n,)."""

    @property
    def best(self) -> LatentFit:
        """The end of least cost."""
        return self.ends[0]


def search(setting: Setting) -> Search:
    """Fit a log from every start that a climb gives.

    Raises
    ------
    numpy.linalg.LinAlgError
        No start leads anywhere.
    """
    climb_log = MotorLog(setting.samples, _CLIMB_RATE * setting.band)
    climb = Climb(climb_log, setting.unknowns, setting.rotors, setting.band)
    starts = [start for start in climb.ends() if not _lost(start)][:_ENDS]
    fits = _Fits(setting, climb)
    for start in starts:
        fits.add(start)
    tops = [top for top in climb.tops[:1] if not _lost(top) and all(top is not start for start in starts)]
    if _unfit(fits.ends) and tops:
        fits.add(tops[0])
    if _unfit(fits.ends) and fits.hopeful:
        climb.with_load = False
        _without_load(fits, starts)
    if not fits.ends:
        raise np.linalg.LinAlgError("no start leads to a fit")
    first, *others = sorted(fits.ends, key=lambda end: end.cost)
    fall, moved = 0.0, np.zeros(setting.link.n)
    for _ in range(0 if any(first is end for end in fits.hopeless) else _RUNS):
        further = fit(first.problem, first.x, first.coefficients, setting.unknowns.free(), FURTHER)
        fall, moved = (first.cost - further.cost) / further.cost, np.abs(further.compliance - first.compliance)
        first = further
        if abs(fall) < FALL or further.chi > UNFIT:
            break
    return Search(setting, (first, *others), fall, moved / np.maximum(np.abs(first.compliance), 1e-300))


def _unfit(ends: Sequence[LatentFit]) -> bool:
    return not ends or min(end.chi for end in ends) > UNFIT


def _lost(start: ClimbEnd) -> bool:
    return start.cost > (LOST_AT_ONCE if start.top < RATIO * FIRST_RUNG else LOST)


def _without_load(fits: _Fits, starts: Sequence[ClimbEnd]) -> None:
    """Add the fit from a climb without load friction, where it ends elsewhere."""
    try:
        start = fits.climb.ascend()
    except (np.linalg.LinAlgError, ValueError):
        return
    known = [fits.setting.unknowns.apart(start.x, other.x) for other in starts]
    if np.all(np.isfinite(start.x)) and all(distance >= 0.03 for distance in known):
        fits.add(start)


class _Fits:
    """Ends of fits from the starts of a climb."""

    def __init__(self, setting: Setting, climb: Climb) -> None:
        self.setting, self.climb = setting, climb
        self.ends: list[LatentFit] = []
        self.hopeless: list[LatentFit] = []
        """Those of `ends` that were not gone on with."""
        self.hopeful = False
        """Whether the log follows from any start's parameters at all."""
        self._plain: list[LatentFit] = []
        """With load friction alone, and the first floors of those, too."""

    def add(self, start: ClimbEnd) -> None:
        """Fit from a start, unless that fails or comes to where another one came."""
        try:
            columns = _Columns(self.setting, self.climb, start)
            if columns.misfit > NO_PATH:
                return
            self.hopeful = True
            first = columns.level(("load",), columns.x, columns.coefficients, FLOORS[:1])
            if first.chi > HOPELESS or (first.chi > MISFIT and not columns.may_fit(first)):
                self.hopeless.append(first)
                self.ends.append(first)
                return
            if self._known(first):
                return
            plain = columns.level(("load",), first.x, first.coefficients, FLOORS[1:])
            if self._known(plain):
                return
            self.ends.append(columns.best(plain))
        except (np.linalg.LinAlgError, ValueError):
            return

    def _known(self, found: LatentFit) -> bool:
        known = any(self._same(found, other) for other in self._plain)
        self._plain.append(found)
        return known

    def _same(self, one: LatentFit, other: LatentFit) -> bool:
        near = self.setting.unknowns.apart(one.x, other.x) < _SAME_PLACE
        return near and abs(one.cost - other.cost) < _SAME_COST * other.cost


class _Columns:
    """Fits from one start, with more and with fewer columns."""

    def __init__(self, setting: Setting, climb: Climb, start: ClimbEnd) -> None:
        self.setting, self.unknowns = setting, setting.unknowns
        held = self._motion_first(start.x, climb.motion(start, setting.log.t))
        self.x, self.coefficients, self.misfit = held.x, held.coefficients, held.chi

    def _motion_first(self, x: Array, q: Array) -> LatentFit:
        """Return the start with the links' motion fitted and the parameters held: else the fit leaves a good start."""
        problem = self.setting.problem(("load",))
        problem.filter_torque(self.setting.cutoff, 0.1)
        only = np.zeros(self.unknowns.size, dtype=bool)
        only[self.unknowns["offset"]] = True
        return fit(problem, x, problem.spline.fit(q), only, Iteration(8, 0.05, robust=False))

    def level(
        self, parts: Sequence[str], x: Array, coefficients: Array, floors: Sequence[tuple[float, int]],
        lost_scale: Array | None = None, high: float = np.inf,
    ) -> LatentFit:  # fmt: skip
        """Return the fit with some columns, floor by floor; `high`: the cost that is asked about."""
        problem = self.setting.problem(parts, lost_scale)
        x = x.copy()
        for name in {"load", "bumps", "lost"} - set(parts):
            x[self.unknowns[name]] = 0.0
        for floor, steps in floors:
            problem.filter_torque(self.setting.cutoff, floor)
            found = fit(
                problem, x, coefficients, self.unknowns.free(), Iteration(steps, settle=True, least=3, high=high)
            )
            x, coefficients = found.x, found.coefficients
        return found

    def may_fit(self, first: LatentFit) -> bool:
        """Return whether all columns from the start foresee a misfit that is believed: later floors only raise it."""
        scale = LOST_SHARE * first.model.spring.std(axis=0)
        found = self.level(("load", "bumps", "lost"), self.x, self.coefficients, FLOORS[:1], scale)
        return found.foreseen <= MISFIT * found.freedom

    def best(self, found: LatentFit) -> LatentFit:
        """Return the fit with the columns that pay, from the one with load friction alone."""
        # no further than is needed to tell which of the two pays
        high = found.cost + _PAYS * self.unknowns.link.n * max(1.0, found.chi)
        plain = self.level((), found.x, found.coefficients, FLOORS[-1:], high=high)
        if found.chi > _STRIBECK_FROM * min(1.0, plain.chi) or _pays(plain, found):
            richer = self.level(("load", "bumps"), found.x, found.coefficients, FLOORS[-2:])
            found = richer if _pays(found, richer) else found
        found = found if _pays(plain, found) else plain
        return self._with_lost_motion(found) if found.chi > _LOST_FROM else found

    def _with_lost_motion(self, found: LatentFit) -> LatentFit:
        scale = LOST_SHARE * found.model.spring.std(axis=0)
        richer = self.level((*found.problem.parts, "lost"), found.x, found.coefficients, FLOORS[-1:], scale)
        if _pays(found, richer) and not _gains_motion(richer):
            found = richer
        if found.chi > _CORNERED:
            fresh = self.level(("load", "bumps", "lost"), self.x, self.coefficients, FLOORS, scale)
            if _pays(found, fresh) and fresh.cost < 0.8 * found.cost and not _gains_motion(fresh):
                found = fresh
        return found


def _pays(fewer: LatentFit, more: LatentFit) -> bool:
    """Return whether further columns are worth it."""
    count = max(1, len(more.free) - len(fewer.free))
    return bool(np.isfinite(more.cost) and fewer.cost - more.cost > _PAYS * count * max(1.0, more.chi))


def _gains_motion(found: LatentFit) -> bool:
    """Return whether lost motion came out clearly negative."""
    place = found.problem.unknowns["lost"]
    error = np.sqrt(np.maximum(np.diag(found.covariance)[place], 0) * max(1.0, found.chi))
    least = -3 * error - 0.02 * np.abs(found.compliance) * found.model.spring.std(axis=0)
    return bool(np.any(found.x[place] < least))
