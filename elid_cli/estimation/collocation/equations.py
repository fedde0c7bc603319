"""The robot's equations of motion as a collocation needs them: link and motor rows at given states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.collocation.effect_rows import EffectRows, EffectsHere, apart_by_speed
from elid_cli.estimation.collocation.layout import Moved, Scanned, UnknownsLayout, moved_together, slots_of
from elid_cli.estimation.collocation.problem import KEPT, States
from elid_cli.estimation.regression.effect_columns import FittedEffects
from elid_cli.memory import Recent
from elid_cli.model.effects.scene import direction_widths
from elid_cli.model.program import Program, compile_program
from elid_cli.model.regressor import INPUTS, fill_inputs
from elid_cli.model.tracing import Graph, Scalar
from elid_cli.signals.motion import STATES, Motion

_SLOW_WEIGHT = 0.05
REVERSES = 2.0
"""Samples before and after a reversal in which torques that were moved in time count as little: where the delay is no
whole number of samples, the step of Coulomb friction is smeared over as many."""


@dataclass(frozen=True)
class _Here:
    """What the equations are computed from at given states."""

    states: States
    motion: Motion
    inputs: Array
    """Inputs of the traced programs, (inputs, instants)."""
    effects: EffectsHere | None
    torques: dict[str, tuple[Array, Array, Array]] = field(default_factory=dict)
    """(p, z, torques of the rows) that were asked for last: of the ``model`` alone, and of the ``whole``."""


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
        self._effects = EffectRows(layout)
        points = sum(rate.shape[1] for rate in layout.rates) * self._model.robot.n
        self.kept = 2 * len(layout.rates) if 0 < points <= KEPT else 1
        """Pieces at some states of which is kept what was computed: at an iterate and at the next one."""
        self._known: Recent[_Here] = Recent(self.kept)

    def _here(self, states: States) -> _Here:
        """Return what residual, slopes and columns at the same states share."""

        def made() -> _Here:
            motion = self.motion(states)
            return _Here(states, motion, self._inputs(motion), self._effects.here(motion, states))

        return self._known.of(id(states), made)

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
        """Return the model's torques in link and motor rows, (rows, instants), which nobody may change."""
        here = self._here(states)
        known = here.torques.get("whole")
        if known is not None and known[0] is p and known[1] is z:
            return known[2]
        out = self._model_torques(here, p, z).copy()
        if here.effects is not None:
            here.effects.add(out, self._effects.placed(z), p)
        for place, row, values in self._nuisances(states):
            out[row] += p[place] * values
        here.torques["whole"] = p, z, out
        return out

    def _model_torques(self, here: _Here, p: Array, z: Array) -> Array:
        """Return the torques of the traced rows, (rows, instants), which nobody may change."""
        known = here.torques.get("model")
        if known is not None and known[0] is p:
            return known[2]
        out = np.empty((len(self._layout.rows), here.motion.samples))
        self._program.run(here.inputs, out, list(map(np.asarray, p)))
        here.torques["model"] = p, z, out
        return out

    def slopes(self, states: States, p: Array, z: Array, steps: Array) -> Array:
        """Return the derivatives of `residual` by the states from forward differences, (3, rows, channels, instants).

        States that no row of the robot depends on together are moved at once (Curtis, Powell and Reid 1974); effects
        may depend on any. Nuisances are the same at any state.
        """
        here, program, values = self._here(states), self._program, list(map(np.asarray, p))
        motion, inputs = here.motion, here.inputs
        before, after = self._model_torques(here, p, z), np.empty((len(self._layout.rows), motion.samples))
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
        if here.effects is not None:
            self._add_effects(found, here.effects, here.states, (p, z), steps)
        return found

    def _add_effects(
        self, found: Array, here: EffectsHere, states: States, unknowns: tuple[Array, Array], steps: Array
    ) -> None:
        """Add the derivatives of the effects' torques to those of the model's rows, (3, rows, channels, instants)."""
        p, z = unknowns
        by_speed, others = apart_by_speed(self._effects.placed(z))
        motion = here.scene.motion
        for c, (side, joint) in enumerate(self._layout.channels):
            motor = side == "theta" or not self._model.robot.joints[joint].elastic
            for d in range(3):
                placed = [*others, *(by_speed.get(joint, []) if motor and d == 1 else [])]
                if not placed:
                    continue
                before, after = np.zeros((2, found.shape[1], motion.samples))
                here.add(before, placed, p)
                with self._moved(motion, c, d, steps[d, c]):
                    there = self._effects.here(motion, states)
                    assert there is not None
                    there.add(after, placed, p)
                found[d, :, c] += (after - before) / steps[d, c]

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

    def shape_slopes(self, states: States, p: Array, z: Array) -> Array:
        """Return the derivatives of `residual` by the logarithms of the effects' shapes, (rows, shapes, instants)."""
        return self._effects.shape_slopes(self._here(states).effects, p, z)

    def _inputs(self, motion: Motion) -> Array:
        rows = np.empty((INPUTS * self._model.robot.n, motion.samples))
        for k, width in enumerate(self._widths):
            fill_inputs(rows, motion, k, range(len(rows)), width)
        return rows

    def trust(self, states: States) -> Array:
        """Return the weight of every row at given states: friction is undefined where a motor reverses or sticks."""
        motion, signals = self._here(states).motion, self._fit.signals
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
        if here.effects is not None:
            for effect, places in self._effects.placed(z):
                kept = [d for d, place in enumerate(places) if place >= 0]
                columns[:, [places[d] for d in kept]] = here.effects.rows(effect)[kept].swapaxes(0, 1)
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

    def scanned(self, z: Array) -> list[Scanned]:
        """Return the effects that have one free, positive shape, which z holds."""
        return self._effects.scanned(z)

    def dictionary(self, states: States, items: Sequence[Scanned], grids: Sequence[Array]) -> Array:
        """Return columns of effects at every shape of their grids of logarithms, (rows, columns, instants)."""
        return self._effects.dictionary(self._here(states).effects, items, grids)

    def final_effects(self, z: Array) -> FittedEffects | None:
        """Return the fit's effects with the shapes found."""
        return self._effects.final(z)
