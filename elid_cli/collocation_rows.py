"""The robot's equations of motion as a collocation needs them: link and motor rows at given states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.collocation import Setting, States
from elid_cli.effects import Declared, FittedEffects
from elid_cli.fitting import Fit
from elid_cli.model import Row, inputs_of
from elid_cli.motion import Motion
from elid_cli.nuisance import DELAY
from elid_cli.terms.effect import DIRECTION_WIDTH, Effect, Scene
from elid_cli.trace import Graph, Program, Scalar, compile_program

Array = NDArray[np.float64]

_SLOW_WEIGHT = 0.05


@dataclass(frozen=True)
class Layout:
    """What stands where in a collocation of a fit."""

    fit: Fit
    channels: tuple[tuple[str, int], ...]
    """Side (q or theta) and joint of every channel."""
    rows: tuple[Row, ...]
    p_columns: NDArray[np.intp]
    """Columns of the fit that are unknowns, in the order of p."""
    setting: Setting
    rates: Sequence[Array] = ()
    """Per piece: rate of the measured torque in every row, N·m/s (N/s), (rows, instants); 0 where no delay is free."""


@dataclass(frozen=True)
class Scanned:
    """An effect whose one free shape can be scanned."""

    number: int
    """Its place among the fit's effects."""
    joint: int
    shape: int
    """Place of its shape's logarithm in z."""
    places: NDArray[np.intp]
    """Places of its amplitudes in p."""
    limits: tuple[float, float]
    """Range of the shape's logarithm."""


def free_shapes(effects: FittedEffects | None) -> Array:
    """Return the logarithms of the shapes that are refined (only positive ones are)."""
    if effects is None:
        return np.zeros(0)
    shapes = [item.effect.shape[k] for item in effects.effects for k in item.free]
    return np.array([np.log(shape) for shape in shapes if shape > 0])


def shaped(effects: FittedEffects, z: Array) -> list[Effect]:
    """Return the effects at shapes whose logarithms are z."""
    found, place = [], 0
    for item in effects.effects:
        shape = list(item.effect.shape)
        for k in item.free:
            if shape[k] > 0:
                shape[k] = float(np.exp(z[place]))
                place += 1
        found.append(type(item.effect)(item.effect.joint, shape))
    return found


def _inputs(motion: Motion) -> Array:
    """Return the traced rows' inputs with sign(v) rounded, so that its slope is seen where a velocity changes sign."""
    inputs = inputs_of(motion)
    inputs[7::9] = np.tanh(motion.dtheta.T / DIRECTION_WIDTH)
    return inputs


