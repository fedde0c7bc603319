"""Fits from one start of a climb: the links' motion first, then everything, and the columns that pay.

Load friction is free from the first floor on; it, Stribeck bumps and lost motion stay only where the cost falls by more
than they could by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.iteration import Iteration
from elid_cli.estimation.motor_side.latent import PARTS
from elid_cli.estimation.motor_side.latent_fit import LatentFit, fit
from elid_cli.estimation.motor_side.rungs import ClimbEnd
from elid_cli.estimation.motor_side.setting import Setting

COARSEST, COARSE = (0.1, 10), (0.03, 40)
FLOORS = ((0.01, 10), (0.003, 15))
"""Least noise of the torque rows, share of the torque, and most steps with it: with none the fit crawls. The coarsest
tells which starts are worth it; the coarse one finds the valley, and a fit that goes on before its compliances have
settled there crawls beside it."""
_FEW = ((FLOORS[-1][0], 5),)
"""The last one, to see what is left: a fit that lacks a friction crawls."""
_ON_THE_WAY = 0.01
"""Fall of the cost in a step that ends all floors but the last one, once the compliances have settled."""
LOST_SHARE = 0.15
"""Torque over which lost motion is passed, share of the transmission's."""
_PAYS = 20.0
"""Fall of the cost, per further unknown and unit of misfit, from which on a column stays."""
EXPLAINED = 1.1
"""Misfit up to which a fit leaves the sensors' noise alone: no other start can end lower. Measured: simulated logs at
their true unknowns 0.5 to 1.0."""
_STRIBECK_FROM, _LOST_FROM, _CORNERED, UNFIT = 1.1, 1.1, 2.5, 2.0
"""Misfits from which on are tried: Stribeck's columns, lost motion, all from the start; that of a fit far off."""
_PATIENCE = 15
"""Further steps with the coarsest floor from starts that were still on their way, where no start leads to noise."""
_SETTLING = Iteration(settle=True, least=3)
WIDTHS = (0.5, 0.25, 2.0)
"""Factors on the speed within which friction changes its sign that are tried."""
_LESS = 0.9
"""Misfit over that of further columns, at most, of another such speed."""
MISFIT = 3.0
"""Most cost per degree of freedom of a model that is believed."""


