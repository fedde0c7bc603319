"""A torque that is logged earlier or later than it acts, by more than a sample, is named and put right."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, diagnose
from elid_cli.diagnosis.refit import contributions
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, World, _late, laws_of, log_of, make, recorded

RATE = 1000.0
TRIED = ("torque_delay", "transmission_damping", "stribeck", "torque_offset")


def late(joint: int, by: float) -> Laws:
    """Return a torque channel that tells what was true `by` seconds before."""

    def changed(world: World, signals: dict[str, np.ndarray]) -> None:
        _late(world.t, signals["tau"], joint, by)

    return Laws(sensors=[changed])


@pytest.mark.parametrize("by", [-20e-3, -8e-3, -3e-3, 3e-3, 8e-3])
@pytest.mark.parametrize(("arm", "joint"), [(1, 0), (1, 1), (2, 0), (3, 1)])
def test_a_shift_of_either_sign_is_named(arm: int, joint: int, by: float) -> None:
    made = make(arm, 2, rate=RATE, duration=12.0)
    log = recorded(made, log_of(made, late(joint, by)), db=90.0, counts=5e5, torque=0.005, colour=0.0, seed=arm)
    found = diagnose(
        made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)), DiagnoseOptions(only=TRIED)
    )
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("torque_delay", f"j{joint + 1}")
    assert effect.parameters["delay"] == pytest.approx(-by, abs=1e-4)
    (worth,) = contributions(found)
    assert worth.with_it < 0.6 * worth.without
    if by < 0:  # acts later than logged: corrected before anything is judged
        assert found.before[effect.joint].rms < 1.05 * found.after[effect.joint].rms
    assert {n.joint for n in found.nuisances if n.effect == "torque_delay"} >= {effect.joint}


@pytest.mark.parametrize("arm", [41, 42, 43, 44])
def test_friction_that_builds_up_over_a_distance_is_no_late_torque(arm: int) -> None:
    made = make(arm, 2, rate=500.0, duration=12.0)
    laws = laws_of("presliding", made, arm % 2)
    log = recorded(made, log_of(made, laws), db=85.0, counts=0.0, torque=0.004, colour=0.0, seed=arm)
    found = diagnose(
        made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(500.0)), DiagnoseOptions(only=TRIED)
    )
    assert "torque_delay" not in {e.effect for e in found.effects}
