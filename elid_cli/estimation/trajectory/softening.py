"""Whether friction fades in over a speed, in place of holding a joint at rest: fitted where the motion asks for it.

Friction that holds is what a robot has, or nearly. Simulators smooth it, and it then turns otherwise at every reversal:
armature, viscous friction and delay are off where a fit does not know. A first look costs little: what simulations with
friction of usual smoothness leave, after one linear step of all unknowns. Only where that is clearly less, width and
lead of every joint become unknowns. They stay where they are clear of 0, and where parts of the log that the values
were not found from are simulated better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.regression.normal_equations import jackknife, step_of
from elid_cli.estimation.trajectory.block_sums import DAMPING
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.loss import weighed
from elid_cli.estimation.trajectory.normal_equations import passed
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS, Unknowns, started
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.linearised import Linearised

USUAL = ((3e-3, 5e-3), (3e-3, 1e-2), (5e-3, 0.0), (2e-2, 0.0), (6e-2, 0.0))
"""Width, rad/s (m/s), and lead, s, of smooth friction: constraints of several softnesses, and plain widths."""
WORTH = 0.008
"""Part of the usual size of the error by which softer friction must lower it, over the joints of a chain."""
SHOWN = 3.0
"""Standard errors by which a width or a lead must be clear of 0."""
HELPED = 0.75
"""Part of the blocks of time, simulated by values found without them, that it must make better."""
SPOILT = 1.5
"""Times the size of a joint's error before from which the fit has lost it on the way."""

Refit = Callable[[Unknowns, TrajectoryFit, Array], TrajectoryFit]
"""Fits unknowns, started from given ones (U,), to the stretches of a fit."""


def softened(
    hard: TrajectoryFit, refit: Refit, columns: Sequence[Array] | None = None, *,
    shapes: Mapping[int, tuple[float, float]] | None = None, start: Array | None = None,
) -> TrajectoryFit:  # fmt: skip
    """Return the fit with friction that fades in at the joints where the log asks for it; mostly it is `hard`.

    Parameters
    ----------
    hard
        The fit with friction that holds.
    refit
        Fits again.
    columns
        Change of the positions of its stretches with every unknown, (N, n, U) each, where known.
    shapes
        Width and lead to start from of the joints where it may fade in; None: those where the log asks for it.
    start
        Drive parameters to start from, (n, 4); None: those of the fit with friction that holds.

    Returns
    -------
    TrajectoryFit
        With `held`, the fit before, where friction fades in. Its effects stand after those that the robot declares.
    """
    if shapes is None:
        shapes = _asked(hard, columns if columns is not None else columns_of(hard))
    if not shapes:
        return hard
    kind, own, place = effect_that(softens=True), hard.unknowns, hard.unknowns.held
    found, asked = hard, [kind(joint, shape) for joint, shape in shapes.items()]
    try:
        while asked:
            others = found.effects[place:]  # in the shapes that they have by now
            softer = [effect for effect in others if effect.softens and effect.joint not in shapes]
            softer = sorted([*softer, *asked], key=lambda effect: effect.joint)
            effects = (*hard.effects[:place], *softer, *(effect for effect in others if not effect.softens))
            unknowns = replace(own, effects=effects, held=place)
            near = found.values if start is None or found is not hard else start
            z = started(unknowns, near, found.z[found.unknowns.amplitudes].tolist())
            z[unknowns.delays], z[unknowns.departures] = found.delays, found.z[found.unknowns.departures]
            found = refit(unknowns, hard, z)
            ours = [found.effects[found.unknowns.soft[effect.joint]] for effect in asked]
            kept = [effect for effect in ours if _stays(found, effect, hard)]
            if len(kept) == len(asked):
                spoilt = bool((found.equations.size > SPOILT * hard.equations.size).any())
                return hard if spoilt else replace(found, held=hard)
            asked = kept
    except DataError:  # the motion ran away
        pass
    return hard


def gains_of(soft: TrajectoryFit) -> dict[int, float]:
    """Return the part of their chain's squared error, not fitted to, that joints' softer friction takes away.

    None of a fit that was not found by `softened`, nor of joints whose friction was softer before.
    """
    found, hard = {}, soft.held
    for joint in soft.unknowns.soft if hard is not None else ():
        assert hard is not None
        if joint not in hard.unknowns.soft:
            chain = int(soft.unknowns.chain_of[len(KINDS) * joint])
            found[joint] = 1.0 - float(np.exp(2.0 * (_held_out(soft, chain) - _held_out(hard, chain)).mean()))
    return found


def is_worth(soft: TrajectoryFit, hard: TrajectoryFit, joint: int) -> bool:
    """Whether a joint's chain is simulated better with softer friction, where that was not fitted."""
    chain = int(soft.unknowns.chain_of[len(KINDS) * joint])
    change = _held_out(soft, chain) - _held_out(hard, chain)
    return bool(change.mean() < -WORTH and np.mean(change < 0) >= HELPED)


