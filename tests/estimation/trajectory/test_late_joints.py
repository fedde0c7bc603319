"""A drive that acts later than the others: found below the noise, and counted in the errors where it is not sure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.trajectory import identification
from elid_cli.estimation.trajectory.beside import Beside
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.identification import fit_of
from elid_cli.estimation.trajectory.late_joints import may_be_late, with_doubts
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

TRUTH = np.stack([plant.ARMATURE, plant.COULOMB, plant.VISCOUS], axis=1)
NOISE = 2e-3
"""rad: more than what a drive that is late by a millisecond changes of the motion."""


@pytest.fixture(scope="module")
def pendulums(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    bare = plant.robot(tmp_path_factory.mktemp("pendulums"))
    return replace(bare, joints=tuple(replace(joint, transmission="rigid") for joint in bare.joints))


def logged(seed: int, late: float) -> Recording:
    """Return a log in which the first drive is late, s, with the torque of its commands."""
    recording = plant.moved(seed, 9.0, sweep=0.15, delay=np.array([late, 0.0, 0.0]), noise=NOISE)
    told = recording.commands
    tau = told["kp"] * (told["q_des"] - recording.q) + told["kd"] * (told["dq_des"] - recording.dq)
    return replace(recording, tau=tau)


@pytest.fixture(scope="module")
def clean(pendulums: Robot) -> Callable[[int], TrajectoryFit]:
    """Return fits of logs in which no drive is late, by their seed."""

    def fitted(seed: int) -> TrajectoryFit:
        log = logged(seed, 0.0)
        return fit_of(pendulums, prepare(log, pendulums), log)[0]

    return cache(fitted)


def errors(fit: TrajectoryFit) -> np.ndarray:
    """Return how far the values are from the truth in standard errors, (3, 3)."""
    found = (fit.values[:, :3] - TRUTH) / fit.unknowns.joint_values(fit.deviation)[:, :3]
    return np.asarray(found)


def test_late_drive_below_the_noise_is_named(pendulums: Robot) -> None:
    log = logged(0, 0.006)
    signals = prepare(log, pendulums)
    fit, _ = fit_of(pendulums, signals, log)
    late = fit.joint_delays[0]
    own = float(np.broadcast_to(fit.apart, 3)[0])
    assert abs(late[0] - late[1] - 0.006) < 4 * own < 0.004
    assert late[1] == late[2]
    assert np.abs(errors(fit)).max() < 3.5

    told = diagnose_motion(pendulums, signals)
    assert [(effect.effect, effect.joint) for effect in told.effects] == [("torque_delay", "one")]


def test_a_declared_delay_is_fitted_from_its_value_on(pendulums: Robot) -> None:
    log = logged(1, 0.006)
    for declared in ({}, {"delay": 0.003}):
        known = replace(pendulums, effects=(EffectSpec("torque_delay", "one", declared),))
        found = identify(known, prepare(log, known), EstimateOptions(fit="trajectory"))
        (late,) = (item for item in found.nuisances if item.effect == "torque_delay" and item.joint == "one")
        assert abs(late.parameters["delay"] - 0.006) < 4 * late.std_error["delay"]
        assert late.std_error["delay"] < 1e-3
        # a diagnosis has the value and the error of the motion as well
        after = diagnose_motion(known, prepare(log, known)).after
        (same,) = (item for item in after.nuisances if item.effect == "torque_delay" and item.joint == "one")
        assert abs(same.parameters["delay"] - 0.006) < 4 * same.std_error["delay"]
        assert 0.5 < same.std_error["delay"] / late.std_error["delay"] < 2


def test_a_drive_ahead_of_its_commands_is_not_believed(clean: Callable[[int], TrajectoryFit]) -> None:
    fit = clean(0)
    later, sure = np.array([0.0, -0.002, 0.002]), np.full(3, 1e-4)
    assert may_be_late(fit, later, sure).tolist() == [True, False, True]


def test_no_drive_is_named_late_in_clean_logs(clean: Callable[[int], TrajectoryFit]) -> None:
    for seed in range(4):
        assert np.ptp(clean(seed).joint_delays) == 0


def test_delays_that_are_not_sure_are_in_the_errors(pendulums: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    logs = [logged(seed, 0.001) for seed in (0, 1, 3, 4)]
    without: list[TrajectoryFit] = []

    def doubted(fit: TrajectoryFit, alone: Beside | None) -> TrajectoryFit:
        without.append(fit)
        return with_doubts(fit, alone)

    monkeypatch.setattr(identification, "with_doubts", doubted)
    know = np.array([errors(fit_of(pendulums, prepare(log, pendulums), log)[0]) for log in logs])
    do_not = np.array([errors(fit) for fit in without])
    assert len(without) == len(logs)
    assert np.sqrt(np.mean(know[:, 0] ** 2)) < 1.7
    assert np.sqrt(np.mean(do_not[:, 0] ** 2)) > 3.0