class RobotEquations:
    """Link and motor rows of the robot at given states."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._fit = layout.fit
        self._model = layout.fit.model
        self._place = {int(c): k for k, c in enumerate(layout.p_columns)}
        self._row = {row: k for k, row in enumerate(layout.rows)}
        self._still = {
            (side, k): float(np.nanmean(getattr(layout.fit.signals.motion, side)[:, k]))
            for side in ("q", "theta")
            for k in np.flatnonzero(layout.fit.signals.still).tolist()
        }
        self._folded: tuple[bytes, Program] | None = None

    def motion(self, states: States) -> Motion:
        """Return the motion of all joints at the collocation points."""
        n, instants = self._model.robot.n, states.values.shape[2]
        arrays = {name: np.zeros((instants, n)) for name in ("q", "dq", "ddq", "theta", "dtheta", "ddtheta")}
        for (side, k), value in self._still.items():
            arrays[side][:, k] = value
        for c, (side, k) in enumerate(self._layout.channels):
            for d in range(3):
                arrays["d" * d + side][:, k] = states.values[d, c]
                if side == "q" and not self._model.robot.joints[k].elastic:
                    arrays["d" * d + "theta"][:, k] = states.values[d, c]
        t = (states.first + np.arange(instants)) * self._layout.setting.width / self._layout.setting.points
        return Motion(t, *(arrays[k] for k in ("q", "dq", "ddq", "theta", "dtheta", "ddtheta")))

    def residual(self, states: States, p: Array, z: Array) -> Array:
        """Return the model's torques in link and motor rows, (rows, instants)."""
        motion = self.motion(states)
        out = np.empty((len(self._layout.rows), motion.samples))
        self._program(p).run(_inputs(motion), out)
        extra = self._extra_columns(motion, z, states)
        for place, values in extra.items():
            out += p[place] * values
        return out

    def trust(self, states: States) -> Array:
        """Return the weight of every row at given states: friction is undefined where a motor reverses or sticks."""
        motion, signals = self.motion(states), self._fit.signals
        weight = np.ones((len(self._layout.rows), motion.samples))
        for k, row in enumerate(self._layout.rows):
            if row.kind != "link" and not signals.still[row.joint]:
                slow = np.abs(motion.dtheta[:, row.joint]) < signals.min_velocity[row.joint]
                weight[k] = np.where(slow, _SLOW_WEIGHT, 1.0)
        return weight

    def columns(self, states: States, z: Array) -> Array:
        """Return the columns of all linear parameters, (rows, p, instants)."""
        motion = self.motion(states)
        plan = self._model.equations
        columns = np.zeros((len(plan.rows), len(self._place), motion.samples))
        out = np.empty((plan.program.outputs, motion.samples))
        plan.program.run(_inputs(motion), out)
        rows = {item.row: out[item.slots] for item in plan.rows}
        for k, item in enumerate(plan.rows):
            for position, column in enumerate(item.columns):
                if int(column) in self._place:
                    columns[k, self._place[int(column)]] = rows[item.row][position]
        for place, values in self._extra_columns(motion, z, states).items():
            columns[:, place] = values
        return columns

    def _program(self, p: Array) -> Program:
        """Return the traced rows with the parameters folded in."""
        key = p.tobytes()
        if self._folded is None or self._folded[0] != key:
            values = dict.fromkeys(self._model.names, 0.0)
            for column, place in self._place.items():
                if column < self._model.parameters:
                    values[self._model.names[column]] = float(p[place])
            graph = Graph(9 * self._model.robot.n)
            traced = self._model.trace(graph, paper=True)
            outputs: list[Scalar] = []
            for row in self._layout.rows:
                total: Scalar = 0.0
                for name, value in traced[row].items():
                    total = total + value * values[name]
                outputs.append(total)
            self._folded = (key, compile_program(graph, outputs))
        return self._folded[1]

    def _extra_columns(self, motion: Motion, z: Array, states: States) -> dict[int, Array]:
        """Return columns of delays, offsets and effects by their place in p, each (rows, instants)."""
        found: dict[int, Array] = {}
        number = self._model.parameters
        shape = (len(self._layout.rows), motion.samples)
        for extra in self._fit.nuisances:
            if number in self._place:
                values = np.zeros(shape)
                rates = self._layout.rates[states.piece] if extra.name == DELAY else None
                for row in extra.rows:
                    target = row if row in self._row and row.kind != "sum" else None
                    if row.kind == "sum" and not self._model.robot.joints[row.joint].elastic:
                        target = row
                    if target is not None:
                        k = self._row[target]
                        values[k] = 1.0 if rates is None else rates[k, states.first : states.first + motion.samples]
                found[self._place[number]] = values
            number += extra.width
        if self._fit.effects is None:
            return found
        scene = self._scene(motion, states)
        for effect in shaped(self._fit.effects, z):
            for d, values in enumerate(self._effect_rows(effect, scene)):
                if number + d in self._place:
                    found[self._place[number + d]] = values
            number += len(effect.amplitudes)
        return found

    def _effect_rows(self, effect: Effect, scene: Scene) -> Array:
        """Return an effect's columns, (amplitudes, rows, instants)."""
        out = np.zeros((len(effect.amplitudes), len(self._layout.rows), scene.motion.samples))
        for key, rows in effect.columns(scene).items():
            elastic = self._model.robot.joints[key.joint].elastic
            out[:, self._row[Row(key.side, key.joint) if elastic else Row("sum", key.joint)]] += rows
        return out

    def scanned(self, z: Array) -> list[Scanned]:
        """Return the effects that have one free, positive shape, which z holds."""
        if self._fit.effects is None:
            return []
        found, place = [], 0
        column = self._model.parameters + sum(extra.width for extra in self._fit.nuisances)
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

    def dictionary(self, states: States, items: Sequence[Scanned], grids: Sequence[Array]) -> Array:
        """Return columns of effects at every shape of their grids of logarithms, (rows, columns, instants)."""
        assert self._fit.effects is not None
        scene = self._scene(self.motion(states), states)
        columns = []
        for item, grid in zip(items, grids, strict=True):
            declared = self._fit.effects.effects[item.number]
            (free,) = (k for k in declared.free if declared.effect.shape[k] > 0)
            for value in grid:
                shape = list(declared.effect.shape)
                shape[free] = float(np.exp(value))
                columns.append(self._effect_rows(type(declared.effect)(item.joint, shape), scene))
        return np.concatenate(columns).transpose(1, 0, 2)

    def _scene(self, motion: Motion, states: States) -> Scene:
        assert self._fit.effects is not None
        scene = self._fit.effects.scene
        every = self._layout.setting.stride // self._layout.setting.points
        begin = scene.starts[min(states.piece, len(scene.starts) - 1)] + states.first * every
        index = begin + np.arange(motion.samples) * every
        index = np.minimum(index, len(scene.tau) - 1)
        stiffness = np.nan_to_num(scene.stiffness)
        load = np.where(np.isfinite(scene.stiffness), stiffness * (motion.theta - motion.q), scene.load[index])
        return replace(
            scene, motion=motion, dt=scene.dt * every, tau=scene.tau[index], load=load,
            predicted=scene.predicted[index], starts=(0,), temperature=None, cache={},
        )  # fmt: skip

    def final_effects(self, z: Array) -> FittedEffects | None:
        """Return the fit's effects with the shapes found."""
        fitted = self._fit.effects
        if fitted is None:
            return None
        items: Sequence[Declared] = [
            replace(item, effect=effect) for item, effect in zip(fitted.effects, shaped(fitted, z), strict=True)
        ]
        return replace(fitted, effects=tuple(items))
