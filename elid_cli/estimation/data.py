"""What the one fit asks of the data, whether samples are at hand or reduced logs only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.facts import SignalFacts, facts_of
from elid_cli.estimation.regression.covariance import residuals, sandwich
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.nuisances import delay_columns, offset_columns
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.regression.other_shapes import triangles_with_effects
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangles
from elid_cli.estimation.stiffness.link_equation import LinkStiffness, TwoWays, link_stiffness, two_ways
from elid_cli.estimation.stretches import STRETCHES, stretch_of
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.signals.signals import Signals


class FitData(Protocol):
    """The equations of a log or of several: triangles with a mask and further columns, and a solution's scores."""

    @property
    def model(self) -> Regressor:
        """The robot's model."""

    @property
    def facts(self) -> SignalFacts:
        """What the signals were like."""

    @property
    def samples(self) -> SampledData | None:
        """The samples, where they are at hand: shapes of effects and gains of torque sensors are fitted to them."""

    @property
    def masked(self) -> Array:
        """Share of instants left out around reversals, per joint, (n,)."""

    def counting(self, gliding: NDArray[np.bool_]) -> FitData:
        """Return the data with the reversals of some joints (n,) counted as well."""

    def delays(self) -> list[ExtraColumns]:
        """Return the delay of every torque channel that has equations."""

    def offsets(self) -> list[ExtraColumns]:
        """Return the offset of every torque channel that has equations."""

    def triangles(self, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None = None) -> Triangles:
        """Return the triangles of all stretches with the columns of nuisances, then of effects."""

    def covariance(
        self, solution: Solution, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None = None
    ) -> Array:
        """Return the covariance (r, r) of a solution's basis, correlated residuals accounted for."""

    def at_reversals(
        self, values: Array, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None = None
    ) -> tuple[Array, Array]:
        """Return the rms residual of every joint's sum row at reversals and elsewhere, (n,) each; NaN where none."""

    def two_ways(self, standard: Array, joint: int) -> TwoWays | None:
        """Return a joint's stiffness by both regressions of its row, other parameters (p,) given."""

    def link_stiffness(self, base: BaseParameters, joint: int) -> LinkStiffness | None:
        """Return a joint's stiffness from its link's equation with the robot file's inertias."""


@dataclass(frozen=True)
class SampledData:
    """The equations of one recording whose samples are at hand."""

    model: Regressor
    signals: Signals
    observation: Observation
    stretch: NDArray[np.intp]
    """Stretch of every instant, (M,), predicted in turn from the others."""

    @property
    def samples(self) -> SampledData:
        """Itself."""
        return self

    @cached_property
    def facts(self) -> SignalFacts:
        """See `FitData`."""
        return facts_of(self.signals, self.observation.known)

    @property
    def masked(self) -> Array:
        """See `FitData`."""
        return self.observation.masked

    def counting(self, gliding: NDArray[np.bool_]) -> SampledData:
        """See `FitData`."""
        return replace(self, observation=self.observation.unmasked(gliding))

    def delays(self) -> list[ExtraColumns]:
        """See `FitData`."""
        return delay_columns(self.observation)

    def offsets(self) -> list[ExtraColumns]:
        """See `FitData`."""
        return offset_columns(self.observation)

    def triangles(self, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None = None) -> Triangles:
        """See `FitData`."""
        return triangles_with_effects(self.observation, nuisances, effects, self.stretch)

    def covariance(
        self, solution: Solution, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None = None
    ) -> Array:
        """See `FitData`."""
        return sandwich(self.observation, solution, (*nuisances, *(effects.extras if effects else ())))

    def at_reversals(
        self, values: Array, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None = None
    ) -> tuple[Array, Array]:
        """See `FitData`."""
        residual = residuals(self.observation, values, (*nuisances, *(effects.extras if effects else ())))
        inside, outside = np.full((2, self.model.robot.n), np.nan)
        for k in range(len(inside)):
            trace = residual.get(("sum", k))
            reversing, known = self.observation.reversing[k], self.observation.known[k]
            if trace is not None and (known & reversing).any() and (known & ~reversing).any():
                inside[k] = np.sqrt(np.mean(trace[known & reversing] ** 2))
                outside[k] = np.sqrt(np.mean(trace[known & ~reversing] ** 2))
        return inside, outside

    def two_ways(self, standard: Array, joint: int) -> TwoWays | None:
        """See `FitData`."""
        return two_ways(self.observation, standard, self.model.names, joint)

    def link_stiffness(self, base: BaseParameters, joint: int) -> LinkStiffness | None:
        """See `FitData`."""
        return link_stiffness(base, self.observation, self.signals, self.model.robot.reference(), joint)

    def rows_of_sensors(self) -> bool:
        """Whether a joint torque sensor is used."""
        return len(self.observation.independent) < len(self.observation.groups)


def sampled(
    model: Regressor, signals: Signals, stretches: int = STRETCHES, observation: Observation | None = None
) -> SampledData:
    """Return the equations of a log, divided into stretches; `observation` where they have been computed."""
    observation = observe(model, signals) if observation is None else observation
    return SampledData(model, signals, observation, stretch_of(observation.instants, stretches))


def sum_row(extra: ExtraColumns) -> EstimationRow:
    """Return the first row that extra columns act on; of a nuisance, its channel's."""
    return next(iter(extra.rows))
