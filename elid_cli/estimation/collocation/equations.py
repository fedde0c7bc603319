"""The robot's equations of motion as a collocation needs them: link and motor rows at given states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.collocation.layout import Moved, Scanned, UnknownsLayout, moved_together, shaped, slots_of
from elid_cli.estimation.collocation.problem import States
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.model.effects.declared import Declared
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import EquationRow, Scene, direction_widths
from elid_cli.model.program import Program, compile_program
from elid_cli.model.regressor import INPUTS, EstimationRow, fill_inputs
from elid_cli.model.tracing import Graph, Scalar
from elid_cli.signals.motion import STATES, Motion

_SLOW_WEIGHT = 0.05
REVERSES = 2.0
"""Samples before and after a reversal in which torques that were moved in time count as little: where the delay is no
whole number of samples, the step of Coulomb friction is smeared over as many."""
_SHAPE_STEP = 1e-4
"""Step of differences in a shape's logarithm."""

Placed = tuple[Effect, list[int]]
"""An effect, and where its amplitudes stand in p; -1 where they do not."""


@dataclass(frozen=True)
class _Here:
    """What the equations are computed from at given states."""

    states: States
    motion: Motion
    inputs: Array
    """Inputs of the traced programs, (inputs, instants)."""
    scene: Scene | None
    """What effects are computed from, where there are any."""


