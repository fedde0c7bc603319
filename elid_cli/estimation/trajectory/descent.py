"""Steps of the trajectory fit: Levenberg-Marquardt by the slopes of one motion, for as long as they lower the error.

A delay, viscous friction and inertia move a motion nearly alike: the error has a narrow valley, along which single
unknowns go far. A step is therefore made shorter as a whole, or turned by damping, never cut unknown by unknown.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.normal_equations import step_of, steps_without
from elid_cli.estimation.trajectory.block_sums import DAMPING, Equations
from elid_cli.estimation.trajectory.memory import has_memory, without_memory
from elid_cli.estimation.trajectory.normal_equations import Tracked, passed
from elid_cli.estimation.trajectory.unknowns import LATEST, Unknowns
from elid_cli.model.linearised import Linearised

STEPS = 8
"""Most steps by the slopes of one motion."""
FAR = 0.8
"""Part of itself by which an inertia or friction falls in one step at most …"""
HIGH = 4.0
"""… and times the usual value of all joints by which it rises."""
BENT = 0.25
"""Part of itself by which a shape moves in one step."""
LEAST = 1e-4
"""Usual value, SI, of a parameter that is 0 in all joints."""
BOUNDS = 4
"""Rounds in which unknowns that a step would bring beyond their bounds are found."""
SETTLED = 0.1
"""Part of the standard errors that the next step must be below for the fit to end."""
FIRST, LAST = 1e-3, 10.0
"""Damping, in parts of the diagonal, after a step that did not lower the error; ten times more after the next."""
SLIGHT = 1e-4
"""Relative change of the error that does not count as a rise."""
SLOWEST = 0.8
"""Largest part of the step before that a step is taken to be, for where they lead."""


def costs(found: Equations, unknowns: Unknowns) -> Array:
    """Return what the fit makes small, chain by chain, (C,)."""
    cost = np.log(np.maximum(found.size, 1e-9))
    return np.array([cost[joints].sum() for joints in unknowns.chains])


def descended(
    equations: Linearised, tracked: list[Tracked], unknowns: Unknowns, z: Array,
    known: tuple[Equations, list[Array]], *, prompt: bool,
) -> Array:  # fmt: skip
    """Return unknowns (U,) with a lower error, by the equations and slopes `known` at z.

    Where delays are held (`prompt`), chains of joints do not move each other: one whose error a step does not lower
    takes a damped one, the others go on.
    """
    found, columns = known
    parameters, cost = unknowns.robot.reference(), costs(found, unknowns)
    waiting, damping = np.ones(len(cost), dtype=bool), np.zeros(len(cost))
    last: Array | None = None
    for _ in range(STEPS):
        step = plain = _step(unknowns, z, found, damping, prompt=prompt)
        if not damping.any() and is_small(step, found):
            return z
        if last is not None and not damping.any():
            step = _farther(plain, last, found)
        last = plain
        trial = unknowns.possible(z + np.where(np.append(waiting, not prompt)[unknowns.chain_of], step, 0.0))
        motions = [(item.x, item.v, item.local, item.path) for item in tracked]
        tried, _ = passed(equations, tracked, unknowns, trial, parameters, columns)
        now = costs(tried, unknowns)
        fell = now <= cost + SLIGHT if prompt else np.full(len(cost), now.sum() <= cost.sum() + SLIGHT)
        z = np.where(np.append(fell, fell.all())[unknowns.chain_of], trial, z)
        if not fell.all():
            for item, motion in zip(tracked, motions, strict=True):
                item.x, item.v, item.local, item.path = motion  # equations are not about a motion that ran away
            waiting, last = ~fell, None
            damping = np.where(fell, damping, np.maximum(10 * damping, FIRST))
            if damping.max() > LAST:
                return z
            continue
        cost, found = now, tried
        waiting, damping = np.ones(len(cost), dtype=bool), np.where(damping > FIRST, 0.1 * damping, 0.0)
    return z


def _farther(step: Array, last: Array, found: Equations) -> Array:
    """Return where steps that become shorter by one part each, as those by slopes that are not exact, lead (Aitken)."""
    matrix = found.matrix.sum(axis=0)
    ratio = float(last @ matrix @ step) / max(float(last @ matrix @ last), 1e-300)
    farther: Array = step / (1.0 - min(max(ratio, 0.0), SLOWEST))
    return farther


def is_settled(unknowns: Unknowns, z: Array, found: Equations, *, prompt: bool) -> bool:
    """Whether the next step from z is far smaller than the standard errors, by equations at z."""
    return is_small(_step(unknowns, z, found, np.zeros(len(unknowns.chains)), prompt=prompt), found)


def is_small(step: Array, found: Equations) -> bool:
    """Whether a step is far smaller than the standard errors."""
    moved = steps_without(found.matrix, found.load, DAMPING)
    deviation = np.sqrt(len(moved) - 1) * np.std(moved, axis=0)
    if not has_memory(found):
        deviation = np.minimum(deviation, np.sqrt(np.diag(without_memory(found))))
    return bool((np.abs(step) <= SETTLED * deviation).all())


def _step(unknowns: Unknowns, z: Array, found: Equations, damping: Array, *, prompt: bool) -> Array:
    """Return the step of the unknowns, (U,): those that it would bring beyond a bound go to it, the others beside."""
    matrix, load = found.matrix.sum(axis=0), found.load.sum(axis=0)
    more = np.append(damping, damping.max())[unknowns.chain_of]
    low, high = unknowns.bounds
    held, fixed = np.zeros(len(z), dtype=bool), np.zeros(len(z))
    if prompt:
        held[unknowns.delays] = True
    for _ in range(BOUNDS):
        step = step_of(matrix, load + matrix @ fixed, DAMPING + more, held) + fixed
        end = np.clip(z + step, low, high)
        broken = ~held & (end != z + step)
        broken[unknowns.drives :] &= (end == z)[
            unknowns.drives :
        ]  # shapes are not linear: one that is on its way goes on
        if not broken.any():
            break
        fixed[broken] = (end - z)[broken]
        held |= broken
    part = _within_reach(unknowns, z, step)
    shortened: Array = (part if prompt else np.full_like(part, part.min()))[unknowns.chain_of] * step
    return shortened


def _within_reach(unknowns: Unknowns, z: Array, step: Array) -> Array:
    """Return the part of a step that each chain of joints, and the delays, take at once, (C + 1,)."""
    values = np.abs(unknowns.joint_values(z))
    down, up = np.full((2, unknowns.count), np.inf)
    usual = np.median(values, axis=0)
    # where most joints have none, any is a start
    usual = np.where(usual > 0, usual, np.maximum(np.max(values, axis=0), LEAST))
    fall, rise = FAR * np.maximum(values, 0.2 * usual), HIGH * np.maximum(values, usual)
    fall[:, 3] = rise[:, 3] = np.inf
    down[: unknowns.drives], up[: unknowns.drives] = fall.ravel(), rise.ravel()
    shapes = slice(unknowns.amplitudes.stop, unknowns.delays.start)
    size = np.maximum(np.abs(z[shapes]), unknowns.usual_shapes)
    down[shapes] = up[shapes] = np.where(unknowns.softening, FAR, BENT) * size
    down[unknowns.delays] = up[unknowns.delays] = 0.2 * LATEST
    over = np.maximum(np.maximum(-step / down, step / up), 1.0)
    part = np.ones(len(unknowns.chains) + 1)
    np.minimum.at(part, unknowns.chain_of, 1.0 / over)
    return part
