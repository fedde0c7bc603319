"""A wrong scale of one of a joint's two encoders is named, alone or beside a zero that is off."""

from __future__ import annotations

from dataclasses import replace

import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.diagnosis.diagnose import DiagnoseOptions
from elid_cli.diagnosis.residuals import RowState, suspects
from elid_cli.experiment import simulation
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.diagnosis.diagnosis_logs import arm

SCALE, OFFSET = 100 / 101 - 1, 2e-3


@pytest.mark.parametrize(
    ("offset", "seed", "only"),
    [(0.0, 3, ()), (0.0, 4, ("encoder_scale", "encoder_offset", "encoder_skew")), (OFFSET, 3, ()),
     (OFFSET, 3, ("encoder_scale", "encoder_offset"))],
)  # fmt: skip
def test_a_wrong_gear_ratio_is_named_and_its_size_is_right(offset: float, seed: int, only: tuple[str, ...]) -> None:
    robot = arm()
    specs = [EffectSpec("encoder_scale", "joint2", {"scale": SCALE})]
    specs += [EffectSpec("encoder_offset", "joint2", {"offset": offset})] if offset else []
    faulty = replace(robot, effects=tuple(specs))
    options = simulation.SimulationOptions(duration=6.0, seed=seed, rate=500.0, sensors=SensorOptions(noise_db=90.0))
    log = simulation.run(faulty, options).recording
    found = diagnose(robot, prepare(log, robot, SignalOptions.for_diagnosis(500.0)), DiagnoseOptions(only=only))
    assert isinstance(found, Diagnosis)
    sizes = {(e.effect, e.joint): e for e in found.effects}
    assert set(sizes) == {(spec.effect, spec.joint) for spec in specs}
    for spec in specs:
        told = sizes[spec.effect, spec.joint]
        for name, value in spec.parameters.items():
            assert abs(told.parameters[name] - value) < 4 * told.std_error[name]
    assert not found.unexplained


def test_what_the_motor_side_alone_has_much_of_is_not_the_motors() -> None:
    def rows(whole: float, motor: float) -> tuple[RowState, ...]:
        return RowState("j1", "sum", 1.0, 0.1, whole), RowState("j1", "motor", 1.0, 0.1, motor)

    assert suspects(rows(9.9, 56.0)) == {"j1": "transmission or its encoders"}
    assert suspects(rows(18.0, 18.0)) == {"j1": "motor or its torque signal"}
    assert suspects(rows(5.0, 1.0)) == {"j1": "link side"}


def test_what_noise_of_encoders_takes_from_a_spring_is_no_wrong_scale() -> None:
    """A spring that the noise weakens lacks torque that follows the load, and with it the position."""
    robot = read_robot("puma560")
    sensors = SensorOptions(noise_db=90.0, torque_noise_relative=0.003, motor_side=True)
    log = simulation.run(robot, simulation.SimulationOptions(seed=3, sensors=sensors)).recording
    signals = prepare(log, robot, SignalOptions.for_diagnosis(1000.0))
    found = diagnose(robot, signals, DiagnoseOptions(only=("encoder_scale",)))
    assert isinstance(found, Diagnosis)
    assert not found.effects
