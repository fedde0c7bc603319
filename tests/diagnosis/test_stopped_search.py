"""Ctrl-C during a search, by torques and by motion: what was found so far, said to be partial, exit code 130."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import environment, interruptible
from tests.diagnosis.by_motion.plant import moved, robot, written

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "planar2_stribeck.h5"


def stopped(line: list[str], word: str) -> tuple[int, str, str]:
    """Run a command on a terminal, press Ctrl-C when its progress says a word; return code, stdout and stderr."""
    master, slave = pty.openpty()
    try:
        with subprocess.Popen(
            [sys.executable, "-m", "elid_cli", *line], stdout=subprocess.PIPE, stderr=slave,
            env={**environment(), "TERM": "xterm", "COLUMNS": "100"}, preexec_fn=interruptible, text=True,
        ) as process:  # fmt: skip
            os.close(slave)
            seen, pressed = "", False
            try:
                while told := os.read(master, 65536):
                    seen += told.decode("utf-8", "replace")
                    if not pressed and word in seen:
                        process.send_signal(signal.SIGINT)
                        pressed = True
            except OSError:  # Linux: nobody holds the other end any more
                pass
            out, _ = process.communicate(timeout=120)
        assert pressed, seen
        return process.returncode, out, seen
    finally:
        os.close(master)


@pytest.fixture(scope="module")
def sprung(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Return a log of commands, of pendulums with a spring that the robot file lacks, and that file."""
    folder = tmp_path_factory.mktemp("sprung")
    path = robot(folder).source
    stiffness = np.array([1.5, 0.0, 0.0])
    return written(folder, "run.h5", moved(1, 10.5, push=lambda x, v, load: stiffness * x)), str(path)


def test_before_anything_is_judged_the_search_by_motion_says_what_it_had_chosen(
    sprung: tuple[str, str], tmp_path: Path
) -> None:
    log, path = sprung
    refined, page = tmp_path / "refined.yaml", tmp_path / "page.html"
    line = ["diagnose", log, "--robot", path, "--write-robot", str(refined), "--report", str(page)]
    code, out, seen = stopped(line, "fitting again")
    assert code == 130
    assert "Not known yet: the search was stopped" in out
    assert "warning: stopped by Ctrl-C" in out
    assert "not judged yet" in out
    assert "link_spring" in out
    assert "round 1 of 3 at most: " in seen  # which joint it had come to is drawn ten times a second
    assert "Ctrl-C again stops at once" in seen
    assert not refined.exists()
    assert "stopped by Ctrl-C" in page.read_text("utf-8")


def test_after_a_round_the_search_by_motion_shows_what_was_judged(sprung: tuple[str, str]) -> None:
    log, path = sprung
    code, out, _ = stopped(["diagnose", log, "--robot", path], "round 2")
    assert code == 130
    assert "ink spring at one" in out
    assert "missing from the model" in out
    assert "warning: stopped by Ctrl-C" in out


def test_the_search_by_torques_shows_what_was_found(tmp_path: Path) -> None:
    refined = tmp_path / "refined.yaml"
    line = ["diagnose", str(SAMPLE), "--robot", "planar2", "--write-robot", str(refined)]
    code, out, seen = stopped(line, "search 2")
    assert code == 130
    assert "warning: stopped by Ctrl-C" in out
    assert "missing from the model" in out
    assert "Stribeck friction at joint" in out
    assert "left" in seen
    assert not refined.exists()
