"""What is said of a stiffness that is not shown: true reasons, once, and what would help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.motor_side.refits import Figures
from elid_cli.estimation.motor_side.result import MotorSideJoint, NextMotion, why
from elid_cli.estimation.motor_side.verdict import WORDS, failed_gates, suffices, taken_as_rigid
from elid_cli.estimation.validation.verdicts import hidden_by_rest

MOTION = NextMotion((2.0, 6.0), 26.0, True, "elbow")


def figures() -> Figures:
    """Return figures of two joints that pass all gates."""
    one, none = np.ones(2), np.zeros(2)
    return Figures(
        compliance=1e-3 * one, error=1e-6 * one, chi=1.0, delay=0.0, damping=none, rotor=one, rotor_pull=none,
        rotor_sensitivity=none, load_friction=none, load_friction_error=0.01 * one, band=20 * one,
        antiresonance=10 * one, least_mass=1.0, gain=50 * one, fall=0.0, moved=none, watched=none > 0,
    )  # fmt: skip


def test_a_fit_far_from_noise_is_not_called_one_to_a_share_of_the_torque() -> None:
    failed = tuple(failed_gates(replace(figures(), chi=7.7, borne=False), 0))
    assert set(failed) == {"misfit", "noise"}
    assert why(failed) == WORDS["misfit"]
    assert why(("noise",)) == WORDS["noise"]
    assert why(("sign", "rotor", "damping", "negative")) == f"{WORDS['sign']}; {WORDS['negative']}"


def test_the_rotor_of_another_joint_is_told_as_such() -> None:
    told = replace(figures(), rotor_pull=np.array([-0.5, -12.0]))
    assert failed_gates(told, 0) == ["other_rotor"]
    assert failed_gates(told, 1) == ["rotor"]
    assert failed_gates(replace(told, rotor_pull=np.array([-0.5, -4.0])), 0) == []


def test_joints_without_a_spring_are_taken_as_rigid_where_others_wait_for_that_alone() -> None:
    springless = ("sign", "rotor", "damping")
    assert taken_as_rigid([springless, ("other_rotor",), ("negative", "others")], [0, 1, 2]) == [0]
    assert taken_as_rigid([springless, ("other_rotor", "misfit")], [0, 1]) == []  # more is wrong with it
    assert taken_as_rigid([springless, ()], [0, 1]) == []
    assert taken_as_rigid([springless, ("sure", "close")], [0, 1]) == []
    assert taken_as_rigid([springless, ("other_rotor",)], [1]) == []  # what is not asked for stays as it is declared


@pytest.mark.parametrize(("failed", "antiresonance", "enough"), [
    (("misfit", "noise"), 15.0, True), (("noise",), 15.0, True), (("misfit",), 20.0, False), (("sign",), 5.0, False),
])  # fmt: skip
def test_another_motion_is_advised_only_where_it_would_help(
    failed: tuple[str, ...], antiresonance: float, enough: bool
) -> None:
    assert suffices(failed, 20.0, antiresonance) == enough
    joint = MotorSideJoint("elbow", 1, "refused", failed=failed, reason=why(failed), motion=None if enough else MOTION)
    assert joint.lacking == enough
    for said in (joint.says, joint.told):
        assert ("torque scale" in said) == enough
        assert ("torque multisine" in said) == (not enough)
    assert ("--show-stiffness" in joint.says) == (not enough)
    assert "--show-stiffness" not in joint.told


def test_what_is_left_is_told_where_it_makes_the_error() -> None:
    share = "standard error 38 % of the value: "
    for cause in ("the motor of j1 moves too little against the noise", "the motion excites it too little"):
        assert hidden_by_rest(f"{share}{cause}", "j1") == f"{share}what is left at j1 hides it"
    assert hidden_by_rest("j1 does not move", "j1") == "j1 does not move"
