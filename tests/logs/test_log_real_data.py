"""Measured logs read through mappings as their robots have them (skipped where the data are absent)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elid_cli.logs import read_recording
from elid_cli.robot.robot import Joint, Robot

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data is absent")

GEARS = (256.857, 267.429, 252.333, 221.0, 239.619, 154.323)


def columns(name: str) -> dict[str, np.ndarray]:
    path = DATA / name
    names = path.read_text().split("\n", 1)[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def test_emps() -> None:
    log = {"t": {"from": "t_s"}, "q": "q_meas_m", "theta": "q_meas_m", "tau": {"from": "u_V", "scale": 35.15065188}}
    robot = Robot("emps", (Joint("x", type="prismatic", transmission="rigid"),), log=log)
    got, raw = read_recording([DATA / "emps.csv"], robot), columns("emps.csv")
    assert got.dt == 0.001
    assert np.array_equal(got.q[:, 0], raw["q_meas_m"])
    assert np.array_equal(got.theta, got.q)
    assert np.array_equal(got.tau[:, 0], 35.15065188 * raw["u_V"])
    assert got.repairs == got.warnings == ()


def test_kr300() -> None:
    joints = tuple(
        Joint(f"a{i + 1}", gear_ratio=gear, transmission="elastic" if i < 3 else "rigid")
        for i, gear in enumerate(GEARS)
    )
    log = {
        "t": {"from": "t_s", "unit": "s"},
        "q": "q{i}_rad",
        "theta": "theta{i}_rad",
        "dq": "dq{i}_rad_s",
        "dtheta": "dtheta{i}_rad_s",
        "tau": {"from": "taum{i}_motorside_Nm", "unit": "N.m", "side": "motor"},
    }
    got, raw = read_recording([DATA / "kr300_A.csv"], Robot("kr", joints, log=log)), columns("kr300_A.csv")
    assert got.rate == pytest.approx(250)
    assert got.samples == 2501
    for i, gear in enumerate(GEARS, start=1):
        assert np.allclose(got.tau[:, i - 1], gear * raw[f"taum{i}_motorside_Nm"], rtol=1e-14)
        link = raw[f"q{i}_rad"] if i <= 3 else raw[f"theta{i}_rad"]
        assert np.array_equal(got.q[:, i - 1], link)
    assert got.dq is not None
    assert np.array_equal(got.dq[:, 5], raw["dtheta6_rad_s"])
    assert got.repairs == got.warnings == ()


def test_quanser() -> None:
    log = {
        "t": {"from": "t_s"},
        "theta": "theta{i}_rad",
        "q": {"from": "defl{i}_rad", "add": "theta"},
        "tau": {"from": "i{i}_A", "unit": "A", "scale": [8.925, 0.87]},
    }
    robot = Robot("quanser", (Joint("one"), Joint("two")), log=log)
    got, raw = read_recording([DATA / "quanser_2dsfl.csv"], robot), columns("quanser_2dsfl.csv")
    for i in (0, 1):
        assert np.array_equal(got.q[:, i], raw[f"defl{i + 1}_rad"] + raw[f"theta{i + 1}_rad"])
    assert np.allclose(got.tau[:, 1], 0.87 * raw["i2_A"], rtol=1e-14)
    assert got.repairs == ()
