"""How far the predictions of two effects lie apart on one motion, beyond what either can imitate of the other.

All is done to the rows that a diagnosis compares effects by: filtered, decimated, reversals left out, whitened by the
noise that it found. What a rival can imitate is what its own columns, in the best of its shapes, span together with the
base parameters, the torque channels' delays and offsets, and the effects that act anyway.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.whitening import JointWhitener, history, stack
from elid_cli.estimation.regression.effect_columns import extra_of, scene_of
from elid_cli.estimation.regression.nuisances import delay_columns, offset_columns
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import ExtraColumns, full_columns
from elid_cli.experiment.information import States
from elid_cli.experiment.resolve.decision import TRAINED, Distance
from elid_cli.experiment.resolve.played import Acting, Bench, Played
from elid_cli.experiment.resolve.question import Hypothesis
from elid_cli.model.effects import twins_of
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import EstimationRow

UNKNOWN, MOST = 0.3, 0.6
"""Relative standard error of a parameter of which the diagnosis gives none, and most that any is varied by."""
NEARBY, LOOKS = 0.7, 15
"""Logarithm of the factor by which a rival's shape is refined about the best of its grid, and looks per shape."""
TRIED = 24
"""Most shapes of a rival's grid that are tried."""
WEIGHINGS = 4
"""Rounds in which rows are weighted by what is left of them."""
RANK = 1e-9
"""Singular value below which a direction of columns of length one counts as unseen."""
KEPT = 1e-9
"""Part of a column's length beyond the others below which it counts as spanned by them."""


@dataclass(frozen=True)
class Wall:
    """Whitened rows of one played motion, stacked channel by channel."""

    whiteners: tuple[JointWhitener, ...]
    channels: tuple[slice, ...]
    instants: int
    noise: Array
    """Variance of the noise in every channel, (channels,): 1 but where an effect decides which rows count as one."""

    def whitened(self, rows: Mapping[EstimationRow, Array], width: int) -> Array:
        """Return columns of rows, (d, M) each, whitened and stacked, (K, d)."""
        parts = []
        for whitener in self.whiteners:
            series = stack(rows, whitener, self.instants)
            if series is None:
                series = np.zeros((len(whitener.rows), width, self.instants))
            parts += list(whitener.apply(series)[:, :, whitener.use])
        return np.concatenate(parts, axis=1).T


@dataclass
class View:
    """One motion as it would be seen if one hypothesis were true."""

    played: Played
    wall: Wall
    target: Array
    """Whitened residual of the model without the effect, (K,)."""
    rest: Array
    """Orthonormal basis of what acts whichever hypothesis is true, (K, r)."""
    own: Effect
    """The effect itself."""
    taken: float
    """Part of the variance of its rows that the effect takes away, those weighted by the sensors' noise."""
    seen: Array = field(init=False)
    """What of the residual that basis leaves, (K,)."""

    def __post_init__(self) -> None:
        self.seen = self.target - self.rest @ (self.rest.T @ self.target)

    def by_channel(self, values: Array) -> Array:
        """Return sums of squares, (channels,)."""
        return np.array([float(values[c] @ values[c]) for c in self.wall.channels])

    def left(self, rival: Effect) -> Array:
        """Return what of the residual an effect in one shape leaves, (K,)."""
        extra = extra_of(rival, self.played.scene, self.played.signals)
        if not extra.rows:
            return self.seen
        own = self.wall.whitened(extra.rows, extra.width)
        sizes = np.linalg.norm(own, axis=0)
        own = own - self.rest @ (self.rest.T @ own)
        beyond = np.linalg.norm(own, axis=0) > 1e-4 * np.maximum(sizes, 1e-300)
        if not beyond.any():
            return self.seen
        basis, _ = np.linalg.qr(own[:, beyond] / np.linalg.norm(own[:, beyond], axis=0))
        return np.asarray(self.seen - basis @ (basis.T @ self.seen))


