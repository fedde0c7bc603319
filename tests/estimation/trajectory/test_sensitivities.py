"""How a simulated motion changes with what a fit finds: columns against differences of whole simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli.diagnosis.by_motion.torque_gains import gains_of
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.estimation.trajectory.normal_equations import simulated
from elid_cli.estimation.trajectory.softening import columns_of
from elid_cli.estimation.trajectory.unknowns import PARAMETERS, Unknowns
from elid_cli.logs.reading import read_recording
from elid_cli.model.linearised import Linearised
from elid_cli.model.runs import Run
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.test_carried import ARMATURE, described, moved, written

ROUNDS = 6
"""Times that the equations are linearised about the motion that came out."""
NUDGE = 1e-3


def _positions(fit: TrajectoryFit, robot: Robot, runs: Sequence[Run], z: np.ndarray) -> np.ndarray:
    """Return the positions, less what was measured, of equations about the motion that comes out, rad, (N, n)."""
    own = fit.unknowns
    unknowns, equations = Unknowns(robot, fit.effects, own.recordings, own.held), Linearised(robot, without=PARAMETERS)
    found = []
    for item, run in zip(fit.tracked, runs, strict=True):
        here = replace(item, run=run, local=None)
        for _ in range(ROUNDS):
            error = simulated(equations, here, unknowns, z, robot.reference(), plain=True).error
        found.append(error)
    return np.concatenate(found)


def _fit(folder: Path) -> TrajectoryFit:
    arm = described(folder)
    recording = read_recording([written(folder, moved(5, 0.0))], arm)
    start = started_from(arm, prepare(recording, arm))
    return fit_trajectory(arm, commanded_runs(recording, arm), start, soft=False)


def _off(column: np.ndarray, difference: np.ndarray) -> float:
    """Return the part of a change of the motion that a column lacks, of the joint that lacks most."""
    return float(np.max(np.std(difference - column, axis=0) / np.std(difference, axis=0)))


def test_columns_of_drives_are_the_slopes_of_the_motion(tmp_path: Path) -> None:
    """Of joints that move each other, too: there the inertias that change with the pose are what counts."""
    fit = _fit(tmp_path)
    robot, runs, columns = fit.unknowns.robot, [item.run for item in fit.tracked], np.concatenate(columns_of(fit))
    for k in range(fit.unknowns.drives):
        step = NUDGE * max(abs(fit.z[k]), 0.1 * float(ARMATURE[0])) * np.eye(len(fit.z))[k]
        high, low = (_positions(fit, robot, runs, fit.z + sign * step) for sign in (1, -1))
        assert _off(columns[:, :, k], (high - low) / (2 * step[k])) < 0.03, k


def test_columns_of_gains_are_the_slopes_of_the_motion(tmp_path: Path) -> None:
    """They have what those of the drives have: a joint's inertia beside its gain would make up for neither else."""
    fit = _fit(tmp_path)
    robot, runs = fit.unknowns.robot, [item.run for item in fit.tracked]
    change = gains_of(robot, (0, 1))
    columns = np.concatenate(list(change.moved(fit, robot, np.zeros(2))))
    for k, values in enumerate(NUDGE * np.eye(2)):
        high, low = (_positions(fit, robot, [change.run(run, by) for run in runs], fit.z) for by in (values, -values))
        assert _off(columns[:, :, k], (high - low) / (2 * NUDGE)) < 0.02, k


def test_equations_about_a_motion_hold_to_first_order_beside_it() -> None:
    """With centrifugal torques and inertias that change with the pose: what is left falls with the square."""
    elastic = read_robot("puma560")
    robot = replace(elastic, joints=tuple(replace(joint, transmission="rigid") for joint in elastic.joints))
    equations, rng, dt = Linearised(robot), np.random.default_rng(3), 1e-3
    t = dt * np.arange(200)
    phase, rate = rng.uniform(0, 6, robot.n), rng.uniform(3, 9, robot.n)

    def motion(part: float) -> tuple[np.ndarray, np.ndarray]:
        beside = part * 0.1 * np.sin(5 * t[:, None] + phase[::-1])
        x = 0.8 * np.sin(t[:, None] * rate + phase) + beside
        return x[:, None], np.gradient(x, dt, axis=0)[:, None]

    (x, v), (middle, edge) = motion(0.0), (slice(50, 150), np.s_[50:150, 0])
    about, left = equations.about(x, v, dt), []
    for part in (1.0, 0.5):
        y, w = motion(part)
        there, a = equations.about(y, w, dt), np.gradient(w, dt, axis=0)[edge]
        exact = np.einsum("nij,nj->ni", there.mass[edge], a) + there.force[edge]
        near = np.einsum("nij,nj->ni", about.mass[edge], a) + about.force[edge]
        near += np.einsum("nij,nj->ni", about.slope[edge], (y - x)[edge])
        near += np.einsum("nij,nj->ni", about.swerve[edge], (w - v)[edge])
        left.append(np.abs(exact - near).max() / np.abs(exact).max())
    assert left[0] < 0.1
    assert left[1] < 0.3 * left[0]
    without = equations.about(x, v)
    assert not without.curved
    assert np.abs(without.slope - about.slope)[middle].max() > 0.1 * np.abs(about.slope)[middle].max()