def is_unsure(fit: TrajectoryFit) -> bool:
    """Whether neither width nor lead of some joint's friction that fades in is clear of 0 any more."""
    own = fit.unknowns
    places = [own.shapes_of(own.soft[joint])[0] for joint in own.soft]
    return any(not (fit.z[at] > SHOWN * fit.deviation[at]).any() for at in places)


def columns_of(fit: TrajectoryFit) -> list[Array]:
    """Return how the positions of a fit's stretches change with every unknown, (N, n, U) each."""
    robot = fit.unknowns.robot
    equations = Linearised(robot, without=PARAMETERS)
    return passed(equations, [replace(item) for item in fit.tracked], fit.unknowns, fit.z, robot.reference())[1]


def _asked(hard: TrajectoryFit, columns: Sequence[Array]) -> dict[int, tuple[float, float]]:
    """Return the width and lead to start from of every joint whose chain is simulated clearly better with them."""
    own = hard.unknowns
    robot, kind, parameters = own.robot, effect_that(softens=True), own.robot.reference()
    equations = Linearised(robot, without=PARAMETERS)
    free = [joint for joint in range(robot.n) if joint not in own.soft]

    def size_of(shapes: Mapping[int, tuple[float, float]]) -> Array:
        softer: list[Effect] = [kind(joint, shape) for joint, shape in shapes.items()]
        # the unknowns are the same: the first effects keep their shapes
        unknowns = replace(own, effects=(*softer, *hard.effects), held=len(softer) + own.held)
        return size_after_a_step(equations, unknowns, hard, columns, parameters)

    bare = size_of({})
    every = [dict.fromkeys(free, shape) for shape in USUAL]
    nearer = [np.log(size_of(shapes) / bare) for shapes in every]
    # every joint with the shape that it would have itself
    own_best = np.argmin(nearer, axis=0)
    every.append({joint: USUAL[own_best[joint]] for joint in free if nearer[own_best[joint]][joint] < -0.5 * WORTH})
    nearer.append(np.log(size_of(every[-1]) / bare))
    found = {}
    for joints in own.chains:
        best = min(range(len(every)), key=lambda k: float(nearer[k][joints].mean()))
        if nearer[best][joints].mean() < -WORTH:
            found.update({int(joint): every[best][joint] for joint in joints if joint in every[best]})
    return found


def size_after_a_step(
    equations: Linearised, unknowns: Unknowns, hard: TrajectoryFit, columns: Sequence[Array], parameters: Array
) -> Array:
    """Return the size of every joint's error, large ones counted less, after a linear step of all unknowns, (n,)."""
    tracked = [replace(item) for item in hard.tracked]
    every, _ = passed(equations, tracked, unknowns, hard.z, parameters, list(columns), rounds=1)
    step = step_of(every.matrix.sum(axis=0), every.load.sum(axis=0), DAMPING)
    total = np.zeros(unknowns.robot.n)
    for item, slopes in zip(tracked, columns, strict=True):
        x = item.x[:, : unknowns.robot.n] + item.finer
        error = np.where(np.isnan(item.run.measured), 0.0, x - item.run.measured) + slopes @ step
        total += weighed(error, item.usual, item.counts).loss.sum(axis=0)
    return np.sqrt(total)


def _stays(soft: TrajectoryFit, effect: Effect, hard: TrajectoryFit) -> bool:
    """Whether the log shows a joint's width or lead, and its chain is simulated better where that was not fitted."""
    own = soft.unknowns
    places, _ = own.shapes_of(own.soft[effect.joint])
    # what makes no memory may make a lead that is none: blocks of time know
    blocks = np.sqrt(np.diag(jackknife(soft.left_out)))
    clear = soft.z[places] > SHOWN * np.maximum(soft.deviation, blocks)[places]
    return bool(clear.any()) and is_worth(soft, hard, effect.joint)


def _held_out(fit: TrajectoryFit, chain: int) -> Array:
    """Return the logarithm of a chain's error in every block of time, with the values found without it, (B,)."""
    own, found = fit.unknowns, fit.equations
    joints: NDArray[np.intp] = own.chains[chain]
    inside = found.lighter[:, joints]
    scaled = np.sum(inside / found.size[joints] ** 2, axis=1)
    move = np.where(np.isin(own.chain_of, (chain, len(own.chains))), fit.left_out - fit.z, 0.0)
    beyond = 2.0 * np.einsum("bu,bu->b", move, found.load) + np.einsum("bu,buv,bv->b", move, found.straight, move)
    inflated = np.maximum(1.0 + beyond / np.maximum(scaled, 1e-300), 1e-3)
    size = np.log(np.maximum(inside / found.counts[:, None], 1e-18)).mean(axis=1)
    result: Array = 0.5 * (size + np.log(inflated))
    return result
