"""A trajectory fit as screening sees it from the measured motion.

What a torque does to the simulated motion is known near that motion only: where the model lacks much, its friction is
far off, and joints stick where they do not. Along the measured motion the torque that the model leaves is linear in
friction, inertia and in whatever is missing, however large. Filtered by how a joint responds, it is the error of the
position, and the noise of the encoders in it is no larger than they have it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.candidates import View, moved_by
from elid_cli.estimation.trajectory.acting import acting, scene_along
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.normal_equations import Tracked, as_late
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS
from elid_cli.model.effects.scene import Scene
from elid_cli.model.linearised import Linearised

WINDOW = 0.03
"""s before and after an instant, over which the motion that effects are computed of is smoothed."""
SLOW = 0.03
"""Part of its top speed below which a measured joint may stick."""
DIRTY = 1.5
"""Times the squared error of the simulated motion from which that along the measured motion tells of noise and of
joints that stick, not of what is missing."""


def measured_views(fit: TrajectoryFit, views: Sequence[View]) -> list[View]:
    """Return views of the stretches along their measured motion.

    Parameters
    ----------
    fit
        The fit.
    views
        Its views along the simulated motion: how joints respond, weights, and columns of what is no drive parameter
        are theirs.
    """
    equations = Linearised(fit.unknowns.robot, without=PARAMETERS)
    return [_along(fit, equations, view, item) for view, item in zip(views, fit.tracked, strict=True)]


def is_clean(views: Sequence[View], measured: Sequence[View], joint: int) -> bool:
    """Whether what is left at a joint along the measured motion is what is left of the simulated one."""
    left, own = (sum(float(np.sum(view.error[:, joint] ** 2)) for view in of) for of in (views, measured))
    return own <= DIRTY * left


def _along(fit: TrajectoryFit, equations: Linearised, view: View, item: Tracked) -> View:
    robot, run, values = fit.unknowns.robot, item.run, fit.values
    dt, q, parameters = run.dt, run.near, robot.reference()
    v, a = np.gradient(q, dt, axis=0), np.zeros_like(q)
    a[1:-1] = np.diff(q, 2, axis=0) / dt**2
    x, speed = _smoothed(q, dt)
    local = equations.about(x[:, None], speed[:, None])
    scene = scene_along(robot, x, speed, local, dt, parameters, len(x))
    sticks = np.abs(speed) < SLOW * np.quantile(np.abs(speed), 0.98, axis=0)
    still = np.where(sticks, 0.0, speed)
    scene = replace(scene, motion=replace(scene.motion, dq=still, dtheta=still), cache={})
    drives = np.stack([a, np.sign(still), v, np.ones_like(q)], axis=2)  # as KINDS
    scene = replace(scene, tau=_driven(fit, item, x, speed))
    left = _driven(fit, item, q, v) - np.einsum("njk,jk->nj", drives, values)
    left -= np.einsum("nij,nj->ni", local.mass[:, 0], a) + local.force[:, 0] + _of_effects(fit, scene)
    error, columns = np.empty_like(view.error), view.columns.copy()
    for k in range(robot.n):
        torques = np.concatenate([-left[:, [k]], drives[:, k]], axis=1).T
        moved = moved_by(torques, view.response[k], sticks[:, k]).T * view.weight[:, [k]]
        error[:, k] = np.where(np.isnan(run.measured[:, k]), 0.0, moved[:, 0])
        columns[:, k, len(KINDS) * k : len(KINDS) * (k + 1)] = moved[:, 1:]
    return replace(view, scene=scene, error=error, columns=columns)


def _smoothed(q: Array, dt: float) -> tuple[Array, Array]:
    """Return positions and velocities of cubics through the neighbours of every instant, (N, n)."""
    from scipy.signal import savgol_filter  # most of a second

    window = min(max(2 * round(WINDOW / dt) + 1, 5), (len(q) - 1) // 2 * 2 + 1)
    x, v = (savgol_filter(q, window, 3, deriv=k, delta=dt, axis=0) for k in (0, 1))
    return x, v


def _driven(fit: TrajectoryFit, item: Tracked, q: Array, v: Array) -> Array:
    """Return the torque of the drives at every instant, the mean of what is held before and after it, (N, n)."""
    drives = as_late(item, fit.unknowns, fit.z).drives
    told = drives.told.reshape(len(q) - 1, -1, q.shape[1]).mean(axis=1)
    held = 0.5 * (np.concatenate([told[:1], told]) + np.concatenate([told, told[-1:]]))
    if drives.ki is not None:
        held -= drives.ki * item.run.dt * (np.cumsum(q, axis=0) - 0.5 * (q + q[0]))
    found: Array = np.clip(held - drives.kp * q - drives.kd * v, -drives.limit, drives.limit)
    return found


def _of_effects(fit: TrajectoryFit, scene: Scene) -> Array:
    """Return the torque of the effects that the fit holds, on the model's side, (N, n)."""
    if not fit.unknowns.pushing:
        return np.zeros_like(scene.motion.q)
    push, grip = acting(fit.unknowns.pushing_at(fit.z), scene).total(fit.z[fit.unknowns.amplitudes])
    found: Array = push + grip * np.sign(scene.motion.dtheta)
    return found
