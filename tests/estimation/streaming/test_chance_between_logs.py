"""Logs of one machine that differ by chance, and logs that do not agree: what is told, and of which parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.result import Identification
from elid_cli.estimation.streaming.between_logs import Together
from elid_cli.estimation.streaming.merge import identify_reduced
from elid_cli.estimation.streaming.reduce import reduce_log
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare

WIDTH, PIECES = 40, 20


def drawn(rng: np.random.Generator, logs: int, moved: float = 0.0) -> tuple[Together, np.ndarray]:
    """Return logs whose noise is known from fewer pieces than there are parameters, one of which moves in the last."""
    shares = np.array([np.eye(WIDTH) / logs] * logs)
    own = rng.standard_normal((logs, WIDTH)) / np.sqrt(logs)
    own[-1, 3] += moved / logs
    noise = []
    for _ in range(logs):
        pieces = rng.standard_normal((PIECES, WIDTH)) / np.sqrt(PIECES * logs)
        noise.append(pieces.T @ pieces)
    noise_of = np.array(noise)
    basis, none = np.arange(WIDTH), np.zeros(0, dtype=np.intp)
    solution = Solution(
        np.zeros(WIDTH), basis, none, np.zeros((WIDTH, 0)), np.eye(WIDTH), np.eye(WIDTH), 1.0, {}
    )  # fmt: skip
    sums = own - own.mean(axis=0)
    found = Together(solution, noise_of.sum(axis=0), noise_of, shares, sums, np.full(logs, float(PIECES)))
    return found, own.sum(axis=0)


@pytest.mark.parametrize("logs", [2, 6])
def test_a_largest_difference_that_is_chance_is_not_told(logs: int) -> None:
    """By the inverse of a covariance known from 20 pieces, 40 parameters differed in every pair."""
    rng = np.random.default_rng(logs)
    found = [drawn(rng, logs)[0] for _ in range(200)]
    assert sum(one.disagree for one in found) <= 4
    quiet = next(one for one in found if not one.disagree)
    assert np.array_equal(quiet.of_few(np.eye(WIDTH)), quiet.within)


@pytest.mark.parametrize("logs", [2, 6])
def test_what_surely_differs_is_told_and_counts_where_it_does(logs: int) -> None:
    rng = np.random.default_rng(logs)
    wide, told, others = [], 0, []
    for _ in range(50):
        one, estimate = drawn(rng, logs, moved=40.0)
        told += one.disagree and bool(one.moved(np.eye(WIDTH))[3])
        errors = np.sqrt(np.diag(one.of_few(np.eye(WIDTH))))
        wide.append(abs(estimate[3]) < 3 * errors[3])
        others.append(np.median(errors))
    assert told == 50
    assert np.mean(wide) > 0.9
    assert np.median(others) == pytest.approx(1.0, abs=0.15)


def identified(robots: list[Robot], reads: Robot) -> Identification:
    logs = []
    for seed, robot in enumerate(robots):
        recording = simulate(robot, SimulationOptions(duration=6.0, seed=seed))
        recording = replace(recording, files=(f"log{seed}.h5",))
        logs.append(reduce_log(reads, prepare(recording, reads), recording, {}))
    return identify_reduced(reads, logs)[0]


def test_friction_that_differs_between_logs_is_marked_with_the_reason() -> None:
    """It was weak because the motor "moves too little", and elid asked for slow motion."""
    robot = read_robot("planar2")
    joints = list(robot.joints)
    joints[1] = replace(joints[1], parameters={**joints[1].parameters, "fs": 5.0 * joints[1].parameters["fs"]})
    found = identified([robot, replace(robot, joints=tuple(joints))], robot)
    item = next(p for p in found.parameters if p.name == "fs2")
    assert item.bias_possible
    assert item.verdict == "supported" or item.reason.endswith("differs from log to log")
    assert any("disagree by more than their noise, most in fs2" in note for note in found.notes)
    assert not next(p for p in found.parameters if p.name == "fs1").bias_possible


def test_a_gain_of_one_log_is_told_as_a_difference() -> None:
    robot = read_robot("planar2")
    logs = []
    for seed in range(2):
        recording = simulate(robot, SimulationOptions(duration=6.0, seed=seed))
        tau = recording.tau * np.array([1.0, 1.0 if seed else 1.1])
        recording = replace(recording, tau=tau, files=(f"log{seed}.h5",))
        logs.append(reduce_log(robot, prepare(recording, robot), recording, {}))
    found, _ = identify_reduced(robot, logs)
    assert "logs" in {item.follows for item in found.insufficient}
    assert any("log0.h5 alone lacks something" in note for note in found.notes)
