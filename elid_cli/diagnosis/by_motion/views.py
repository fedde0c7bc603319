"""A trajectory fit as screening sees it: every stretch's scene, errors, columns and how its joints respond."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.candidates import View, response_of
from elid_cli.estimation.trajectory.acting import scene_along
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.loss import weighed
from elid_cli.estimation.trajectory.normal_equations import Tracked, simulated
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS, Unknowns
from elid_cli.model.linearised import Linearised
from elid_cli.signals.motion import Motion

SAME = 1e-9
"""rad (m) by which positions of one count differ where they were interpolated."""


def views_of(fit: TrajectoryFit) -> list[View]:
    """Return the stretches of a fit with the columns of all its unknowns."""
    robot = fit.unknowns.robot
    equations, parameters = Linearised(robot, without=PARAMETERS), robot.reference()
    size = np.maximum(fit.equations.size, 1e-9)
    found = []
    for item in fit.tracked:
        moved = simulated(equations, item, fit.unknowns, fit.z, parameters)
        weight = weighed(moved.error, item.usual, item.counts).light / size * _of_rests(item.run.measured)
        scene = scene_along(robot, item.x, item.v, item.equations(equations), item.run.dt, parameters, len(item.x))
        found.append(View(
            scene, moved.error * weight, weight, moved.columns * weight[:, :, None], _responses(fit, item, equations),
            item.run.source, _turning(fit, scene.motion),
        ))  # fmt: skip
    return found


def _of_rests(measured: Array) -> Array:
    """Return the weight of every sample among those that an encoder gives one count for, (N, n): together they are one.

    What is left of a count is the same for a whole rest, and again whenever the joint comes back: it would look like a
    function of the position.
    """
    weight = np.ones_like(measured)
    for k, column in enumerate(measured.T):
        starts = np.concatenate([[0], np.flatnonzero(np.abs(np.diff(column)) > SAME) + 1, [len(column)]])
        lengths = np.diff(starts)
        weight[:, k] = np.repeat(1.0 / np.sqrt(lengths), lengths)
    return weight


def _turning(fit: TrajectoryFit, motion: Motion) -> Array | None:
    """Return the part of every joint's dry friction that acts, with its sign, (N, n); None where all of it holds."""
    fading = fit.unknowns.fading_of(fit.z[None])
    if fading is None:
        return None
    soft = np.clip((motion.dtheta + fading.lead[0] * motion.ddtheta) / fading.width[0], -1.0, 1.0)
    return np.where(fading.friction[0] > 0, soft, np.sign(motion.dtheta))


def _responses(fit: TrajectoryFit, item: Tracked, equations: Linearised) -> tuple[tuple[Array, Array], ...]:
    local, drives, values = item.equations(equations), item.run.drives, fit.values
    mass, slope = local.mass[:, 0].mean(axis=0), local.slope[:, 0].mean(axis=0)
    return tuple(
        response_of(
            float(mass[k, k] + values[k, 0]), float(values[k, 2] + drives.kd[k]), float(drives.kp[k] + slope[k, k]),
            item.run.dt,
        )
        for k in range(fit.unknowns.robot.n)
    )  # fmt: skip


def own_unknowns(unknowns: Unknowns, joint: int) -> NDArray[np.intp]:
    """Return the places in z of a joint's own unknowns, and of the delays."""
    kinds = len(KINDS)
    effects = unknowns.drives + np.flatnonzero(unknowns.owners == joint)
    delays = np.arange(unknowns.delays.start, unknowns.delays.stop)
    return np.concatenate([np.arange(kinds * joint, kinds * (joint + 1)), effects, delays])


def seen_by(views: Sequence[View], unknown: NDArray[np.intp], joint: int) -> list[View]:
    """Return views whose columns are those of some unknowns at a joint."""
    return [replace(view, columns=view.columns[:, joint, unknown]) for view in views]