class Columns:
    """Fits from one start, with more and with fewer columns."""

    def __init__(self, setting: Setting, end: ClimbEnd, q: Array) -> None:
        """`q`: the links' positions at the log's samples, (N, n)."""
        self.setting, self.unknowns, self.end = setting, setting.unknowns, end
        held = self._motion_first(end.x, q)
        self.x, self.coefficients, self.misfit = held.x, held.coefficients, held.chi

    @cached_property
    def coarsest(self) -> LatentFit:
        """With load friction alone and the coarsest floor, no further than is needed to tell whether it fits."""
        return self.level(
            ("load",), self.x, self.coefficients, (COARSEST,), asked=replace(_SETTLING, above=UNFIT * self.freedom)
        )

    @property
    def on_the_way(self) -> bool:
        """Whether the coarsest floor's fit ran out of steps where it had come near to fitting."""
        return self.coarsest.steps == COARSEST[1] and EXPLAINED < self.coarsest.chi <= UNFIT

    def go_further(self) -> None:
        """Go on from where the coarsest floor's fit stopped."""
        first = self.coarsest
        self.coarsest = self.level(("load",), first.x, first.coefficients, ((COARSEST[0], _PATIENCE),))

    def _motion_first(self, x: Array, q: Array) -> LatentFit:
        """Return the start with the links' motion fitted and the parameters held: else the fit leaves a good start."""
        problem = self.setting.problem(("load",))
        problem.filter_torque(self.setting.cutoff, 0.1)
        x = x.copy()
        sensors = self.unknowns.of_sensors
        x[sensors] = problem.prior_mean[sensors]
        only = np.zeros(self.unknowns.size, dtype=bool)
        only[self.unknowns["offset"]] = only[sensors] = True
        log, rows = problem.log, len(problem.centres) * len(problem.tau_noise)
        self.freedom = (log.count - problem.spline.count) * log.n + rows
        return fit(problem, x, problem.spline.fit(q), only, Iteration(8, 0.05, robust=False))

    def level(
        self, parts: Sequence[str], x: Array, coefficients: Array, floors: Sequence[tuple[float, int]],
        lost_scale: Array | None = None, asked: Iteration = _SETTLING,
    ) -> LatentFit:  # fmt: skip
        """Return the fit with some columns, floor by floor; `asked`: with the costs that are asked about."""
        problem = self.setting.problem(parts, lost_scale)
        x = x.copy()
        for name in set(PARTS) - set(parts):
            x[self.unknowns[name]] = 0.0
        for floor, steps in floors:
            problem.filter_torque(self.setting.cutoff, floor)
            tolerance = 1e-3 if floor == FLOORS[-1][0] else _ON_THE_WAY
            how = replace(asked, steps=steps, tolerance=tolerance)
            found = fit(problem, x, coefficients, self.unknowns.free(), how)
            x, coefficients = found.x, found.coefficients
        return found

    def may_fit(self, first: LatentFit) -> bool:
        """Return whether all columns from the start foresee a misfit that is believed: later floors only raise it."""
        scale = LOST_SHARE * first.model.spring.std(axis=0)
        found = self.level(PARTS, self.x, self.coefficients, (COARSEST, COARSE), scale)
        return found.foreseen <= MISFIT * found.freedom

    def with_all(self) -> LatentFit | None:
        """Return the fit with all columns from the start, or None where it leaves more than noise at once."""
        scale = LOST_SHARE * self.coarsest.model.spring.std(axis=0)
        with suppress(np.linalg.LinAlgError, ValueError):
            found = self.level(PARTS, self.x, self.coefficients, (COARSEST,), scale)
            if found.chi <= EXPLAINED:
                found = self.level(PARTS, found.x, found.coefficients, (COARSE, *FLOORS), scale)
                return None if _gains_motion(found) else found
        return None

    def nearer_width(self, fine: LatentFit, found: LatentFit) -> float | None:
        """Return the factor on the speed within which friction changes its sign that leaves less than a fit does.

        None where noise alone is left without further columns, or the usual speed leaves as little.
        """
        usual = self.setting
        if found.problem.parts in ((), ("load",)) and found.chi <= EXPLAINED:
            return None
        tried = []
        for factor in WIDTHS:
            self.setting = usual.within(factor)
            with suppress(np.linalg.LinAlgError, ValueError):
                tried.append((self.level(("load",), fine.x, fine.coefficients, _FEW).chi, factor))
        self.setting = usual
        chi, factor = min(tried, default=(np.inf, 1.0))
        return factor if chi <= min(EXPLAINED, _LESS * found.chi) else None

    def best(self, fine: LatentFit) -> LatentFit:
        """Return the fit with the columns that pay, from the floor before the last with load friction alone."""
        found = self.level(("load",), fine.x, fine.coefficients, _FEW)
        if found.chi > _STRIBECK_FROM and (richer := self._with_bumps(found)) is not found:
            return self._with_lost_motion(richer)
        if found.steps == _FEW[0][1]:
            found = self.level(("load",), found.x, found.coefficients, FLOORS[-1:])
        # no further than is needed to tell which of the two pays
        high = found.cost + _PAYS * self.unknowns.link.n * max(1.0, found.chi)
        plain = self.level((), found.x, found.coefficients, FLOORS[-1:], asked=replace(_SETTLING, high=high))
        if found.chi <= _STRIBECK_FROM and _pays(plain, found):
            found = self._with_bumps(found)
        return self._with_lost_motion(found if _pays(plain, found) else plain)

    def _with_bumps(self, found: LatentFit) -> LatentFit:
        """Return the fit with Stribeck's columns, or the given one where they do not pay."""
        richer = self.level(("load", "bumps"), found.x, found.coefficients, FLOORS)
        return richer if _pays(found, richer) else found

    def _with_lost_motion(self, found: LatentFit) -> LatentFit:
        """Return the fit with lost motion, or the given one where noise is all that is left or it does not pay."""
        if found.chi <= _LOST_FROM:
            return found
        scale = LOST_SHARE * found.model.spring.std(axis=0)
        richer = self.level((*found.problem.parts, "lost"), found.x, found.coefficients, FLOORS[-1:], scale)
        if _pays(found, richer) and not _gains_motion(richer):
            found = richer
        if found.chi > _CORNERED:
            fresh = self.level(PARTS, self.x, self.coefficients, (COARSEST, COARSE, *FLOORS), scale)
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
