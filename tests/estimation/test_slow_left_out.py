"""--min-velocity leaves out what is slower, also of a motor that glides through zero."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.estimation.identify import identify
from elid_cli.experiment.simulation.run import SimulationOptions, simulate
from elid_cli.robot.files import read_robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare


def test_what_the_user_calls_too_slow_is_left_out_where_motors_glide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing was: reversals of a joint whose residual there is no larger count whatever the option said."""
    monkeypatch.setattr("elid_cli.estimation.default_fit.STICKING", 1e9)  # every motor glides
    robot = read_robot("planar2")
    log = simulate(robot, SimulationOptions(duration=6.0, seed=1))
    assert log.theta is not None
    free = identify(robot, prepare(log, robot))
    asked = identify(robot, prepare(log, robot, SignalOptions(min_velocity=0.5)))
    slow = np.mean(np.abs(np.gradient(log.theta, log.dt, axis=0)) < 0.5, axis=0)
    assert max(free.settings["masked"]) == 0.0
    assert np.all(np.array(asked.settings["masked"]) > 0.8 * slow)
