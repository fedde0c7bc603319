"""Effects that a robot file declares, in the one fit: where they start, their shapes refined between its steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.data import FitData, SampledData, Solved
from elid_cli.estimation.regression.covariance import lasting_weights
from elid_cli.estimation.regression.effect_columns import (
    FittedEffects,
    extra_of,
    scene_of,
    triangles_with_effects,
    with_effects,
)
from elid_cli.estimation.regression.effect_shapes import fit_declared
from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.triangles import ExtraColumns, to_triangles
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.effects.declared import declared_effects


def start_effects(base: BaseParameters, data: FitData, hold: float = 0.0) -> FittedEffects | None:
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
    extras = tuple(extra_of(item.effect, scene, samples.signals) for item in effects)
    return FittedEffects(effects, extras, scene)


def rescened(data: FitData, effects: FittedEffects | None, values: Array) -> FittedEffects | None:
    """Return effects with their columns computed from other parameters (p,)."""
    if effects is None or data.samples is None:
        return effects
    scene = scene_of(data.model, data.samples.signals, values)
    return replace(
        effects, extras=tuple(extra_of(e.effect, scene, data.samples.signals) for e in effects.effects), scene=scene
    )


class Step(Enum):
    """One fit of the shapes, between two of everything else."""

    SCAN = "all valleys of the cost about what the file gives"
    RESCAN = "the same with what the residual's colour leaves of the rows"
    REFINE = "the valley it is in"


def shaped(
    base: BaseParameters,
    data: SampledData,
    nuisances: Sequence[ExtraColumns],
    effects: FittedEffects,
    steps: Sequence[Step],
) -> FittedEffects:
    """Return effects with refined shapes.

    Which valley of the cost is right is a matter of a few standard deviations, in which rows with a slow residual, as
    that of a stiff spring's torque, count for far less than their number, and what the file gives counts as it stands.
    """
    model, observation, signals = data.model, data.observation, data.signals
    for step in steps:
        triangles = triangles_with_effects(observation, nuisances, effects)
        solution = reweighted(triangles, base.count + triangles.extras)
        solved = Solved(base, data, tuple(nuisances), effects, triangles, solution)
        scene = scene_of(model, signals, solved.standard)
        scene = with_effects(scene, [(e.effect, a) for e, a in zip(effects.effects, solved.amplitudes(), strict=True)])
        weights, items = solution.weights, effects.effects
        if step is not Step.REFINE:
            items = tuple(replace(item, effect=item.start or item.effect) for item in items)
        if step is Step.RESCAN:
            weights = lasting_weights(observation, solution, solved.extras)
        found = fit_declared(observation, signals, scene, items, weights, nuisances, scan=step is not Step.REFINE)
        effects = replace(found, others=found.others if step is Step.RESCAN else effects.others)
    return effects
