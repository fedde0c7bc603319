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