class Separation:
    """Distances between hypotheses of one question on any motion.

    Parameters
    ----------
    bench
        Plays the motions.
    """

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.question = bench.question
        self._rest = bench.at_rest()
        self.present = [bench.acting(h, self._rest) for h in self.question.present if not h.once]

    def view(self, states: States, truth: Hypothesis) -> View:
        """Return a motion as it would be seen if an effect were there."""
        mine = self.bench.acting(truth, self._rest)
        played = self.bench.play(states, [*self.present, mine])
        extras = [extra_of(item.effect, played.scene, played.signals) for item in self.present]
        rows = _dense(played.observation, [*extras, *_of_channels(played.observation, mine.effect)])
        if mine.effect.simulated != "log":
            played = replace(played, observation=self._exact(played, rows, mine))
        residual, fitted = self._fitted(played.observation, rows)
        # a search computes its candidates' columns from the parameters that the effect's absence has moved
        played = replace(played, scene=scene_of(self.bench.model, played.signals, fitted))
        taken = self._taken(residual, extra_of(mine.effect, played.scene, played.signals))
        wall = self._wall(played.observation, residual)
        target = wall.whitened({row: values[None] for row, values in residual.items()}, 1)[:, 0]
        return View(played, wall, target, _basis(wall.whitened(rows, _width(rows))), mine.effect, taken)

    def shapes(self, view: View, rival: Hypothesis) -> list[Effect]:
        """Return the rival in the shapes that it may take on a motion, the fitted one first."""
        kind = rival.kind
        own = self.bench.acting(rival, view.played.scene).effect
        grid = kind.grid(view.played.scene, rival.number) if own.shape else []
        chosen = grid[:: max(len(grid) // TRIED, 1)]
        return [own, *(kind(rival.number, shape) for shape in chosen)]

    def refined(self, view: View, shapes: Sequence[Effect]) -> Effect:
        """Return a rival in the shape near the best of some that imitates the truth best."""
        from scipy.optimize import minimize

        best = min(shapes, key=lambda shape: _square(view.left(shape)))
        start = np.array(best.shape)
        free = np.array([value > 0 and not p.fixed for value, p in zip(start, best.shapes, strict=True)], dtype=bool)
        if not free.any():
            return best

        def at(logs: Array) -> Effect:
            shape = start.copy()
            shape[free] = start[free] * np.exp(np.clip(logs, -NEARBY, NEARBY))
            return type(best)(best.joint, tuple(shape))

        def cost(logs: Array) -> float:
            try:
                return _square(view.left(at(logs)))
            except (ValueError, FloatingPointError):
                return np.inf

        size = int(free.sum())
        simplex = np.vstack([np.zeros(size), 0.3 * NEARBY * np.eye(size)])
        found = minimize(cost, np.zeros(size), method="Nelder-Mead",
                         options={"maxfev": LOOKS * size, "initial_simplex": simplex})  # fmt: skip
        return at(found.x)

    def distance(self, view: View, truth: Hypothesis, rival: Hypothesis, shapes: Sequence[Effect]) -> Distance:
        """Return how far the truth's motion lies from what the rival imitates best."""
        # what happened once need not come again: the next log holds the truth or nothing
        left = view.seen if rival.once else min((view.left(shape) for shape in shapes), key=_square)
        # of a channel moved in time the screening knows the first order only: some is left of the truth itself
        itself = view.left(view.own) if view.own.simulated == "log" else np.zeros_like(view.seen)
        share = TRAINED * self.question.share
        counted = np.array([c.stop - c.start for c in view.wall.channels]) * share
        seen, apart, itself = (view.by_channel(part) * share / view.wall.noise for part in (view.seen, left, itself))
        least = truth.kind.least_gain
        return Distance(seen, apart, itself, counted, view.taken, least, rival.effect in twins_of(truth.kind))

    def _exact(self, played: Played, rows: Mapping[EstimationRow, Array], mine: Acting) -> Observation:
        """Return equations that an effect fulfils to the last digit, however nearly the deflections have settled."""
        known = np.concatenate([self.bench.standard, *(item.amplitudes for item in self.present)])
        values = np.zeros(_width(rows))  # no channel is late or has an offset
        values[: len(known)] = known
        own = extra_of(mine.effect, played.scene, played.signals).rows
        groups = []
        for group in played.observation.groups:
            target = values @ rows[group.row]
            if group.row in own:
                target = target + mine.amplitudes @ own[group.row]
            groups.append(replace(group, target=target))
        return replace(played.observation, groups=tuple(groups))

    def _wall(self, observation: Observation, residual: Mapping[EstimationRow, Array]) -> Wall:
        """Return the whitener of a search whose model leaves a residual beside the noise (`JointWhitener.mixed_by`)."""
        found, channels, variances, first = [], [], list[float](), 0
        groups = {group.row: group for group in observation.groups}
        for noise in self.question.noise:
            rows = tuple(EstimationRow(kind, noise.number) for kind in noise.rows)
            use: NDArray[np.bool_] = np.logical_and.reduce([groups[row].use for row in rows])
            plain = JointWhitener(rows, noise.lags, np.eye(len(rows)), history(use, observation.segment))
            seen = plain.apply(np.array([residual[row][None] for row in rows]))[:, 0, plain.use]
            count = seen.shape[1]
            root = np.linalg.inv(noise.mix)
            mix = np.linalg.inv(np.linalg.cholesky(seen @ seen.T / max(count, 1) + root @ root.T))
            found.append(JointWhitener(rows, noise.lags, mix, plain.use))
            variances += np.sum((mix @ root) ** 2, axis=1).tolist()
            for _ in rows:
                channels.append(slice(first, first + count))
                first += count
        return Wall(tuple(found), tuple(channels), observation.instants, np.array(variances))

    def _fitted(
        self, observation: Observation, rows: Mapping[EstimationRow, Array]
    ) -> tuple[dict[EstimationRow, Array], Array]:
        """Return what a fit without the effect leaves of every row, (M,), and its standard parameters, (p,).

        Rows are weighted by what is left of them, as in every fit.
        """
        groups = {group.row: group for group in observation.groups}
        noises = {
            EstimationRow(kind, item.number): float(rms)
            for item in self.question.noise
            for kind, rms in zip(item.rows, item.rms, strict=True)
        }
        system = {row: np.vstack([rows[row], groups[row].target])[:, groups[row].use].T for row in noises}
        sizes = np.sqrt(sum(np.sum(part[:, :-1] ** 2, axis=0) for part in system.values()))
        sizes[sizes == 0] = 1.0
        corners: dict[EstimationRow, Array] = {
            row: np.asarray(np.linalg.qr(part / np.append(sizes, 1.0), mode="r")) for row, part in system.items()
        }
        weights, left = {row: 1.0 / size for row, size in noises.items()}, {}
        for _ in range(WEIGHINGS):
            whole = np.concatenate([weights[row] * corner for row, corner in corners.items()])
            values = np.linalg.lstsq(whole[:, :-1], whole[:, -1], rcond=RANK)[0] / sizes
            for row, size in noises.items():
                left[row] = groups[row].target - values @ rows[row]
                spread = float(np.mean(left[row][groups[row].use] ** 2)) if groups[row].use.any() else 0.0
                weights[row] = 1.0 / float(np.hypot(size, np.sqrt(spread)))
        kept = {row: np.where(groups[row].use, part, 0.0) for row, part in left.items()}
        return kept, values[: observation.parameters]

    def _taken(self, residual: Mapping[EstimationRow, Array], own: ExtraColumns) -> float:
        """Return the part of its rows' variance that an effect takes away, rows weighted by the sensors' noise."""
        effect = whole = 0.0
        for item in self.question.noise:
            for kind, rms, floor in zip(item.rows, item.rms, item.floor, strict=True):
                row = EstimationRow(kind, item.number)
                if row in own.rows:
                    here = float(np.mean(residual[row] ** 2)) / floor**2
                    effect, whole = effect + here, whole + here + (rms / floor) ** 2
        return effect / max(whole, 1e-300)


def _of_channels(observation: Observation, truth: Effect) -> list[ExtraColumns]:
    """Return the columns of every torque channel's delay and offset, which each diagnosis fits along.

    Not the delay of a channel that the truth itself makes late.
    """
    delays = delay_columns(observation)
    if truth.corrects == "torque":
        delays = [extra for extra in delays if all(row.joint != truth.joint for row in extra.rows)]
    return [*delays, *offset_columns(observation)]


def _dense(observation: Observation, extras: Sequence[ExtraColumns]) -> dict[EstimationRow, Array]:
    """Return the columns of standard parameters and extras in every row, (p + e, M)."""
    width = observation.parameters + sum(extra.width for extra in extras)
    rows = {}
    for group in observation.groups:
        index, columns = full_columns(group, extras, observation.parameters)
        rows[group.row] = np.zeros((width, observation.instants))
        rows[group.row][index] = columns
    return rows


def _square(values: Array) -> float:
    return float(values @ values)


def _width(rows: Mapping[EstimationRow, Array]) -> int:
    return len(next(iter(rows.values())))


def _basis(columns: Array) -> Array:
    """Return an orthonormal basis of what columns (K, d) span."""
    from scipy.linalg import qr

    sizes = np.linalg.norm(columns, axis=0)
    columns = columns[:, sizes > 0] / sizes[sizes > 0]
    basis, factor, _ = qr(columns, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(factor))
    return np.asarray(basis[:, pivots > KEPT * pivots[0]])


def varied(hypothesis: Hypothesis, scale: float) -> Hypothesis:
    """Return a hypothesis whose parameters lie so many standard errors from their estimates, within their bounds."""
    kind = hypothesis.kind
    bounds = {p.name: (p.low, p.high) for p in (*kind.amplitudes, *kind.shapes)}
    fixed = {p.name for p in kind.shapes if p.fixed}
    values = dict(hypothesis.parameters)
    for name, value in values.items():
        if name in fixed or name not in bounds:
            continue
        error = hypothesis.std_error.get(name, UNKNOWN * abs(value))
        moved = value + np.sign(value) * np.sign(scale) * min(abs(scale) * error, MOST * abs(value))
        values[name] = float(np.clip(moved, *bounds[name]))
    return replace(hypothesis, parameters=values)
