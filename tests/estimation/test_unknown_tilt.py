"""A base whose tilt is declared without a value, under an arm with a vertical first axis."""

from __future__ import annotations

from dataclasses import replace

import pytest

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.robot.files import robot_from_text
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.signals import prepare

VALUES = (
    "{m: 6, cx: 1.1, cy: 0.1, cz: 0.15, Ixx: 0.1, Iyy: 0.35, Izz: 0.35, Ixy: 0.02, Ixz: 0.03, Iyz: -0.01, "
    "Jm: 8.0e-5, fs: 6, fv: 8}"
)
TILT = {"roll": -0.052, "pitch": 0.052}


def arm(*effects: EffectSpec, known: bool = True) -> Robot:
    values = f", parameters: {VALUES}" if known else ""
    places = (
        "xyz: [0, 0, 0.2], axis: [0, 0, 1]",
        "xyz: [0, 0.05, 0.15], axis: [0, 1, 0]",
        "xyz: [0.43, 0, 0], axis: [0, 1, 0]",
    )
    lines = [
        f"  - {{name: j{k}, {place}, rpy: [0, 0, 0], gear_ratio: 100, transmission: rigid{values}}}"
        for k, place in enumerate(places, 1)
    ]
    head = ["name: leaning", "gravity: [0, 0, -9.81]", "dh: urdf", "joints:"]
    return replace(robot_from_text("\n".join([*head, *lines]), "leaning"), effects=effects)


@pytest.mark.parametrize("known", [True, False], ids=["known bodies", "no values"])
def test_a_tilt_without_value_is_found(known: bool) -> None:
    """First moments that only a leaning base shows grew with each of its columns; the angle stood still, "± 7e-10"."""
    truth = arm(EffectSpec("gravity_direction", None, TILT), EffectSpec("load_friction", "j2", {"coefficient": 0.08}))
    log = simulate(truth, SimulationOptions(duration=12.0, seed=2, sensors=SensorOptions(noise_db=80.0)))
    robot = arm(EffectSpec("gravity_direction", None, {}), EffectSpec("load_friction", "j2", {}), known=known)
    found = identify(robot, prepare(log, robot), EstimateOptions(fit="torque"))
    effect, _ = found.effects
    for name, value in TILT.items():
        assert effect.parameters[name] == pytest.approx(value, abs=4 * effect.std_error[name])
        assert 1e-5 < effect.std_error[name] < 2e-3
    assert found.model == "sufficient"
