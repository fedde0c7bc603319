"""Zeros of encoders, exchanged torques and delays, as a diagnosis of a log with torque tells them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.estimation.identify import identify
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, Made, laws_of, log_of, make, recorded


@pytest.fixture(scope="module")
def made() -> Made:
    return make(529, 3, rate=250.0, duration=14.0)


def logged(made: Made, laws: Laws) -> Recording:
    return recorded(made, log_of(made, laws), db=90.0, counts=0.0, torque=0.003, colour=0.0, seed=4)


def diagnosed(made: Made, log: Recording, *only: str) -> Diagnosis:
    return diagnose(
        made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(log.rate)), DiagnoseOptions(only=only)
    )


def test_exchanged_torques_are_told_and_no_value_counts_as_known(made: Made) -> None:
    log = logged(made, Laws())
    exchanged = replace(log, tau=log.tau[:, [0, 2, 1]])
    told = diagnosed(made, exchanged, "payload").identified_after
    assert any("the torques of j2 and j3 look swapped" in line for line in told.warnings)
    assert all(item.bias_possible for item in told.parameters)
    assert not any("swapped" in line for line in diagnosed(made, log, "payload").identified_after.warnings)


def test_a_delay_is_shown_as_identification_corrects_it(made: Made) -> None:
    log = logged(made, laws_of("torque_delay", made, 1))
    shown = {(item.effect, item.joint): item for item in diagnosed(made, log, "payload").corrected}
    own = identify(made.robot, prepare(log, made.robot)).nuisances
    assert own
    for item in own:
        assert shown[item.effect, item.joint].parameters == pytest.approx(dict(item.parameters), rel=0.05, abs=1e-5)
