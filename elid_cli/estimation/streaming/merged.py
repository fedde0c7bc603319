"""Triangles of one log or of several together, as the data of the one fit.

Columns are the standard parameters, then a delay and then an offset for every torque channel, whether a log has it or
not, so that the columns of all logs of a robot agree.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.data import SampledData, sum_row
from elid_cli.estimation.facts import SignalFacts
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.nuisances import DELAY, OFFSET
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangle, Triangles, merged_triangle, with_columns
from elid_cli.estimation.stiffness.link_equation import LinkStiffness, TwoWays, ways_of
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import EstimationRow, Regressor

_ORDER = {"link": 0, "sum": 1, "motor": 2}


@dataclass(frozen=True)
class MergedTriangles:
    """Triangles of one log or of several together, with columns for every nuisance there may be."""

    parameters: int
    joints: int
    folds: int
    steady: tuple[Triangle, ...]
    reversing: tuple[Triangle, ...]
    _combined: dict[bytes, list[Triangle]] = field(default_factory=dict, init=False, repr=False, compare=False)
    _chosen: dict[tuple[bytes, tuple[int, ...]], Triangles] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    """What was made before, by gliding joints and nuisances: a fit asks for the same again and again."""

    def chosen(self, gliding: NDArray[np.bool_], nuisances: Sequence[int]) -> Triangles:
        """Return the triangles to fit: reversals of the `gliding` joints (n,) and some nuisances only.

        Nuisance k < n is the delay, k >= n the offset of torque channel k mod n; they are numbered anew from p on.
        """
        glides = gliding.tobytes()
        key = glides, tuple(nuisances)
        if key not in self._chosen:
            if glides not in self._combined:
                self._combined[glides] = combined(counted(self, gliding))
            self._chosen[key] = self._with(self._combined[glides], nuisances)
        return self._chosen[key]

    def _with(self, triangles: Sequence[Triangle], nuisances: Sequence[int]) -> Triangles:
        number = np.full(self.parameters + 2 * self.joints, -1, dtype=np.intp)
        number[: self.parameters] = np.arange(self.parameters)
        number[self.parameters + np.array(nuisances, dtype=np.intp)] = self.parameters + np.arange(len(nuisances))
        items = with_columns(triangles, number, reduced=False)
        rows = sorted({t.row for t in items}, key=lambda row: (_ORDER[row.kind], row.joint))
        return Triangles(items, self.parameters, len(nuisances), self.folds, tuple(rows))

    @property
    def channels(self) -> list[int]:
        """Torque channels that have equations."""
        return sorted({t.row.joint for t in self.steady})

    @property
    def nuisances(self) -> list[int]:
        """Delay and offset of every channel that has equations."""
        return [*self.channels, *(self.joints + k for k in self.channels)]


class Parts(Protocol):
    """Triangles of instants away from reversals, and around them."""

    @property
    def steady(self) -> tuple[Triangle, ...]:
        """Away from reversals."""

    @property
    def reversing(self) -> tuple[Triangle, ...]:
        """Around them."""


def counted(parts: Parts, gliding: NDArray[np.bool_]) -> list[Triangle]:
    """Return the triangles that count with the reversals of the `gliding` joints (n,)."""
    return [*parts.steady, *(t for t in parts.reversing if gliding[t.row.joint])]


def combined(items: Iterable[Triangle]) -> list[Triangle]:
    """Return one triangle for every row group and fold, in their order."""
    groups: dict[tuple[EstimationRow, int], list[Triangle]] = {}
    for triangle in items:
        groups.setdefault((triangle.row, triangle.fold), []).append(triangle)
    ordered = sorted(groups.items(), key=lambda g: (_ORDER[g[0][0].kind], g[0][0].joint, g[0][1]))
    return [merged_triangle(members) for _, members in ordered]


Spread = Callable[[Solution, Sequence[int], NDArray[np.bool_]], Array]
"""(solution, numbers of its nuisances, gliding joints) -> covariance of its basis (r, r)."""
LinkWay = Callable[[int], LinkStiffness | None]
"""Joint -> its stiffness from its link's equation."""


