"""Torque that drives did not deliver: limits below those of the robot file, told by the motion.

Along the measured motion the torque that the commands ask for is known, and what of it lies beyond a limit moves the
joint as any torque that the model lacks (`measured`). How much is missing follows from the limit alone, so that one
peak in a log tells it; of an amplitude, parts of the log without a peak would know nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.candidates import (
    STILL,
    Candidate,
    View,
    best_of,
    edges_of,
    moved_by,
    recordings_of,
    screened,
)
from elid_cli.diagnosis.by_motion.held_out import Blocks, gain
from elid_cli.diagnosis.by_motion.measured import is_clean, measured_views
from elid_cli.diagnosis.by_motion.peaks import of_peaks
from elid_cli.diagnosis.by_motion.refits import again
from elid_cli.diagnosis.by_motion.views import own_unknowns, seen_by, views_of
from elid_cli.errors import DataError
from elid_cli.estimation.regression.normal_equations import step_of
from elid_cli.estimation.trajectory.beside import BESIDE, FARTHEST, SETTLED, Beside, moved_by_runs
from elid_cli.estimation.trajectory.block_sums import DAMPING
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot

PEAKS, TRIED = (0.4, 0.999), 40
"""Parts of the log that the torque of a joint is below at the lowest and the highest limit tried, and how many are."""
SMALLEST = 1e-4
"""Least inertia and friction to start from."""
FINER, NARROWED = 9, 3
"""Limits tried about the best, and times that they are."""
LEAST = 0.15
"""Part of a joint's squared error that a limit must take away."""
ROUNDS = 3
"""Times that limits are looked for: what one joint does hides what others of its chain do."""
STEPPED = 3e-4
"""Part of itself to which the steps of the simulation, in which a drive enters its limit, give it."""
STEPS = 10
"""Steps by which a limit is fitted."""
AGAIN, NEARER = 12, 0.02
"""Times that limits are fitted again beside unknowns that are found anew, and what the loss must fall by for more."""


@dataclass(frozen=True)
class TorqueLimit:
    """The largest torque that a joint's drive delivers."""

    joint: int
    limit: float
    """N·m (N)."""
    deviation: float
    """Its standard error."""
    gain: float
    """Part of the joint's squared error that it takes away."""


def limited(fit: TrajectoryFit, kinds: Sequence[type[Effect]]) -> tuple[TrajectoryFit, tuple[TorqueLimit, ...]]:
    """Return the fit with lower limits of torque where the motion asks for them, and these; mostly it is `fit`.

    Parameters
    ----------
    fit
        The fit with the limits of its robot.
    kinds
        Effects that must not explain a joint's error better.
    """
    found: dict[int, float] = {}
    gains: dict[int, float] = {}
    for _ in range(ROUNDS):
        asked, near = _asked(fit, kinds, found)
        while asked:
            other = _refitted(fit, asked, near)
            better = {} if other is None else {j: share for j in asked if (share := _gain(fit, other, j)) >= LEAST}
            if other is not None and len(better) == len(asked):
                fit, found, gains = other, found | asked, gains | better
                break
            asked = {joint: asked[joint] for joint in better}
        if not asked:
            break
    if not found:
        return fit, ()
    fit, limits = sharpened(
        fit, [TorqueLimit(joint, limit, 0.0, gains[joint]) for joint, limit in sorted(found.items())]
    )
    for _ in range(AGAIN):  # far from a limit its steps end where those of the other unknowns do not lead on
        anew = _refitted(fit, {item.joint: item.limit for item in limits}, fit.values)
        if anew is None:
            break
        other, nearer = sharpened(anew, limits)
        if _loss(other) > _loss(fit) - NEARER:
            break
        fit, limits = other, nearer
    return fit, limits


def with_limits(robot: Robot, limits: Mapping[int, float | None]) -> Robot:
    """Return a robot whose drives deliver no more than some torques, N·m (N), by joint; None: no limit."""
    joints = tuple(
        replace(joint, limits=replace(joint.limits, torque=limits[k])) if k in limits else joint
        for k, joint in enumerate(robot.joints)
    )
    return replace(robot, joints=joints)


