"""A drive that delivers less than is commanded in a large part of a log: its limit is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import random_arm


def limited(seed: int, below: float, *, rigid: bool = True, duration: float = 15.0) -> tuple[Robot, float, Recording]:
    """Return an arm of two joints, a limit at its second, and a log of what was commanded."""
    robot = random_arm(np.random.default_rng(seed), 2).described()
    if rigid:
        robot = replace(robot, joints=tuple(replace(joint, transmission="rigid") for joint in robot.joints))
    sensors = SensorOptions(noise_db=80, torque_noise_relative=0.003)
    options = SimulationOptions(duration=duration, seed=seed, rate=500.0, sensors=sensors)
    limit = float(np.quantile(np.abs(simulate(robot, options).tau[:, 1]), below))
    weak = replace(robot, effects=(EffectSpec("saturation", robot.joint_names[1], {"limit": limit}),))
    return robot, limit, simulate(weak, options)


@pytest.mark.parametrize(("seed", "below", "cut"), [(3, 0.85, 0.26), (4, 0.7, 0.48)])
def test_a_limit_that_cuts_a_large_part_is_found(seed: int, below: float, cut: float) -> None:
    robot, limit, log = limited(seed, below)
    assert np.mean(np.abs(log.tau[:, 1]) > limit) == pytest.approx(cut, abs=0.02)
    told = diagnose(robot, prepare(log, robot))
    assert isinstance(told, Diagnosis)
    assert [(e.effect, e.joint) for e in told.effects] == [("saturation", robot.joint_names[1])]
    assert told.effects[0].parameters["limit"] == pytest.approx(limit, rel=2e-3)
    assert not told.unexplained


@pytest.mark.parametrize(("seed", "below", "rigid"), [(3, 0.8, True), (6, 0.9, True), (5, 0.8, False)])
def test_a_limit_that_bends_the_fit_without_it_is_judged_by_a_fit_with_it(
    seed: int, below: float, *, rigid: bool
) -> None:
    """What was predicted beyond the limit without it is no torque that the arm needs: nothing was named."""
    robot, limit, log = limited(seed, below, rigid=rigid, duration=10.0)
    told = diagnose(robot, prepare(log, robot), DiagnoseOptions(only=("saturation",)))
    assert isinstance(told, Diagnosis)
    assert [(e.effect, e.joint) for e in told.effects] == [("saturation", robot.joint_names[1])]
    assert told.effects[0].parameters["limit"] == pytest.approx(limit, rel=3e-3)
