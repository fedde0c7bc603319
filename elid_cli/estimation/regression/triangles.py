"""Triangles: all that least squares must keep of the data.

The R factor of [columns | right-hand side] of each row group and fold carries everything later: weights, residual
variances, adding or dropping a column, leaving a fold out, merging logs. Solving is a QR of a few dozen rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import cast

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.observation import Observation, RowGroup
from elid_cli.lapack import lapack
from elid_cli.model.effects import nuisance_of
from elid_cli.model.effects.effect import Nuisance
from elid_cli.model.regressor import EstimationRow

_SLICE, _PANEL = 2048, 8
"""Rows taken at a time, and columns of a panel, in QR."""


@dataclass(frozen=True)
class ExtraColumns:
    """Columns beyond the standard parameters (a nuisance or an effect): row -> (d, M), all with the same d."""

    name: str
    rows: Mapping[EstimationRow, Array]
    units: tuple[str, ...] = ()

    @cached_property
    def width(self) -> int:
        """Number of columns d; an effect outside the log acts in no row but keeps its amplitudes."""
        first = next(iter(self.rows.values()), None)
        return len(self.units) if first is None else first.shape[0]

    @property
    def nuisance(self) -> Nuisance | None:
        """Which fault of a torque channel or sensor they are; None: another effect."""
        return nuisance_of(self.name)


@dataclass(frozen=True)
class Triangle:
    """R factor of [columns | target] of one row group in one fold, (k, len(index) + 1)."""

    row: EstimationRow
    fold: int
    index: NDArray[np.intp]
    factor: Array
    count: int
    """Instants it was made of."""
    power: float
    """Sum of squares of the measured torque, the motor's or the joint torque sensor's, over these instants."""

    def squares(self, solution: Array) -> float:
        """Return the residual sum of squares for a solution over all columns."""
        known = np.empty(len(self.index) + 1)
        known[:-1], known[-1] = solution[self.index], -1.0
        residual = self.factor @ known
        return float(residual @ residual)

    def rms(self, solution: Array) -> float:
        """Return the residual rms for a solution over all columns, N·m."""
        return float(np.sqrt(self.squares(solution) / self.count))


@dataclass(frozen=True)
class Triangles:
    """The triangles of a log (or several), for p standard parameters and e extra columns."""

    items: tuple[Triangle, ...]
    parameters: int
    extras: int
    folds: int
    rows: tuple[EstimationRow, ...] = field(default=())
    prior: Array | None = None
    """Further equations [columns | target] in units of their standard deviation, (k, p + e + 1): what is known of
    columns before the data speak."""
    solved: dict[int | None, object] = field(init=False, default_factory=dict, repr=False, compare=False)
    """Solutions with weights by the residuals, by the largest rank (`least_squares.reweighted`)."""
    joint: dict[EstimationRow, Array] = field(init=False, default_factory=dict, repr=False, compare=False)
    """Factors of all folds together, of the row groups of which they are known."""

    @property
    def width(self) -> int:
        """Number of columns p + e."""
        return self.parameters + self.extras

    def of(self, row: EstimationRow, folds: Sequence[int] | None = None) -> list[Triangle]:
        """Return the triangles of one row group, of some folds or all."""
        return [t for t in self.items if t.row == row and (folds is None or t.fold in folds)]

    def rms(self, solution: Array, row: EstimationRow, folds: Sequence[int] | None = None) -> float:
        """Return the residual rms of a row group, N·m; NaN without data."""
        chosen = self.of(row, folds)
        count = sum(t.count for t in chosen)
        return float(np.sqrt(sum(t.squares(solution) for t in chosen) / count)) if count else float("nan")

    def torque_rms(self, row: EstimationRow, folds: Sequence[int] | None = None) -> float:
        """Return the rms of the measured torque over the instants of a row group, N·m."""
        chosen = self.of(row, folds)
        count = sum(t.count for t in chosen)
        return float(np.sqrt(sum(t.power for t in chosen) / count)) if count else float("nan")

    def joined(self) -> Triangles:
        """Return the triangles of all folds as one fold: what is solved again and again is then smaller."""
        groups: dict[EstimationRow, list[Triangle]] = {}
        for triangle in self.items:
            groups.setdefault(triangle.row, []).append(triangle)
        items = tuple(merged_triangle(parts, self.joint.get(row), 0) for row, parts in groups.items())
        return replace(self, items=items, folds=1)

    def stacked(self, weights: Mapping[EstimationRow, float], folds: Sequence[int] | None = None) -> Array:
        """Return the weighted triangles as one system, (rows, p + e + 1), reduced to a triangle."""
        parts = []
        for triangle in self.items:
            if folds is not None and triangle.fold not in folds:
                continue
            weight = weights.get(triangle.row, 0.0)
            if weight == 0.0 or triangle.count == 0:
                continue
            part = np.zeros((triangle.factor.shape[0], self.width + 1))
            part[:, triangle.index] = weight * triangle.factor[:, :-1]
            part[:, -1] = weight * triangle.factor[:, -1]
            parts.append(part)
        if not parts:
            return np.zeros((0, self.width + 1))
        if self.prior is not None:
            parts.append(self.prior)
        return factor_of(np.concatenate(parts))


def merged_triangle(parts: Sequence[Triangle], known: Array | None = None, fold: int | None = None) -> Triangle:
    """Return the triangle of several of one row group, by default with the fold of the first; `known`: its factor."""
    first = parts[0]
    fold = first.fold if fold is None else fold
    if len(parts) == 1:
        return Triangle(first.row, fold, first.index, first.factor, first.count, first.power)
    factor = factor_of(np.concatenate([part.factor for part in parts])) if known is None else known
    count, power = sum([p.count for p in parts]), sum([p.power for p in parts])
    return Triangle(first.row, fold, first.index, factor, count, power)


def with_columns(items: Sequence[Triangle], number: NDArray[np.intp], *, reduced: bool) -> tuple[Triangle, ...]:
    """Return triangles with some columns only: `number` tells their new ones by the old, -1 of those that go.

    They are triangles again where they are `reduced`.
    """
    found = []
    columns: dict[int, tuple[NDArray[np.intp], NDArray[np.intp] | None]] = {}  # the folds of a row group share theirs
    for triangle in items:
        if id(triangle.index) not in columns:
            kept = np.flatnonzero(number[triangle.index] >= 0)
            order = kept[np.argsort(number[triangle.index[kept]])]
            whole = np.array_equal(order, np.arange(len(triangle.index)))
            chosen = None if whole else np.append(order, len(triangle.index))
            columns[id(triangle.index)] = number[triangle.index[order]], chosen
        index, chosen = columns[id(triangle.index)]
        factor = triangle.factor if chosen is None else triangle.factor[:, chosen]
        factor = factor_of(factor) if reduced and chosen is not None else factor
        found.append(Triangle(triangle.row, triangle.fold, index, factor, triangle.count, triangle.power))
    return tuple(found)


def to_triangles(
    observation: Observation,
    extras: Sequence[ExtraColumns] = (),
    fold: NDArray[np.intp] | None = None,
) -> Triangles:
    """Reduce an observation to triangles.

    Parameters
    ----------
    observation
        Filtered equations.
    extras
        Further columns, numbered from p on in this order.
    fold
        Fold of every instant, (M,); default: one fold.
    """
    fold = np.zeros(observation.instants, dtype=np.intp) if fold is None else fold
    for before in cast(list[_Reduction], observation.reductions):
        if set(map(id, extras)) <= set(map(id, before.extras)) and np.array_equal(before.fold, fold):
            grown = _grown(before, observation)
            if grown is not None:
                observation.reductions[:] = [grown]
                return _with_fewer(grown.triangles, grown.extras, extras)
    count = int(fold.max()) + 1 if len(fold) else 1
    items = []
    of_folds: dict[int, list[NDArray[np.intp]]] = {}  # row groups of one joint share their marks
    for group in observation.groups:
        index, parts = parts_of(group, extras, observation.parameters)
        if id(group.use) not in of_folds:
            of_folds[id(group.use)] = by_fold(group.use, fold, count)
        for number, use in enumerate(of_folds[id(group.use)]):
            if len(use):
                factor, power = _factor(None, parts, use), power_of(observation, group, use)
                items.append(Triangle(group.row, number, index, factor, len(use), power))
    rows = tuple(group.row for group in observation.groups if group.count)
    found = Triangles(tuple(items), observation.parameters, sum(e.width for e in extras), count, rows)
    if extras:
        observation.reductions[:] = [_Reduction(found, tuple(extras), fold, observation.groups)]
    return found


@dataclass(frozen=True)
class _Reduction:
    """Triangles with what they were made of."""

    triangles: Triangles
    extras: Sequence[ExtraColumns]
    fold: NDArray[np.intp]
    groups: tuple[RowGroup, ...]


def _grown(before: _Reduction, observation: Observation) -> _Reduction | None:
    """Return the reduction with the instants that `observation` counts beyond it; None where it counts some no more."""
    known = {(item.row, item.fold): item for item in before.triangles.items}
    items = []
    for old, group in zip(before.groups, observation.groups, strict=True):
        if np.array_equal(old.use, group.use):
            own = (known.get((group.row, number)) for number in range(before.triangles.folds))
            items += [item for item in own if item is not None]
            continue
        if (old.use & ~group.use).any():
            return None
        index, parts = parts_of(group, before.extras, observation.parameters)
        for number, use in enumerate(by_fold(group.use & ~old.use, before.fold, before.triangles.folds)):
            item = known.get((group.row, number))
            if len(use):
                factor, power = _factor(item.factor if item else None, parts, use), power_of(observation, group, use)
                count = len(use) + (item.count if item else 0)
                power += item.power if item else 0.0
                item = Triangle(group.row, number, index, factor, count, power)
            if item is not None:
                items.append(item)
    if len(items) == len(before.triangles.items) and all(item is known.get((item.row, item.fold)) for item in items):
        return before
    rows = tuple(group.row for group in observation.groups if group.count)
    triangles = replace(before.triangles, items=tuple(items), rows=rows)
    return replace(before, triangles=triangles, groups=observation.groups)


def by_fold(use: NDArray[np.bool_], fold: NDArray[np.intp], count: int) -> list[NDArray[np.intp]]:
    """Return the marked instants of every fold."""
    marked = np.flatnonzero(use)
    own = fold[marked]
    order = np.argsort(own, kind="stable")
    bounds = np.searchsorted(own[order], np.arange(count + 1)).tolist()
    return [marked[order[start:stop]] for start, stop in pairwise(bounds)]


def power_of(observation: Observation, group: RowGroup, use: NDArray[np.intp]) -> float:
    """Return the sum of squares of the measured torque of a row group's instants."""
    torque = group.target if group.row.kind in ("load", "spring") else observation.tau[group.row.joint]
    return float(np.sum(torque[use] ** 2))


