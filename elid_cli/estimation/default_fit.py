"""The default fit: least squares on sum and motor rows (the spring eliminated, no homogeneous rows).

Rows are filtered in parallel and every row group is weighted by its own residual; delay and offset of the torque
channels and the shapes of declared effects are estimated along. There is one fit, whatever holds the data.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.data import FitData, SampledData, Solved, sampled, sum_row
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.regression.covariance import lasting_weights
from elid_cli.estimation.regression.effect_columns import FittedEffects, scene_of
from elid_cli.estimation.regression.effect_shapes import fit_declared
from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.nuisances import LONGEST, beside_effects, reading_columns, short_enough, significant
from elid_cli.estimation.regression.other_shapes import check_shape_ambiguity
from elid_cli.estimation.regression.scene_with_effects import with_effects, with_found
from elid_cli.estimation.regression.standard_errors import covariance_of, covariance_with_dropped
from elid_cli.estimation.regression.triangles import ExtraColumns, to_triangles
from elid_cli.estimation.result import EstimateOptions
from elid_cli.estimation.validation.cross_validation import held_out
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.effects import nuisance_of
from elid_cli.model.effects.declared import declared_effects
from elid_cli.model.effects.posed import turns_model
from elid_cli.model.effects.scene import Scene
from elid_cli.model.regressor import Regressor
from elid_cli.robot.parameter import StandardParameter
from elid_cli.signals.signals import Signals

STICKING = 2.5
"""Residual rms at reversals over that elsewhere, above which a joint's reversals are left out."""
RESCENED = 2
"""Times that the columns of effects that keep their shapes are computed again, …"""
SETTLING, SETTLED = 10, 1e-3
"""… and most where rotors that only friction under load tells have not settled, to that part of themselves."""
READING_ROUNDS = 2
"""Rounds of fitting a stiffness and the gain of its torque sensor in turn."""


@dataclass(frozen=True)
class DefaultFit(Solved):
    """The default estimator's fit, before it is judged."""

    covariance: Array = field(kw_only=True)
    """Covariance of the basis of `solution`, shapes of effects accounted for, (r, r)."""
    scatter: Array | None = None
    """Covariance of the basis by leaving stretches out, (r, r), below which no error goes; None: the model suffices."""

    pull: Array | None = None
    """What noise of the positions in the columns may have pulled the base parameters by, in some directions, (b, d)."""

    @property
    def doubted(self) -> bool:
        """Whether errors are larger than what the covariance says."""
        return self.scatter is not None or self.pull is not None

    def nuisance(self, number: int) -> tuple[float, float]:
        """Return a nuisance's coefficient and its standard deviation; NaN where the log does not determine it."""
        column = len(self.base.parameters) + number
        where = np.flatnonzero(self.solution.basis == column)
        if not len(where) or not self.solution.determined(column):
            return float("nan"), float("nan")
        return float(self.solution.values[column]), float(np.sqrt(max(self.covariance[where[0], where[0]], 0.0)))


def fit_log(model: Regressor, base: BaseParameters, signals: Signals, options: EstimateOptions) -> DefaultFit:
    """Fit a log whose samples are at hand by the default estimator (`fit_data`)."""
    return fit_data(base, sampled(model, signals, options.folds), options)


def fit_data(base: BaseParameters, data: FitData, options: EstimateOptions) -> DefaultFit:
    """Fit by the default estimator.

    First every torque channel has a delay and an offset, and reversals are left out; the residual there decides which
    joints' reversals count, unless the user said what is too slow; then nuisances that are not significant, or that
    predict no better, go.

    Parameters
    ----------
    base
        Structural base parameters.
    data
        The equations.
    options
        How to estimate.

    Raises
    ------
    DataError
        If the log excites no parameter at all.
    """
    delays, offsets = data.delays, data.offsets
    if options.mask is False:
        data = data.counting(np.ones(data.model.robot.n, dtype=bool))
    elif options.mask is None and not data.slow_left_out:
        data = _with_gliding(base, data, [*delays, *offsets])
    nuisances = [*(delays if options.delays else ()), *(offsets if options.offsets else ())]
    effects = _start_effects(base, data, options.hold)
    if effects is not None:
        nuisances = beside_effects(nuisances, [item.effect for item in effects.effects], effects.extras)
    if options.offsets and data.samples is not None and data.samples.rows_of_sensors():
        nuisances += _reading_columns(base, data.samples, nuisances, effects)
    known = options.declared_late
    solved = solve_with(
        base, data, nuisances, effects, shaping=not options.hold, valleys=options.valleys, declared=known
    )
    for k in range(SETTLING if effects and options.hold else 0):  # columns from what the fit made of the parameters
        rotors, here = solved.rotors(), effects.scene.rotors if effects else {}
        if k >= RESCENED and all(abs(rotors[j] - here[j]) <= SETTLED * rotors[j] for j in rotors):
            break
        scene = scene_of(data.model, solved.signals, solved.standard, rotors, solved.late)
        found = zip(effects.effects, solved.amplitudes(), strict=True) if effects else ()
        scene = with_found(scene, [(item.effect, amplitude) for item, amplitude in found])
        effects = FittedEffects.of(effects.effects, scene, solved.signals) if effects else None
        solved = solve_with(base, data, solved.nuisances, effects, declared=known)
    covariance = covariance_with_dropped(solved, covariance_of(solved))
    if solved.effects and data.samples is not None and not options.hold:
        effects, covariance = check_shape_ambiguity(solved, solved.effects, covariance)
        solved = replace(solved, effects=effects)
    return DefaultFit(**vars(solved), covariance=covariance)


