"""Options that nothing is done with, or that cannot be kept to, are told, not passed over."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests import forked

ROOT = Path(__file__).parents[2]
PLANAR = ("sample_logs/planar2.h5", "--robot", "planar2")


def run(*line: str) -> subprocess.CompletedProcess[str]:
    return forked.run(line, cwd=ROOT)


def test_knots_too_far_apart_for_the_log() -> None:
    done = run("identify", *PLANAR, "--knots", "9")
    assert done.returncode == 2
    assert "--knots 9: splines with knots that far apart are no motion in 12 s of log" in done.stderr
    assert "less than 3, such as 0.05" in done.stderr
    assert run("identify", *PLANAR, "--knots", "0.05").returncode == 0


def test_gains_that_no_command_needs() -> None:
    said = "--kp and --kd are not used: no log holds commanded positions (q_des)"
    done = run("identify", *PLANAR, "--kp", "40", "--kd", "1")
    assert done.returncode == 0
    assert said in " ".join(done.stderr.split())
    assert said not in " ".join(run("identify", *PLANAR).stderr.split())


def test_effects_dropped_from_no_file() -> None:
    line = ("diagnose", "sample_logs/planar2_stribeck.h5", "--robot", "planar2", "--drop-effects")
    done = run(*line)
    assert done.returncode == 2
    assert "--drop-effects: no robot file is written" in done.stderr
    assert "--write-robot" in done.stderr


def test_a_robot_of_other_joints_is_no_rival() -> None:
    done = run("replay", *PLANAR, "--against", "puma560")
    assert done.returncode == 2
    assert "--against puma560: other joints than those of planar2" in done.stderr
    assert run("replay", *PLANAR, "--against", "planar2").returncode == 0


@pytest.mark.parametrize(("gains", "lost"), [(("--kp", "20", "--kd", "1", "--feedforward", "none"), True), ((), False)])
def test_a_reference_that_is_not_followed(tmp_path: Path, gains: tuple[str, ...], lost: bool) -> None:
    log = str(tmp_path / "log.h5")
    done = run("simulate", "--robot", "planar2", "--duration", "2", *gains, "-o", log)
    assert done.returncode == 0, done.stderr
    assert ("the reference is not followed" in " ".join((done.stdout + done.stderr).split())) is lost
