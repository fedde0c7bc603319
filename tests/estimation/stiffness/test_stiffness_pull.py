"""What encoder noise pulls a stiffness by is in its error: coarse encoders, and what the pull grows with."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.identify import EstimateOptions, fit_log, identify
from elid_cli.estimation.stiffness.noise import deciding_deflection, with_pull
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals, prepare
from tests.system.reproduce.inverse_logs import Laws, log_of, make, recorded

LOGS, COUNTS, RATE = 40, 2.0**14, 500.0


@cache
def coarse(seed: int) -> tuple[Robot, Robot, Signals]:
    """Return an arm of two joints without values, the true one, and a log by coarse encoders."""
    made = make(seed, 2, rate=RATE)
    log = recorded(made, log_of(made, Laws()), db=0.0, counts=COUNTS, torque=0.004, colour=0.0, seed=seed)
    return made.robot, made.truth, prepare(log, made.robot)


@cache
def fitted() -> DefaultFit:
    robot, _, signals = coarse(303)
    model = Regressor(robot)
    return fit_log(model, find_base(model), signals, EstimateOptions())


def widened(fit: DefaultFit, noise: np.ndarray) -> np.ndarray:
    """Return what noise in the deflections adds to the covariance."""
    return with_pull(fit.model, fit.triangles, fit.solution, fit.covariance, noise) - fit.covariance


def place(fit: DefaultFit, name: str) -> int:
    """Return where a parameter stands in the basis."""
    return int(np.flatnonzero(fit.solution.basis == fit.model.index[name])[0])


def scores(seed: int) -> np.ndarray:
    """Return the error of every stiffness in its standard errors."""
    robot, truth, signals = coarse(seed)
    result = identify(robot, signals, EstimateOptions(guards=False))
    error = (result.estimate - result.base.values(truth.reference())) / result.std_error
    return error[[result.base.names.index(f"K{k}") for k in (1, 2)]]


def test_intervals_of_stiffnesses_by_coarse_encoders_hold_the_truth_for_the_pull(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seeds = range(301, 301 + LOGS)
    wide = np.concatenate([scores(seed) for seed in seeds])
    monkeypatch.setattr(
        "elid_cli.estimation.assembly.with_pull", lambda model, triangles, solution, covariance, noise: covariance
    )
    alone = np.concatenate([scores(seed) for seed in seeds])
    inside, short = (np.mean(np.abs(x[np.isfinite(x)]) < 1.96) for x in (wide, alone))
    assert np.isfinite(wide).mean() > 0.9
    assert inside > 0.92
    assert short < inside - 0.08
    # wide enough, and no wider than that: intervals of any width hold the truth
    assert 0.6 < np.sqrt(np.nanmean(wide**2)) < 1.3


def test_no_noise_pulls_at_nothing() -> None:
    fit = fitted()
    assert widened(fit, np.zeros(2)) == pytest.approx(np.zeros_like(fit.covariance), abs=0.0)


def test_the_pull_is_the_noises_share_of_the_deciding_deflection() -> None:
    fit = fitted()
    noise = fit.data.facts.deflection_noise
    for number, name in enumerate(("K1", "K2")):
        one, own = np.where(np.arange(2) == number, noise, 0.0), place(fit, name)
        left = deciding_deflection(fit.model, fit.triangles, fit.solution, number)
        assert left is not None
        stiffness = fit.solution.values[fit.model.index[name]]
        pulls = [np.sqrt(widened(fit, size * one)[own, own]) for size in (1.0, 2.0, 1e6)]
        assert pulls[0] == pytest.approx(stiffness * noise[number] ** 2 / left / np.sqrt(3.0), rel=1e-6)
        assert pulls[1] == pytest.approx(4.0 * pulls[0], rel=1e-6)  # of the noise's variance
        assert pulls[2] == pytest.approx(stiffness / np.sqrt(3.0), rel=1e-6)  # to nothing, and no further


def test_what_a_stiffness_is_correlated_with_moves_along() -> None:
    fit = fitted()
    own = place(fit, "K2")
    added = widened(fit, fit.data.facts.deflection_noise * np.array([0.0, 1.0]))
    slope = fit.covariance[:, own] / fit.covariance[own, own]
    assert added == pytest.approx(added[own, own] * np.outer(slope, slope), rel=1e-6)
    assert np.count_nonzero(np.diag(added) > 0) > 1


def test_a_link_whose_stiffness_is_lost_is_known_as_well_as_the_other_rows_say() -> None:
    """Without K the motor's row takes the link's inertia for the rotor's, and the sum rows contradict it."""
    robot = read_robot("puma560")
    sensors = SensorOptions(noise_db=90.0, torque_noise_relative=0.003, motor_side=True)
    log = simulate(robot, SimulationOptions(seed=4, friction_width=3e-4, sensors=sensors))
    found = {item.name: item for item in identify(robot, prepare(log, robot)).parameters}
    assert found["K4"].verdict == "refused"
    told = found["Iyy4 + Izz5"]
    error = abs(told.estimate - told.reference)
    assert 0.2 * told.reference < error < 2 * told.std_error