def sharpened(fit: TrajectoryFit, limits: Sequence[TorqueLimit]) -> tuple[TrajectoryFit, tuple[TorqueLimit, ...]]:
    """Return a fit with limits of torque with these fitted beside all other unknowns, whose errors then know of them.

    The fit's other values are those at the limits that are returned.
    """
    if not limits:
        return fit, ()
    for number in range(STEPS):
        beside, size = Beside.of(fit, _moved(fit, limits)), np.array([item.limit for item in limits])
        beside = beside.rougher(STEPPED * size)
        deviations = beside.deviations
        limits = [replace(item, deviation=float(d)) for item, d in zip(limits, deviations, strict=True)]
        if number == STEPS - 1 or (np.abs(beside.steps) <= SETTLED * deviations).all():
            break
        farthest = FARTHEST * size
        moved = np.clip(beside.steps, -farthest, farthest)
        nearer = [replace(item, limit=item.limit + float(d)) for item, d in zip(limits, moved, strict=True)]
        other = _moved_on(fit, {item.joint: item.limit for item in nearer}, beside.along)
        if other is None or _loss(other) > _loss(fit):
            break
        fit, limits = other, nearer
    return replace(fit, covariance=fit.covariance + beside.added), tuple(limits)


def _asked(
    fit: TrajectoryFit, kinds: Sequence[type[Effect]], known: Mapping[int, float]
) -> tuple[dict[int, float], Array]:
    """Return limits to try, N·m (N), by joint: those that take away more than anything else that may be missing.

    With them come drive parameters to start from, (n, 4): those that go with the limits along the measured motion.
    """
    views = views_of(fit)
    measured = measured_views(fit, views)
    kind, found = effect_that(of_drive="limit"), {}
    (amplitude,) = kind.amplitudes
    near = fit.values.copy()
    for joint in range(fit.unknowns.robot.n):
        if joint in known:
            continue
        own, clean = own_unknowns(fit.unknowns, joint), is_clean(views, measured, joint)
        if clean:
            limit, share, part, change = _best(seen_by(measured, own, joint), joint)
        else:
            limit, share, part, change = (*of_peaks(fit, joint), 1.0, np.zeros(len(KINDS)))
        if share < LEAST or not amplitude.low <= part <= amplitude.high:
            continue
        rivals: list[list[Candidate]] = [
            screened(seen_by(of, own, joint), joint, kinds, fit.effects) if use else []
            for of, use in ((views, True), (measured, clean))
        ]
        if all(rival.gain < share for rival in best_of(*rivals)):
            found[joint] = limit
            near[joint, : len(PARAMETERS)] = np.maximum((near[joint] + change)[: len(PARAMETERS)], SMALLEST)
            near[joint, len(PARAMETERS) :] += change[len(PARAMETERS) :]
    return found, near


def _best(views: Sequence[View], joint: int) -> tuple[float, float, float, Array]:
    """Return the limit that takes away most at a joint, its gain, and which part of the excess is missing by the data.

    The views' columns are those of the joint's own unknowns. Last comes by how much its drive parameters then change.
    """
    recordings = [
        (own, np.concatenate([v.columns for v in own]), np.concatenate([v.error[:, joint] for v in own]), edges_of(own))
        for own in recordings_of(views)
    ]
    plain = np.concatenate([Blocks.of(columns, error, edges).left() for _, columns, error, edges in recordings])
    torque = np.abs(np.concatenate([view.scene.tau[:, joint] for view in views]))

    def left(limit: float) -> Array:
        return np.concatenate([
            Blocks.of(columns, error + _excess(own, joint, limit), edges).left()
            for own, columns, error, edges in recordings
        ])  # fmt: skip

    tried = np.unique(np.quantile(torque, np.linspace(*PEAKS, TRIED)))
    best = tried[0]
    for number in range(1 + NARROWED):
        place = int(np.argmin([left(limit).sum() for limit in tried]))
        best, low, high = tried[place], tried[max(place - 1, 0)], tried[min(place + 1, len(tried) - 1)]
        if number < NARROWED:
            tried = np.linspace(low, high, FINER)
    share, _ = gain(plain, left(best))
    amounts, changes, energies = [], [], []
    for own, columns, error, _ in recordings:
        excess = _excess(own, joint, best)
        both = np.concatenate([columns, excess[:, None]], axis=1)
        amounts.append(float(step_of(both.T @ both, both.T @ error, DAMPING)[-1]))
        changes.append(step_of(columns.T @ columns, columns.T @ (error + excess), DAMPING)[: len(KINDS)])
        energies.append(max(float(excess @ excess), 1e-300))  # a recording without a peak says nothing of it
    part = float(np.average(amounts, weights=energies))
    return float(best), share, part, np.asarray(np.average(changes, axis=0, weights=energies))


