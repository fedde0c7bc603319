"""From a log to the best fit: climbs give starts, and fits from them are gone on with, the best first."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.best_end import CLOSE, Search, concluded, relative_errors
from elid_cli.estimation.motor_side.climb import Climb
from elid_cli.estimation.motor_side.columns import COARSE, EXPLAINED, FLOORS, MISFIT, UNFIT, Columns
from elid_cli.estimation.motor_side.latent_fit import LatentFit
from elid_cli.estimation.motor_side.motor_log import MotorLog
from elid_cli.estimation.motor_side.rungs import FIRST_RUNG, RATIO, ClimbEnd
from elid_cli.estimation.motor_side.setting import Setting

_OTHER_CLIMBS = ((True, 14.0, 14.0), (False, None, 0.0))
"""Further climbs where no start leads to noise: whether with load friction, from which locked frequency, Hz, and below
which cut-off it is held."""
LOST, LOST_AT_ONCE = 5000.0, 100.0
"""Cost from which on a climb's best rung leads nowhere, and that of one that gets no further than its first: what
follows mends friction, and not equations that fail. Measured: simulated logs with every friction up to 115, 14. Last
rungs are looked at in any case: one at 5655 led to the truth."""
HOPELESS = 15.0
"""Misfit at the first floor from which on no more is tried: equations that leave over a tenth of the torque lack more
than a shape of friction. Measured: simulated logs with every friction up to 3.4, a flexible arm that refuses 20."""
NO_PATH = 50.0
"""Misfit of a start's path, to a tenth of the torque, from which on its parameters explain nothing. Measured: starts
that led somewhere up to 5, arms whose motion goes on far above the highest band 100 to 10^6."""
_SAME_COST, _SAME_PLACE, _ELSEWHERE = 1e-3, 0.003, 0.03
"""Share of the cost, and logarithm of the compliances, within which two ends are one; the latter for starts."""
STUCK = 0.25
"""Standard errors of a fit as if the sensors were rougher by which finer ones must move the compliances, rms: a fit
that moves by less crawls along its valley, and its own errors, of the curvature at a point of that, are too small.
Measured: `planar2` with fine sensors, 0.05 with errors of 0.006 % and stiffnesses 2 % off."""
_CLIMB_RATE = 16.0
"""Sample rate of the climb over the end of the band."""


def search(setting: Setting) -> Search:
    """Fit a log from every start that a climb gives.

    Raises
    ------
    numpy.linalg.LinAlgError
        No start leads anywhere.
    """
    fits = _of_rougher(setting)
    lost = True
    for start in fits.climb.ends() if not fits.told else ():
        if not _lost(start):
            lost = False
            fits.look_at(start)
            fits.go_on()
            if fits.told:
                break
    fits.be_patient()
    for start in _others(fits, lost):
        fits.look_at(start)
        fits.go_on()
        fits.be_patient()
    fits.take_the_best()
    if not fits.ends:
        raise np.linalg.LinAlgError("no start leads to a fit")
    ends = sorted(fits.ends, key=lambda end: end.cost)
    return _unless_stuck(concluded(fits.setting, ends, fits.hopeless), fits.rougher)


def _unless_stuck(found: Search, rougher: LatentFit | None) -> Search:
    """Return what was found, with the errors of a fit as if the sensors were rougher where it stayed at its end."""
    if rougher is None:
        return found
    elastic, places = rougher.problem.link.elastic, rougher.problem.unknowns["c"]
    error = rougher.errors[places] / np.maximum(np.abs(rougher.compliance), 1e-300)
    moved = found.best.compliance / np.where(rougher.compliance == 0.0, 1.0, rougher.compliance) - 1.0
    apart = float(np.sqrt(np.mean((moved / np.maximum(error, 1e-12))[elastic] ** 2)))
    return found if apart >= STUCK else replace(found, stuck=np.where(elastic, error, 0.0))


def _of_rougher(setting: Setting) -> _Fits:
    """Return fits from where the search of the same log with rougher sensors ended; none where they are rough."""
    climb_log = MotorLog(setting.samples, _CLIMB_RATE * setting.band)
    fits = _Fits(setting, Climb(climb_log, setting.unknowns, setting.rotors, setting.band))
    rougher = setting.rougher
    if rougher is not None:
        with suppress(np.linalg.LinAlgError):
            fits.rougher = best = search(rougher).best
            t = np.clip(setting.log.t, *best.problem.log.t[[0, -1]])
            fits.look_at(ClimbEnd(best.x, best.chi, rougher.band), best.problem.spline.at(t, best.coefficients))
            fits.go_on()
    return fits


def _lost(start: ClimbEnd) -> bool:
    return start.cost > (LOST_AT_ONCE if start.top < RATIO * FIRST_RUNG else LOST)


def _others(fits: _Fits, lost: bool) -> Iterator[ClimbEnd]:
    """Yield starts while none led to noise: a climb's last rung and, unless all are lost, ends of other climbs."""
    climb, apart = fits.climb, fits.setting.unknowns.apart
    starts = [start.end for start in fits.seen]
    if not fits.explained:
        yield from (top for top in climb.tops[:1] if all(top is not start for start in starts))
    if lost and not any(start.coarsest.chi <= UNFIT for start in fits.seen):
        return
    for load, locked, held_to in _OTHER_CLIMBS:
        if fits.explained or not fits.seen:
            return
        climb.with_load = load
        try:
            ends = climb.ascend(locked, held_to=held_to)
        except (np.linalg.LinAlgError, ValueError):
            continue
        for end in ends[::-1] if held_to else ends[:1]:
            if np.all(np.isfinite(end.x)) and all(apart(end.x, other.x) >= _ELSEWHERE for other in starts):
                starts.append(end)
                yield end


