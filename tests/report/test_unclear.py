"""A residual far above the sensors' noise is not called nothing, and a doubt stands in the first answer."""

from __future__ import annotations

import pytest

from elid_cli.estimation.judgement import RowNoise
from elid_cli.report.answers.lacking import is_unclear, lacking_words
from elid_cli.report.answers.summary import DOUBTS, doubted


@pytest.mark.parametrize(("ratio", "first"), [(1.1, "Nothing"), (2.0, "Nothing"), (45.0, "Not clear")])
def test_what_is_left_far_above_noise_is_not_clear(ratio: float, first: str) -> None:
    noise = (RowNoise("one", "sum", 0.1, 1.0, 0.02), RowNoise("two", "sum", 0.1, ratio, 0.02))
    said = lacking_words("sufficient", (), noise)
    assert said.startswith(first)
    assert ("elid diagnose" in said) == is_unclear(noise) == (first == "Not clear")
    assert ("two" in said) == (ratio > 1.4)


def test_a_doubt_of_units_stands_before_the_answer_and_keeps_its_condition() -> None:
    said = doubted("Yes, once what is missing is added: the rest.", (f"tau {DOUBTS[0]} here",))
    assert said.startswith("Only if")
    assert "once what is missing is added" in said
    assert said.endswith(": the rest.")
    assert doubted("Yes: the rest.", ("all is well",)) == "Yes: the rest."
