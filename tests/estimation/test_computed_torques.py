"""What least squares say of torques that are computed from commands, and how sure they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.streaming.merge import identify_reduced
from elid_cli.estimation.streaming.reduce import reduce_each
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

TORQUE = EstimateOptions(fit="torque")
INERTIA = plant.INERTIA + plant.MASS * plant.REACH**2 + plant.ARMATURE
TRUTH = {
    f"{kind}{k + 1}{more}": value[k]
    for k in range(3)
    for kind, value, more in (
        ("fs", plant.COULOMB, ""), ("fv", plant.VISCOUS, ""), ("Iyy", INERTIA, f" + Ja{k + 1}"),
        ("cz", -plant.MASS * plant.REACH, ""),
    )
}  # fmt: skip


def test_a_velocity_sampled_as_its_command_changes_is_late_by_its_ripple(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plant, "COULOMB", np.full(3, 1e-9))
    log = plant.written(tmp_path, "log.h5", plant.moved(60, 9.0, noise=1e-6))
    robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
    found = identify(robot, prepare(read_recording([log], robot), robot), TORQUE)
    delays = [item.parameters["delay"] for item in found.nuisances if item.effect == "torque_delay"]
    assert delays == pytest.approx(plant.KD * plant.DT**2 / (12 * INERTIA), rel=0.02)


def test_intervals_hold_though_commands_are_stairs(tmp_path: Path) -> None:
    # a velocity sampled as its command changes is late by kd dt² / (12 inertia), here 18 to 38 µs: without a delay
    # viscous friction was up to 28 standard errors off
    scores = []
    for seed in (60, 61, 62, 63):
        log = plant.written(tmp_path, f"{seed}.h5", plant.moved(seed, 6.0))
        robot = robot_as_logged(plant.robot(tmp_path), [log], None, {})
        signals = prepare(read_recording([log], robot), robot)
        found = identify(robot, signals, TORQUE)
        values = {item.name: (item.estimate, item.std_error) for item in found.parameters}
        scores += [(values[name][0] - truth) / values[name][1] for name, truth in TRUTH.items()]
        delays = [item for item in found.nuisances if item.effect == "torque_delay"]
        assert {item.joint for item in delays} == set(plant.NAMES)
        assert all(abs(item.parameters["delay"]) < 5e-5 + 3 * item.std_error["delay"] < 2e-3 for item in delays)
        # what is reduced knows of commands as well
        again, _ = identify_reduced(robot, reduce_each(robot, signals, {}), TORQUE)
        assert [item.name for item in again.parameters] == [item.name for item in found.parameters]
        assert {n.joint for n in again.nuisances if n.effect == "torque_delay"} == set(plant.NAMES)
    assert np.abs(scores).max() < 4.0
    assert np.sqrt(np.mean(np.square(scores))) < 1.4
