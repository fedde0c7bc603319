"""An error that is a constant for the most part is told as one."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import pytest

from elid_cli.cli import main

LOG = Path(__file__).parents[2] / "sample_logs" / "planar2.h5"


def test_validate_tells_a_constant_torque_and_none_where_there_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    off = tmp_path / "off.h5"
    shutil.copy(LOG, off)
    with h5py.File(off, "r+") as file:
        file["tau"][:, 1] += 0.3
    told = []
    for log in (LOG, off):
        assert main(["validate", str(log), "--robot", "planar2", "--json"]) == 0
        told.append(json.loads(capsys.readouterr().out)["constant"])
    assert told == [{}, {"joint2": pytest.approx(0.3, rel=0.01)}]
    assert main(["validate", str(off), "--robot", "planar2"]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "Most of that is a constant, as of an offset of the torque: 0.3 N·m at joint2." in words
