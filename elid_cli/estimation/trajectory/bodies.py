"""Whether the motion asks for other bodies than the robot file describes, which the trajectory fit takes as they are.

To first order a body's parameters act as their columns of the regressor along the simulated motion. Beside them, drives
and offsets are free: where parts of the log that nothing was fitted to are then simulated clearly better, masses are
wrong, or something is missing that imitates them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.normal_equations import step_of
from elid_cli.estimation.trajectory.block_sums import BLOCKS
from elid_cli.estimation.trajectory.fit import COARSE, TrajectoryFit
from elid_cli.estimation.trajectory.loss import weighed
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.estimation.trajectory.pushes import columns_of_pushes
from elid_cli.estimation.trajectory.unknowns import PARAMETERS
from elid_cli.model.linearised import Linearised
from elid_cli.model.regressor import Regressor
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.signals.motion import Motion

ASKED = 0.05
"""Part of the squared error, not fitted to, that other bodies take off a joint's motion where it asks for them."""
HELPED = 0.75
"""Part of the blocks of time, simulated by values found without them, in which they must help."""
TOLD_APART = 1e-5
"""Size of a direction of the bodies' parameters, by the torques that it makes, beside the largest: less is none."""
STRENGTH = 0.05
"""Torque by which directions differ, in parts of the usual Coulomb friction …"""
LEAST = 1e-6
"""… and at least, N·m (N)."""
MEMORY = 256 << 20
"""Bytes of columns."""
INSTANTS, TOGETHER = 20_000, 12
"""Instants whose torques are computed at once, and directions that are simulated side by side."""
DAMPING = 1e-7
"""Part of the normal equations' diagonal: what bodies and drives cannot tell apart stays where it is."""


def other_bodies(fit: TrajectoryFit, columns: Sequence[Array]) -> dict[str, float]:
    """Return the part of their squared error, not fitted to, that other bodies take off, of joints that ask for them.

    Parameters
    ----------
    fit
        A fit with the bodies of its robot.
    columns
        Change of the positions of its stretches with every unknown, (N, n, U) each.
    """
    own, robot = fit.unknowns, fit.unknowns.robot
    shown = np.diag(fit.equations.matrix.sum(axis=0)) > 0  # not delays that are held at 0
    every = stride_of(fit)
    of_bodies = body_columns(fit, every)
    found = {}
    for chain, joints in enumerate(own.chains):
        free = np.flatnonzero(shown & np.isin(own.chain_of, (chain, len(own.chains))))
        blocks = []
        for item, of_drives, of_body in zip(fit.tracked, columns, of_bodies, strict=True):
            error = np.where(np.isnan(item.run.measured), 0.0, item.x[:, : robot.n] + item.finer - item.run.measured)
            light = weighed(error, item.usual, item.counts).light / np.maximum(fit.equations.size, 1e-12)
            error, scale = error[::every], light[::every, joints]
            drives = of_drives[::every, joints[:, None], free]
            both = np.concatenate([drives, of_body[:, joints]], axis=2) * scale[:, :, None]
            edges = np.linspace(0, len(error), BLOCKS + 1).astype(int)
            # a block in which nothing counts yet says nothing of how many are helped
            parts = [slice(a, b) for a, b in pairwise(edges) if scale[a:b].any()]
            blocks += [(both[part], (error[:, joints] * scale)[part]) for part in parts]
        with_them, without = (_left_out(blocks, count) for count in (None, len(free)))
        gain = np.log(np.maximum(with_them, 1e-300)) - np.log(np.maximum(without, 1e-300))
        asked = (np.mean(gain, axis=0) < np.log1p(-ASKED)) & (np.mean(gain < 0, axis=0) >= HELPED)
        less = fit.settled_rms[joints] * (1.0 - np.exp(0.5 * np.mean(gain, axis=0)))
        asked &= less > COARSE * _spread(fit)[joints]
        for place in np.flatnonzero(asked):
            found[robot.joint_names[joints[place]]] = 1.0 - float(np.exp(np.mean(gain[:, place])))
    return found


def _spread(fit: TrajectoryFit) -> Array:
    """Return the standard deviation of every joint's measured positions, rad (m), (n,)."""
    found: Array = np.nanstd(np.concatenate([item.run.measured for item in fit.tracked]), axis=0)
    return found


