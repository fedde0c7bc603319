"""Noise of the motor torque that remembers is told as noise, and no effect is named for it."""

from __future__ import annotations

from elid_cli.diagnosis import diagnose
from elid_cli.diagnosis.refit import published
from elid_cli.estimation.identify import identify
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, log_of, make, recorded


def test_coloured_noise_of_the_torque_is_noise() -> None:
    made = make(171, 2, rate=500.0)
    log = recorded(made, log_of(made, Laws()), db=90.0, counts=1.25e6, torque=0.004, colour=0.02, seed=171)
    found = diagnose(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(500.0)))
    assert found.effects == ()
    assert found.unexplained == ()
    assert all(row.ratio > 3 for row in found.rows_after)  # of white noise
    usual = prepare(log, made.robot)
    told = identify(made.robot, usual)
    assert told.model == "sufficient"
    assert all(item.ratio > 3 and 0.01 < item.correlation < 0.2 for item in told.noise)
    assert published(found, usual).after.model == "sufficient"
