"""Fits of other effects to the same stretches, started from what a fit knows."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.changes import nearer_by
from elid_cli.estimation.trajectory.decided import NEARER, late_or_prompt, shows_delays
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fitted
from elid_cli.estimation.trajectory.held_loops import refitted
from elid_cli.estimation.trajectory.own_values import with_own_values_again
from elid_cli.estimation.trajectory.softening import is_worth, softened
from elid_cli.estimation.trajectory.unknowns import Unknowns, started
from elid_cli.model.effects.effect import Effect

STUCK = 0.999
"""Times the squared error from which a fit with a further effect has not moved."""
QUICK = 6
"""Most motions whose slopes are computed while effects come and go; the last fit is a whole one."""


def grown(fit: TrajectoryFit, effects: Sequence[Effect], tell: Callable[[float], None] | None = None) -> TrajectoryFit:
    """Return the fit with further effects, started from what is known."""
    own = fit.unknowns
    unknowns = replace(own, effects=(*fit.effects, *effects))
    near = _in_shape(fit, unknowns)
    unknowns = replace(unknowns, own=near.unknowns.own)
    found = again(near, unknowns, known_of(near, unknowns, near.z[near.unknowns.amplitudes]), tell)
    least = own.joint_values(own.bounds[0])
    none = any(fit.values[effect.joint, 0] <= least[effect.joint, 0] for effect in effects)
    if not none or found.equations.lighter.sum() < STUCK * fit.equations.lighter.sum():
        return found
    # no step led on from where a joint came out without inertia: the recordings' own linear steps may be near
    try:
        other = again(fit, unknowns, unknowns.possible(np.median(found.alone, axis=0)), tell)
    except DataError:
        return found
    return other if other.equations.lighter.sum() < STUCK * found.equations.lighter.sum() else found


def _in_shape(fit: TrajectoryFit, unknowns: Unknowns) -> TrajectoryFit:
    """Return where a fit of several recordings with further effects starts: in their shapes, with own values again.

    Where friction changed between recordings, the misfit of one value for all bends shapes that are free.
    """
    if unknowns.recordings < 2 or len(unknowns.shapes) == len(fit.unknowns.shapes):
        return fit
    shaped = replace(unknowns, held=len(unknowns.effects))
    try:
        near = again(fit, shaped, known_of(fit, shaped, fit.z[fit.unknowns.amplitudes]))
    except DataError:
        return fit
    near = with_own_values_again(near)
    return fit if near.unknowns.own == fit.unknowns.own else near


def known_of(fit: TrajectoryFit, unknowns: Unknowns, amplitudes: Array) -> Array:
    """Return what is known of other unknowns of a fit, (U,), with amplitudes of the first effects."""
    z = started(unknowns, fit.values, amplitudes.tolist())
    z[unknowns.delays] = fit.delays
    z[unknowns.departures] = unknowns.departing(fit.unknowns.departures_of(fit.z))
    return z


def again(
    fit: TrajectoryFit, unknowns: Unknowns, z: Array, tell: Callable[[float], None] | None = None, cycles: int = QUICK
) -> TrajectoryFit:
    """Return a fit of other unknowns to the same stretches; delays stay at 0 where the log does not show them."""
    tracked = [replace(item) for item in fit.tracked]
    return fitted(unknowns, tracked, z, prompt=not fit.delays.any(), tell=tell, cycles=cycles)


def softened_again(fit: TrajectoryFit) -> TrajectoryFit:
    """Return the fit with friction that fades in over a speed, where the log asks for it now."""
    return softened(fit, lambda unknowns, near, z: again(near, unknowns, z))


def hardened(fit: TrajectoryFit, soft: Collection[int]) -> TrajectoryFit:
    """Return the fit without friction that fades in at some joints, where the motion no longer asks for any of it.

    What effects that were found since explain, softer friction may have imitated: its lead a delay.
    """
    own = fit.unknowns
    places = {own.soft[joint] for joint in soft if joint in own.soft}
    if not places:
        return fit
    kept = [k for k in range(len(own.effects)) if k not in places]
    unknowns = replace(own, effects=tuple(fit.effects[k] for k in kept))
    tracked = [replace(item) for item in fit.tracked]
    try:
        hard, _ = late_or_prompt(unknowns, tracked, known_of(fit, unknowns, fit.z[own.amplitudes]), late=True)
    except DataError:
        return fit
    return fit if any(is_worth(fit, hard, joint) for joint in soft) else hard


def in_place(fit: TrajectoryFit, others: Mapping[int, Effect]) -> TrajectoryFit | None:
    """Return the fit with other effects in the places of some; None where the motion runs away."""
    own = fit.unknowns
    effects = [others.get(k, effect) for k, effect in enumerate(fit.effects)]
    unknowns = replace(own, effects=tuple(effects))
    parts = [
        np.zeros(len(effect.amplitudes)) if k in others else fit.z[own.amplitudes_of(k)]
        for k, effect in enumerate(effects)
        if not effect.softens
    ]
    try:
        return again(fit, unknowns, known_of(fit, unknowns, np.concatenate(parts)))
    except DataError:
        return None


def without(fit: TrajectoryFit, places: set[int], tell: Callable[[float], None] | None = None) -> TrajectoryFit:
    """Return the fit without some of its effects, none of them declared."""
    own = fit.unknowns
    kept = [k for k in range(len(own.effects)) if k not in places]
    unknowns = replace(own, effects=tuple(fit.effects[k] for k in kept))
    left = np.concatenate([np.zeros(0), *(fit.z[own.amplitudes_of(k)] for k in kept if not fit.effects[k].softens)])
    return again(fit, unknowns, known_of(fit, unknowns, left), tell)


def with_delay(fit: TrajectoryFit) -> TrajectoryFit:
    """Return a fit without a delay, or the one with that which shows beside what was missing.

    One ahead of the commands, as steps of a simulator make it, where the motion is clearly nearer so: what it leaves
    looks like further effects otherwise.
    """
    if fit.delays.any():
        return fit
    free = refitted(fit, [item.run for item in fit.tracked], fit.z)
    if free is None or not shows_delays(free):
        return fit
    least = 0.0 if (free.delays > 0).all() else NEARER
    return replace(free, held=fit.held) if nearer_by(free, fit) > least else fit
