"""Fifty noisy logs made physical, and 10,000 mass matrices: prints what `--physical` costs.

    python -m tests.system.reproduce.physical [LOGS]

Planar and PUMA arms in turn. Several noise draws share one simulated motion, since simulating takes longest.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from elid_cli.estimation.identify import identify
from elid_cli.estimation.physical.nearest import PhysicalParameters, make_physical
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare

POSES = 10_000
POSITION_NOISE = (1e-6, 1e-5, 3e-5, 1e-4)
TORQUE_NOISE = (0.005, 0.03, 0.1)


def noisy(log: Recording, seed: int) -> Recording:
    """Return a log with a fresh draw of sensor noise, of a size that the seed chooses too."""
    generator = np.random.default_rng(seed)
    position = POSITION_NOISE[seed % len(POSITION_NOISE)]
    torque = TORQUE_NOISE[seed % len(TORQUE_NOISE)] * np.sqrt(np.mean(log.tau**2, axis=0))
    return replace(
        log,
        q=log.q + position * generator.standard_normal(log.q.shape),
        theta=log.theta + position * generator.standard_normal(log.q.shape),
        tau=log.tau + torque * generator.standard_normal(log.q.shape),
    )


def least_eigenvalue(physical: PhysicalParameters, poses: int) -> float:
    """Return the smallest eigenvalue of the mass matrix, scaled to a unit diagonal, over random poses."""
    dynamics = Dynamics(physical.robot, physical.values)
    generator = np.random.default_rng(0)
    least = np.inf
    for q in generator.uniform(-np.pi, np.pi, (poses, physical.robot.n)):
        matrix = dynamics.mass_matrix(q.tolist())
        size = np.sqrt(np.diag(matrix))
        least = min(least, float(np.linalg.eigvalsh(matrix / np.outer(size, size))[0]))
    return least


def main(logs: int) -> None:
    """Print a line per log and the worst of all."""
    losses, worst, feasible, impossible = [], [], 0, 0
    motions: list[tuple[Robot, Recording]] = []
    for k in range(logs):
        name = "planar2" if k % 2 == 0 else "puma560"
        robot = read_robot(name)
        if k % 20 < 2:
            options = SimulationOptions(duration=8.0 if name == "planar2" else 12.0, rate=250.0, seed=k)
            motions = [(r, log) for r, log in motions if r.name != name] + [(robot, simulate(robot, options))]
        log = noisy(next(log for r, log in motions if r.name == name), k)
        physical = make_physical(identify(robot, prepare(log, robot)))
        least = least_eigenvalue(physical, POSES)
        feasible += physical.margin > 0 and least > 0
        impossible += bool(physical.impossible)
        losses.append(physical.loss)
        worst.append(max(physical.rises.values()))
        print(
            f"{k:3d} {name}  held-out error {100 * physical.loss:+.3f} % (worst joint {100 * worst[-1]:+.2f} %)  "
            f"chi2 {physical.chi2_before:.4f} -> {physical.chi2_after:.4f}  "
            f"impossible before: {len(physical.impossible)}  "
            f"least eigenvalue of the scaled mass matrix {least:.1e} ({POSES} poses)",
            flush=True,
        )
    print(f"{feasible} of {logs} feasible; {impossible} had impossible base estimates before")
    print(
        f"held-out error of all joints: worst log {100 * max(losses):+.3f} %, "
        f"median {100 * float(np.median(losses)):+.3f} %; of single joints: worst {100 * max(worst):+.3f} %, "
        f"median of each log's worst {100 * float(np.median(worst)):+.3f} %"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
