"""Fitting the effects that a robot file declares.

An effect is linear in its amplitudes; its shapes are refined by variable projection (Golub and Pereyra 1973): the
amplitudes and all base parameters are eliminated, and what remains is a small search over shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.effect_columns import FittedEffects, extra_of
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.other_shapes import APART
from elid_cli.estimation.regression.triangles import ExtraColumns, full_columns
from elid_cli.model.effects.declared import Declared, amplitude_prior
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene
from elid_cli.model.regressor import EstimationRow
from elid_cli.signals.signals import Signals

SHAPE_SPREAD = 0.5
"""Prior standard deviation of a shape's logarithm about its start: holds shapes that the log does not show."""
_SCAN = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Moves of a shape's logarithm that are tried before the refinement."""
_SCANNED = 3
"""Shapes searched together up to which all combinations are tried."""
_STARTS = 5
"""Valleys of the grid that are refined."""
_ALIKE = 60.0
"""Cost above the least up to which a valley is worth a look (`other_shapes`)."""
_LEFT = 1e-13
"""Part of a squared column below which the base columns, or other effects, explain it all."""
_STEP = 1e-3
"""Relative step of the shapes' finite differences."""


def fit_declared(
    observation: Observation,
    signals: Signals,
    scene: Scene,
    effects: Sequence[Declared],
    weights: Mapping[EstimationRow, float],
    nuisances: Sequence[ExtraColumns] = (),
    *,
    scan: bool = True,
) -> FittedEffects:
    """Refine the shapes of effects together, with all linear parameters eliminated.

    Parameters
    ----------
    observation, signals, scene
        The log.
    effects
        What to fit, with starting shapes.
    weights
        Weight of every row group (one over its noise), as in a `Solution`.
    nuisances
        Further linear columns that are eliminated as well.
    scan
        Whether other valleys of the cost are looked for, too.
    """
    projection = _Projection(observation, weights, nuisances)
    cache: dict[tuple[int, tuple[float, ...]], ExtraColumns] = {}

    def extra(number: int, shape: tuple[float, ...]) -> ExtraColumns:
        key = (number, shape)
        if key not in cache:
            effect = type(effects[number].effect)(effects[number].effect.joint, shape)
            cache[key] = extra_of(effect, scene, signals)
        return cache[key]

    places = [(i, k) for i, item in enumerate(effects) for k in item.free]
    start = [item.effect.shape for item in effects]
    others: list[dict[int, Effect]] = []
    if places:
        first = np.array([start[i][k] for i, k in places])
        logarithmic = first > 0
        scale = np.where(logarithmic, 1.0, np.maximum(np.abs(first), 1.0))
        bounds = _bounds(effects, places, logarithmic, scale)

        def shapes(z: Array) -> list[tuple[float, ...]]:
            values = np.where(logarithmic, np.exp(np.where(logarithmic, z, 0.0)), z * scale)
            lists = [list(s) for s in start]
            for value, (i, k) in zip(values, places, strict=True):
                lists[i][k] = float(value)
            return [tuple(s) for s in lists]

        begin = np.where(logarithmic, np.log(np.where(logarithmic, first, 1.0)), first / scale)
        begin = np.clip(begin, bounds[0] + 1e-9, bounds[1] - 1e-9)

        def cost(z: Array) -> Array:
            columns = [extra(i, shape) for i, shape in enumerate(shapes(z))]
            return np.concatenate([projection.residual(columns, effects), (z - begin) / SHAPE_SPREAD])

        groups = sorted({effects[i].searched_with for i, _ in places})
        owners = [groups.index(effects[i].searched_with) for i, _ in places]
        found, alike = _search(cost, begin, owners, bounds) if scan else (_refine(cost, begin, bounds)[0], [])
        start = shapes(found)
        for mine, part in alike:
            z = found.copy()
            z[mine] = part
            moved = {places[k][0] for k in mine}
            others.append({i: _reshaped(effects[i], shapes(z)[i]).effect for i in moved})
    fitted = tuple(_reshaped(item, shape) for item, shape in zip(effects, start, strict=True))
    return FittedEffects(fitted, tuple(extra(i, shape) for i, shape in enumerate(start)), scene, tuple(others))


