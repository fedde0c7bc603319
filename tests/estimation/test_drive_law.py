"""Logged torques that drives computed at the instants at which their commands step."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.signals.recording import Recording
from tests.diagnosis.by_motion.plant import DT, KD, KP, NAMES, VISCOUS, moved, robot, written


def with_torque(log: Recording) -> Recording:
    """Return a log with the torque of the drives at its samples, at which commands step."""
    told = log.commands
    tau = KP * (told["q_des"] - log.q) + KD * (told["dq_des"] - np.gradient(log.q, DT, axis=0))
    return replace(log, tau=tau, commands={name: told[name] for name in ("q_des", "dq_des")})


def identified(folder: Path, log: Recording, capsys: pytest.CaptureFixture[str], *more: str) -> dict[str, object]:
    line = [
        "identify",
        written(folder, "log.h5", log),
        "--robot",
        str(robot(folder).source),
        "--fit",
        "torque",
        "--json",
    ]
    assert main([*line, *more]) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def test_a_torque_at_the_steps_of_commands_is_doubted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = with_torque(moved(3, 9.0, noise=1e-5))
    found = identified(tmp_path, log, capsys)
    told = [line for line in found["warnings"] if "what the drive computes" in line]  # type: ignore[attr-defined]
    assert [line.split(":")[0] for line in told] == list(NAMES)
    values = {item["name"]: item for item in found["base_parameters"]}  # type: ignore[attr-defined]
    for k in range(3):
        item = values[f"fv{k + 1}"]
        assert item["bias_possible"]
        assert item["estimate"] - VISCOUS[k] == pytest.approx(0.5 * DT * KP[k], rel=0.2)  # what the warning says


def test_a_measured_torque_is_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = with_torque(moved(3, 9.0, noise=1e-5))
    tau = 0.5 * (log.tau + np.roll(log.tau, 1, axis=0))  # as one that is measured in the middle
    noisy = replace(log, tau=tau + 0.05 * np.random.default_rng(1).standard_normal(tau.shape) * np.std(tau, axis=0))
    found = identified(tmp_path, noisy, capsys)
    assert not [line for line in found["warnings"] if "what the drive computes" in line]  # type: ignore[attr-defined]
