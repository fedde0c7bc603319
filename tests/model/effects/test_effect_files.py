"""A robot file may declare any effect: it is written, read back as it was, and judged on a log."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.validation.prediction import validate
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.declared import resolve
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.signals import Signals, prepare
from tests.model.effects.effect_scenes import rigid

LIBRARY = effect_classes()


@pytest.fixture(scope="module")
def signals() -> Signals:
    robot = read_robot("planar2")
    log = simulate(robot, SimulationOptions(duration=3.0, rate=250.0, seed=2, sensors=SensorOptions(tau_link=True)))
    made = prepare(log, robot)
    # as under a position loop, of which some effects tell
    return replace(made, error_integrals=np.cumsum(np.stack([0.01 * made.tau, made.tau]), axis=1) * made.dt)


@pytest.mark.parametrize("name", LIBRARY)
def test_a_robot_with_the_effect_is_written_read_and_judged(name: str, signals: Signals, tmp_path: Path) -> None:
    plain = read_robot("planar2")
    if not LIBRARY[name].applies(plain, 0):
        plain = rigid(plain)
    spec = EffectSpec(name, None if LIBRARY[name].whole_robot else "joint1", {**LIBRARY[name].example})
    write_robot(replace(plain, effects=(spec,)), tmp_path / "robot.yaml")
    robot = read_robot(tmp_path / "robot.yaml")
    assert [(s.effect, s.joint, dict(s.parameters)) for s in robot.effects] == [(name, spec.joint, spec.parameters)]
    assert resolve(robot, robot.effects[0])[0] is LIBRARY[name]
    with_it, without = (validate(r, signals).residual for r in (robot, plain))
    change = [np.nanmax(np.abs(with_it[row] - without[row])) for row in without]
    assert np.all(np.isfinite(change))
    # how a drive's loop filters and how often it acts is in the simulated motion
    assert (max(change) > 1e-3) == (LIBRARY[name].of_drive not in ("kp", "kd", "filter", "hold", "step"))
