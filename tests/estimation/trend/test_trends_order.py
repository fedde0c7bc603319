"""Places of recordings in time: results are put in their order, and places that say nothing are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import UsageError
from elid_cli.estimation.trend.trends import trend


def saved(folder: Path, values: np.ndarray) -> list[str]:
    """Return results of one parameter whose values are given, each ± 1 %."""
    found = []
    for k, value in enumerate(values.tolist()):
        entry = {"name": "fv1", "terms": {"fv1": 1}, "unit": "N·m·s/rad", "estimate": value, "std_error": 0.01,
                 "verdict": "supported", "reference": None}  # fmt: skip
        result = {"schema": "elid/1", "command": "identify", "robot": "arm", "joints": ["j1"],
                  "base_parameters": [entry], "log": {"files": [f"{k}.csv"]}, "nuisances": [],
                  "effects": []}  # fmt: skip
        path = folder / f"{k:02d}.json"
        path.write_text(json.dumps(result))
        found.append(str(path))
    return found


def test_results_are_taken_in_the_order_of_their_places(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = 1.0 + np.where(np.arange(12) < 6, 0.0, 0.2) + 0.01 * rng.standard_normal(12)
    files = saved(tmp_path, values)
    plain = trend(files)
    (step,) = plain.of("step")
    assert step.series.step is not None
    again = trend(files[::-1], places=np.arange(12.0)[::-1].tolist(), axis="hour")
    (same,) = again.of("step")
    assert same.series.step is not None
    assert same.series.step.p == pytest.approx(step.series.step.p)
    np.testing.assert_allclose(same.series.values, step.series.values)
    assert again.files == plain.files


@pytest.mark.parametrize("places", [[0.0] * 12, [np.nan] * 12, [0.0, 1.0]])
def test_places_that_tell_no_order_are_refused(tmp_path: Path, places: list[float]) -> None:
    files = saved(tmp_path, 1.0 + 0.01 * np.random.default_rng(0).standard_normal(12))
    with pytest.raises(UsageError):
        trend(files, places=places)
