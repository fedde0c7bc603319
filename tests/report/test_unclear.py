"""Answers that must not say more than is known: residuals far above noise, doubted units, changes over recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.identify import identify_logs
from elid_cli.estimation.judgement import Insufficient, RowNoise
from elid_cli.estimation.request import LogRequest
from elid_cli.estimation.result import Nuisance
from elid_cli.estimation.trend.series import Step, series_of
from elid_cli.estimation.trend.trends import Trend
from elid_cli.estimation.validation.sufficiency import far_off
from elid_cli.report.answers.identification_json import model_payload
from elid_cli.report.answers.inputs import nuisance_items, nuisance_payload
from elid_cli.report.answers.lacking import is_unclear, lacking_words, words_of
from elid_cli.report.answers.summary import DOUBTS, doubted
from elid_cli.report.answers.trend import changed_by
from elid_cli.robot.files import read_robot
from tests.system.plain_arms import random_arm


@pytest.mark.parametrize(
    ("ratio", "first"), [(1.1, "Nothing"), (2.0, "Nothing"), (2.9, "Not clear"), (45.0, "Not clear")]
)
def test_what_is_left_far_above_noise_is_not_clear(ratio: float, first: str) -> None:
    noise = (RowNoise("one", "sum", 0.1, 1.0, 0.02), RowNoise("two", "sum", 0.1, ratio, 0.02))
    said = lacking_words("sufficient", (), noise)
    assert said.startswith(first)
    assert ("elid diagnose" in said) == is_unclear(noise) == (first == "Not clear")
    assert ("two" in said) == (ratio > 1.4)
    assert model_payload("sufficient", noise, ())["unclear"] == (first == "Not clear")
    assert not model_payload("insufficient", noise, ())["unclear"]  # it is clear that something is


def test_a_doubt_of_units_stands_before_the_answer_and_keeps_its_condition() -> None:
    said = doubted("Yes, once what is missing is added: the rest.", (f"tau {DOUBTS[0]} here",))
    assert said.startswith("Only if")
    assert "once what is missing is added" in said
    assert said.endswith(": the rest.")
    assert doubted("Yes: the rest.", ("all is well",)) == "Yes: the rest."


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((1.0, 1.0, 2.0, 2.0, 2.0, 2.0), "+100 %"),
        ((0.0, 0.0, 2.0, 2.0, 2.0, 2.0), "2 N·m"),
        ((-2.0, -2.0, -3.0, -3.0), "−50 %"),
    ],
)
def test_a_step_is_a_share_of_what_was_before_whatever_the_errors(values: tuple[float, ...], said: str) -> None:
    found, count = np.array(values), len(values)
    series = series_of("fs1", "N·m", np.arange(float(count)), found, np.linspace(0.01, 0.5, count))
    size = found[-1] - found[0]
    stepped = Trend(replace(series, step=Step(1, float(size), 1e-9)), "step")
    assert f"by {said} at once after recording 2" == changed_by(stepped)


def test_what_is_far_off_and_follows_nothing_of_a_joint_may_bias_all_of_its_parameters() -> None:
    found = judged_far_off({"j1": 12.0, "j2": 3.0})
    assert found == {"j1"}
    follows = [Insufficient("j1", "sum", 40.0, name, 0.5) for name in ("time", "load")]
    assert judged_far_off({"j1": 40.0}, follows[:1]) == {"j1"}
    assert judged_far_off({"j1": 40.0}, follows[1:]) == set()  # which parameters a load moves is known


def judged_far_off(ratios: dict[str, float], insufficient: Sequence[Insufficient] = ()) -> set[str]:
    noise = [RowNoise(name, "sum", 0.1, ratio, 0.02) for name, ratio in ratios.items()]
    return far_off(noise, insufficient)


def test_a_long_delay_of_a_model_that_lacks_something_is_told_with_a_doubt() -> None:
    robot = random_arm(np.random.default_rng(0), 2).described()
    short, long = (
        Nuisance("torque_delay", name, {"delay": delay}, {"delay": 1e-4}, long=delay > 1e-3)
        for name, delay in zip(robot.joint_names, (5e-4, 0.015), strict=True)
    )
    ((_, sure),) = nuisance_items(robot, (short, long))
    ((_, said),) = nuisance_items(robot, (short.doubted, long.doubted))
    assert "biased" not in str(sure)
    first, second = str(said).split("; ")[:2]
    assert "biased" not in first
    assert second.endswith("± 0.10 ms (may be biased)")
    assert ["bias_possible" in item for item in nuisance_payload((short.doubted, long.doubted))] == [False, True]


@pytest.mark.parametrize(
    ("masked", "said"),
    [([0.0, 0.1], "Reversals of joint2 were left out"), ([0.1, 0.1], "Reversals of all joints"), ([0.0, 0.0], None)],
)
def test_where_nothing_is_missing_reversals_that_were_left_out_are_said(masked: list[float], said: str | None) -> None:
    request = LogRequest([Path("sample_logs/planar2.h5")], read_robot("planar2"))
    found = identify_logs(request).found
    told = words_of(replace(found, settings={**found.settings, "masked": masked}))
    assert told.startswith("Nothing that this log shows")
    assert (said in told) if said else ("eversals" not in told)
    lacking = Insufficient("joint1", "sum", 3.0, "motor speed", 0.5)
    other = replace(found, model="insufficient", insufficient=(lacking,))
    assert "eversals" not in words_of(replace(other, settings={**found.settings, "masked": masked}))
