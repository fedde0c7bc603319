"""Equations whose own columns are reduced once, so that others beside them are reduced quickly, again and again.

A search fits one log a hundred times with other effects; the columns of the standard parameters stay. Their Householder
reflections are kept and applied to what is new, of which only what they leave over is reduced: R of [A b] is R of A,
the reflected b above, and R of the rest below (Golub and Van Loan, 5.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.observation import Observation, RowGroup
from elid_cli.estimation.regression.triangles import (
    ExtraColumns,
    Triangle,
    Triangles,
    by_fold,
    factor_of,
    parts_of,
    power_of,
)
from elid_cli.lapack import lapack

ROOM = 64_000_000
"""Bytes of columns up to which their reflections are kept."""
_BLOCK = 32
"""Reflections that LAPACK applies at once."""
_KEPT = 4
"""Sets of further columns whose triangles are kept."""


def beside_own(
    observation: Observation, extras: Sequence[ExtraColumns], fold: NDArray[np.intp] | None
) -> Triangles | None:
    """Return `to_triangles` of the same by the reflections of the own columns; None where they are not worth keeping.

    They are from the second time on that an observation is reduced with columns that are new.
    """
    own = _own_columns(observation, fold)
    if own is None:
        return None
    items: list[Triangle] = []
    joint = {}
    for part in own.parts:
        row = part.group.row
        index, _ = parts_of(part.group, extras, observation.parameters)
        factors, joint[row] = part.factors([extra for extra in extras if row in extra.rows])
        items += [
            Triangle(row, number, index, factor, count, power)
            for (number, count, power), factor in zip(part.facts, factors, strict=True)
        ]
    width = sum(extra.width for extra in extras)
    found = Triangles(tuple(items), observation.parameters, width, own.folds, tuple(joint))
    found.joint.update(joint)
    return found


class _Own(NamedTuple):
    """The row groups of an observation with their own columns reduced."""

    fold: NDArray[np.intp]
    folds: int
    """Number of folds."""
    parts: tuple[_OwnColumns, ...]


def _own_columns(observation: Observation, fold: NDArray[np.intp] | None) -> _Own | None:
    fold = np.zeros(observation.instants, dtype=np.intp) if fold is None else fold
    for known in cast(list[_Own], observation.own):
        if np.array_equal(known.fold, fold):
            return known
    if not observation.reductions or sum(group.columns.nbytes for group in observation.groups) > ROOM:
        return None
    count = int(fold.max()) + 1 if len(fold) else 1
    marked = [(group, by_fold(group.use, fold, count)) for group in observation.groups if group.count]
    if any(0 < len(use) <= len(group.index) for group, uses in marked for use in uses):
        return None
    own = _Own(fold, count, tuple(_OwnColumns(observation, group, uses) for group, uses in marked))
    observation.own[:] = [own]
    return own


class _OwnColumns:
    """A row group, its own columns reduced in every fold that has any of the instants `uses`, marked fold by fold."""

    def __init__(self, observation: Observation, group: RowGroup, uses: Sequence[NDArray[np.intp]]) -> None:
        self.group = group
        self.facts = [
            (number, len(use), power_of(observation, group, use)) for number, use in enumerate(uses) if len(use)
        ]
        """Fold, number of instants and power."""
        self._folds = [_Fold(group, use) for use in uses if len(use)]
        self._turned: dict[int, tuple[ExtraColumns, list[Array]]] = {}
        self._factors: dict[tuple[int, ...], tuple[list[ExtraColumns], list[Array], Array]] = {}

    def factors(self, extras: Sequence[ExtraColumns]) -> tuple[list[Array], Array]:
        """Return the triangles of [own columns | extras | target] of every fold, and that of all folds together."""
        key = tuple(map(id, extras))
        known = self._factors.pop(key, None)
        if known is None:
            known = (list(extras), *self._reduced(extras))
            if len(self._factors) >= _KEPT:
                del self._factors[next(iter(self._factors))]
        self._factors[key] = known  # the last that was asked for goes last
        return known[1], known[2]

    def _reduced(self, extras: Sequence[ExtraColumns]) -> tuple[list[Array], Array]:
        turned = [self._turned_of(extra) for extra in extras]
        chosen = set(map(id, extras))
        # of effects' columns only the last are asked for again
        self._turned = {k: v for k, v in self._turned.items() if k in chosen or v[0].nuisance is not None}
        found = [fold.factor([columns[k] for columns in turned]) for k, fold in enumerate(self._folds)]
        return found, found[0] if len(found) == 1 else factor_of(np.concatenate(found))

    def _turned_of(self, extra: ExtraColumns) -> list[Array]:
        if id(extra) not in self._turned:
            columns = extra.rows[self.group.row]
            self._turned[id(extra)] = extra, [fold.turned(columns) for fold in self._folds]
        return self._turned[id(extra)][1]


class _Fold:
    """Some instants of a row group: reflections that make a triangle of its own columns, and the target after them."""

    def __init__(self, group: RowGroup, use: NDArray[np.intp]) -> None:
        self._use, self._width = use, len(group.index)
        self._reflected, self._tau, _, _ = lapack().dgeqrf(
            group.columns.take(use, axis=1).T, _BLOCK * self._width, overwrite_a=1
        )
        self._corner = np.triu(self._reflected[: self._width])
        self._target = self.turned(group.target[None])

    def turned(self, columns: Array) -> Array:
        """Return columns (d, M) after the reflections, (m, d)."""
        here = columns.take(self._use, axis=1).T
        work = _BLOCK * max(here.shape[1], _BLOCK)
        return np.asarray(lapack().dormqr("L", "T", self._reflected, self._tau, here, work, overwrite_c=1)[0])

    def factor(self, turned: Sequence[Array]) -> Array:
        """Return the R factor with further columns, turned, before the target."""
        columns = np.concatenate([*turned, self._target], axis=1)
        width = self._width
        rest = factor_of(columns[width:])
        factor = np.zeros((width + len(rest), width + columns.shape[1]))
        factor[:width, :width] = self._corner
        factor[:width, width:] = columns[:width]
        factor[width:, width:] = rest
        return factor
