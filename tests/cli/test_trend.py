"""`elid trend` on saved results: what was given, what they warn of, and how it reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.errors import UsageError
from elid_cli.estimation.comparison import SavedResult, result_of


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    """Return five results of a machine; the last two warn of the same, and the last is of the same log as the first."""
    rng = np.random.default_rng(1)
    found = []
    for k in range(5):
        entries = [{"name": name, "unit": "N·m", "estimate": 1.0 + 0.01 * rng.standard_normal(), "std_error": 0.01}
                   for name in ("K1", "m2 - 4.93827*Izz2 + 6.92521*Izz3")]  # fmt: skip
        saved: dict[str, Any] = {"schema": "elid/1", "command": "identify", "robot": "arm", "joints": ["a", "b"],
                                 "base_parameters": entries, "log": {"sha256": [f"{k % 4}"]}}  # fmt: skip
        if k > 2:
            saved["warnings"] = ["a: its noise is estimated too large"]
        found.append(str(tmp_path / f"{k}.json"))
        Path(found[-1]).write_text(json.dumps(saved))
    return found


def test_a_parameter_is_one_line_of_80_columns(
    files: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["trend", *files[:3]]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    start = lines.index("steady: 2 of 2 parameters")
    assert lines[start + 1].split()[:4] == ["base", "parameter", "mean", "unit"]
    assert [line.split("  ")[1] for line in lines[start + 2 : start + 4]] == ["K1", "m2 with 2 others"]
    assert lines[start + 4].startswith("  within: standard error of one recording")


def test_a_saved_result_is_told_by_its_content(files: list[str]) -> None:
    for name in files[:3]:
        Path(name).rename(name.removesuffix("json") + "out")
    assert main(["trend", *(name.removesuffix("json") + "out" for name in files[:3])]) == 0


def warnings(line: list[str], capsys: pytest.CaptureFixture[str]) -> list[str]:
    assert main(["trend", *line, "--json"]) == 0
    out, err = capsys.readouterr()
    told: list[str] = json.loads(out)["warnings"]
    assert all(f"warning: {line}\n" in err for line in told)
    return told


def test_what_results_warn_of_is_told_with_their_files(files: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert warnings(files[:3], capsys) == []
    assert warnings(files, capsys) == [
        f"{files[0]} and {files[4]} are of the same log, but count as different recordings",
        f"{files[3]} and {files[4]}: a: its noise is estimated too large",
    ]


def test_it_names_the_joints_and_the_logs(files: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    for k, name in enumerate(files):
        saved = json.loads(Path(name).read_text())
        saved["log"]["files"] = [f"run{k % 4}.mcap"]
        Path(name).write_text(json.dumps(saved))
    assert main(["trend", *files, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["joints"] == ["a", "b"]
    assert told["log"] == {"files": [f"run{k}.mcap" for k in range(4)], "sha256": ["0", "1", "2", "3"]}


def test_the_same_result_counts_once(files: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    copy = Path(files[0]).with_name("copy.json")
    copy.write_bytes(Path(files[0]).read_bytes())
    line = [*files[:3], files[0], str(copy)]
    assert warnings(line, capsys) == [f"{files[0]} is given 2 times and the same result as {copy}: counted once"]
    assert main(["trend", files[0], files[0], files[0]]) == 2
    err = capsys.readouterr().err
    assert "1 recording is given, at least 3 are needed" in err
    assert "is given 3 times: counted once" in err


def test_options_of_logs_are_not_passed_over(files: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--lock", "a=0", "--cutoff", "20", "--by", "order"]
    assert warnings([*files[:3], *given], capsys) == [
        "--lock and --cutoff are not used here: all recordings are results, which were identified before"
    ]


def test_a_rise_over_few_recordings_is_told_and_a_gate_fails_on_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of four recordings a line is not certain among many parameters, however far beyond the errors it rises."""
    rng, files = np.random.default_rng(2), list[str]()
    for k, rising in enumerate((1.1006, 1.2, 1.317, 1.43)):
        values = {"fs3": rising} | {f"p{j}": 1.0 + 0.0012 * rng.standard_normal() for j in range(21)}
        entries = [{"name": n, "unit": "N·m", "estimate": v, "std_error": 0.0012} for n, v in values.items()]
        files.append(str(tmp_path / f"{k}.json"))
        Path(files[-1]).write_text(json.dumps({
            "schema": "elid/1", "command": "identify", "robot": "arm", "joints": ["a", "b", "c"],
            "base_parameters": entries}))  # fmt: skip
    assert main(["trend", *files, "--fail-on-trend"]) == 0
    out, err = capsys.readouterr()
    said = " ".join(out.split())
    assert "Nothing" not in said
    assert "No trend and no step is certain, but recordings disagree in fs3." in said
    assert "fs3 by up to 30 % (194 standard errors)" in said
    assert "4 recordings are too few to tell whether it follows time" in said
    assert "lets recordings that disagree pass (fs3): --fail-on-disagreement fails on them" in err
    assert main(["trend", *files, "--fail-on-disagreement"]) == 1
    assert "recordings disagree: fs3 by up to 30 %" in capsys.readouterr().err


def test_the_stricter_gate_fails_on_a_certain_trend_too(tmp_path: Path) -> None:
    files = []
    for k in range(8):
        entries = [{"name": "fs3", "unit": "N·m", "estimate": 1.0 + 0.1 * k + 0.001 * (k % 2), "std_error": 0.001}]
        files.append(str(tmp_path / f"{k}.json"))
        Path(files[-1]).write_text(json.dumps({
            "schema": "elid/1", "command": "identify", "robot": "arm", "base_parameters": entries}))  # fmt: skip
    for gate in ("--fail-on-trend", "--fail-on-disagreement"):
        assert main(["trend", *files, gate]) == 1


def test_a_quiet_machine_passes_both_gates(files: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trend", *files, "--fail-on-trend", "--fail-on-disagreement"]) == 0
    out, err = capsys.readouterr()
    assert "Nothing, of 2 parameters" in out
    assert "disagree" not in err


def test_a_log_that_it_identifies_itself_tells_what_a_saved_result_tells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its temperature, what it is recognised by, and what was warned of it."""
    log = str(tmp_path / "warm.csv")
    assert main(["simulate", "--robot", "planar2", "--temperature", "--duration", "6", "-o", log]) == 0
    capsys.readouterr()
    assert main(["identify", log, "--robot", "planar2", "--json"]) == 0
    saved = result_of(json.loads(capsys.readouterr().out), log)
    assert saved.temperature is not None
    given: list[SavedResult] = []

    def seen(results: list[SavedResult], *_: Any) -> None:
        given.extend(results)
        raise UsageError("seen")

    monkeypatch.setattr("elid_cli.estimation.trend.trends.trend", seen)
    assert main(["trend", log, "--robot", "planar2"]) == 2
    (found,) = given
    assert (found.temperature, found.logs, found.warnings) == (saved.temperature, saved.logs, saved.warnings)
