"""What results of a trend warn of: once, whatever the numbers."""

from __future__ import annotations

from elid_cli.estimation.comparison import SavedResult
from elid_cli.estimation.trend.given import warnings_of


def results(*lines: str) -> list[SavedResult]:
    return [SavedResult(f"{k}.json", "arm", {}, {}, warnings=(line,)) for k, line in enumerate(lines)]


def test_warnings_that_differ_in_one_number_are_one_with_its_range() -> None:
    shares = (0.064, 0.5, 0.077, 1.2e-05, 0.084, 0.09)
    told = warnings_of(results(*(f"joint 2: the residual is {share:.2g} of its noise" for share in shares)))
    assert told == ["0.json, 1.json, 2.json, 3.json and 2 more: joint 2: the residual is 1.2e-05 to 0.5 of its noise"]


def test_warnings_of_other_joints_or_with_more_numbers_that_differ_stay_apart() -> None:
    lines = ("joint1: off by 0.1", "joint2: off by 0.1", "axis 1: off by 0.1", "axis 2: off by 0.1")
    times = ("off from 0.1 to 0.3 s", "off from 0.2 to 0.5 s")
    assert warnings_of(results(*lines, *times)) == [f"{k}.json: {line}" for k, line in enumerate((*lines, *times))]