class RobotEquations:
    """Link and motor rows of the robot at given states."""

    def __init__(self, layout: UnknownsLayout) -> None:
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
        self._widths = direction_widths(self._model.robot)
        self._slots = [
            [slots_of(side, k, d, elastic=self._model.robot.joints[k].elastic) for d in range(3)]
            for side, k in layout.channels
        ]
        self._kept: dict[tuple[int, int, int], tuple[Array, Array, Array]] = {}
        self._known: _Here | None = None
        if self._fit.effects is not None:
            self._stiffness = np.nan_to_num(self._fit.effects.scene.stiffness)
            self._rigid = ~np.isfinite(self._fit.effects.scene.stiffness)

    def _here(self, states: States) -> _Here:
        """Return what residual, slopes and columns at the same states share."""
        if self._known is None or self._known.states is not states:
            motion = self.motion(states)
            scene = None if self._fit.effects is None else self._scene(motion, states)
            self._known = _Here(states, motion, self._inputs(motion), scene)
        return self._known

    def motion(self, states: States) -> Motion:
        """Return the motion of all joints at the collocation points."""
        n, instants = self._model.robot.n, states.values.shape[2]
        arrays = {name: np.zeros((instants, n)) for name in STATES}
        for (side, k), value in self._still.items():
            arrays[side][:, k] = value
        for c, (side, k) in enumerate(self._layout.channels):
            for d in range(3):
                arrays["d" * d + side][:, k] = states.values[d, c]
                if side == "q" and not self._model.robot.joints[k].elastic:
                    arrays["d" * d + "theta"][:, k] = states.values[d, c]
        t = (states.first + np.arange(instants)) * self._layout.setting.width / self._layout.setting.points
        return Motion(t, **arrays)

    def residual(self, states: States, p: Array, z: Array) -> Array:
        """Return the model's torques in link and motor rows, (rows, instants)."""
        here = self._here(states)
        out = np.empty((len(self._layout.rows), here.motion.samples))
        self._program.run(here.inputs, out, list(map(np.asarray, p)))
        for effect, places in self._placed(z):
            self._add(out, effect, places, here.scene, p)
        for place, row, values in self._nuisances(states):
            out[row] += p[place] * values
        return out

    def slopes(self, states: States, p: Array, z: Array, steps: Array) -> Array:
        """Return the derivatives of `residual` by the states from forward differences, (3, rows, channels, instants).

        States that no row of the robot depends on together are moved at once (Curtis, Powell and Reid 1974); effects
        may depend on any. Nuisances are the same at any state.
        """
        here, program, values = self._here(states), self._program, list(map(np.asarray, p))
        motion, inputs = here.motion, here.inputs
        before, after = np.empty((2, len(self._layout.rows), motion.samples))
        program.run(inputs, before, values)
        found = np.zeros((3, len(before), len(self._layout.channels), motion.samples))
        present = np.empty_like(inputs)
        for group in self._together:
            present[:] = inputs
            for c, d, _ in group:
                with self._moved(motion, c, d, steps[d, c]) as joint:
                    fill_inputs(present, motion, joint, self._slots[c][d], self._widths[joint])
            program.run(present, after, values)
            for c, d, touched in group:
                found[d, touched, c] = (after[touched] - before[touched]) / steps[d, c]
        by_speed, others = self._by_speed(self._placed(z))
        for c, (side, joint) in enumerate(self._layout.channels):
            motor = side == "theta" or not self._model.robot.joints[joint].elastic
            for d in range(3):
                placed = [*others, *(by_speed.get(joint, []) if motor and d == 1 else [])]
                if not placed:
                    continue
                self._effects(here.scene, p, placed, before)
                with self._moved(motion, c, d, steps[d, c]):
                    self._effects(self._scene(motion, states), p, placed, after)
                found[d, :, c] += (after - before) / steps[d, c]
        return found

    @staticmethod
    def _by_speed(placed: Sequence[Placed]) -> tuple[dict[int, list[Placed]], list[Placed]]:
        """Return the effects that follow from a motor's speed alone, by joint, and the others."""
        by_speed: dict[int, list[Placed]] = {}
        for item in placed:
            if item[0].of_motor_speed:
                by_speed.setdefault(item[0].joint, []).append(item)
        return by_speed, [item for item in placed if not item[0].of_motor_speed]

    @contextmanager
    def _moved(self, motion: Motion, channel: int, derivative: int, step: float) -> Iterator[int]:
        """Move a derivative of a channel by a step for a while; yields the joint."""
        side, joint = self._layout.channels[channel]
        sides = (side,) if self._model.robot.joints[joint].elastic else ("q", "theta")
        columns = [getattr(motion, "d" * derivative + one)[:, joint] for one in sides]
        held = [column.copy() for column in columns]
        for column in columns:
            column += step
        yield joint
        for column, values in zip(columns, held, strict=True):
            column[:] = values

    def _effects(self, scene: Scene | None, p: Array, placed: Sequence[Placed], out: Array) -> None:
        """Write the torques of effects alone, (rows, instants)."""
        out[:] = 0.0
        for effect, places in placed:
            self._add(out, effect, places, scene, p)

    def shape_slopes(self, states: States, p: Array, z: Array) -> Array:
        """Return the derivatives of `residual` by the logarithms of the effects' shapes, (rows, shapes, instants)."""
        scene = self._here(states).scene
        assert scene is not None
        found = np.zeros((len(self._layout.rows), len(z), scene.samples))
        before = self._placed(z)
        torques: dict[int, Array] = {}
        for k in range(len(z)):
            moved = z.copy()
            moved[k] += _SHAPE_STEP
            for number, (here, there) in enumerate(zip(before, self._placed(moved), strict=True)):
                if here[0].shape == there[0].shape:
                    continue
                if number not in torques:
                    torques[number] = np.zeros((len(found), scene.samples))
                    self._add(torques[number], *here, scene, p)
                after = np.zeros_like(torques[number])
                self._add(after, *there, replace(scene, cache={}), p)
                found[:, k] = (after - torques[number]) / _SHAPE_STEP
        return found

    def _inputs(self, motion: Motion) -> Array:
        rows = np.empty((INPUTS * self._model.robot.n, motion.samples))
        for k, width in enumerate(self._widths):
            fill_inputs(rows, motion, k, range(len(rows)), width)
        return rows

    def _placed(self, z: Array) -> list[Placed]:
        """Return the effects at shapes whose logarithms are z, with the places of their amplitudes in p, or -1."""
        if self._fit.effects is None:
            return []
        found, column = [], self._fit.first_amplitude
        for effect in shaped(self._fit.effects, z):
            found.append((effect, [self._place.get(column + d, -1) for d in range(len(effect.amplitudes))]))
            column += len(effect.amplitudes)
        return found

    def _add(self, out: Array, effect: Effect, places: Sequence[int], scene: Scene | None, p: Array) -> None:
        """Add an effect's torques to those of the rows (rows, instants)."""
        assert scene is not None
        for key, rows in effect.columns(scene).items():
            row = self._row_of(key)
            for place, values in zip(places, rows, strict=True):
                if place >= 0:
                    out[row] += p[place] * values

    def _row_of(self, key: EquationRow) -> int:
        elastic = self._model.robot.joints[key.joint].elastic
        return self._row[EstimationRow(key.side, key.joint) if elastic else EstimationRow("sum", key.joint)]

    def trust(self, states: States) -> Array:
        """Return the weight of every row at given states: friction is undefined where a motor reverses or sticks."""
        motion, signals = self.motion(states), self._fit.signals
        weight = np.ones((len(self._layout.rows), motion.samples))
        for k, row in enumerate(self._layout.rows):
            if row.kind != "link" and not signals.still[row.joint]:
                least: Array | float = signals.min_velocity[row.joint]
                if signals.moved.any() and signals.moved[row.joint]:
                    least = np.maximum(least, REVERSES * signals.dt * np.abs(motion.ddtheta[:, row.joint]))
                slow = np.abs(motion.dtheta[:, row.joint]) < least
                weight[k] = np.where(slow, _SLOW_WEIGHT, 1.0)
        return weight

    def columns(self, states: States, z: Array) -> Array:
        """Return the columns of all linear parameters, (rows, p, instants)."""
        here, plan = self._here(states), self._model.equations
        columns = np.zeros((len(plan.rows), len(self._place), here.motion.samples))
        out = np.empty((plan.program.outputs, here.motion.samples))
        plan.program.run(here.inputs, out)
        rows = {item.row: out[item.slots] for item in plan.rows}
        for k, item in enumerate(plan.rows):
            for position, column in enumerate(item.columns):
                if int(column) in self._place:
                    columns[k, self._place[int(column)]] = rows[item.row][position]
        for place, number, values in self._nuisances(states):
            columns[number, place] = values
        for effect, places in self._placed(z):
            kept = [d for d, place in enumerate(places) if place >= 0]
            columns[:, [places[d] for d in kept]] = self._effect_rows(effect, here.scene)[kept].swapaxes(0, 1)
        return columns

    @cached_property
    def _program(self) -> Program:
        """The traced rows; their inputs are those of `inputs_of`, then the parameters in the order of p."""
        graph = Graph(INPUTS * self._model.robot.n + len(self._place))
        traced = self._model.trace(graph, paper=True)
        values = {
            self._model.names[column]: graph.input(INPUTS * self._model.robot.n + place)
            for column, place in self._place.items()
            if column < self._model.parameters
        }
        outputs: list[Scalar] = []
        for row in self._layout.rows:
            total: Scalar = 0.0
            for name, value in traced[row].items():
                total = total + value * values.get(name, 0.0)
            outputs.append(total)
        return compile_program(graph, outputs)

    @cached_property
    def _together(self) -> list[list[Moved]]:
        return moved_together(self._program, self._slots)

    def _nuisances(self, states: States) -> Iterator[tuple[int, int, Array | float]]:
        """Yield (place in p, row, values) of delays and offsets."""
        here = slice(states.first, states.first + states.values.shape[2])
        for number, extra in enumerate(self._fit.nuisances, start=self._model.parameters):
            if number not in self._place:
                continue
            rates = self._layout.rates[states.piece] if extra.nuisance == "delay" else None
            for row in extra.rows:
                known = row in self._row and row.kind != "sum"
                if known or (row.kind == "sum" and not self._model.robot.joints[row.joint].elastic):
                    k = self._row[row]
                    yield self._place[number], k, 1.0 if rates is None else rates[k, here]

    def _effect_rows(self, effect: Effect, scene: Scene | None) -> Array:
        """Return an effect's columns, (amplitudes, rows, instants)."""
        assert scene is not None
        out = np.zeros((len(effect.amplitudes), len(self._layout.rows), scene.motion.samples))
        for key, rows in effect.columns(scene).items():
            out[:, self._row_of(key)] += rows
        return out

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

    def dictionary(self, states: States, items: Sequence[Scanned], grids: Sequence[Array]) -> Array:
        """Return columns of effects at every shape of their grids of logarithms, (rows, columns, instants)."""
        assert self._fit.effects is not None
        scene, columns = self._here(states).scene, []
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
        where = (states.piece, states.first, motion.samples)
        if where not in self._kept:
            begin = scene.starts[min(states.piece, len(scene.starts) - 1)] + states.first * every
            index = np.minimum(begin + np.arange(motion.samples) * every, len(scene.tau) - 1)
            self._kept[where] = scene.tau[index], scene.predicted[index], scene.load[index]
        tau, predicted, known = self._kept[where]
        load = known if self._rigid.all() else np.where(self._rigid, known, self._stiffness * (motion.theta - motion.q))
        return replace(
            scene, motion=motion, dt=scene.dt * every, tau=tau, load=load,
            predicted=predicted, starts=(0,), temperature=None, cache={},
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