def _reshaped(item: Declared, shape: tuple[float, ...]) -> Declared:
    return replace(item, effect=type(item.effect)(item.effect.joint, shape))


def _search(
    cost: Callable[[Array], Array], begin: Array, owners: Sequence[int], bounds: tuple[Array, Array]
) -> tuple[Array, list[tuple[NDArray[np.intp], Array]]]:
    """Return the shapes of least cost, and (places, shapes) of other valleys that cost hardly more.

    A grid and refinement from its valleys owner after owner, then all together: shapes of effects of one kind at one
    joint trade against each other, so their cost has more than one valley; those of others hardly meet.
    """
    best, alike = begin, list[tuple[NDArray[np.intp], Array]]()
    for one in sorted(set(owners)):
        mine = np.array([k for k, owner in enumerate(owners) if owner == one])

        def inner(part: Array, mine: NDArray[np.intp] = mine, held: Array = best) -> Array:
            whole = held.copy()
            whole[mine] = part
            return cost(whole)

        limits = (bounds[0][mine], bounds[1][mine])
        starts = _valleys(inner, begin[mine], limits) if len(mine) <= _SCANNED else [begin[mine]]
        refined = [_refine(inner, start, limits) for start in starts]
        part, least = min(refined, key=lambda item: item[1])
        best = best.copy()
        best[mine] = part
        apart = [p for p, c in refined if 2 * (c - least) < _ALIKE and np.max(np.abs(p - part)) > APART]
        alike += [(mine, other) for k, other in enumerate(apart) if not _among(other, apart[:k])]
    return (_refine(cost, best, bounds)[0] if len(set(owners)) > 1 else best), alike


def _among(point: Array, others: Sequence[Array]) -> bool:
    """Whether a point lies in the valley of one of the others."""
    return any(np.max(np.abs(point - other)) <= APART for other in others)


def _refine(cost: Callable[[Array], Array], start: Array, bounds: tuple[Array, Array]) -> tuple[Array, float]:
    from scipy.optimize import least_squares

    step = np.full(len(start), _STEP)
    found = least_squares(cost, start, bounds=bounds, diff_step=step, x_scale=0.3, max_nfev=25)
    return np.asarray(found.x), float(found.cost)


def _valleys(cost: Callable[[Array], Array], begin: Array, bounds: tuple[Array, Array]) -> list[Array]:
    """Return the lowest grid points that are no neighbours of each other, at most `_STARTS`."""
    moves = list(product(_SCAN, repeat=len(begin)))
    points = [np.clip(begin + np.array(move), bounds[0] + 1e-9, bounds[1] - 1e-9) for move in moves]
    values = np.array([float(np.sum(cost(point) ** 2)) for point in points])
    found: list[Array] = []
    for k in np.argsort(values):
        if not _among(points[k], found):
            found.append(points[k])
        if len(found) == _STARTS:
            break
    return found


def _bounds(
    effects: Sequence[Declared], places: Sequence[tuple[int, int]], logarithmic: NDArray[np.bool_], scale: Array
) -> tuple[Array, Array]:
    low, high = np.full(len(places), -np.inf), np.full(len(places), np.inf)
    for number, (i, k) in enumerate(places):
        spec = effects[i].effect.shapes[k]
        if logarithmic[number]:
            low[number] = np.log(spec.low) if spec.low > 0 else -30.0
            high[number] = np.log(spec.high) if np.isfinite(spec.high) else 30.0
        else:
            low[number], high[number] = spec.low / scale[number], spec.high / scale[number]
    return low, high