def _excess(views: Sequence[View], joint: int, limit: float) -> Array:
    """Return what a torque beyond a limit that is missing does to a joint's position, weighted, (N,)."""
    found = []
    for view in views:
        torque, speed = view.scene.tau[:, joint], view.scene.motion.dtheta[:, joint]
        beyond = torque - np.clip(torque, -limit, limit)
        found.append(moved_by(beyond[None], view.response[joint], np.abs(speed) < STILL)[0] * view.weight[:, joint])
    return np.concatenate(found)


def _refitted(fit: TrajectoryFit, limits: Mapping[int, float], near: Array) -> TrajectoryFit | None:
    """Return the fit with other limits of some joints, found anew; None where the simulated motion runs away.

    It starts from drive parameters `near`, (n, 4).
    """
    own = fit.unknowns
    robot = with_limits(own.robot, limits)
    declared = fit.effects[: own.held]
    amplitudes = [fit.z[own.amplitudes_of(k)] for k, effect in enumerate(declared) if not effect.softens]
    known = np.concatenate([np.zeros(0), *amplitudes]).tolist()
    try:
        return fit_trajectory(robot, [item.run for item in _cut(fit, robot)], near, declared, known)
    except DataError:
        return None


def _moved_on(fit: TrajectoryFit, limits: Mapping[int, float], along: Array) -> TrajectoryFit | None:
    """Return the fit with slightly other limits, its effects kept; None where the simulated motion runs away.

    `along` is by how much its unknowns move with the limits, (U,).
    """
    own = fit.unknowns
    robot = with_limits(own.robot, limits)
    unknowns = replace(own, robot=robot, effects=fit.effects)
    try:
        found = again(replace(fit, tracked=tuple(_cut(fit, robot))), unknowns, fit.z + along)
    except DataError:
        return None
    return replace(found, held=fit.held)


def _cut(fit: TrajectoryFit, robot: Robot) -> list[Tracked]:
    """Return the stretches of a fit with drives that deliver no more than a robot's limits."""
    return [replace(item, run=item.run.within(robot.torque_limits), local=None) for item in fit.tracked]


def _loss(fit: TrajectoryFit) -> float:
    """Return what a fit makes small, by the sizes of its joints' errors."""
    return float(np.log(np.maximum(fit.equations.size, 1e-12)).sum())


def _gain(fit: TrajectoryFit, other: TrajectoryFit, joint: int) -> float:
    """Return the part of a joint's squared error that a fit with limits takes away; 0 where its chain is worse off."""
    before, after = (own.equations.lighter.sum(axis=0) for own in (fit, other))
    chain = fit.unknowns.chain == fit.unknowns.chain[joint]
    if after[chain].sum() > before[chain].sum():
        return 0.0
    return float(1.0 - after[joint] / max(before[joint], 1e-300))


def _moved(fit: TrajectoryFit, limits: Sequence[TorqueLimit]) -> list[Array]:
    """Return how the positions of a fit's stretches change with limits, rad (m) per N·m (N), (N, n, L) each."""

    def further(item: TorqueLimit) -> Callable[[Run], Run]:
        moved = np.where(np.arange(fit.unknowns.robot.n) == item.joint, 1.0 + BESIDE, 1.0)
        return lambda run: run.within(run.drives.limit * moved)

    sizes = BESIDE * np.array([item.limit for item in limits])
    return [moved / sizes for moved in moved_by_runs(fit, [further(item) for item in limits])]
