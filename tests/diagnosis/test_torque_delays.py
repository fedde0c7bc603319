"""A channel that is logged earlier or later than it was, by more than a sample, is named and put right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, diagnose
from elid_cli.diagnosis.refit import contributions
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import Signals, prepare
from tests.system.plain_arms import Sensors, random_arm
from tests.system.plain_arms import log as plain_log
from tests.system.reproduce.inverse_logs import Laws, World, _late, laws_of, log_of, make, recorded

RATE = 1000.0
TRIED = ("torque_delay", "transmission_damping", "stribeck", "torque_offset")


def late(joint: int, by: float) -> Laws:
    """Return a torque channel that tells what was true `by` seconds before."""

    def changed(world: World, signals: dict[str, np.ndarray]) -> None:
        _late(world.t, signals["tau"], joint, by)

    return Laws(sensors=[changed])


@pytest.mark.parametrize("by", [-20e-3, -3e-3, 8e-3])
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


def moved(channel: str, joints: tuple[int, ...], by: float, robot: str, seed: int) -> tuple[Robot, Signals]:
    """Return a plain arm and its log, in which a channel of some joints is logged `by` seconds later."""
    rigid = {"elastic": (), "rigid": (0, 1), "mixed": (0,)}[robot]
    arm = random_arm(np.random.default_rng(seed), 2 if robot != "mixed" else 3, rigid)
    log = plain_log(arm, seed=seed, duration=12.0, sensors=Sensors(rate=500.0, bits=17, delay=0.5))
    values = {name: np.array(getattr(log, name)) for name in ("q", "theta", "tau")}
    for joint in joints:
        for name in ("q", "theta") if channel != "tau" and joint in rigid else (channel,):
            values[name][:, joint] = np.roll(values[name][:, joint], round(by * 500.0))
    log, known = replace(log, **values), arm.described()
    return known, prepare(log, known, SignalOptions.for_diagnosis(500.0))


@pytest.mark.parametrize("by", [-20e-3, 4e-3, 16e-3])
@pytest.mark.parametrize(
    ("robot", "channel", "joints"),
    [
        ("rigid", "tau", (0,)), ("rigid", "tau", (0, 1)), ("rigid", "q", (1,)), ("rigid", "q", (0, 1)),
        ("elastic", "tau", (0,)), ("elastic", "q", (1,)), ("elastic", "theta", (0, 1)), ("mixed", "q", (0,)),
    ],
)  # fmt: skip
def test_a_channel_that_is_late_is_given_no_other_name(
    robot: str, channel: str, joints: tuple[int, ...], by: float
) -> None:
    found = diagnose(*moved(channel, joints, by, robot, seed=90))
    said = {effect.effect for effect in found.effects}
    assert said <= {"torque_delay", "position_delay", "encoder_skew"}
    assert said or found.unexplained


@pytest.mark.parametrize("by", [-16e-3, 20e-3])
def test_positions_of_a_rigid_joint_read_late_are_found(by: float) -> None:
    (effect,) = diagnose(*moved("q", (1,), by, "rigid", seed=91)).effects
    assert (effect.effect, effect.joint) == ("position_delay", "joint2")
    assert effect.parameters["delay"] == pytest.approx(by, abs=1e-4)
