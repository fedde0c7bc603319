"""Recordings that stand out: named, left out of the trend of the others, and seldom named by chance."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.estimation.comparison import Estimate, SavedResult
from elid_cli.estimation.trend.trends import Trends, trend
from tests.system.reproduce.trend_fleets import STILL, alarmed, fleet, robot

NAMES = ("K1", "K2", "K3", "fs1", "fv1")
SCATTER = np.array([1e-4, 1e-4, 1e-4, 0.01, 0.01])
ERROR = 5e-5


def values_of(count: int, seed: int = 3) -> np.ndarray:
    """Return parameters of a machine whose K2 falls by 3 % over `count` recordings, as parts of the first, (R, 5)."""
    found = 1.0 + SCATTER * np.random.default_rng(seed).standard_normal((count, len(NAMES)))
    found[:, 1] -= 0.03 * np.arange(count) / (count - 1)
    return found


def told(values: np.ndarray) -> Trends:
    return trend([
        SavedResult(f"r{k}.json", "arm", {n: Estimate(float(v), ERROR, "N·m") for n, v in zip(NAMES, row, strict=True)},
                    {}, ("a", "b", "c"))
        for k, row in enumerate(values)
    ])  # fmt: skip


@pytest.mark.parametrize("at", [0, 4, 8])
def test_a_recording_of_another_robot_is_named_and_hides_nothing(at: int) -> None:
    foreign = np.array([0.8, 0.8, 0.8, 1.4, 1.4])
    found = told(np.insert(values_of(8), at, foreign, axis=0))
    assert [far.number for far in found.stands_out] == [at]
    assert {"K1", "K2", "K3"} <= {d.name for d in found.stands_out[0].parameters}
    words = {item.series.name: item.word for item in found.trends}
    assert words["K2"] == "trend"
    assert words["K1"] == "disagrees"
    k2 = next(item for item in found.trends if item.series.name == "K2")
    assert len(k2.series.values) == 8
    assert k2.outside.tolist() == [[float(at), 0.8, ERROR]]
    assert [k2.number(k) for k in range(8)] == [k for k in range(9) if k != at]


def _newest(values: np.ndarray, count: int) -> np.ndarray:
    values[-count:, 0] *= 0.8
    return values


def _two_foreign(values: np.ndarray) -> np.ndarray:
    values[[2, 5], 0] *= 0.8
    return values


@pytest.mark.parametrize(
    ("change", "numbers", "step"),
    [
        (lambda v: _newest(v, 1), [7], False),
        (lambda v: _newest(v, 2), [6, 7], False),
        (lambda v: _newest(v, 3), [], True),
        (_two_foreign, [2, 5], False),
        (lambda v: v, [], False),
    ],
)
def test_fewer_than_a_step_stand_out(
    change: Callable[[np.ndarray], np.ndarray], numbers: list[int], step: bool
) -> None:
    """A change before one or two of the newest recordings cannot be called a step; two that are alike are both seen."""
    found = told(change(values_of(8)))
    assert [far.number for far in found.stands_out] == numbers
    assert (next(item.word for item in found.trends if item.series.name == "K1") == "step") == step


def test_a_long_run_at_the_end_is_a_step_whatever_its_part_of_all() -> None:
    found = told(_newest(values_of(40), 4))
    assert found.stands_out == ()
    assert next(item.word for item in found.trends if item.series.name == "K1") == "step"


def test_quiet_machines_raise_no_alarm() -> None:
    """A change or a recording that stands out: on one of a hundred machines at most."""
    alarms = [alarmed(make(seed)) for seed in range(60)
              for make in (lambda s: fleet(3000 + s, 8), lambda s: robot(4000 + s, STILL, 12, session=0.05),
                           lambda s: fleet(5000 + s, 4))]  # fmt: skip
    assert sum(alarms) <= 5


def test_the_gate_fails_and_says_which_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    values = values_of(8, 4)
    values[:, 1] = values[::-1, 0]  # nothing drifts
    values[-1, 2] *= 0.8
    files = []
    for k, row in enumerate(values):
        entries = [{"name": n, "unit": "N·m/rad", "estimate": v, "std_error": ERROR}
                   for n, v in zip(NAMES, row.tolist(), strict=True)]  # fmt: skip
        files.append(tmp_path / f"r{k}.json")
        files[-1].write_text(json.dumps({"schema": "elid/1", "command": "identify", "robot": "arm",
                                         "base_parameters": entries}))  # fmt: skip
    assert main(["trend", *map(str, files), "--fail-on-trend"]) == 1
    out, err = capsys.readouterr()
    assert f"{files[-1]} stands out (K3 −20 %)" in err
    answers = out[: out.index("what has changed?")]
    assert "what stands out?" in answers
    assert "K3 −20 %" in " ".join(answers.split())
    assert main(["trend", *map(str, files[:-1]), "--fail-on-trend"]) == 0


def test_a_recording_hardly_farther_off_than_another_is_the_parameters_own_scatter() -> None:
    """Tails that are heavier than the normal law's; five times as far as any other is more than that."""
    values = values_of(30)
    values[:, 0] = 1.0 + 1e-4 * np.random.default_rng(1).standard_normal(30)
    values[[4, 20], 0] += [-4e-4, 14e-4]
    assert told(values).stands_out == ()
    values[20, 0] += 30e-4
    assert [far.number for far in told(values).stands_out] == [20]
