"""The paper's robot with noisy positions: what `--accurate` finds, and what it would find if it started from the truth.

    python -m tests.system.reproduce.valleys [--level DB] [--motions A-B]

A rotor's inertia makes the motor ring against its link, and the cost has a valley for every whole number of periods in
the log. The table shows the normalised mean error, what the fit's own covariance expects ("formal", without what elid
adds for valleys), and how much less likely the log is than in the lower of both valleys (minus twice the logarithm of
the likelihood). "as it is": the equations hold as closely as elid takes them in such noise; "close": as in
little noise.
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from unittest.mock import patch

import numpy as np

from elid_cli.estimation.collocation import setup as settings
from elid_cli.estimation.collocation.gauss_newton import Outcome
from elid_cli.estimation.collocation.problem import Iterate
from elid_cli.estimation.collocation.setup import Setup
from elid_cli.estimation.collocation.starts import best_of, from_start, values_of
from elid_cli.estimation.cutoff import fit_best
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.identify import EstimateOptions
from elid_cli.experiment.simulation import Simulation
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.signals.signals import prepare
from elid_cli.signals.spline_fit import fit_spline
from tests.system.reproduce.paper import numbers
from tests.system.reproduce.paper_logs import Array, log_of, motion_of


def truth(setup: Setup, simulation: Simulation, reference: Array) -> Iterate:
    """Return the true motion, on the knots of a problem, and parameters whose base parameters are true."""
    fit, columns = setup.fit, np.asarray(setup.p_columns)
    coefficients = []
    for piece, segment in zip(setup.pieces, fit.signals.segments, strict=True):
        intervals = piece.measured.shape[1]
        part = slice(segment.start, segment.start + intervals * setup.setting.stride)
        exact = np.array([getattr(simulation.motion, side)[part, k] for side, k in setup.channels])
        spline = fit_spline(exact, setup.setting.stride, fit.signals.dt).spline
        coefficients.append(spline.coefficients[:, : intervals + 5].T)
    values = fit.solution.values[columns]
    miss = reference - fit.transform @ fit.solution.values
    return Iterate(coefficients, values + np.linalg.lstsq(fit.transform[:, columns], miss, rcond=None)[0],
                   setup.start.z.copy())  # fmt: skip


def judged(setup: Setup, outcome: Outcome, reference: Array) -> tuple[float, float]:
    """Return the normalised mean error, and what the covariance expects of it."""
    columns, transform = np.asarray(setup.p_columns), setup.fit.transform
    own = transform[:, columns]
    spread = np.sqrt(np.diag(own @ outcome.covariance[: len(columns), : len(columns)] @ own.T))
    size = np.where(reference == 0, np.inf, np.abs(reference))
    error = np.abs(transform @ values_of(setup, outcome) - reference) / size
    return float(error.mean()), float((spread / size).mean() * np.sqrt(2 / np.pi))


def rows(fit: DefaultFit, simulation: Simulation, reference: Array, *, close: bool) -> list[tuple[float, float, float]]:
    """Return what is found from the default estimate, and from the truth."""
    with ExitStack() as stack:
        if close:
            stack.enter_context(patch.object(settings, "NOISY", -np.inf))
        setup = Setup(fit, coarse=True)
        found = best_of(setup)[0], from_start(setup, truth(setup, simulation, reference))
        told = [judged(setup, outcome, reference) for outcome in found]
        costs = [sum(float(part.sum()) for part in own) for own in setup.common_costs(*(one.end for one in found))]
    return [(*one, cost - min(costs)) for one, cost in zip(told, costs, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--level", type=float, default=40.0, metavar="DB", help="signal-to-noise ratio of the positions"
    )
    parser.add_argument("--motions", type=numbers, default=list(range(1, 9)), metavar="A-B", help="seeds of motions")
    chosen = parser.parse_args()
    robot = read_robot("planar2")
    model = Regressor(robot)
    base = find_base(model)
    reference = base.transform @ robot.reference()
    print("error, formal, less likely: started from the default estimate | from the truth")
    print(f"{'motion':8}{'as it is':>52}{'close':>52}")
    found = []
    for seed in chosen.motions:
        simulation = motion_of(robot, seed)
        log, _ = log_of(simulation, chosen.level, seed, rates=False)
        fit = fit_best(model, base, prepare(log, robot), EstimateOptions(guards=False))
        both = [part for close in (False, True) for part in rows(fit, simulation, reference, close=close)]
        found.append([(error, expected) for error, expected, _ in both])
        print(f"{seed:<8}" + "".join(f"{e:10.4f}{x:8.4f}{less:8.1f}" for e, x, less in both), flush=True)
    middle = np.median(found, axis=0)
    print(f"{'median':8}" + "".join(f"{e:10.4f}{x:8.4f}{'':8}" for e, x in middle))


if __name__ == "__main__":
    main()
