"""Friction that grows with the load, beside what takes a part of the load off the spring."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.signals import prepare

ROBOT = Path(__file__).parents[3] / "robots" / "planar2.yaml"
LOADED = EffectSpec("load_friction", "joint1", {"coefficient": 0.08})
PLAY = EffectSpec("backlash", "joint1", {"gap": 6e-4})
ZERO = EffectSpec("encoder_offset", "joint1", {"offset": 1e-3})


def arm(*effects: EffectSpec) -> Robot:
    return replace(read_robot(ROBOT), effects=effects)


@pytest.mark.parametrize("beside", [PLAY, ZERO], ids=["play", "encoder zeros"])
def test_load_is_what_passes_the_transmission(beside: EffectSpec) -> None:
    robot = arm(LOADED, beside)
    options = SimulationOptions(duration=12.0, seed=3, sensors=SensorOptions(noise_db=80.0))
    log = simulate(robot, options)
    found = identify(robot, prepare(log, robot), EstimateOptions(fit="torque"))
    own = {str(item.leader): item for item in found.parameters}
    truth = robot.joints[0].parameters
    missed = 0.08 * truth["K"] * 6e-4
    for name in ("fs1", "K1"):
        item = own[name]
        assert item.estimate == pytest.approx(truth[item.leader.kind], abs=4 * item.std_error)
    assert own["fs1"].std_error < 0.1 * missed  # a load without the play would be many of them off
    assert found.model == "sufficient"
