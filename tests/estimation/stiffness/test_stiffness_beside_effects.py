"""A stiffness beside an effect in its motor's row, and errors of amplitudes as files name them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, diagnose
from elid_cli.estimation.identify import Identification, identify
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Made, laws_of, log_of, make, recorded


@pytest.fixture(scope="module")
def made() -> Made:
    return make(523, 3, rate=500.0, duration=12.0)


def logged(made: Made, effect: str, joint: int, seed: int) -> Recording:
    laws = laws_of(effect, made, joint)
    return recorded(made, log_of(made, laws), db=90.0, counts=0.0, torque=0.002, colour=0.0, seed=seed)


def declared(made: Made, recording: Recording, spec: EffectSpec) -> Identification:
    robot = replace(made.robot, effects=(spec,))
    return identify(robot, prepare(recording, robot))


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_the_gain_of_one_motor_leaves_every_stiffness_told(made: Made, joint: int) -> None:
    found = declared(made, logged(made, "torque_gain", joint, 5), EffectSpec("torque_gain", f"j{joint + 1}"))
    by_name = {item.name: item for item in found.parameters}
    for k, own in enumerate(made.truth.joints):
        item = by_name[f"K{k + 1}"]
        assert item.verdict == "supported"
        assert "link's equation" not in item.reason
        assert abs(item.estimate - own.parameters["K"]) < 4 * item.std_error < 0.04 * item.estimate


def test_errors_of_a_ripple_are_of_its_amplitude_and_phase(made: Made) -> None:
    """As a diagnosis of the same log gives them, and as repetition with other noise scatters."""
    spec = EffectSpec("kinematic_error", "j2", {"order": 20.0})
    values = []
    for seed in range(12):
        recording = logged(made, "kinematic_error", 1, seed)
        (effect,) = declared(made, recording, spec).effects
        values.append([effect.parameters["amplitude"], effect.parameters["phase"]])
    told = np.array([effect.std_error["amplitude"], effect.std_error["phase"]])
    spread = np.std(values, axis=0, ddof=1)
    assert np.all(told > 0.4 * spread)
    assert np.all(told < 4.0 * spread)
    assert told[0] < 0.1 * effect.parameters["amplitude"]
    robot, signals = made.robot, prepare(recording, made.robot, SignalOptions.for_diagnosis(recording.rate))
    (found,) = [e for e in diagnose(robot, signals, DiagnoseOptions(only=("kinematic_error",))).effects]
    assert 0.2 < found.std_error["amplitude"] / told[0] < 5.0
