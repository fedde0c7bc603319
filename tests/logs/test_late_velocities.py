"""A velocity that a filter has made late is told where a torque is computed from it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from elid_cli.cli import main
from elid_cli.logs.checks.late_velocities import LEAST, SURE, delay_of, late_velocities
from elid_cli.robot.files import read_robot
from tests.diagnosis.by_motion import plant

DT = 0.005


def motion(seed: int, late: float = 0.0, *, scale: float = 1.0, bits: int = 0, noise: float = 1e-4):
    """Return a position and its velocity of 12 s, the velocity `late` s late."""
    draw = np.random.default_rng(seed)
    t = DT * np.arange(2400)
    size, rate, phase = draw.uniform(0.1, 0.5, 5), 2 * np.pi * draw.uniform(0.1, 2.0, 5), draw.uniform(0, 6.0, 5)
    q = np.sin(np.outer(t, rate) + phase) @ size
    dq = np.cos(np.outer(t - late, rate) + phase) @ (size * rate)
    q += noise * draw.standard_normal(len(t))
    if bits:
        step = 2 * np.pi / 2**bits
        q = step * np.round(q / step)
    return q, scale * dq + 30 * noise * draw.standard_normal(len(t))


@pytest.mark.parametrize(
    ("late", "how"),
    [
        (8e-3, {}), (-6e-3, {}), (3e-3, {"scale": 1.02}), (4e-3, {"bits": 12}),
        (0.0, {"scale": 0.97}), (1.5e-3, {"noise": 1e-5}),
    ],
)  # fmt: skip
def test_the_delay_is_that_of_the_velocity(late: float, how: dict[str, float]) -> None:
    found = delay_of(*motion(1, late, **how), DT, 0)  # type: ignore[arg-type]
    assert found is not None
    assert found.value == pytest.approx(late, abs=max(4 * found.std_error, 2e-5))
    assert found.std_error < 5e-4


def test_without_delay_nothing_is_said_of_300_logs() -> None:
    scores = []
    for seed in range(300):
        found = delay_of(*motion(seed, bits=(0, 12, 14)[seed % 3], noise=(1e-5, 1e-4, 1e-3)[seed % 3]), DT, 0)
        assert found is not None
        assert abs(found.value) - LEAST < SURE * found.std_error
        scores.append(found.value / found.std_error)
    assert np.sqrt(np.mean(np.square(scores))) < 1.6


def test_short_logs_rests_and_gaps_say_nothing() -> None:
    q, dq = motion(1, 8e-3)
    assert delay_of(q[:200], dq[:200], DT, 0) is None
    assert delay_of(np.zeros(2400), np.zeros(2400), DT, 0) is None
    q[7] = np.nan
    assert delay_of(q, dq, DT, 0) is None
    robot, still = read_robot("planar2"), np.zeros((2400, 2))
    assert list(late_velocities({"dq": still}, still, np.ones(2, dtype=bool), DT, robot)) == []


def test_a_late_position_bends_viscous_friction() -> None:
    q, dq = (np.tile(part[:, None], 2) for part in motion(1, -6e-3))
    gains = {"kp": np.full(q.shape, 20.0), "kd": np.full(q.shape, 0.5)}
    (said,) = late_velocities({"dq": dq, **gains}, q, np.ones(2, dtype=bool), DT, read_robot("planar2"))
    assert said.startswith("joint1 joint2: the position is late against the velocity by 6 ms")
    assert "viscous frictions fitted to the torque are right" in said
    assert "fitted to the motion too small by kp times that, 0.12 N·m·s/rad" in said


def test_joints_are_judged_by_the_velocity_that_they_have_and_only_where_a_torque_is_computed() -> None:
    q, dq = (np.tile(part[:, None], 2) for part in motion(1, 8e-3))
    gains = {"kp": np.full(q.shape, 20.0), "kd": np.full(q.shape, 0.5)}
    first, second = np.array([True, False]), np.array([False, True])
    sides = {"dq": np.where(first, dq, np.nan), "dtheta": np.where(first, np.nan, dq)}
    robot = read_robot("planar2")
    (said,) = late_velocities({**sides, **gains}, q, first | second, DT, robot)
    assert said.startswith("joint1 joint2: the velocity is late")
    # a joint without gains has a measured torque
    bare = {name: np.where(second, values, np.nan) for name, values in gains.items()}
    (said,) = late_velocities({**sides, **bare}, q, second, DT, robot)
    assert said.startswith("joint2: the velocity is late")


def test_identify_warns_of_a_filtered_velocity(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, robot = plant.moved(1, 6.0), plant.robot(tmp_path)
    top, bottom = butter(1, 20.0, fs=1 / plant.DT)
    late = replace(recording, dq=lfilter(top, bottom, recording.dq, axis=0))
    warnings = {}
    for name, log in (("plain", recording), ("late", late)):
        path = plant.written(tmp_path, f"{name}.h5", log)
        assert main(["identify", path, "--robot", str(robot.source), "--json"]) == 0
        answer = json.loads(capsys.readouterr().out)
        told = answer["log"]["warnings"]
        assert set(told) <= set(answer["warnings"])  # who asks what looks wrong is told all of it
        warnings[name] = [warning for warning in told if "late against" in warning]
    assert warnings["plain"] == []
    (said,) = warnings["late"]
    # a first-order filter at 20 Hz is 8 ms late; kd is 1, 0.8 and 0.5 N·m·s/rad
    assert said.startswith("one two three: the velocity is late against the position by 7.")
    assert "those fitted to the motion too small by kd times that, 0.0039 to 0.0077 kg·m²" in said
    assert said.count("fitted to the torque too large by as much") == 1
