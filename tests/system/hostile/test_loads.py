"""Long logs: memory of a CSV log in blocks, numbers of a long log against the truth."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from elid_cli import LogRequest, identify_logs
from elid_cli.robot.files import read_robot
from tests.system.benchmarks import made

CODE = """
import json, sys
from tests import peaks
from tests.system.benchmarks.cases import csv_memory
begin = peaks.begin()
found = csv_memory(sys.argv[1])
print(json.dumps(found | {"peak": peaks.since()}))
"""


def test_a_csv_log_is_read_in_blocks(tmp_path: Path) -> None:
    """Beyond its arrays a log takes some blocks, whatever its length: an hour of seven joints has 634 MB of arrays."""
    arrow, csv = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.csv")
    robot, t = made.seven(), np.arange(150_000) * 1e-3
    names = [f"{signal}.{joint}" for signal in ("q", "theta", "tau") for joint in robot.joint_names]
    columns = {"t": t} | {name: np.sin(t * (1 + 0.01 * k)) for k, name in enumerate(names)}
    csv.write_csv(arrow.table(columns), path := tmp_path / "log.csv")
    done = subprocess.run([sys.executable, "-c", CODE, str(path)], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert path.stat().st_size > 50e6
    assert found["peak"] - found["before"] - found["arrays"] < 45, found


def test_the_numbers_of_a_long_log_are_the_truth(tmp_path: Path) -> None:
    robot = read_robot("puma560")
    made.write_hdf5(robot, path := tmp_path / "log.h5", 120.0)
    found = identify_logs(LogRequest((str(path),), robot)).found
    known = [p for p in found.parameters if p.verdict == "supported"]
    z = np.array([(p.estimate - p.reference) / p.std_error for p in known])
    assert found.model == "sufficient"
    assert len(known) >= 55
    assert np.mean(np.abs(z) < 1.96) > 0.85
    assert np.abs(z).max() < 4
    assert np.sqrt(np.mean(z**2)) < 1.5