class _Fits:
    """Ends of fits from the starts of climbs."""

    def __init__(self, setting: Setting, climb: Climb) -> None:
        self.setting, self.climb = setting, climb
        self.seen: list[Columns] = []
        """Starts that were looked at with the coarsest floor, and explain anything."""
        self.ends: list[LatentFit] = []
        self.rougher: LatentFit | None = None
        """Where the search of the same log with rougher sensors ended."""
        self.hopeless: list[LatentFit] = []
        """Those of `ends` that were not gone on with."""
        self._waiting: list[Columns] = []
        self._coarse: list[LatentFit] = []
        """With load friction alone and the coarse floor; `_fine`: with the next one."""
        self._fine: list[LatentFit] = []

    @property
    def explained(self) -> bool:
        """Whether an end leaves the sensors' noise alone."""
        return any(end.chi <= EXPLAINED for end in self.ends)

    @property
    def told(self) -> bool:
        """Whether an end leaves the sensors' noise alone and tells every compliance: no other start says more."""
        return any(end.chi <= EXPLAINED and _close(end) for end in self.ends)

    def look_at(self, start: ClimbEnd, q: Array | None = None) -> None:
        """Fit from a start with the coarsest floor; `q`: its links' positions where no climb has them, (N, n)."""
        with suppress(np.linalg.LinAlgError, ValueError):
            columns = Columns(self.setting, start, self.climb.motion(start, self.setting.log.t) if q is None else q)
            if columns.misfit <= NO_PATH and np.isfinite(columns.coarsest.cost):
                self.seen.append(columns)
                self._waiting.append(columns)

    def go_on(self) -> None:
        """Fit from the starts that leave noise with the coarsest floor, the best first, until one tells everything."""
        for columns in sorted(self._waiting, key=lambda start: start.coarsest.cost):
            if columns.coarsest.chi <= EXPLAINED and not self.told:
                self._waiting.remove(columns)
                self._add(columns)

    def be_patient(self) -> None:
        """Fit on from starts that had not arrived, the best first, where none led to noise."""
        for columns in sorted(self._waiting, key=lambda start: start.coarsest.cost):
            if not self.explained and columns.on_the_way:
                with suppress(np.linalg.LinAlgError, ValueError):
                    columns.go_further()
                    self.go_on()

    def take_the_best(self) -> None:
        """Fit from the best start where none led anywhere: what refuses wants its figures, too."""
        for columns in sorted(self._waiting, key=lambda start: start.coarsest.cost):
            if self.ends:
                break
            if columns.coarsest.chi <= UNFIT:
                self._add(columns)
            elif (found := columns.with_all()) is not None:
                self.ends.append(found)
            elif columns.coarsest.chi > MISFIT:
                self._give_up(columns.coarsest)

    def _add(self, columns: Columns) -> None:
        """Fit from a start, unless that fails or comes to where another one came."""
        with suppress(np.linalg.LinAlgError, ValueError):
            first = columns.level(("load",), columns.coarsest.x, columns.coarsest.coefficients, (COARSE,))
            if first.chi > HOPELESS or (first.chi > MISFIT and not columns.may_fit(first)):
                self._give_up(first)
            elif not self._known(first, self._coarse):
                fine = columns.level(("load",), first.x, first.coefficients, FLOORS[:1])
                if not self._known(fine, self._fine):
                    self.ends.append(self._best(columns, fine))

    def _best(self, columns: Columns, fine: LatentFit) -> LatentFit:
        """Return the fit with the columns that pay, of the first start within the speed that friction shows.

        Where friction that changes its sign within another speed leaves less than Stribeck's columns and lost motion
        do, all further fits take that speed: each would try those columns in its place.
        """
        found = columns.best(fine)
        if not self.ends and (factor := columns.nearer_width(fine, found)) is not None:
            self.setting = self.setting.within(factor)
            for other in (columns, *self._waiting):
                other.setting = self.setting
            found = columns.best(fine)
        return found

    def _give_up(self, first: LatentFit) -> None:
        self.hopeless.append(first)
        self.ends.append(first)

    def _known(self, found: LatentFit, others: list[LatentFit]) -> bool:
        known = any(self._same(found, other) for other in others)
        others.append(found)
        return known

    def _same(self, one: LatentFit, other: LatentFit) -> bool:
        near = self.setting.unknowns.apart(one.x, other.x) < _SAME_PLACE
        return near and abs(one.cost - other.cost) < _SAME_COST * other.cost


def _close(found: LatentFit) -> bool:
    """Return whether every compliance's standard error is what a gate allows."""
    return bool(np.all(relative_errors(found) <= CLOSE))
