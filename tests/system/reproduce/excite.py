"""How much better an exciting trajectory conditions the identification than random splines of equal length.

    python -m tests.system.reproduce.excite [ROBOT] [SECONDS]

Prints condition numbers and predicted standard errors over 20 random motions and for the trajectory of `elid excite`,
and what identification then makes of a simulated log of it, whose torques are as noisy as was assumed.
"""

from __future__ import annotations

import sys

import numpy as np

from elid_cli.estimation.identify import identify
from elid_cli.experiment.excitation import BANDWIDTH, INSTANTS, Excitation, ExciteOptions, excite
from elid_cli.experiment.information import Information, residuals_of
from elid_cli.experiment.reference import random_reference
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.model.base_parameters import find_base
from elid_cli.model.consistency import consistency, prior
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare

RATE = 500.0
"""Samples per second of the simulated log."""
PASSED = 16.8
"""Of those, samples per second that the low-pass leaves independent (twice the bandwidth of its noise)."""


def main(name: str, duration: float) -> None:
    """Print the figures of one robot."""
    robot = read_robot(name)
    found = excite(robot, ExciteOptions(duration=duration))
    model = Regressor(robot)
    base = find_base(model)
    grid = np.linspace(0.0, duration, round(duration * INSTANTS))
    motions = [random_reference(robot, duration, seed).evaluate(grid) for seed in range(100, 120)]
    parameters = prior(robot, consistency(robot, robot.reference()).scales)
    unit = Information(model, base, parameters, np.ones((2, robot.n)), 1.0, motions[0])
    residual = residuals_of(unit.torques(motions[0]), found.options.residual, robot.elastic)
    information = Information(model, base, parameters, residual, duration * BANDWIDTH / len(grid), motions[0])
    judged = [information.evaluate(motion) for motion in motions]
    mine = information.evaluate(found.trajectory.evaluate(grid))
    conditions = sorted(e.condition for e in judged)
    gains = sorted(float(np.exp((mine.log_det - e.log_det) / base.count)) for e in judged)
    print(f"{name}, {duration:g} s, condition number of the weighted base regressor (columns of unit norm):")
    print(f"  20 random splines   {conditions[0]:.1f} to {conditions[-1]:.1f}, median {np.median(conditions):.1f}")
    print(
        f"  elid excite         {mine.condition:.1f}: {np.median(conditions) / mine.condition:.2f} times better "
        f"than the median, {conditions[0] / mine.condition:.2f} times than the best"
    )
    print(
        f"  standard errors     {gains[0]:.2f} to {gains[-1]:.2f} times smaller (geometric mean over "
        f"{base.count} base parameters)"
    )

    _kept(robot, found)


def _kept(robot: Robot, found: Excitation) -> None:
    """Print how the predicted standard errors compare with those of identification and with the true errors."""
    noise = found.options.residual * np.sqrt(RATE / PASSED)
    sensors = SensorOptions(torque_noise_relative=float(noise), position_noise=1e-6)
    options = SimulationOptions(duration=found.trajectory.duration, rate=RATE, reference=found.trajectory,
                                sensors=sensors)  # fmt: skip
    got = identify(robot, prepare(simulate(robot, options), robot))
    ratio = got.std_error / found.std_error
    ratio = ratio[np.isfinite(ratio)]
    true = (got.estimate - got.reference) / got.std_error
    print(
        f"  a simulated log     standard errors found over those predicted: median {np.median(ratio):.2f}, "
        f"10 to 90 % of the parameters {np.quantile(ratio, 0.1):.2f} to {np.quantile(ratio, 0.9):.2f}; "
        f"true errors {np.sqrt(np.nanmean(true**2)):.2f} of them (rms)"
    )


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "puma560", float(sys.argv[2]) if len(sys.argv) > 2 else 20.0)