def _with_fewer(triangles: Triangles, given: Sequence[ExtraColumns], extras: Sequence[ExtraColumns]) -> Triangles:
    """Return triangles with some of the extra columns only: those of the data need not be made again for that."""
    if list(map(id, given)) == list(map(id, extras)):
        return triangles
    number = np.full(triangles.width, -1, dtype=np.intp)
    number[: triangles.parameters] = np.arange(triangles.parameters)
    places = dict(zip(map(id, given), np.cumsum([0, *(extra.width for extra in given)])[:-1], strict=True))
    start = triangles.parameters
    for extra in extras:
        first = triangles.parameters + int(places[id(extra)])
        number[first : first + extra.width] = np.arange(start, start + extra.width)
        start += extra.width
    items = with_columns(triangles.items, number, reduced=True)
    return replace(triangles, items=items, extras=start - triangles.parameters)


def full_columns(group: RowGroup, extras: Sequence[ExtraColumns], parameters: int) -> tuple[NDArray[np.intp], Array]:
    """Return (column numbers, columns (k, M)) of a row group with the extra columns that act on it."""
    index, parts = parts_of(group, extras, parameters)
    return index, np.concatenate(parts[:-1])


def parts_of(group: RowGroup, extras: Sequence[ExtraColumns], parameters: int) -> tuple[NDArray[np.intp], list[Array]]:
    """Return (column numbers, arrays (k, M) of columns, the last that of the target)."""
    index, columns = [group.index], [group.columns]
    place = parameters
    for extra in extras:
        width, own = extra.width, extra.rows.get(group.row)
        if own is not None:
            index.append(np.arange(place, place + width, dtype=np.intp))
            columns.append(own)
        place += width
    return np.concatenate(index), [*columns, group.target[None]]


