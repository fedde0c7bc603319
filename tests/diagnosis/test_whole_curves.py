"""Friction curves of two terms: the term that hides under the noise is told by collocation, and only where it is."""

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.base import find_base
from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.diagnosis.conditioning import options_for
from elid_cli.model import Model
from elid_cli.robot import Robot
from elid_cli.robot_file import read_robot
from elid_cli.signals import prepare
from elid_cli.validation import validate
from tests.reproduce.own_case import error
from tests.reproduce.paper_logs import FRICTION, log_of, motion_of, with_friction

NOISE = 80.0


def bare() -> Robot:
    return replace(read_robot("planar2"), effects=())


def diagnosed(friction: Robot, seed: int, *, rates: bool = False) -> Diagnosis:
    recording, accelerations = log_of(motion_of(friction, seed), NOISE, seed, rates=rates)
    return diagnose(bare(), prepare(recording, bare(), options_for(1 / recording.dt), accelerations))


@pytest.fixture(scope="module")
def papers() -> Diagnosis:
    """Eq. (43)'s friction at both joints, 8.9 s, positions only."""
    return diagnosed(with_friction(read_robot("planar2"), known=True), 6)


def test_the_papers_own_case(papers: Diagnosis) -> None:
    base = find_base(Model(bare()))
    truth = base.values(bare().reference())
    before, after = (
        error(base.transform @ state.standard, truth) for state in (papers.state_before, papers.state_after)
    )
    assert before > 0.1
    assert after < 0.015
    assert {(e.effect, e.joint) for e in papers.effects} == {("stribeck", "joint1"), ("stribeck", "joint2")}
    assert len(papers.effects) == 4


def test_its_terms_are_those_of_eq_43(papers: Diagnosis) -> None:
    for effect in papers.effects:
        _, _, f3, f4, f5, f6 = FRICTION[("joint1", "joint2").index(effect.joint or "")]
        amplitude, velocity = (-f3, f4) if effect.parameters["exponent"] > 0 else (-f5, 1 / f6)
        assert effect.parameters["amplitude"] == pytest.approx(amplitude, abs=0.06)
        assert effect.parameters["velocity"] == pytest.approx(velocity, rel=0.25)


def test_the_refined_robot_holds_the_collocations_values(papers: Diagnosis) -> None:
    again = validate(papers.refined, papers.state_after.log.raw, papers.chosen)
    for name, item in papers.validation_after.error.items():
        assert again.error[name].rms == item.rms
    base = find_base(Model(bare()))
    held = base.values(papers.refined.reference())
    assert held == pytest.approx(base.transform @ papers.state_after.standard, rel=1e-6, abs=1e-9)


def test_shifts_are_counted_in_the_collocations_errors(papers: Diagnosis) -> None:
    friction = {m.name: m for m in papers.moved}
    for name in ("fs1", "fs2"):
        assert abs(friction[name].deviations) > 3
        assert np.isfinite(friction[name].deviations)


def test_a_joint_without_the_curve_gets_none() -> None:
    whole = with_friction(read_robot("planar2"), known=True)
    second = replace(whole, effects=tuple(e for e in whole.effects if e.joint == "joint2"))
    found = diagnosed(second, 6, rates=True)
    assert [e.joint for e in found.effects] == ["joint2", "joint2"]