def numbers_of(nuisances: Sequence[ExtraColumns], n: int) -> list[int]:
    """Return the numbers of nuisances among a robot's: k < n the delay of channel k, from n on the offsets."""
    return [sum_row(extra).joint + (n if extra.nuisance == "offset" else 0) for extra in nuisances]


@dataclass(frozen=True)
class TriangleData:
    """Equations of which only triangles are at hand; methods as those of `SampledData`."""

    model: Regressor
    facts: SignalFacts
    merged: MergedTriangles
    spread: Spread
    links: LinkWay
    gliding: NDArray[np.bool_]
    """Joints whose reversals count, (n,)."""
    slow_left_out: bool = False
    """Whether the user said below which speed samples are left out."""
    samples: ClassVar[SampledData | None] = None
    """There are none."""

    @property
    def masked(self) -> Array:
        """Share of instants left out around reversals, per joint, (n,)."""
        used = np.zeros(self.merged.joints, dtype=np.intp)
        for triangle in counted(self.merged, self.gliding):
            used[triangle.row.joint] += triangle.count if triangle.row.kind == "sum" else 0
        return np.asarray((self.facts.known - used) / np.maximum(self.facts.known, 1))

    def counting(self, gliding: NDArray[np.bool_]) -> TriangleData:
        """Return the data with the reversals of some joints (n,) counted as well."""
        return replace(self, gliding=gliding)

    @cached_property
    def delays(self) -> list[ExtraColumns]:
        """The delay of every torque channel that has equations."""
        return self._columns(DELAY, "s")

    @cached_property
    def offsets(self) -> list[ExtraColumns]:
        """The offset of every torque channel that has equations."""
        return self._columns(OFFSET, "N·m")

    def _columns(self, name: str, unit: str) -> list[ExtraColumns]:
        nothing = np.zeros((1, 0))
        return [ExtraColumns(name, {EstimationRow("sum", k): nothing}, (unit,)) for k in self.merged.channels]

    def numbers(self, nuisances: Sequence[ExtraColumns]) -> list[int]:
        """See `numbers_of`."""
        return numbers_of(nuisances, self.merged.joints)

    def triangles(self, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None = None) -> Triangles:
        """Return the triangles of all stretches with the columns of nuisances, then of effects."""
        return self.merged.chosen(self.gliding, self.numbers(nuisances))

    def covariance(self, solution: Solution, extras: Sequence[ExtraColumns]) -> Array:
        """Return the covariance (r, r) of a solution's basis, correlated residuals accounted for."""
        return self.spread(solution, self.numbers(extras), self.gliding)

    def at_reversals(self, values: Array, extras: Sequence[ExtraColumns]) -> tuple[Array, Array]:
        """Return the rms residual of every joint's sum row at reversals and elsewhere, (n,) each; NaN where none."""
        numbers, n = self.numbers(extras), self.merged.joints
        steady = self.merged.chosen(np.zeros(n, dtype=bool), numbers)
        everywhere = self.merged.chosen(np.ones(n, dtype=bool), numbers)
        inside, outside = np.full((2, n), np.nan)
        for k in range(n):
            row = EstimationRow("sum", k)
            away, both = steady.of(row), everywhere.of(row)
            count = sum(t.count for t in both) - sum(t.count for t in away)
            if not away or count == 0:
                continue
            squares = sum(t.squares(values) for t in away)
            inside[k] = np.sqrt(max(sum(t.squares(values) for t in both) - squares, 0.0) / count)
            outside[k] = np.sqrt(squares / sum(t.count for t in away))
        return inside, outside

    def two_ways(self, values: Array, joint: int, extras: Sequence[ExtraColumns] = ()) -> TwoWays | None:
        """Return a joint's stiffness by both regressions of its row, other parameters (p,) given."""
        merged, p = self.merged, self.model.parameters
        if joint not in merged.channels:
            return None
        parts = merged.chosen(self.gliding, merged.nuisances).of(EstimationRow("motor", joint))
        constant = p + merged.nuisances.index(merged.joints + joint)
        return ways_of(parts, values[:p], self.model.names, joint, constant)

    def link_stiffness(self, base: BaseParameters, joint: int) -> LinkStiffness | None:
        """Return a joint's stiffness from its link's equation with the robot file's inertias."""
        return self.links(joint)