def _factor(before: Array | None, parts: Sequence[Array], use: NDArray[np.intp]) -> Array:
    """Return the R factor of a triangle, if there is one, and the instants `use` (m,) of columns (k, M).

    The columns are gathered some thousand instants at a time: no copy of all of them is made.
    """
    width = sum(map(len, parts))
    rows = 0 if before is None else len(before)
    if rows + len(use) <= width:
        found = np.concatenate([part.take(use, axis=1) for part in parts]).T
        return np.ascontiguousarray(found) if before is None else np.concatenate([before, found])
    factor = np.zeros((width, width), order="F")
    if before is not None:
        factor = onto(factor, np.array(before, order="F"))
    for start in range(0, len(use), _SLICE):
        here = use[start : start + _SLICE]
        block = np.empty((len(here), width), order="F")
        place = 0
        for part in parts:  # "clip" spares a buffer: no instant lies outside
            part.take(here, axis=1, out=block.T[place : place + len(part)], mode="clip")
            place += len(part)
        factor = onto(factor, block)
    return np.ascontiguousarray(factor)


def factor_of(system: Array) -> Array:
    """Return the R factor of a tall matrix (at most as many rows as columns).

    Rows are taken some thousand at a time onto the triangle of those before (LAPACK's tpqrt with narrow panels: three
    times as fast as QR of the whole, and no second copy of it). Householder's way is accurate column by column, so
    that columns of any scale may stand side by side.
    """
    rows, width = system.shape
    if rows <= width:
        return np.array(system)
    factor = np.zeros((width, width), order="F")
    for start in range(0, rows, _SLICE):
        factor = onto(factor, np.array(system[start : start + _SLICE], order="F"))
    return np.ascontiguousarray(factor)


def onto(factor: Array, system: Array) -> Array:
    """Return the R factor of a triangle (width, width) and further rows (m, width), both overwritten.

    Both are best in Fortran's order: others are copied first.
    """
    return np.asarray(lapack().dtpqrt(0, min(_PANEL, len(factor)), factor, system, overwrite_a=1, overwrite_b=1)[0])
