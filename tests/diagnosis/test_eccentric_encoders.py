"""An encoder off its centre reads wrong once per turn: named with its size, in elastic joints and in rigid ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.estimation.identify import identify
from elid_cli.estimation.validation.following import TURN
from elid_cli.experiment import simulation
from elid_cli.experiment.simulation.sensors import SensorOptions
from elid_cli.report.answers.lacking import words_of
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.diagnosis_logs import arm
from tests.estimation.test_unsaid_causes import RATE, as_rigid, made_rigid
from tests.system.reproduce.inverse_logs import Laws, Made, World, log_of, recorded


def _simulated(name: str, joint: str, seed: int, **parameters: float) -> Recording:
    faulty = replace(arm(), effects=(EffectSpec(name, joint, parameters),))
    options = simulation.SimulationOptions(duration=6.0, seed=seed, rate=500.0, sensors=SensorOptions(noise_db=90.0))
    return simulation.run(faulty, options).recording


def _found(recording: Recording) -> Diagnosis:
    robot = arm()
    found = diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(500.0)))
    assert isinstance(found, Diagnosis)
    return found


@pytest.mark.parametrize(("joint", "amplitude", "phase", "seed"), [("joint1", 5e-4, 0.7, 3), ("joint2", 1e-3, 2.7, 7)])
def test_in_an_elastic_joint_it_is_named_and_its_size_is_right(
    joint: str, amplitude: float, phase: float, seed: int
) -> None:
    """It was a scale, an offset and ripples of orders that do not exist."""
    found = _found(_simulated("encoder_eccentricity", joint, seed, amplitude=amplitude, phase=phase))
    assert [(e.effect, e.joint) for e in found.effects] == [("encoder_eccentricity", joint)]
    told = found.effects[0]
    for name, value in {"amplitude": amplitude, "phase": phase}.items():
        assert abs(told.parameters[name] - value) < 4 * told.std_error[name]
    assert not found.unexplained


@pytest.mark.parametrize("size", [2e-3, 5e-3])
def test_a_wrong_scale_is_none(size: float) -> None:
    found = _found(_simulated("encoder_scale", "joint2", 3, scale=size))
    assert [e.effect for e in found.effects] == ["encoder_scale"]


def _eccentric(amplitude: float, phase: float, joint: int) -> Laws:
    def read(_: World, signals: dict[str, np.ndarray]) -> None:
        wrong = amplitude * np.sin(signals["q"][:, joint] + phase)
        for side in ("q", "theta"):
            signals[side][:, joint] += wrong

    return Laws(sensors=[read])


def _rigid_log(made: Made, laws: Laws, seed: int) -> Recording:
    return recorded(made, log_of(made, laws), db=0.0, counts=2.0**18, torque=0.003, colour=0.0, seed=seed)


@pytest.mark.parametrize(("seed", "joint"), [(2, 1), (3, 1), (4, 2)])
def test_in_a_rigid_arm_it_is_named_and_values_are_right(seed: int, joint: int) -> None:
    """Values were up to 18 of their standard errors off, the model sufficient, nothing named."""
    made = made_rigid(seed)
    recording = _rigid_log(made, _eccentric(6e-3, 0.5, joint), seed)
    found = diagnose(made.robot, prepare(recording, made.robot, SignalOptions.for_diagnosis(RATE)))
    assert isinstance(found, Diagnosis)
    assert [(e.effect, e.joint) for e in found.effects] == [("encoder_eccentricity", f"j{joint + 1}")]
    told = found.effects[0]
    assert abs(told.parameters["amplitude"] - 6e-3) < 4 * told.std_error["amplitude"]
    after = found.identified_after
    true = after.base.values(as_rigid(made.truth).reference())
    far = [abs(p.estimate - value) / p.std_error for p, value in zip(after.parameters, true, strict=True)]
    assert max(far) < 4.5


def test_identification_marks_what_it_moves_and_says_it() -> None:
    made = made_rigid(3)
    found = identify(made.robot, prepare(_rigid_log(made, _eccentric(4e-3, 0.5, 1), 3), made.robot))
    true = found.base.values(as_rigid(made.truth).reference())
    far = [abs(p.estimate - value) / p.std_error for p, value in zip(found.parameters, true, strict=True)]
    marked = [p.bias_possible for p in found.parameters]
    assert max(far) > 6.0
    assert max(z for z, m in zip(far, marked, strict=True) if not m) < 4.0
    assert [(item.joint, item.follows) for item in found.insufficient] == [("j2", TURN)]
    assert "the positions of j2 look off once per turn" in words_of(found)


@pytest.mark.parametrize("seed", [2, 3, 4, 5, 6, 7])
def test_right_encoders_are_not_doubted(seed: int) -> None:
    made = made_rigid(seed)
    found = identify(made.robot, prepare(_rigid_log(made, Laws(), seed), made.robot))
    assert found.model == "sufficient"
    assert not any(p.bias_possible for p in found.parameters)


def test_a_simulated_one_of_a_rigid_joint_is_read_by_both_encoders_and_found() -> None:
    plain = arm()
    stiff = [replace(j, transmission="rigid", parameters={k: v for k, v in j.parameters.items() if k != "K"})
             for j in plain.joints]  # fmt: skip
    robot = replace(plain, joints=tuple(stiff))
    spec = EffectSpec("encoder_eccentricity", "joint1", {"amplitude": 0.02, "phase": 0.7})
    options = simulation.SimulationOptions(duration=6.0, seed=3, rate=500.0, sensors=SensorOptions(noise_db=90.0))
    log = simulation.run(replace(robot, effects=(spec,)), options).recording
    np.testing.assert_array_equal(log.q, log.theta)
    declared = replace(spec, parameters={})
    found = identify(replace(robot, effects=(declared,)), prepare(log, robot)).effects[0]
    assert found.parameters["amplitude"] == pytest.approx(0.02, rel=0.02)
    assert found.parameters["phase"] == pytest.approx(0.7, abs=0.02)