def solve_with(
    base: BaseParameters,
    data: FitData,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects | None,
    *,
    shaping: bool = False,
    valleys: bool = True,
    alone: bool = False,
    declared: Container[int] = (),
) -> Solved:
    """Solve with nuisances, as far as they are significant and predict better, and effects.

    Parameters
    ----------
    base, data
        Structural base parameters and the equations.
    nuisances
        All that there may be.
    effects
        Effects with their columns.
    shaping
        Whether the effects' shapes are refined; else they stay as they are.
    valleys
        Whether the refinement looks for other valleys than the one that they are in.
    alone
        Whether each delay must show by itself.
    declared
        Joints whose delays stay.
    """
    before, known = None, None
    for last in (False, True):
        if shaping and effects and data.samples is not None:
            effects = _shaped(base, data.samples, nuisances, effects, valleys=valleys and not last)
        solved = replace(known or Solved.of(base, data, nuisances, effects), before=before)
        if last or not nuisances:
            break
        before = solved
        solution, spread = solved.solution, data.covariance(solved.solution, solved.extras)
        # of a torque that is computed, samples of a velocity within its ripple are late by some hundredths of their
        # time: too little to show, and enough to bend viscous friction by several standard errors
        late = bool(np.any(data.facts.moved) or data.facts.computed.any())
        dt = data.facts.dt
        kept = significant(
            solution, spread, nuisances, data.model.parameters, dt, late=late, alone=alone, declared=declared
        )
        kept, known = _borne_out(base, data, kept, effects)
        if not (shaping and effects) and len(kept) == len(nuisances):
            break
        known = None if shaping and effects else known
        nuisances = kept
    return solved


def _start_effects(base: BaseParameters, data: FitData, hold: float = 0.0) -> FittedEffects | None:
    """Return the robot file's effects at the shapes it gives, or None where it declares none.

    `hold`: part of themselves within which amplitudes stay.
    """
    model, samples = data.model, data.samples
    if not model.robot.effects or samples is None:
        return None
    if hold:  # what the file says is known: a fit without effects would start further away
        rough = np.nan_to_num(model.robot.reference())
    else:
        rough = reweighted(to_triangles(samples.observation), base.count).values[: model.parameters]
    scene = scene_of(model, samples.signals, rough)
    effects = declared_effects(model.robot, scene)
    if hold:
        effects = tuple(replace(e, spread=np.where(e.mean != 0, hold * np.abs(e.mean), np.inf)) for e in effects)
    return FittedEffects.of(effects, scene, samples.signals)


def _shaped(
    base: BaseParameters,
    data: SampledData,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects,
    *,
    valleys: bool,
) -> FittedEffects:
    """Return effects with refined shapes, in the valley that they are in or in the best of all `valleys` of the cost.

    Which valley is right is a matter of a few standard deviations, in which rows with a slow residual, as that of a
    stiff spring's torque, count for far less than their number, and what the file gives counts as it stands. So all
    about that are searched twice, the second time with what the residual's colour leaves of the rows.
    """
    data = replace(data, stretch=np.zeros_like(data.stretch))  # nothing is left out here: one triangle per row group
    for scan, lasting in ((True, False), (True, True), (False, False)) if valleys else ((False, False),) * 2:
        solved = Solved.of(base, data, nuisances, effects)
        scene = _scene_beside(solved, effects)
        weights, items = solved.solution.weights, effects.effects
        if scan:
            items = tuple(replace(item, effect=item.start or item.effect) for item in items)
        if lasting:
            weights = lasting_weights(data.observation, solved.solution, solved.extras)
        found = fit_declared(data.observation, data.signals, scene, items, weights, nuisances, scan=scan)
        effects = replace(found, others=found.others if lasting else effects.others)
    return effects


def _scene_beside(solved: Solved, effects: FittedEffects) -> Scene:
    """Return the scene of a fit, made without the columns of effects that turn the model.

    First moments that only a base that leans shows make its column, and trade with the angle: from a fit that has
    both, they grow from one scene to the next, and the angle stays where it is.
    """
    still = [k for k, item in enumerate(effects.effects) if not turns_model(type(item.effect))]
    if len(still) < len(effects.effects):
        items, extras = ([values[k] for k in still] for values in (effects.effects, effects.extras))
        effects = FittedEffects(tuple(items), tuple(extras), effects.scene)  # type: ignore[arg-type]
        solved = Solved.of(solved.base, solved.data, solved.nuisances, effects)
    scene = scene_of(solved.model, solved.signals, solved.standard, solved.rotors(), solved.late)
    found = zip(effects.effects, solved.amplitudes(), strict=True)
    return with_effects(scene, [(item.effect, amplitude) for item, amplitude in found])


