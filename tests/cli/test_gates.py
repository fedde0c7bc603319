"""Limits of the prediction's error: the error that the report's first answer names is the one that breaks them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from elid_cli.cli.gates import broken_gates, motor_rows_told
from elid_cli.cli.options import Gates, Output
from elid_cli.estimation.judgement import JointError
from elid_cli.report.answers.summary import trust_words
from elid_cli.report.tree import Report, Text
from elid_cli.robot.files import read_robot

WHOLE = JointError(0.1, 0.01, None, None, torque_rms=10.0, floor=0.1)
BENT = replace(WHOLE, spring_rms=2.0, spring_relative=0.2, spring_floor=0.1)
"""The spring is wrong by a fifth: the motor's equation is, and the two sides cancel."""
NOISY = replace(BENT, spring_floor=2.0)
"""The same by the noise of encoders."""


@pytest.mark.parametrize(
    ("error", "limit", "words"),
    [
        (WHOLE, 0.02, None),
        (WHOLE, 0.005, "joint1: torque error 1 % exceeds --max-error 0.5 %"),
        (BENT, 0.05, "joint1: torque error 20 % (motor side) exceeds --max-error 5 %"),
        (BENT, 0.3, None),
        (NOISY, 0.05, None),
        (NOISY, 0.005, "joint1: torque error 20 % (motor side) exceeds --max-error 0.5 %"),
        (replace(BENT, spring_floor=None), 0.05, "joint1: torque error 20 % (motor side) exceeds --max-error 5 %"),
        (replace(BENT, rms=3.0, relative=0.3), 0.05, "joint1: torque error 30 % exceeds --max-error 5 %"),
        (replace(WHOLE, relative=float("nan")), 0.05, "joint1: torque error nan % exceeds --max-error 5 %"),
    ],
)
def test_the_worse_equation_breaks_a_limit_unless_by_noise(error: JointError, limit: float, words: str | None) -> None:
    assert broken_gates(Gates(max_error=limit), {"joint1": error}) == ([] if words is None else [words])


def test_the_first_answer_and_the_limit_give_one_figure() -> None:
    (broken,) = broken_gates(Gates(max_error=0.01), {"joint1": replace(BENT, rms=0.79, relative=0.079)})
    said = trust_words(read_robot("planar2"), {"joint1": replace(BENT, rms=0.79, relative=0.079)})
    assert "20 %" in said
    assert "20 %" in broken


@pytest.mark.parametrize(("error", "told"), [(WHOLE, False), (BENT, False), (NOISY, True)])
def test_noise_above_a_limit_is_a_warning(error: JointError, told: bool, capsys: pytest.CaptureFixture[str]) -> None:
    report = motor_rows_told(Report("validate", {}, ()), Gates(max_error=0.05), {"joint1": error}, Output())
    texts = [section.text for section in report.sections if isinstance(section, Text)]
    assert bool(texts) is told
    assert ("by the noise of the encoders alone" in capsys.readouterr().err) is told
