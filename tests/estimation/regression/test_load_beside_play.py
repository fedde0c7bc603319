"""Friction that grows with the load, beside what takes a part of the load off the spring."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import Laws, Sensors, World, log, random_arm

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


@pytest.mark.parametrize("spring", [0.0, 80.0])
def test_load_of_a_rigid_joint_holds_what_acts_on_its_link(spring: float) -> None:
    """A balancing spring passes the gear as well; without it in the load, ten times the noise was left."""
    arm = random_arm(np.random.default_rng(5), 2, rigid=(0, 1))

    def torque(world: World) -> np.ndarray:
        total = np.zeros_like(world.q)
        total[:, 0] = spring * world.q[:, 0]
        total[:, 0] += 0.1 * np.abs(world.spring[:, 0] + total[:, 0]) * np.sign(world.dtheta[:, 0])
        return total

    recording = log(arm, seed=5, duration=10.0, sensors=Sensors(rate=500.0, torque=0.001), laws=Laws(motor=[torque]))
    effects = (EffectSpec("link_spring", "joint1", {}), EffectSpec("load_friction", "joint1", {}))
    robot = replace(arm.described(), effects=effects if spring else effects[1:])
    found = identify(robot, prepare(recording, robot), EstimateOptions(fit="torque"))
    truth = {"stiffness": spring, "coefficient": 0.1}
    for effect in found.effects:
        for name in effect.parameters.keys() & truth.keys():
            assert effect.parameters[name] == pytest.approx(truth[name], abs=4 * effect.std_error[name])
            assert effect.std_error[name] < 0.02 * truth[name]
    assert found.model == "sufficient"
