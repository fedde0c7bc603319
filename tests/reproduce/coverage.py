"""How often 95 % intervals hold the truth, per base parameter.

Run: python -m tests.reproduce.coverage [--logs N] [--accurate].
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from elid_cli.estimate import EstimateOptions, identify
from elid_cli.reference import ReferenceOptions
from elid_cli.robot_file import read_robot
from elid_cli.signals import prepare
from elid_cli.simulation import ControlOptions, SimulationOptions, simulate

TORQUE_NOISE = 0.01
"""Standard deviation of the torque noise, as a share of the torque's own."""
POSITION_NOISE = 90.0
"""Signal-to-noise ratio of the positions, dB."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=200, metavar="N")
    parser.add_argument("--accurate", action="store_true")
    chosen = parser.parse_args()
    robot = read_robot("planar2")
    motions = [
        simulate(
            robot,
            SimulationOptions(
                duration=8.9,
                seed=seed,
                reference=ReferenceOptions(amplitude=0.75, interval=1.1),
                control=ControlOptions(continuous=True),
            ),
        )
        for seed in range(1, 5)
    ]
    for label, pole in (("white", 0.0), ("coloured (50 ms)", float(np.exp(-1e-3 / 0.05)))):
        inside = []
        for number in range(chosen.logs):
            generator = np.random.default_rng(number)
            log = motions[number % len(motions)]
            noise = lfilter([np.sqrt(1 - pole**2)], [1, -pole], generator.standard_normal(log.tau.shape), axis=0)
            size = 10 ** (-POSITION_NOISE / 20)
            log = replace(
                log,
                q=log.q + size * log.q.std(axis=0) * generator.standard_normal(log.q.shape),
                theta=log.theta + size * log.theta.std(axis=0) * generator.standard_normal(log.q.shape),
                tau=log.tau + TORQUE_NOISE * log.tau.std(axis=0) * noise,
            )
            found = identify(robot, prepare(log, robot), EstimateOptions(accurate=chosen.accurate, guards=False))
            inside.append(np.abs(found.estimate - found.reference) < 1.96 * found.std_error)
        shares = np.mean(inside, axis=0)
        print(f"{label} torque noise, {chosen.logs} logs, {'accurate' if chosen.accurate else 'default'} estimator")
        for name, share in zip(found.base.names, shares, strict=True):
            print(f"  {name:26} {share:6.1%}")
        print(f"  lowest {shares.min():.1%}, highest {shares.max():.1%}", flush=True)


if __name__ == "__main__":
    main()
