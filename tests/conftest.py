"""The order of the tests: folders of long files come first, so that no worker is left alone with one at the end."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import pytest

from elid_cli import diagnosis
from elid_cli.estimation.identify import Identification, identify
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare

LONG = ("diagnosis", "report", "system/measured", "estimation", "experiment", "system/test_public")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Move the tests of the long folders to the front; all others keep their order."""
    here = Path(__file__).parent

    def rank(item: pytest.Item) -> int:
        place = item.path.relative_to(here).as_posix()
        return next((k for k, folder in enumerate(LONG) if place.startswith(folder)), len(LONG))

    items.sort(key=rank)


def pytest_collection_finish() -> None:
    """Leave modules and tests, which all stay, out of every later search for garbage."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def diagnosed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands after the first one tell what that one found: for tests of what different ones say of one log."""
    found: list[Any] = []
    search = diagnosis.diagnose

    def once(*args: Any) -> Any:
        if not found:
            found.append(search(*args))
        return found[0]

    monkeypatch.setattr(diagnosis, "diagnose", once)


@pytest.fixture(scope="session")
def planar() -> Robot:
    return read_robot("planar2")


@pytest.fixture(scope="session")
def clean(planar: Robot) -> Recording:
    return simulate(planar, SimulationOptions(duration=8.0, rate=500.0, seed=3))


@pytest.fixture(scope="session")
def noisy(planar: Robot) -> Recording:
    sensors = SensorOptions(position_noise=3e-5, torque_noise_relative=0.03)
    return simulate(planar, SimulationOptions(duration=8.0, rate=500.0, seed=1, sensors=sensors))


@pytest.fixture(scope="session")
def found(planar: Robot, noisy: Recording) -> Identification:
    return identify(planar, prepare(noisy, planar))
