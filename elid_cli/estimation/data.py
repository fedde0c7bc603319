"""What the one fit asks of the data, whether samples are at hand or reduced logs only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.facts import SignalFacts, facts_of
from elid_cli.estimation.regression.covariance import residuals, sandwich
from elid_cli.estimation.regression.effect_columns import FittedEffects, triangles_with_effects
from elid_cli.estimation.regression.least_squares import Solution, reweighted
from elid_cli.estimation.regression.nuisances import delay_columns, offset_columns
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.regression.rotor_shares import FARTHEST, rotor_columns, rotor_prior, with_known_rotors
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangles
from elid_cli.estimation.stiffness.link_equation import LinkStiffness, TwoWays, two_ways
from elid_cli.estimation.stretches import STRETCHES, stretch_of
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.signals.signals import Signals

if TYPE_CHECKING:
    from elid_cli.estimation.streaming.merged import TriangleData


@dataclass(frozen=True)
class SampledData:
    """The equations of one recording whose samples are at hand; `TriangleData` has the same methods."""

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
        """What the signals were like."""
        return facts_of(self.signals, self.observation.known)

    @property
    def slow_left_out(self) -> bool:
        """Whether the user said below which speed samples are left out."""
        return self.signals.slow_left_out

    @property
    def masked(self) -> Array:
        """Share of instants left out around reversals, per joint, (n,)."""
        return self.observation.masked

    def counting(self, gliding: NDArray[np.bool_]) -> SampledData:
        """Return the data with the reversals of some joints (n,) counted as well."""
        return replace(self, observation=self.observation.unmasked(gliding))

    @cached_property
    def delays(self) -> list[ExtraColumns]:
        """The delay of every torque channel that has equations."""
        return delay_columns(self.observation)

    @cached_property
    def offsets(self) -> list[ExtraColumns]:
        """The offset of every torque channel that has equations."""
        return offset_columns(self.observation)

    def triangles(self, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None = None) -> Triangles:
        """Return the triangles of all stretches with the columns of nuisances, then of effects."""
        return triangles_with_effects(self.observation, nuisances, effects, self.stretch)

    def covariance(self, solution: Solution, extras: Sequence[ExtraColumns]) -> Array:
        """Return the covariance (r, r) of a solution's basis, correlated residuals accounted for."""
        return sandwich(self.observation, solution, extras)

    def at_reversals(self, values: Array, extras: Sequence[ExtraColumns]) -> tuple[Array, Array]:
        """Return the rms residual of every joint's sum row at reversals and elsewhere, (n,) each; NaN where none."""
        residual = residuals(self.observation, values, extras)
        inside, outside = np.full((2, self.model.robot.n), np.nan)
        for k in range(len(inside)):
            trace = residual.get(("sum", k))
            reversing, known = self.observation.reversing[k], self.observation.known[k]
            if trace is not None and (known & reversing).any() and (known & ~reversing).any():
                inside[k] = np.sqrt(np.mean(trace[known & reversing] ** 2))
                outside[k] = np.sqrt(np.mean(trace[known & ~reversing] ** 2))
        return inside, outside

    def two_ways(self, values: Array, joint: int, extras: Sequence[ExtraColumns] = ()) -> TwoWays | None:
        """Return a joint's stiffness by both regressions of its row, all else given: parameters, then `extras`."""
        return two_ways(self.observation, values, self.model.names, joint, extras)

    def link_stiffness(self, base: BaseParameters, joint: int) -> LinkStiffness | None:
        """Return a joint's stiffness from its link's equation with the robot file's inertias."""
        from elid_cli.estimation.stiffness.links import link_stiffness

        return link_stiffness(base, self.observation, self.signals, self.model.robot.reference(), joint)

    def rows_of_sensors(self) -> bool:
        """Whether a joint torque sensor is used."""
        return len(self.observation.independent) < len(self.observation.groups)


FitData: TypeAlias = "SampledData | TriangleData"
"""What the one fit asks of the data: samples, or reduced logs of which only triangles are at hand."""


def sampled(
    model: Regressor, signals: Signals, stretches: int = STRETCHES, observation: Observation | None = None
) -> SampledData:
    """Return the equations of a log, divided into stretches; `observation` where they have been computed."""
    observation = observe(model, signals) if observation is None else observation
    return SampledData(model, signals, observation, stretch_of(observation.instants, stretches))


def sum_row(extra: ExtraColumns) -> EstimationRow:
    """Return the first row that extra columns act on; of a nuisance, its channel's."""
    return next(iter(extra.rows))