class _Projection:
    """Weighted equations of a log with their base columns eliminated once."""

    def __init__(
        self, observation: Observation, weights: Mapping[EstimationRow, float], others: Sequence[ExtraColumns]
    ) -> None:
        groups = [g for g in observation.groups if weights.get(g.row, 0.0) > 0 and g.count]
        parameters = observation.parameters
        width = parameters + sum(extra.width for extra in others)
        rows, targets = [], []
        for group in groups:
            index, columns = full_columns(group, others, parameters)
            part = np.zeros((group.count, width))
            part[:, index] = weights[group.row] * columns[:, group.use].T
            rows.append(part)
            targets.append(weights[group.row] * group.target[group.use])
        system = np.concatenate(rows)
        norms = np.linalg.norm(system, axis=0)
        live = norms > 0
        left, singular, _ = np.linalg.svd(system[:, live] / norms[live], full_matrices=False)
        self._base = left[:, singular > 1e-8 * singular[0]]
        target = np.concatenate(targets)
        self._target = target - self._base @ (self._base.T @ target)
        ends = np.cumsum([group.count for group in groups])
        self._places = {
            g.row: (slice(int(end) - g.count, int(end)), weights[g.row], g.use)
            for g, end in zip(groups, ends, strict=True)
        }

    def residual(self, extras: Sequence[ExtraColumns], effects: Sequence[Declared]) -> Array:
        """Return the weighted residual with everything linear eliminated, the amplitudes' prior last, (rows,)."""
        width = sum(extra.width for extra in extras)
        if not width:
            return self._target
        # effects act in few rows: what the base explains of them comes from those alone
        block, known = np.zeros((len(self._target), width)), np.zeros((self._base.shape[1], width))
        first = 0
        for extra in extras:
            own = slice(first, first + extra.width)
            for row, values in extra.rows.items():
                if row in self._places:
                    place, weight, use = self._places[row]
                    block[place, own] = weight * values[:, use].T
                    known[:, own] += self._base[place].T @ block[place, own]
            first = own.stop
        square, pull = block.T @ block, block.T @ self._target
        left = square - known.T @ known
        prior = amplitude_prior(effects, 0, width)
        if prior is not None:
            left, pull = left + prior[:, :-1].T @ prior[:, :-1], pull + prior[:, :-1].T @ prior[:, -1]
        live = np.diag(left) > _LEFT * np.diag(square)
        scale = np.zeros(width)
        scale[live] = 1.0 / np.sqrt(np.diag(left)[live])
        amplitudes = scale * np.linalg.lstsq(left * np.outer(scale, scale), scale * pull, rcond=_LEFT)[0]
        residual: Array = self._target - block @ amplitudes + self._base @ (known @ amplitudes)
        if prior is not None:
            residual = np.concatenate([residual, prior[:, -1] - prior[:, :-1] @ amplitudes])
        return residual


def shape_columns(fitted: FittedEffects, signals: Signals, coefficients: Sequence[Array]) -> list[ExtraColumns]:
    """Return the columns of the shapes' logarithms (or values) at the fit: what their uncertainty costs the rest.

    Parameters
    ----------
    fitted
        Fitted effects.
    signals
        The log.
    coefficients
        Fitted amplitudes of each effect, (d,).
    """
    extras = []
    for item, base, values in zip(fitted.effects, fitted.extras, coefficients, strict=True):
        for k in item.free:
            shape = list(item.effect.shape)
            step = _STEP * max(abs(shape[k]), 1e-6)
            shape[k] += step
            moved = extra_of(type(item.effect)(item.effect.joint, shape), fitted.scene, signals)
            relative = abs(item.effect.shape[k]) or 1.0
            rows = {row: ((values @ (moved.rows[row] - base.rows[row])) * (relative / step))[None] for row in base.rows}
            extras.append(ExtraColumns(f"shape of {item.effect.name}", rows, ("",)))
    return extras
