"""Whoever waits for a long log is told how much of it has been read."""

from __future__ import annotations

from pathlib import Path

import pytest

from elid_cli.logs import read_recording
from tests.logs.made_logs import ROBOT, recording, same, written


def rises(shares: list[float], least: int) -> bool:
    return len(shares) >= least and shares == sorted(shares) and 0 <= shares[0] < 0.95 and shares[-1] <= 1


@pytest.mark.parametrize(("name", "least"), [("a.csv", 5), ("a.csv.gz", 5), ("a.h5", 3), ("a.mcap", 2)])
def test_shares_rise_to_the_end_of_a_log(
    tmp_path: Path, name: str, least: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("elid_cli.logs.formats.csv_text.PART", 100_000)
    shares: list[float] = []
    got = read_recording([written(tmp_path, name)], ROBOT, progress=shares.append)
    same(got, recording())
    assert got.samples == 4000
    assert rises(shares, least), shares


def test_several_logs_have_their_part_each(tmp_path: Path) -> None:
    logs = [written(tmp_path, name) for name in ("a.csv", "b.h5", "c.mcap")]
    shares: list[float] = []
    read_recording(logs, ROBOT, progress=shares.append)
    assert rises(shares, 5), shares
    assert any(share < 1 / 3 + 1e-9 for share in shares)
    assert any(1 / 3 < share < 2 / 3 for share in shares)
    assert shares[-1] > 2 / 3


def test_nobody_need_listen(tmp_path: Path) -> None:
    same(read_recording([written(tmp_path, "a.mcap")], ROBOT), recording())
