"""A fault that lasts for a moment: where it lies is told, and what is left out is left out."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from elid_cli.cli import main
from elid_cli.estimation.identify import identify
from elid_cli.estimation.judgement import Judgement, RowNoise
from elid_cli.estimation.validation.one_moment import moment_of
from elid_cli.estimation.validation.sufficiency import judged_model
from elid_cli.logs import read_recording
from elid_cli.report.answers.lacking import moment_words
from elid_cli.robot.files import read_robot
from elid_cli.signals.signals import prepare

Array = NDArray[np.float64]

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "planar2.h5"
ADVICE = re.compile(r"--leave-out ([\d.]+):([\d.]+) goes on")


def frozen(t: Array, tau: Array) -> None:
    during = (t > 6) & (t < 6.3)
    tau[during, 0] = tau[np.flatnonzero(during)[0], 0]


def late(t: Array, tau: Array) -> None:
    first = int(np.argmax(t > 6))
    tau[first : first + 400] = tau[first - 200 : first + 200].copy()


def pushed(t: Array, tau: Array) -> None:
    during = (t > 6) & (t < 6.4)
    tau[during, 1] += 8 * np.sin(np.pi * (t[during] - 6) / 0.4) ** 2


def faulty(path: Path, fault: Callable[[Array, Array], None]) -> Path:
    shutil.copy(SAMPLE, path)
    with h5py.File(path, "r+") as file:
        t, tau = file["t"][()], file["tau"][()]
        fault(t - t[0], tau)
        file["tau"][...] = tau
    return path


def told(capsys: pytest.CaptureFixture[str], verb: str, log: Path, *more: str) -> tuple[dict, str]:
    """Return the JSON, and the sentence on what is missing."""
    assert main([verb, str(log), "--robot", "planar2", "--json", *more]) == 0
    found = json.loads(capsys.readouterr().out)
    assert main([verb, str(log), "--robot", "planar2", *more]) == 0
    text = " ".join(capsys.readouterr().out.split())
    return found, text[text.index("what is missing?") : text.index("what is known?")]


@pytest.mark.parametrize("fault", [frozen, late, pushed])
def test_leaving_out_what_elid_prints_gives_the_truth(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, fault: Callable[[Array, Array], None]
) -> None:
    log = faulty(tmp_path / "log.h5", fault)
    found, said = told(capsys, "identify", log)
    advice = ADVICE.search(said)
    assert advice is not None, said
    start, stop = map(float, advice.groups())
    assert 5.6 < start <= 6.0
    assert 6.3 <= stop < 7.0
    joints = {joint for joint, rows in found["noise"].items() for row in rows.values() if row["moment"]}
    assert joints == {frozen: {"joint1"}, late: {"joint1", "joint2"}, pushed: {"joint2"}}[fault]
    rest, said = told(capsys, "identify", log, "--leave-out", f"{start}:{stop}")
    assert "Nothing that this log shows: no joint's residual follows the motion beyond the sensors' noise." in said
    for item in rest["base_parameters"]:
        assert abs(item["estimate"] - item["reference"]) < 4 * item["std_error"] + 1e-4 * abs(item["reference"])


def test_a_diagnosis_tells_the_moment_that_no_effect_explains(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    log = faulty(tmp_path / "log.h5", frozen)
    _, said = told(capsys, "diagnose", log)
    assert ADVICE.search(said) is not None
    assert "Look first at" not in said  # the motor is not to blame for all of the log
    _, said = told(capsys, "diagnose", log, "--leave-out", "5.9:6.5")
    assert "Nothing: only the sensors' noise is left" in said


def test_noise_and_residuals_that_follow_a_motion_have_no_moment() -> None:
    t = np.arange(600) / 50
    use = np.ones(t.size, dtype=bool)
    for seed in range(200):
        generator = np.random.default_rng(seed)
        noise = generator.normal(size=t.size)
        slow = np.convolve(noise, np.ones(8), "same")  # torque noise with a memory
        wave = np.sign(np.sin(generator.uniform(1, 6) * t)) * np.exp(-np.abs(np.sin(generator.uniform(1, 3) * t)) * 3)
        for residual in (noise, slow, 20 * wave + noise):
            assert moment_of(residual, use, t, 0.1) is None


def test_a_moment_is_where_it_is_whatever_is_masked_around_it() -> None:
    t = np.arange(600) / 50
    generator = np.random.default_rng(1)
    for at in (0.1, 3.0, 11.8):
        residual = generator.normal(size=t.size) + 50 * np.exp(-(((t - at) / 0.06) ** 2))
        use = generator.uniform(size=t.size) < 0.9
        moment = moment_of(residual, use, t, 1.0)
        assert moment is not None
        assert moment[0] <= max(at - 0.05, 0)
        assert moment[1] >= min(at + 0.05, t[-1])
        assert moment[1] - moment[0] < 1.0
    quiet = generator.normal(size=t.size)
    assert moment_of(quiet, np.zeros(t.size, dtype=bool), t, 1.0) is None


def test_what_lasts_is_no_moment() -> None:
    t = np.arange(600) / 50
    burst = np.where(np.abs(t - 6) < 0.2, 50.0, 0.1)
    every = np.ones(t.size, dtype=bool)
    assert moment_of(burst, every, t, 0.1) is not None
    masked = every & ~((t > 5.9) & (t < 8.5))  # it may last for all of what is masked within
    edges = np.where((np.abs(t - 5.85) < 0.05) | (np.abs(t - 8.5) < 0.05), 50.0, 0.1)
    assert moment_of(edges, masked, t, 0.1) is None
    long = np.arange(60_000) / 100
    assert moment_of(np.where(np.abs(long - 300) < 12, 50.0, 0.1), np.ones(long.size, dtype=bool), long, 0.1) is None


def test_what_is_left_beyond_noise_counts() -> None:
    t = np.arange(600) / 50
    every, generator = np.ones(t.size, dtype=bool), np.random.default_rng(2)
    noise = generator.normal(size=t.size)
    burst = noise + np.where(np.abs(t - 6) < 0.2, 6.0, 0.0)  # 20 of 600 instants: about half of all squares
    assert moment_of(burst, every, t, 1.0) is not None
    assert moment_of(burst, every, t, 0.0) is None
    half = noise + np.where(np.abs(t - 6) < 0.2, 20.0, 0.0) + np.where(np.abs(t - 10) < 0.2, 20.0, 0.0)
    assert moment_of(half, every, t, 1.0) is None  # two moments


def test_validate_tells_a_moment_beside_other_values(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    log = faulty(tmp_path / "log.h5", late)
    assert main(["validate", str(log), "--robot", "planar2"]) == 0
    assert ADVICE.search(" ".join(capsys.readouterr().out.split())) is not None


def test_no_option_is_printed_that_elid_would_refuse(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    log = faulty(tmp_path / "log.h5", pushed)
    reduced, episodes = tmp_path / "log.npz", tmp_path / "episodes.h5"
    assert main(["reduce", str(log), "--robot", "planar2", "-o", str(reduced)]) == 0
    capsys.readouterr()
    with h5py.File(log) as one, h5py.File(episodes, "w") as file:
        file.attrs["joint_names"] = one.attrs["joint_names"]
        for number in range(2):
            for name in ("t", "q", "theta", "tau"):
                file[f"episode_{number}/{name}"] = one[name][()]
    for other in (reduced, episodes):
        _, said = told(capsys, "identify", other)
        assert not said.startswith("what is missing? Nothing")
        assert "--leave-out" not in said
        assert main(["identify", str(other), "--robot", "planar2", "--leave-out", "6:7"]) == 2
        assert "left out of a reduced log" in (message := capsys.readouterr().err) or "of 2 episodes" in message


def row(joint: str, ratio: float, moment: tuple[float, float] | None) -> RowNoise:
    return RowNoise(joint, "sum", 0.1, ratio, 0.02, moment)


def test_moments_in_words() -> None:
    assert moment_words([row("a", 50.0, None), row("b", 2.0, (1.0, 1.4))]) == ""
    both = moment_words([row("a", 50.0, (6.02, 6.31)), row("b", 20.0, (6.0, 6.41))])
    assert "left at a and b lies between 6 and 6.5 s" in both
    apart = moment_words([row("a", 50.0, (6.02, 6.31)), row("b", 70.0, (9.0, 9.41))])
    assert "left at b lies between 9 and 9.5 s" in apart


def test_a_moment_of_one_of_several_logs_is_told_of_none() -> None:
    robot = read_robot("planar2")
    found = identify(robot, prepare(read_recording([str(SAMPLE)], robot), robot))
    loud = Judgement((row("joint1", 50.0, (6.0, 6.4)),), (), np.zeros(found.base.count, dtype=bool))
    assert judged_model(found, loud).noise[0].moment == (6.0, 6.4)
    for several in ((loud, None), (loud, loud)):
        (said,) = judged_model(found, *several).noise
        assert said.moment is None
        assert said.ratio == pytest.approx(50.0)
