"""A torque that is off by a factor beside a transmission that lacks something: what the factor moves is marked."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.estimation.identify import identify
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, World, log_of, make, recorded


@pytest.mark.parametrize("gain", [1.0, 1.06])
@pytest.mark.parametrize("seed", [1, 2])
def test_another_joints_transmission_hides_no_factor(seed: int, gain: float) -> None:
    made = make(seed, 3, rate=500.0, duration=12.0)

    def lags(world: World, through: Array) -> Array:
        return np.asarray(through / world.stiffness(1) + 2e-4 * np.tanh(world.dtheta[:, 1] / 0.02))

    def read(_: World, signals: dict[str, Array]) -> None:
        signals["tau"][:, 2] *= gain

    law = Laws(spring={1: lags}, sensors=[read])
    log = recorded(made, log_of(made, law), db=0.0, counts=2.0**17, torque=0.003, colour=0.0, seed=seed)
    found = identify(made.robot, prepare(log, made.robot))
    assert found.model == "insufficient"
    marked = {str(p.leader) for p in found.parameters if p.bias_possible}
    assert ({"K3", "fs3", "fv3"} <= marked) == (gain != 1.0)
