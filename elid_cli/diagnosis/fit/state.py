"""The present model during a search: its effects, its fit to the training stretches, and the noise it is judged by."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.fit.channels import Fault, unknowns_of_channels, without_idle_offsets
from elid_cli.diagnosis.fit.divided_log import Log
from elid_cli.diagnosis.fit.projection import Projected
from elid_cli.diagnosis.fit.shifting import found_shifts
from elid_cli.diagnosis.fit.whitened import project
from elid_cli.diagnosis.fit.whitening import whiteners
from elid_cli.estimation.data import Solved, sum_row
from elid_cli.estimation.default_fit import solve_with
from elid_cli.estimation.regression.effect_columns import FittedEffects, scene_of
from elid_cli.estimation.regression.least_squares import Solution, reweighted
from elid_cli.estimation.regression.scene_with_effects import with_found
from elid_cli.estimation.regression.standard_errors import covariance_with_shapes
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangles
from elid_cli.estimation.stretches import STRETCHES
from elid_cli.estimation.validation.cross_validation import fold_fits, left_out
from elid_cli.estimation.validation.noise_floor import Floor
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.effects.declared import Declared
from elid_cli.model.effects.effect import Effect, Nuisance
from elid_cli.model.effects.kinds import CurveEffect, goes_with
from elid_cli.model.effects.posed import Pose, settled, turns_model
from elid_cli.model.effects.scene import Scene
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.parameter import POSITIVE
from elid_cli.robot.robot import EffectSpec

CURVE_HEIGHT = 0.01
"""Prior standard deviation of a smooth curve's heights, as a share of the torque."""
_SETTLED = 0.002
"""Part of a sample within which shifts count as settled."""
_SHIFTING = 12
_AGREED = 1e-4
"""Change of an effect's torque, as a part of it, below which columns from the model and the fit agree …"""
_AGREEING = 30
"""… and most fits until they do."""


