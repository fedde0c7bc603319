"""Torques of effects in the link and motor rows of a collocation, at given states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.collocation.layout import Scanned, UnknownsLayout, shaped
from elid_cli.estimation.collocation.problem import States
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.model.effects.declared import Declared
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion

_SHAPE_STEP = 1e-4
"""Step of differences in a shape's logarithm."""

Placed = tuple[Effect, list[int]]
"""An effect, and where its amplitudes stand in p; -1 where they do not."""
Rows = list[tuple[int, Array]]
"""An effect's columns in the rows that it acts on, (amplitudes, instants) each, with the numbers of these."""


@dataclass(frozen=True)
class EffectsHere:
    """The columns of effects at given states, as far as they have been asked for; nobody may change them."""

    scene: Scene
    robot: Robot
    numbers: Mapping[EstimationRow, int]
    """Numbers of the rows."""
    known: dict[tuple[str, int, tuple[float, ...]], Rows] = field(default_factory=dict)
    """Columns by name, joint and shape."""

    def columns(self, effect: Effect) -> Rows:
        """Return an effect's columns in the rows that it acts on."""
        key = effect.name, effect.joint, effect.shape
        if key not in self.known:
            self.known[key] = [(self._number(row), values) for row, values in effect.columns(self.scene).items()]
        return self.known[key]

    def rows(self, effect: Effect) -> Array:
        """Return an effect's columns in all rows, (amplitudes, rows, instants)."""
        out = np.zeros((len(effect.amplitudes), len(self.numbers), self.scene.samples))
        for number, columns in self.columns(effect):
            out[:, number] += columns
        return out

    def add(self, out: Array, placed: Sequence[Placed], p: Array) -> None:
        """Add the torques of effects to those of the rows (rows, instants)."""
        for effect, places in placed:
            for number, columns in self.columns(effect):
                for place, values in zip(places, columns, strict=True):
                    if place >= 0:
                        out[number] += p[place] * values

    def afresh(self) -> EffectsHere:
        """Return the same without what has been asked for."""
        return replace(self, scene=replace(self.scene, cache={}), known={})

    def _number(self, row: EquationRow) -> int:
        elastic = self.robot.joints[row.joint].elastic
        return self.numbers[EstimationRow(row.side, row.joint) if elastic else EstimationRow("sum", row.joint)]


def apart_by_speed(placed: Sequence[Placed]) -> tuple[dict[int, list[Placed]], list[Placed]]:
    """Return the effects that follow from a motor's speed alone, by joint, and the others."""
    by_speed: dict[int, list[Placed]] = {}
    for item in placed:
        if item[0].of_motor_speed:
            by_speed.setdefault(item[0].joint, []).append(item)
    return by_speed, [item for item in placed if not item[0].of_motor_speed]


