"""A constant torque in a log that cannot tell it from a spring: both are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.diagnosis import diagnose
from elid_cli.signals.signals import prepare
from tests.estimation.test_unsaid_causes import made_rigid
from tests.system.reproduce.inverse_logs import Laws, World, log_of, recorded


@pytest.mark.parametrize(
    ("slope", "rivals"), [(1.0, {"asymmetric_coulomb", "link_spring"}), (0.0, {"asymmetric_coulomb"})]
)
def test_a_spring_is_told_beside_an_offset_where_it_may_be_one(slope: float, rivals: set[str]) -> None:
    made = made_rigid(2)
    made = replace(made, q=made.q + np.array([0.4, -0.9, 0.6]))

    def read(_: World, signals: dict[str, Array]) -> None:
        tau, size = signals["tau"], 0.5 * np.std(signals["tau"][:, 1])
        tau[:, 1] += size * (slope * (signals["q"][:, 1] + 0.3) + (1.0 - slope))

    log = recorded(made, log_of(made, Laws(sensors=[read])), db=0.0, counts=2.0**18, torque=0.01, colour=0.0, seed=1)
    told = diagnose(made.robot, prepare(log, made.robot))
    assert [(e.effect, e.joint) for e in told.effects] == [("torque_offset", "j2")]
    assert {r.effect for r in told.also_possible} == rivals