def _left_out(blocks: Sequence[tuple[Array, Array]], count: int | None) -> Array:
    """Return the squared errors of every joint in every block, (B, joints), after a step that did not see it.

    Of each block columns (N, joints, U) and errors (N, joints); the first `count` unknowns move, or all.
    """
    flat = [(columns[:, :, :count].reshape(len(columns) * columns.shape[1], -1), error) for columns, error in blocks]
    matrices, loads = [part.T @ part for part, _ in flat], [part.T @ error.ravel() for part, error in flat]
    matrix, load = np.sum(matrices, axis=0), np.sum(loads, axis=0)
    found = []
    for (part, error), own, pull in zip(flat, matrices, loads, strict=True):
        after = error + (part @ step_of(matrix - own, load - pull, DAMPING)).reshape(error.shape)
        found.append(np.sum(after**2, axis=0))
    return np.array(found)


def stride_of(fit: TrajectoryFit) -> int:
    """Return which sample of how many suffices for columns of all unknowns and bodies to fit into `MEMORY`."""
    n = fit.unknowns.robot.n
    whole = 8 * sum(len(item.x) for item in fit.tracked) * n * (fit.unknowns.count + len(LINK_PARAMETERS) * n)
    return max(1, -(-whole // MEMORY))


def body_columns(fit: TrajectoryFit, every: int = 1) -> list[Array]:
    """Return how the positions of the stretches change with directions of the bodies' parameters, (N, n, D) each.

    One direction of every chain of joints moves at a time, since chains do not move each other. Of `every` samples
    in a row one is returned.
    """
    own = fit.unknowns
    equations, parameters = Linearised(own.robot, without=PARAMETERS), own.robot.reference()
    strength = max(STRENGTH * float(np.median(fit.values[:, 1])), LEAST)
    thin = [_torques(fit, item, slice(None, None, every)) for item in fit.tracked]
    by_chain = [_directions([part[:, joints] for part in thin], strength) for joints in own.chains]
    del thin
    count = max((directions.shape[1] for directions in by_chain), default=0)
    found = []
    for item in fit.tracked:
        pushes = np.zeros((count, len(item.x), equations.coordinates.count))
        for start in range(0, len(item.x), INSTANTS):
            here = slice(start, start + INSTANTS)
            part = _torques(fit, item, here)
            for joints, directions in zip(own.chains, by_chain, strict=True):
                pushes[: directions.shape[1], here, joints] = np.transpose(part[:, joints] @ directions, (2, 0, 1))
        anew = replace(item, local=None)
        moved = [
            columns_of_pushes(equations, anew, own, fit.z, parameters, pushes[k : k + TOGETHER])[::every]
            for k in range(0, count, TOGETHER)
        ]
        found.append(np.concatenate(moved, axis=2) if moved else np.zeros((len(item.x[::every]), own.robot.n, 0)))
    return found


def _torques(fit: TrajectoryFit, item: Tracked, instants: slice) -> Array:
    """Return the torque that each parameter of a body, of value 1, needs along a simulated motion, (N, n, P)."""
    robot = fit.unknowns.robot
    model = Regressor(replace(robot, effects=()))
    a = np.gradient(item.v[:, : robot.n], item.run.dt, axis=0)[instants]
    x, v = item.x[instants, : robot.n], item.v[instants, : robot.n]
    rows = model.rows(Motion(item.run.t[instants], x, v, a, x, v, a))
    bodies = np.array([name.kind in LINK_PARAMETERS for name in model.names])
    found = np.zeros((len(x), robot.n, model.parameters))
    for plan in model.estimation.rows:
        if plan.row.kind == "sum":
            found[:, plan.row.joint, plan.columns] = rows[plan.row].T
    return found[:, :, bodies]


def _directions(torques: Sequence[Array], strength: float) -> Array:
    """Return directions of parameters (P, D) that make independent torques, of `strength` (rms) each, N·m (N)."""
    flat = np.concatenate([part.reshape(-1, part.shape[2]) for part in torques])
    length = np.sqrt(np.mean(flat**2, axis=0))
    used: NDArray[np.intp] = np.flatnonzero(length > 0)
    if not len(used):
        return np.zeros((flat.shape[1], 0))
    _, sizes, turned = np.linalg.svd(np.linalg.qr(flat[:, used] / length[used], mode="r"))
    kept = np.count_nonzero(sizes > TOLD_APART * sizes[0])
    found = np.zeros((flat.shape[1], kept))
    found[used] = (turned[:kept] / length[used]).T
    made = np.sqrt(np.mean((flat @ found) ** 2, axis=0))
    result: Array = found * (strength / np.maximum(made, 1e-300))
    return result
