"""The coverage-guided fuzzer for a few seconds on every target: no traceback, no hang, no memory without bound."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("atheris", reason="the fuzzer is an optional extra of the tests")

ROOT = Path(__file__).parents[3]
GUIDED = ("-m", "tests.system.fuzz.guided")
FOUND = Path(__file__).with_name("found")
APART = ("sh", "-c", '"$@"; exit $?', "sh")
"""What starts a process of its own: the peak memory of the tests' process, which the fuzzer limits, is else its own."""


@pytest.mark.parametrize("target", ["mcap", "csv", "robot", "mapping"])
def test_a_few_seconds_of_guided_fuzzing_find_nothing(tmp_path: Path, target: str) -> None:
    done = subprocess.run(
        [*APART, sys.executable, *GUIDED, target, "-max_total_time=2", "-seed=1", f"-artifact_prefix={tmp_path}/"],
        capture_output=True, text=True, timeout=240, check=False, cwd=ROOT,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    tried = re.search(r"Done (\d+) runs", done.stderr)
    assert tried is not None
    assert int(tried[1]) > 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("path", sorted(FOUND.glob("*-*")), ids=lambda path: path.name)
def test_what_was_found_stays_mended(path: Path) -> None:
    """Inputs that were crashes once, named ``target-what``."""
    target = path.name.partition("-")[0]
    done = subprocess.run(
        [*APART, sys.executable, *GUIDED, target, str(path)],
        capture_output=True, text=True, timeout=120, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
