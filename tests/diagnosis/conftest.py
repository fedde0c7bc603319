"""Logs that hold known effects, and what the diagnosis says of them; both made once."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests import forked
from tests.diagnosis.diagnosis_logs import Diagnosed, Logs, arm, log_with, moved


@pytest.fixture(scope="session")
def robot() -> Robot:
    return arm()


@pytest.fixture(scope="session")
def log(robot: Robot) -> Logs:
    run = moved(robot, 12.0, seed=1)
    return cache(lambda *effects: log_with(robot, run, effects))


@pytest.fixture(scope="session")
def diagnosed(robot: Robot, log: Logs) -> Diagnosed:
    def found(*effects: str) -> Diagnosis:
        recording = log(*effects)
        return diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate)))

    return cache(found)


@pytest.fixture(scope="session")
def elid() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Return elid as its own process."""
    kept = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "ELID_ROBOT")}

    def run(*arguments: str, cwd: Path, **env: str) -> subprocess.CompletedProcess[str]:
        return forked.run(arguments, cwd=cwd, env={**kept, "LC_ALL": "C.UTF-8", **env})

    return run