class EffectRows:
    """The effects of a fit in the rows of a collocation."""

    def __init__(self, layout: UnknownsLayout) -> None:
        self._layout, self._fit = layout, layout.fit
        self._place = {int(c): k for k, c in enumerate(layout.p_columns)}
        self._numbers = {row: k for k, row in enumerate(layout.rows)}
        self._kept: dict[tuple[int, int, int], tuple[Array, Array, Array]] = {}
        if self._fit.effects is not None:
            self._stiffness = np.nan_to_num(self._fit.effects.scene.stiffness)
            self._rigid = ~np.isfinite(self._fit.effects.scene.stiffness)

    def here(self, motion: Motion, states: States) -> EffectsHere | None:
        """Return the effects' columns at given states, whose motion is given too; None where there are no effects."""
        if self._fit.effects is None:
            return None
        scene = self._fit.effects.scene
        every = self._layout.setting.stride // self._layout.setting.points
        where = (states.piece, states.first, motion.samples)
        if where not in self._kept:
            begin = scene.starts[min(states.piece, len(scene.starts) - 1)] + states.first * every
            index = np.minimum(begin + np.arange(motion.samples) * every, len(scene.tau) - 1)
            self._kept[where] = scene.tau[index], scene.predicted[index], scene.load[index]
        tau, predicted, known = self._kept[where]
        load = known if self._rigid.all() else np.where(self._rigid, known, self._stiffness * (motion.theta - motion.q))
        found = replace(
            scene, motion=motion, dt=scene.dt * every, tau=tau, load=load,
            predicted=predicted, starts=(0,), temperature=None, cache={},
        )  # fmt: skip
        return EffectsHere(found, self._fit.model.robot, self._numbers)

    def placed(self, z: Array) -> list[Placed]:
        """Return the effects at shapes whose logarithms are z, with the places of their amplitudes in p, or -1."""
        if self._fit.effects is None:
            return []
        found, column = [], self._fit.first_amplitude
        for effect in shaped(self._fit.effects, z):
            found.append((effect, [self._place.get(column + d, -1) for d in range(len(effect.amplitudes))]))
            column += len(effect.amplitudes)
        return found

    def shape_slopes(self, here: EffectsHere | None, p: Array, z: Array) -> Array:
        """Return the derivatives of the rows' torques by the logarithms of the shapes, (rows, shapes, instants)."""
        assert here is not None
        found = np.zeros((len(self._numbers), len(z), here.scene.samples))
        before = self.placed(z)
        torques: dict[int, Array] = {}
        for k in range(len(z)):
            moved = z.copy()
            moved[k] += _SHAPE_STEP
            for number, (one, other) in enumerate(zip(before, self.placed(moved), strict=True)):
                if one[0].shape == other[0].shape:
                    continue
                if number not in torques:
                    torques[number] = np.zeros((len(found), here.scene.samples))
                    here.add(torques[number], [one], p)
                after = np.zeros_like(torques[number])
                here.afresh().add(after, [other], p)
                found[:, k] = (after - torques[number]) / _SHAPE_STEP
        return found

    def scanned(self, z: Array) -> list[Scanned]:
        """Return the effects that have one free, positive shape, which z holds."""
        if self._fit.effects is None:
            return []
        found, place, column = [], 0, self._fit.first_amplitude
        for number, item in enumerate(self._fit.effects.effects):
            free = [k for k in item.free if item.effect.shape[k] > 0]
            columns = range(column, column + len(item.effect.amplitudes))
            if len(free) == 1 and all(c in self._place for c in columns):
                spec = item.effect.shapes[free[0]]
                limits = (np.log(spec.low) if spec.low > 0 else -np.inf, np.log(spec.high))
                spots = np.array([self._place[c] for c in columns], dtype=np.intp)
                found.append(Scanned(number, item.effect.joint, place, spots, limits))
            column += len(item.effect.amplitudes)
            place += len(free)
        return found

    def dictionary(self, here: EffectsHere | None, items: Sequence[Scanned], grids: Sequence[Array]) -> Array:
        """Return columns of effects at every shape of their grids of logarithms, (rows, columns, instants)."""
        assert self._fit.effects is not None
        assert here is not None
        columns = []
        for item, grid in zip(items, grids, strict=True):
            declared = self._fit.effects.effects[item.number]
            (free,) = (k for k in declared.free if declared.effect.shape[k] > 0)
            for value in grid:
                shape = list(declared.effect.shape)
                shape[free] = float(np.exp(value))
                columns.append(here.rows(type(declared.effect)(item.joint, shape)))
        return np.concatenate(columns).transpose(1, 0, 2)

    def final(self, z: Array) -> FittedEffects | None:
        """Return the fit's effects with the shapes found."""
        fitted = self._fit.effects
        if fitted is None:
            return None
        items: Sequence[Declared] = [
            replace(item, effect=effect) for item, effect in zip(fitted.effects, shaped(fitted, z), strict=True)
        ]
        return replace(fitted, effects=tuple(items))
