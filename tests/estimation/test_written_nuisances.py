"""The robot that is written holds the faults of channels that the log shows, and no others."""

from __future__ import annotations

from dataclasses import replace

from elid_cli.estimation.identify import identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.result import Nuisance
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.robot.files import read_robot
from elid_cli.signals.signals import prepare


def test_a_delay_within_its_error_is_not_written() -> None:
    robot = read_robot("planar2")
    found = identify(robot, prepare(simulate(robot, SimulationOptions(duration=5.0, rate=500.0, seed=2)), robot))
    found = replace(found, nuisances=tuple(n for n in found.nuisances if n.effect == "torque_delay"))
    both = {spec.joint: spec.parameters["delay"] for spec in identified_robot(found).effects}
    assert both.keys() == {"joint1", "joint2"}
    unsure = Nuisance("torque_delay", "joint2", {"delay": -0.0018}, {"delay": 0.0065})
    kept = [n for n in found.nuisances if n.joint == "joint1"]
    one = identified_robot(replace(found, nuisances=(*kept, unsure)))
    assert {spec.joint: spec.parameters["delay"] for spec in one.effects} == {"joint1": both["joint1"]}
    # one that may be 0 or what another joint is late by, and is nearer to that
    near = Nuisance("torque_delay", "joint2", {"delay": 0.8 * both["joint1"]}, {"delay": 0.0065})
    two = identified_robot(replace(found, nuisances=(*kept, near)))
    assert {spec.joint for spec in two.effects} == {"joint1", "joint2"}


def test_an_offset_within_its_error_is_written_since_the_other_values_predict_with_it() -> None:
    robot = read_robot("planar2")
    found = identify(robot, prepare(simulate(robot, SimulationOptions(duration=5.0, rate=500.0, seed=2)), robot))
    unsure = Nuisance("torque_offset", "joint2", {"offset": 0.003}, {"offset": 0.01})
    written = identified_robot(replace(found, nuisances=(unsure,))).effects
    assert [(spec.effect, spec.joint, spec.parameters) for spec in written] == [
        ("torque_offset", "joint2", {"offset": 0.003})
    ]
