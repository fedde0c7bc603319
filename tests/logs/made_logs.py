"""A good log to break: three joints, smooth motion, small deflections, four seconds at 1 kHz."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli.logs import read_recording, write_recording
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.recording import Recording, Segment

JOINTS = ("shoulder", "elbow", "wrist")
GEARS = (100.0, 80.0, 50.0)
ROBOT = Robot("arm", tuple(Joint(name, gear_ratio=gear) for name, gear in zip(JOINTS, GEARS, strict=True)))
SIGNALS = ("q", "theta", "tau")
FIELDS = {"gyroscope": "gyro", "accelerometer": "accel"}
"""Sensors on links -> the field of a recording that holds what they measure."""


def recording(samples: int = 4000, rate: float = 1000.0, *, velocities: bool = False) -> Recording:
    """Return the good log."""
    t = np.arange(samples) / rate
    phase = 2 * np.pi * t[:, None] * np.array([0.5, 0.9, 1.3]) + np.array([0.1, 1.0, 2.0])
    speed = 2 * np.pi * np.array([0.5, 0.9, 1.3])
    q = np.sin(phase) * np.array([1.0, 0.7, 0.5])
    dq = np.cos(phase) * np.array([1.0, 0.7, 0.5]) * speed
    tau = 20 * np.cos(phase * 1.5) + 5 * q + 1.0
    theta = q + (tau - 2 * dq) / 4000  # the rest is friction
    return Recording(
        JOINTS,
        1 / rate,
        t,
        q,
        theta,
        tau,
        dq=dq if velocities else None,
        dtheta=dq * 1.001 if velocities else None,
        segments=(Segment(0, samples),),
    )


def like(base: Recording, **changes: object) -> Recording:
    """Return a copy with other arrays."""
    return replace(base, **changes)  # type: ignore[arg-type]


def written(folder: Path, name: str, base: Recording | None = None) -> Path:
    """Write the good log and return its path."""
    path = folder / name
    write_recording(base if base is not None else recording(), path)
    return path


def read(*paths: Path, robot: Robot = ROBOT, **options: object) -> Recording:
    """Read logs with the good robot."""
    return read_recording(list(paths), robot, **options)  # type: ignore[arg-type]


def same(got: Recording, wanted: Recording, tolerance: float = 0.0, signals: tuple[str, ...] = SIGNALS) -> None:
    """Assert that a recording holds the wanted numbers at the wanted times, wherever it has samples."""
    step = np.rint(got.t / wanted.dt).astype(int)
    assert np.abs(got.t - step * wanted.dt).max() < 1e-9
    for signal in signals:
        error = np.abs(getattr(got, signal) - getattr(wanted, signal)[step]).max()
        assert error <= tolerance, f"{signal} differs by {error}"
