"""By how much further torques move the simulated motion of a trajectory fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.normal_equations import Tracked, as_late, stepped
from elid_cli.estimation.trajectory.unknowns import Unknowns
from elid_cli.model.drives import Fading, Joints
from elid_cli.model.linearised import Linearised


def columns_of_pushes(
    equations: Linearised, item: Tracked, unknowns: Unknowns, z: Array, parameters: Array, pushes: Array
) -> Array:
    """Return by how much further torques move the simulated positions of a stretch, rad (m), (N, n, D).

    `pushes` are D torques on every coordinate, on the model's side, N·m (N), (D, N, m).
    """
    run, n = as_late(item, unknowns, z), unknowns.robot.n

    def beside(joints: Joints) -> Joints:
        return _beside(joints, pushes, run.finer)

    x = stepped(equations, replace(item), run, unknowns, z, parameters, (), beside)[0]
    found: Array = np.moveaxis(x[:, 1:, :n] - x[:, :1, :n], 1, 2)
    return found


def _beside(joints: Joints, pushes: Array, finer: int) -> Joints:
    """Return the one variant of joints, and D more that differ by further torques on every coordinate, (D, N, m)."""
    count, shape = len(pushes) + 1, (finer * (pushes.shape[1] - 1), 1, 1, pushes.shape[2])
    plain = np.zeros(shape) if joints.push is None else joints.push
    push = np.repeat(plain, count, axis=1)
    push[:, 1:, 0] += np.repeat(np.moveaxis(0.5 * (pushes[:, 1:] + pushes[:, :-1]), 0, 1), finer, axis=0)
    grip = np.repeat(np.zeros(shape) if joints.grip is None else joints.grip, count, axis=1)
    fading = joints.fading
    if fading is not None:
        fading = Fading(*(np.repeat(part, count, axis=0) for part in (fading.friction, fading.width, fading.lead)))
    inertia, coulomb, viscous, offset = (
        np.repeat(part, count, axis=0) for part in (joints.inertia, joints.coulomb, joints.viscous, joints.offset)
    )
    return Joints(inertia, coulomb, viscous, offset, push, grip, fading=fading)
