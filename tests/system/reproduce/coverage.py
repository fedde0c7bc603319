"""How often 95 % intervals hold the truth, per base parameter.

    python -m tests.system.reproduce.coverage [--logs N] [--accurate] [--db 90] [--torque 0.01]
        [--stribeck] [--arm SEED]

Logs are the paper's planar robot's, four motions with fresh noise on positions (SN in dB) and on torque (share of the
torque's standard deviation), white and coloured; with --stribeck the friction is eq. (43)'s, its shapes unknown; with
--arm a random arm of three joints (that of `unseen`). Positions are not quantised.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.experiment.reference import ReferenceOptions
from elid_cli.experiment.simulation import ControlOptions, SimulationOptions, simulate
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.reproduce.paper_logs import with_friction
from tests.system.reproduce.unseen import arm

COLOURS = {"white": 0.0, "coloured": float(np.exp(-1e-3 / 0.05))}
"""Pole of the torque noise: white, or with a memory of 50 ms."""


def noisy(log: Recording, level: float, torque: float, pole: float, seed: int) -> Recording:
    """Return the log with noise on positions (SN in dB) and torque (share of its standard deviation)."""
    generator = np.random.default_rng(seed)
    noise = lfilter([np.sqrt(1 - pole**2)], [1, -pole], generator.standard_normal(log.tau.shape), axis=0)
    size = 10 ** (-level / 20)
    return replace(
        log,
        q=log.q + size * log.q.std(axis=0) * generator.standard_normal(log.q.shape),
        theta=log.theta + size * log.theta.std(axis=0) * generator.standard_normal(log.q.shape),
        tau=log.tau + torque * log.tau.std(axis=0) * noise,
    )


def motions(robot: Robot, count: int, first: int) -> list[Recording]:
    """Return logs of several motions without noise."""
    return [
        simulate(
            robot,
            SimulationOptions(
                duration=8.9,
                seed=seed,
                reference=ReferenceOptions(amplitude=0.75, interval=1.1),
                control=ControlOptions(continuous=True),
            ),
        )
        for seed in range(first, first + count)
    ]


def main() -> None:
    """Print the share of logs whose interval holds the truth, per base parameter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=200, metavar="N")
    parser.add_argument("--accurate", action="store_true")
    parser.add_argument("--db", type=float, default=90.0, help="signal-to-noise ratio of the positions, dB")
    parser.add_argument("--torque", type=float, default=0.01, help="torque noise as a share of the torque's own")
    parser.add_argument("--stribeck", action="store_true", help="friction of eq. (43), its shapes unknown")
    parser.add_argument("--arm", type=int, metavar="SEED", help="a random arm of three joints")
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="seed of the first of four motions")
    parser.add_argument("--colour", choices=COLOURS, nargs="+", default=list(COLOURS))
    chosen = parser.parse_args()
    true = read_robot("planar2") if chosen.arm is None else arm(chosen.arm, 3)
    robot = with_friction(true, known=False) if chosen.stribeck else true
    logs = motions(with_friction(true, known=True) if chosen.stribeck else true, 4, chosen.first)
    options = EstimateOptions(accurate=chosen.accurate, guards=False)
    for label in chosen.colour:
        inside, scores, answered = [], [], 0
        for number in range(chosen.logs):
            log = noisy(logs[number % len(logs)], chosen.db, chosen.torque, COLOURS[label], number)
            found = identify(robot, prepare(log, robot), options)
            answered += found.estimator == "accurate"
            score: NDArray[np.float64] = (found.estimate - found.reference) / found.std_error
            inside.append(np.where(np.isfinite(score), np.abs(score) < 1.96, np.nan))
            scores.append(score)
        given = np.isfinite(scores).mean(axis=0)
        shares = np.nanmean(inside, axis=0)
        spread = np.sqrt(np.nanmean(np.square(scores), axis=0))
        told = f"accurate estimator, {answered} answers accepted" if chosen.accurate else "default estimator"
        print(f"{chosen.db:g} dB, {chosen.torque:.2%} {label} torque noise, {chosen.logs} logs, {told}")
        for name, share, rms, some in zip(found.base.names, shares, spread, given, strict=True):
            refused = f", refused in {1 - some:.0%}" if some < 1 else ""
            print(f"  {name[:44]:44} {share:6.1%}   error {rms:5.2f} standard errors rms{refused}")
        print(f"  lowest {shares.min():.1%}, highest {shares.max():.1%}", flush=True)


if __name__ == "__main__":
    main()