@dataclass(frozen=True)
class Solved:
    """The parameters that fit some equations, with nuisances and with effects at some shapes."""

    base: BaseParameters
    data: FitData
    nuisances: tuple[ExtraColumns, ...]
    effects: FittedEffects | None
    triangles: Triangles
    solution: Solution
    before: Solved | None = None
    """The fit with all nuisances there may be, which told those that stand."""

    @property
    def model(self) -> Regressor:
        """The robot's model."""
        return self.data.model

    @property
    def scored(self) -> tuple[Solved, ...]:
        """The fits whose scores were asked for, itself the last."""
        return (self,) if self.before is None else (self.before, self)

    @property
    def samples(self) -> SampledData:
        """The samples that it was fitted to.

        Raises
        ------
        ValueError
            The fit is one to reduced logs.
        """
        if self.data.samples is None:
            raise ValueError("reduced logs hold no samples")
        return self.data.samples

    @property
    def signals(self) -> Signals:
        """Signals of the log; ValueError as `samples`."""
        return self.samples.signals

    @property
    def observation(self) -> Observation:
        """Equations of the log; ValueError as `samples`."""
        return self.samples.observation

    @property
    def extras(self) -> tuple[ExtraColumns, ...]:
        """All columns beyond the standard parameters: nuisances, then effects."""
        return (*self.nuisances, *(self.effects.extras if self.effects else ()))

    @property
    def standard(self) -> Array:
        """A representative of the standard parameters, (p,)."""
        return self.solution.values[: self.model.parameters]

    @property
    def transform(self) -> Array:
        """Base parameters = transform @ solution, (b, p + e)."""
        return np.pad(self.base.transform, ((0, 0), (0, self.triangles.extras)))

    def deviations(self, covariance: Array) -> Array:
        """Return the standard errors of the base parameters, (b,), from the covariance of the basis, (r, r)."""
        own = self.transform[:, self.solution.basis]
        return np.asarray(np.sqrt(np.maximum(np.diag(own @ covariance @ own.T), 0.0)))

    @property
    def first_amplitude(self) -> int:
        """Column of the first effect's first amplitude."""
        return self.model.parameters + sum(extra.width for extra in self.nuisances)

    @property
    def amplitude_places(self) -> list[slice]:
        """Where the amplitudes of every effect stand among the columns."""
        widths = [extra.width for extra in (self.effects.extras if self.effects else ())]
        edges = (self.first_amplitude + np.cumsum([0, *widths])).tolist()
        return [slice(*pair) for pair in pairwise(edges)]

    def amplitudes(self) -> list[Array]:
        """Return the fitted amplitudes of every effect, each (d,)."""
        return [self.solution.values[place] for place in self.amplitude_places]

    @property
    def late(self) -> Array:
        """Delay of every torque channel that the nuisances still correct, s, (n,)."""
        late = np.zeros(self.model.robot.n)
        for k, extra in enumerate(self.nuisances):
            if extra.nuisance == "delay":
                late[sum_row(extra).joint] = self.solution.values[self.model.parameters + k]
        return late

    def rotors(self) -> Mapping[int, float]:
        """Return the rotor inertias at joints that only friction under load tells, by a step from its scene's."""
        if self.effects is None or not self.effects.scene.rotors:
            return {}
        here, columns = self.effects.scene.rotors, rotor_columns(self.effects, self.signals, self.amplitudes())
        if not columns:
            return here
        extras = [extra for extra, _ in columns.values()]
        wider = self.data.triangles([*self.nuisances, *extras], self.effects)
        wider = with_known_rotors(wider, self.first_amplitude, *rotor_prior(self.effects.scene, columns))
        shares = reweighted(wider, self.base.count + wider.extras).values[self.first_amplitude :]
        found = dict(here)
        for (joint, (_, most)), share in zip(columns.items(), shares.tolist(), strict=False):
            step = min(max(share, -FARTHEST), FARTHEST)  # effects that are not in the scene yet lead astray
            found[joint] = min(max(here[joint] + step * most, 0.0), most)
        return found

    @classmethod
    def of(
        cls,
        base: BaseParameters,
        data: FitData,
        nuisances: Sequence[ExtraColumns],
        effects: FittedEffects | None = None,
    ) -> Solved:
        """Solve the equations of `data`, each row weighted by its own residual."""
        triangles = data.triangles(nuisances, effects)
        solution = reweighted(triangles, base.count + triangles.extras)
        return Solved(base, data, tuple(nuisances), effects, triangles, solution)
