"""`elid excite --resolve`: what it does not go with, and files that are no diagnosis."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.conftest import Elid

SAMPLES = Path(__file__).parents[2] / "sample_logs"


@pytest.mark.parametrize("other", ["--for K1", "--after last.json", "--residual 1%"])
def test_it_does_not_go_with_what_plans_for_parameters(elid: Elid, tmp_path: Path, other: str) -> None:
    (tmp_path / "last.json").write_text("{}", "utf-8")
    line = f"excite --robot planar2 -o next.csv --resolve last.json {other}"
    done = elid(*line.split(), cwd=tmp_path)
    assert done.returncode == 2
    assert f"--resolve does not go with {other.split()[0]}" in done.stderr
    assert not (tmp_path / "next.csv").exists()


def test_a_result_that_is_no_diagnosis_is_refused_with_what_to_run(elid: Elid, tmp_path: Path) -> None:
    (tmp_path / "last.json").write_text(
        '{"schema": "elid/1", "command": "identify", "joints": ["joint1", "joint2"]}', "utf-8"
    )
    done = elid("excite", "--robot", "planar2", "-o", "next.csv", "--resolve", "last.json", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "last.json: not a diagnosis" in done.stderr
    assert "elid diagnose LOG --robot ROBOT --json" in done.stderr
    assert not (tmp_path / "next.csv").exists()
