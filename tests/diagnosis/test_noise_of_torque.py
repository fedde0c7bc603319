"""What is left of a log whose motor torque has coloured noise: named as such, and no effect is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from elid_cli.diagnosis import diagnose
from elid_cli.diagnosis.result import Unexplained
from elid_cli.report.answers.diagnosis_tables import NOISE_WORDS, noise_like, unexplained_section
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, log_of, make, recorded

SUM = Unexplained("j1", "sum", "frequency 5.2 Hz", 0.09, 0.02, 12.0, (("stribeck", "j1", 0.03),))


def test_coloured_noise_of_the_torque_is_called_like_noise() -> None:
    made = make(171, 2, rate=500.0)
    log = recorded(made, log_of(made, Laws()), db=90.0, counts=1.25e6, torque=0.004, colour=0.02, seed=171)
    found = diagnose(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(500.0)))
    assert found.effects == ()
    assert len(found.unexplained) == 4
    (section,) = unexplained_section(found)
    assert all(NOISE_WORDS in text for _, text in section.items)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("change", "like"),
    [
        ({}, True),
        ({"rms": 0.03}, False),  # more in one row than in the other: not the torque's
        ({"share": 0.4}, False),  # it follows something
        ({"nearest": (("stribeck", "j1", 0.3),)}, False),  # an effect takes a part of it
        ({"rows": "link"}, False),
    ],
)
def test_what_follows_something_is_no_noise(change: dict[str, object], like: bool) -> None:
    assert noise_like([SUM, replace(replace(SUM, rows="motor"), **change)]) is like  # type: ignore[arg-type]
