"""Ctrl-C while logs are reduced in several processes: one answer, and no traceback of a worker."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cli.conftest import interruptible

LOGS = Path(__file__).parents[3] / "sample_logs"


@pytest.mark.skipif(sys.platform != "linux", reason="counts processes in /proc")
@pytest.mark.parametrize("later", [0.0, 0.4])
def test_workers_say_nothing_when_all_are_interrupted(later: float) -> None:
    """Every worker told where it was, in dozens of lines."""
    logs = [str(LOGS / f"planar2.{kind}") for kind in ("h5", "csv", "mcap")]
    run = subprocess.Popen(
        [sys.executable, "-m", "elid_cli", "identify", *logs, "--robot", "planar2", "--jobs", "2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=interruptible,
    )
    children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
    until = time.monotonic() + 20.0
    while len(children.read_text().split()) < 3 and time.monotonic() < until:  # two workers beside what tracks them
        time.sleep(0.01)
    time.sleep(later)
    os.killpg(run.pid, signal.SIGINT)
    _, said = run.communicate(timeout=20)
    assert run.returncode == 130
    assert "Traceback" not in said