def _with_gliding(base: BaseParameters, data: FitData, nuisances: Sequence[ExtraColumns]) -> FitData:
    """Return the data with reversals counted for the joints whose residual there is no larger than elsewhere.

    A motor that sticks has no defined friction while it does; one that glides through zero tells most about its
    Coulomb friction just there. Joints with declared effects stay masked: a friction curve is bent by what happens at
    standstill more than it learns there.
    """
    effects = _start_effects(base, data)
    extras = () if effects is None else effects.extras
    # what is known of the effects' amplitudes does not count yet: the columns alone, as further nuisances
    solved = Solved.of(base, data, [*nuisances, *extras])
    inside, outside = data.at_reversals(solved.solution.values, solved.extras)
    glides = inside < STICKING * outside  # false where either is unknown
    for joint in {row.joint for extra in extras for row in extra.rows}:
        glides[joint] = False
    return data.counting(glides)


def with_delays(fit: DefaultFit, options: EstimateOptions) -> DefaultFit:
    """Return the fit with a delay of every torque channel that it could not tell from none.

    A sharper estimator may: without them, rotor inertias and viscous friction would be bent by what is left of one. Not
    those that came out longer than any channel's, nor those that the robot file declares.
    """
    had = {sum_row(extra).joint for extra in fit.nuisances if extra.nuisance == "delay"}
    names = fit.model.robot.joint_names
    had |= {
        names.index(spec.joint)
        for spec in fit.model.robot.effects
        if nuisance_of(spec.effect) == "delay" and spec.joint in names
    }
    missing = [e for e in fit.data.delays if sum_row(e).joint not in had]
    while missing and options.delays:
        nuisances = (*fit.nuisances, *missing)
        solved = Solved.of(fit.base, fit.data, nuisances, fit.effects)
        grown = DefaultFit(**vars(solved), covariance=covariance_of(solved))
        found = np.array([grown.nuisance(k) for k in range(len(fit.nuisances), len(nuisances))])
        short = short_enough(found[:, 0], found[:, 1], LONGEST)
        if short.all():
            return grown
        missing = [extra for extra, may in zip(missing, short, strict=True) if may]
    return fit


def _borne_out(
    base: BaseParameters, data: FitData, nuisances: list[ExtraColumns], effects: FittedEffects | None
) -> tuple[list[ExtraColumns], Solved | None]:
    """Return the nuisances without torque offsets that predict left-out torque no better than none.

    Noise in accelerations pulls a mass towards 0, and an offset then takes up its weight: significant, and wrong. With
    them comes the fit that has them; None where there was no offset to try.
    """
    robot = data.model.robot

    def judged(chosen: Sequence[ExtraColumns]) -> tuple[Solved, dict[str, JointError]]:
        solved = Solved.of(base, data, chosen, effects)
        return solved, held_out(robot, solved.triangles, solved.solution)

    present: tuple[Solved, dict[str, JointError]] | None = None
    for extra in [e for e in nuisances if e.nuisance == "offset"]:
        name = robot.joint_names[sum_row(extra).joint]
        fewer = [e for e in nuisances if e is not extra]
        present = judged(nuisances) if present is None else present
        lacking = judged(fewer)
        with_it, without = present[1].get(name), lacking[1].get(name)
        if without is not None and without.rms < (0.0 if with_it is None else with_it.rms):
            nuisances, present = fewer, lacking
    return nuisances, None if present is None else present[0]


def reshaped(fit: DefaultFit, effects: FittedEffects) -> DefaultFit:
    """Return the fit with effects in other shapes, their columns and everything linear fitted anew."""
    effects = FittedEffects.of(effects.effects, effects.scene, fit.signals)
    solved = Solved.of(fit.base, fit.data, fit.nuisances, effects)
    return DefaultFit(**vars(solved), covariance=fit.covariance)


def _reading_columns(
    base: BaseParameters, data: SampledData, nuisances: Sequence[ExtraColumns], effects: FittedEffects | None
) -> list[ExtraColumns]:
    """Return offset and gain columns of the joint torque sensors, the gains' at the stiffness of a first fit."""
    model, observation = data.model, data.observation
    elastic = model.robot.elastic
    declared = {(item.spec.effect, item.effect.joint) for item in (effects.effects if effects else ())}
    known = [*nuisances, *(effects.extras if effects else ())]
    stiffness = np.zeros(len(elastic))
    for _ in range(READING_ROUNDS):
        extras = [*known, *reading_columns(observation, stiffness, declared)] if np.any(stiffness) else known
        triangles = to_triangles(observation, extras)
        values = reweighted(triangles, base.count + triangles.extras).values
        stiffness = np.array(
            [values[model.index[StandardParameter("K", k)]] if elastic[k] else 0.0 for k in range(len(elastic))]
        )
    return reading_columns(observation, stiffness, declared)
