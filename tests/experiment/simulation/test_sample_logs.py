"""The sample logs are what their README says: present, small, the same in every format, made by its commands."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from elid_cli.logs import read_recording
from elid_cli.robot.files import read_robot

FOLDER = Path(__file__).parents[3] / "sample_logs"
TEXT = (FOLDER / "README.md").read_text("utf-8")
COMMANDS = {
    words[words.index("-o") + 1]: words[1:]
    for line in re.findall(r"^elid simulate(?:\\\n|.)*$", TEXT, re.MULTILINE)
    for words in [shlex.split(line.replace("\\\n", " "))]
}


def test_every_log_has_its_command_and_all_are_small() -> None:
    logs = {path.name for path in FOLDER.iterdir() if path.name != "README.md"}
    assert logs == set(COMMANDS)
    assert sum((FOLDER / name).stat().st_size for name in logs) < 10e6


def test_one_motion_in_three_formats() -> None:
    robot = read_robot("planar2")
    first, *others = (read_recording([str(FOLDER / f"planar2.{kind}")], robot) for kind in ("csv", "h5", "mcap"))
    for other in others:
        for name in ("t", "q", "theta", "tau"):
            np.testing.assert_allclose(getattr(other, name), getattr(first, name), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("name", ["planar2.csv", "planar2_stribeck.h5"])
def test_the_command_makes_the_log(name: str, tmp_path: Path) -> None:
    robot = read_robot("planar2")
    done = subprocess.run(
        [sys.executable, "-m", "elid_cli", *COMMANDS[name]], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    made, kept = (read_recording([str(folder / name)], robot) for folder in (tmp_path, FOLDER))
    step = 2 * np.pi / 1250000  # a last digit may turn one count
    for signal in ("q", "theta"):
        np.testing.assert_allclose(getattr(made, signal), getattr(kept, signal), rtol=0, atol=1.01 * step)
    np.testing.assert_allclose(made.tau, kept.tau, rtol=0, atol=1e-3)
