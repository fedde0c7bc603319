"""Effects that show only beside a torque offset, which does not show without them."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import diagnose
from elid_cli.diagnosis.result import Diagnosis
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import Laws, Sensors, World, log, random_arm


@pytest.mark.parametrize("seed", [1, 4])
def test_friction_by_angle_is_found_beside_an_offset(seed: int) -> None:
    """Alone it explained a thirtieth of what is missing: nothing was named, with eight times the noise left."""
    arm = random_arm(np.random.default_rng(seed), 1, rigid=(0,))
    amplitude, offset = 0.1 * arm.coulomb[0], 0.08 * arm.coulomb[0]

    def torque(world: World) -> np.ndarray:
        return amplitude * np.sin(world.q + 0.3) * np.sign(world.dtheta) + offset

    recording = log(arm, seed=seed, duration=10.0, sensors=Sensors(rate=500.0, torque=0.001), laws=Laws(motor=[torque]))
    robot = arm.described()
    found = diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(500.0)))
    assert isinstance(found, Diagnosis)
    named = {effect.effect: effect for effect in found.effects}
    assert named.keys() == {"position_friction", "torque_offset"}
    friction, constant = named["position_friction"], named["torque_offset"]
    for effect, name, value in (
        (friction, "amplitude", amplitude),
        (friction, "order", 1.0),
        (constant, "offset", offset),
    ):
        assert effect.parameters[name] == pytest.approx(value, abs=4 * effect.std_error[name])
    assert found.unexplained == ()
