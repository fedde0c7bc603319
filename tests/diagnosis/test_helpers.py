"""What an effect of the library only helps to describe is called unexplained, and not by its name."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import pytest

from elid_cli.diagnosis import diagnose
from elid_cli.diagnosis.search.forward import outdone
from elid_cli.diagnosis.written import robot_between, worse
from elid_cli.estimation.judgement import JointError
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import laws_of, log_of, make, recorded

RATE = 500.0


@pytest.mark.parametrize(
    ("law", "arm", "joint"),
    [
        *(("soft_stop", arm, joint) for arm, joint in ((41, 1), (42, 0), (52, 1), (54, 1))),
        *(("dragging_cable", arm, joint) for arm, joint in ((42, 1), (51, 0))),
        ("presliding", 43, 0),
        *(("loose_mount", arm, joint) for arm, joint in ((53, 1), (54, 0))),
    ],
)
def test_nothing_of_the_library_is_named_for_what_it_lacks(law: str, arm: int, joint: int) -> None:
    made = make(arm, 2, rate=RATE, duration=15.0)
    log = recorded(made, log_of(made, laws_of(law, made, joint)), db=90.0, counts=0.0, torque=0.0, colour=0.0, seed=arm)
    found = diagnose(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)))
    assert found.effects == ()
    assert {u.joint for u in found.unexplained} == {f"j{joint + 1}"}


def error(rms: float, torque: float = 10.0) -> JointError:
    return JointError(rms, rms / torque, None, None, torque)


def test_left_out_torque_decides_what_a_robot_is_written_with() -> None:
    before = {"a": error(1.0), "b": error(1.0)}
    assert worse(before, {"a": error(0.5), "b": error(1.02)}) == ()
    assert worse(before, {"a": error(0.5), "b": error(1.1)}) == ("b",)
    assert worse(before, {"a": error(1.02), "b": error(1.01)}) == ("a", "b")
    assert worse(before, {"a": error(0.2), "b": error(1.04)}) == ()  # it gains far more than it costs
    assert worse(before, {"a": error(0.2), "b": error(1.12)}) == ("b",)


def test_what_lies_between_motor_and_link_stays_as_found(robot: Robot) -> None:
    joint = robot.joint_names[0]
    found = (EffectSpec("stribeck", joint, {"amplitude": 1.0}), EffectSpec("encoder_offset", joint, {"offset": 1e-3}))
    stiffer = tuple(
        dataclasses.replace(j, parameters={**j.parameters, "K": 2.0 * j.parameters["K"], "fs": 0.0})
        for j in robot.joints
    )
    mixed = robot_between(robot, dataclasses.replace(robot, joints=stiffer, effects=found))
    assert [spec.effect for spec in mixed.effects] == ["encoder_offset"]
    for own, other in zip(mixed.joints, robot.joints, strict=True):
        assert own.parameters["K"] == 2.0 * other.parameters["K"]
        assert own.parameters["fs"] == other.parameters["fs"]


def test_an_effect_made_needless_by_one_that_explains_far_more_is_no_rival() -> None:
    def gained(likelihood: float) -> Any:
        return SimpleNamespace(gain=SimpleNamespace(likelihood=likelihood))

    step: Any = SimpleNamespace(candidate=gained(100.0))
    assert outdone(gained(230.0), step, later=True)
    assert not outdone(gained(240.0), step, later=True)  # seven tenths of what both explain
    assert not outdone(gained(25.0), step, later=False)  # what it explains alone was not asked