@dataclass(frozen=True)
class State:
    """A model with its fit."""

    log: Log
    effects: tuple[Effect, ...]
    nuisances: tuple[ExtraColumns, ...]
    columns: tuple[ExtraColumns, ...]
    """Columns of the effects, in their order."""
    triangles: Triangles
    solution: Solution
    scene: Scene
    known: Array | None = None
    """Covariance of the solution's basis where another estimator found the values, (r, r)."""
    free: tuple[ExtraColumns, ...] = ()
    """Offsets of torque channels that further effects are scored beside, though they do not show without these."""
    but: frozenset[Fault] = frozenset()
    """Faults of torque channels that the model is taken not to have."""
    lacking: dict[int, State] = field(init=False, default_factory=dict, repr=False, compare=False)
    """The model fitted without an effect, by its number, as asked for last (`without`)."""

    def with_free_offsets(self) -> State:
        """Return the state in which further effects are scored beside offsets that do not show yet; itself: none.

        As long as an effect is missing an offset may not show, and with it the effect explains several times as much.
        """
        own = {(extra.name, sum_row(extra)) for extra in self.nuisances}
        every = unknowns_of_channels(self.log.data, self.effects, self.columns, self.but)
        free = [e for e in every if e.nuisance == "offset" and (e.name, sum_row(e)) not in own]
        return replace(self, free=tuple(free)) if free else self

    @property
    def extras(self) -> tuple[ExtraColumns, ...]:
        """All columns beyond the standard parameters: nuisances first, then effects."""
        return (*self.nuisances, *self.columns)

    @property
    def standard(self) -> Array:
        """Return a representative of the standard parameters, (p,)."""
        return self.solution.values[: self.log.model.parameters]

    def place(self, number: int) -> slice:
        """Return where the coefficients of effect `number` stand in the solution."""
        first = self.log.model.parameters + sum(e.width for e in (*self.nuisances, *self.columns[:number]))
        return slice(first, first + self.columns[number].width)

    def coefficients(self, number: int) -> Array:
        """Return the fitted coefficients of an effect, (d,)."""
        return self.solution.values[self.place(number)]

    def joint_of(self, effect: Effect) -> str | None:
        """Return the name of an effect's joint; None of one of the whole robot."""
        return effect.joint_name(self.log.model.robot)

    @property
    def specs(self) -> list[EffectSpec]:
        """The effects as a robot file would give them."""
        return [EffectSpec(e.name, self.joint_of(e), self.named(k)) for k, e in enumerate(self.effects)]

    def named(self, number: int) -> dict[str, float]:
        """Return an effect's parameters as reports name them."""
        return self.renamed(number, self.coefficients(number))

    def renamed(self, number: int, coefficients: Array) -> dict[str, float]:
        """Return an effect's parameters for other coefficients; shifts in time add to those already corrected."""
        effect = self.effects[number]
        values = effect.named(self.scene, coefficients)
        if effect.corrects is not None:
            values[effect.amplitudes[0].name] += self.log.shifts.of(effect.corrects, effect.joint)
        return self.log.pose.whole(type(effect), effect.joint, values)

    @property
    def delays(self) -> dict[int, float]:
        """Return the torque delay that is corrected, s, by joint: what is moved already, and what its column finds."""
        moved, left = self.log.shifts.torque, self._of_channels("delay")
        named = {effect.joint for effect in self.effects if effect.corrects == "torque"}
        late = sorted({*np.flatnonzero(moved).tolist(), *left} - named)
        return {joint: float(moved[joint]) + left.get(joint, 0.0) for joint in late}

    @property
    def offsets(self) -> dict[int, float]:
        """Return the torque offset that is corrected, N·m (N), by joint."""
        return self._of_channels("offset")

    def _of_channels(self, which: Nuisance) -> dict[int, float]:
        first = self.log.model.parameters
        return {
            sum_row(extra).joint: float(self.solution.values[first + k])
            for k, extra in enumerate(self.nuisances)
            if extra.nuisance == which
        }

    @cached_property
    def floor(self) -> Floor:
        """Propagated sensor noise at this model's parameters."""
        return self.log.noise.floor(self.standard)

    @cached_property
    def projected(self) -> Projected:
        """Whitened problem in which further effects are scored, training stretches only."""
        training, joints = self.log.training, whiteners(self.log.training, self.floor)
        return project(training, self.extras, self.solution, joints, self.log.fold, STRETCHES, self.free)

    @cached_property
    def solved(self) -> Solved:
        """The fit with the effects and what is known of them."""
        held = FittedEffects(_held(self.log, self.effects, self.columns), self.columns, self.scene)
        return Solved(self.log.base, self.log.data, self.nuisances, held, self.triangles, self.solution)

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the solution's basis, (r, r)."""
        if self.known is not None:
            return self.known
        return self.log.data.covariance(self.solution, self.extras)

    @cached_property
    def covariance_with_shapes(self) -> tuple[Array, Mapping[tuple[int, int], int]]:
        """Covariance of the solution's basis and of shapes, and where a shape's logarithm stands in it, by its effect.

        The shapes are those that are refined, keyed by the numbers of effect and shape; none where another estimator
        found the values or the log holds them all.
        """
        fit = self.solved
        items = fit.effects.effects if fit.effects else ()
        if self.known is None and (any(item.free for item in items) or self.scene.rotors):
            whole = covariance_with_shapes(fit)
            if whole is not None:
                keys = [(number, shape) for number, item in enumerate(items) for shape in item.free]
                return whole, {key: len(self.solution.basis) + k for k, key in enumerate(keys)}
        return self.covariance, {}

    @cached_property
    def left_out(self) -> dict[EstimationRow, Array]:
        """Residual sum of squares of every row group per fold, predicted by a fit to the other folds, (folds,)."""
        return left_out(self.triangles, fold_fits(self.triangles, self.solution))

    @property
    def impossible(self) -> frozenset[str]:
        """Return which stiffnesses, rotor inertias and friction coefficients are negative."""
        names = self.log.model.names
        return frozenset(
            name
            for name, value in zip(names, self.standard, strict=True)
            if value < 0 and name.kind in POSITIVE and self.log.base.classes[name] == "independent"
        )

    def base_values(self, base: BaseParameters, *, shapes: bool = False) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return base parameters, of this state or another, their standard errors, which are determined, (b,) each.

        `shapes`: with the effects' shapes unknown.
        """
        fit = Solved(base, self.log.data, self.extras, None, self.triangles, self.solution)
        whole, fitted = self.covariance_with_shapes if shapes else (self.covariance, {})
        spread = whole[: len(self.solution.basis), : len(self.solution.basis)] if fitted else self.covariance
        return base.transform @ self.standard, fit.deviations(spread), self.solution.estimable(fit.transform)

    def rms(self, row: EstimationRow) -> float:
        """Return the training residual rms of a row group, N·m."""
        return self.triangles.rms(self.solution.values, row)

    def ratios(self) -> dict[EstimationRow, float]:
        """Return residual over floor of every row group (training stretches)."""
        least = {row: 2e-4 * self.triangles.torque_rms(row) for row in self.triangles.rows}
        return {row: self.rms(row) / max(self.floor.rms[row], least[row]) for row in self.triangles.rows}


def fit(log: Log, effects: Sequence[Effect], scene: Scene | None = None, *, but: Collection[Fault] = ()) -> State:
    """Fit the model with some effects to the training stretches, by the one fit (`default_fit.solve_with`).

    Parameters
    ----------
    log
        The log and its division.
    effects
        Effects with their shapes.
    scene
        Scene from which the effects' columns are computed; None: made from a fit without effects.
    but
        Faults that torque channels are taken not to have.
    """
    data = log.data
    if scene is None:
        plain = reweighted(data.triangles(()), log.base.count).values
        scene = scene_of(log.model, log.signals, plain[: log.model.parameters])
    columns = tuple(log.columns.of(effect, scene) for effect in effects)
    held = _held(log, effects, columns)
    channels, own = unknowns_of_channels(data, effects, columns, but), FittedEffects(held, columns, scene)
    found = solve_with(log.base, data, channels, own, alone=True)
    if any(extra.nuisance == "offset" for extra in found.nuisances):
        firm = without_idle_offsets(found)
        if len(firm) < len(found.nuisances):
            found = solve_with(log.base, data, firm, own, alone=True)
    state = State(log, tuple(effects), found.nuisances, columns, found.triangles, found.solution, scene)
    return replace(state, but=frozenset(but))


def _held(log: Log, effects: Sequence[Effect], columns: Sequence[ExtraColumns]) -> tuple[Declared, ...]:
    """Return effects with what is known of their amplitudes: the heights of smooth curves lie near 0.

    A curve holds straight lines, which viscous friction or the spring explains already: the line stays with those.
    """
    held = []
    for effect, extra in zip(effects, columns, strict=True):
        spec = EffectSpec(effect.name, effect.joint_name(log.model.robot))
        if not isinstance(effect, CurveEffect):
            held.append(Declared(spec, effect))
            continue
        rows = [group for group in log.training.groups if group.row in extra.rows]
        torque = max(float(np.sqrt(np.mean(log.training.tau[g.row.joint][g.use] ** 2))) for g in rows)
        nothing = np.zeros(extra.width)
        held.append(Declared(spec, effect, nothing, np.full(extra.width, CURVE_HEIGHT * torque)))
    return tuple(held)


def refreshed(state: State) -> State:
    """Return the state fitted again with the scene of its own parameters, late channels moved by what was found."""
    for _ in range(_SHIFTING):
        state = agreed(_turned(state))  # turning leaves the columns of a fit without what turns
        shifts, change = found_shifts(state)
        if change <= _SETTLED * state.log.signals.dt:
            break
        log = state.log.shifted(shifts)
        state = fit(log, state.effects, scene_in(log, state), but=state.but)
    return state


def scene_in(log: Log, state: State, rotors: Mapping[int, float] | None = None) -> Scene:
    """Return the scene that a state makes in a log, its own or another, with its rotors or others."""
    rotors = state.scene.rotors if rotors is None else rotors
    scene = scene_of(log.model, log.signals, state.standard, rotors, state.solved.late)
    return with_found(scene, [(effect, state.coefficients(k)) for k, effect in enumerate(state.effects)])


def _turned(state: State) -> State:
    """Return the state with its model turned until nothing is left to say for the columns of effects that turn it."""
    turning = [k for k, effect in enumerate(state.effects) if turns_model(type(effect))]
    if not turning:
        return state
    others = [effect for k, effect in enumerate(state.effects) if k not in turning]

    def again(state: State, pose: Pose) -> State:
        log = state.log if pose is state.log.pose else state.log.posed(pose)
        # what a turn brings to light, or bends, is not in the old parameters: columns come from a fit without it
        rotors = state.scene.rotors
        scene = scene_of(log.model, log.signals, state.standard, rotors) if others else None
        lacking = fit(log, others, scene, but=state.but)
        return fit(log, state.effects, scene_of(log.model, log.signals, lacking.standard, rotors), but=state.but)

    def left(state: State) -> list[tuple[Effect, Array]]:
        return [(state.effects[k], state.coefficients(k)) for k in turning]

    return settled(again(state, state.log.pose), state.log.pose, left, again)[0]


def agreed(state: State) -> State:
    """Return the state fitted with columns from its own parameters, repeatedly where effects depend on them closely.

    What must settle is the effect's torque: of a gain, gain and parameters may drift together while the gain alone
    hardly changes.
    """
    model = [k for k, effect in enumerate(state.effects) if effect.from_model]
    for _ in range(_AGREEING if model else 1):
        old = state
        state = fit(state.log, state.effects, scene_in(state.log, state, state.solved.rotors()), but=state.but)
        if all(_unchanged(old, state, k) for k in model):
            break
    return state


def _unchanged(old: State, new: State, number: int) -> bool:
    """Whether the torque of effect `number` is the same in two states of the same log."""
    known, one, other = old.columns[number].rows, old.coefficients(number), new.coefficients(number)
    pairs = [(one @ known.get(row, 0.0 * c), other @ c) for row, c in new.columns[number].rows.items()]
    return all(float(np.linalg.norm(b - a)) <= _AGREED * float(np.linalg.norm(b)) for a, b in pairs)


def without(state: State, number: int) -> State:
    """Return the model without effect `number`, fitted; a channel that it had moved goes back to where it was.

    A fault of a torque channel that is named as an effect does not come back as one that every fit estimates along.
    """
    if number not in state.lacking:
        state.lacking.clear()  # what is asked of one effect is asked one after the other
        state.lacking[number] = _without(state, number)
    return state.lacking[number]


def _without(state: State, number: int) -> State:
    effect = state.effects[number]
    log = state.log
    if effect.corrects is not None:
        seen = log.seen.of(effect.corrects, effect.joint)
        if log.shifts.of(effect.corrects, effect.joint) != seen:
            log = log.shifted(log.shifts.moved(effect.corrects, effect.joint, seen))
    if log.pose.of(type(effect), effect.joint).any():
        log = log.posed(log.pose.without(effect))
    but = state.but if effect.nuisance is None else state.but | {(effect.nuisance, effect.joint)}
    return fit(log, [e for e in state.effects if not goes_with(e, effect)], state.scene, but=but)
