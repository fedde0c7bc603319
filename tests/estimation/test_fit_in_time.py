"""Declared channels that are read at another instant: moved to where they belong, not corrected to first order."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from elid_cli.estimation.identify import EstimateOptions, FittedEffect, Identification, Nuisance, identify
from elid_cli.experiment.simulation.control import ControlOptions
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.signals import Signals, prepare

SHIFTS = [
    EffectSpec("encoder_skew", "joint2", {"skew": 0.003}),
    EffectSpec("position_delay", "joint1", {"delay": 0.008}),
    EffectSpec("torque_delay", "joint1", {"delay": -0.008}),
]


@cache
def _logged(name: str) -> tuple[Robot, Signals]:
    effect = next(effect for effect in SHIFTS if effect.effect == name)
    robot = read_robot("planar2")
    # held torques would act half a sample later than logged
    options = SimulationOptions(
        duration=7.0, rate=500.0, seed=3, control=ControlOptions(continuous=True),
        sensors=SensorOptions(position_noise=2e-6, velocity_noise=2e-4, torque_noise=0.02),
    )  # fmt: skip
    log = simulate(replace(robot, effects=(effect,)), options)
    return robot, prepare(log, robot)


def _furthest(found: Identification) -> float:
    return max(abs(item.estimate - item.reference) / item.std_error for item in found.parameters)


@pytest.mark.parametrize("effect", SHIFTS, ids=lambda effect: effect.effect)
def test_a_declared_shift_bends_no_parameter(effect: EffectSpec) -> None:
    robot, signals = _logged(effect.effect)
    found = identify(replace(robot, effects=(replace(effect, parameters={}),)), signals)
    ((name, value),) = effect.parameters.items()
    shown: list[FittedEffect | Nuisance] = [*found.effects, *found.nuisances]
    told = next(e for e in shown if (e.effect, e.joint) == (effect.effect, effect.joint))
    assert told.parameters[name] == pytest.approx(value, abs=3 * told.std_error[name])
    assert _furthest(found) < 3.5
    assert found.model == "sufficient"


@pytest.mark.parametrize("effect", SHIFTS[:2], ids=lambda effect: effect.effect)
def test_the_files_value_is_where_it_starts_and_nothing_more(effect: EffectSpec) -> None:
    robot, signals = _logged(effect.effect)
    ((name, value),) = effect.parameters.items()
    options = EstimateOptions(guards=False)
    without, wrong = (
        identify(replace(robot, effects=(replace(effect, parameters=given),)), signals, options)
        for given in ({}, {name: 0.5 * value})
    )
    assert wrong.effects[0].parameters[name] == pytest.approx(without.effects[0].parameters[name], rel=1e-4)
    for one, other in zip(without.parameters, wrong.parameters, strict=True):
        assert np.isclose(one.estimate, other.estimate, rtol=0, atol=0.05 * one.std_error)
