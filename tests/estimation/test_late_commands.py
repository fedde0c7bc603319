"""A torque that is computed from commands which act late: friction and inertia come out as they are."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.logs.checks.commanded import commanded_torque
from elid_cli.logs.reading import read_recording
from elid_cli.logs.writing import write_recording
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.one_pendulum import ROBOT

KP, KD, DT, FINE = 40.0, 1.5, 0.004, 40
INERTIA, COULOMB, VISCOUS, WEIGHT = 0.05, 0.3, 0.25, 1.6


def swing(late: int, seconds: float = 16.0) -> Recording:
    """Return the log of a pendulum whose commands act `late` steps of 0.1 ms late, integrated plainly."""
    count = round(seconds / DT)
    t = DT * np.arange(count)
    q_des = 0.5 * np.sin(2.0 * t) + 0.25 * np.sin(6.1 * t + 1) + 0.1 * np.sin(11.3 * t + 2)
    h, x, v = DT / FINE, float(q_des[0]), 0.0
    q = np.empty(count)
    for k in range(count):
        q[k] = x
        for s in range(FINE):
            told = KP * float(q_des[max((k * FINE + s - late) // FINE, 0)])
            half = v + 0.5 * h * _bend(x, v, told)  # midpoint rule
            x, v = x + h * half, v + h * _bend(x + 0.5 * h * v, half, told)
    column = q[:, None]
    commands = {"q_des": q_des[:, None], "kp": np.full_like(column, KP), "kd": np.full_like(column, KD)}
    noisy = column + 2e-6 * np.random.default_rng(late).standard_normal(column.shape)
    values = {"q": noisy, "theta": noisy, **commands}
    tau, _ = commanded_torque(values, commands, [(0, count)], DT, ROBOT)
    return Recording(("j",), DT, t, noisy, noisy, tau, commands=commands, segments=(Segment(0, count),),
                     files=("swing.h5",), sources={"tau": "command"})  # fmt: skip


def _bend(x: float, v: float, told: float) -> float:
    friction = COULOMB * math.tanh(v / 1e-3) + VISCOUS * v
    return (told - KP * x - KD * v - friction - WEIGHT * math.cos(x)) / INERTIA


@pytest.mark.parametrize("late", [0, 15, 40, 110])
def test_late_commands_give_nothing_to_friction_and_inertia(late: int) -> None:
    """Moved as a whole, the torque would give kp times the delay to viscous friction: 0.16 of 0.25 at 4 ms."""
    found = identify(ROBOT, prepare(swing(late), ROBOT))
    values = {item.name.split()[0]: item.estimate for item in found.parameters}
    assert values["fs1"] == pytest.approx(COULOMB, rel=2e-3)
    assert values["fv1"] == pytest.approx(VISCOUS, rel=5e-3)
    # m1 and cx1 stand for m - J / a² and c + J / a, J the inertia about the frame at the link's end
    assert 0.09 * values["m1"] + 0.6 * values["cx1"] == pytest.approx(INERTIA, rel=5e-3)
    assert 9.81 * (0.3 * values["m1"] + values["cx1"]) == pytest.approx(WEIGHT, rel=2e-3)
    delays = [n.parameters["delay"] for n in found.nuisances if n.effect == "torque_delay"]
    assert sum(delays) == pytest.approx(1e-4 * late, abs=1.5e-5)


def test_a_robot_that_declares_a_delay_is_written_with_the_whole_delay() -> None:
    late = EffectSpec("torque_delay", "j", {"delay": 2.5e-3})
    robot = replace(ROBOT, effects=(late,))
    written = identified_robot(identify(robot, prepare(swing(40), robot)))
    (delay,) = [spec.parameters["delay"] for spec in written.effects if spec.effect == "torque_delay"]
    assert delay == pytest.approx(4e-3, abs=3e-5)


def test_the_loop_of_an_elastic_joint_is_closed_by_its_motor(tmp_path: Path) -> None:
    """With the link's position in the drive's torque, K of this log comes out many standard errors off."""
    stiffness, rotor, link = 400.0, 0.05, 0.08
    arm = replace(ROBOT, joints=(replace(ROBOT.joints[0], transmission="elastic", gear_ratio=None),))
    count, h = round(16.0 / DT), DT / FINE
    t = DT * np.arange(count)
    q_des = 0.5 * np.sin(2.0 * t) + 0.25 * np.sin(6.1 * t + 1) + 0.1 * np.sin(21.3 * t + 2)
    state, logged = np.array([q_des[0], q_des[0], 0.0, 0.0]), np.empty((count, 2))

    def rate(at: np.ndarray, told: float) -> np.ndarray:
        q, theta, dq, dtheta = at.tolist()
        spring = stiffness * (theta - q)
        friction = COULOMB * math.tanh(dtheta / 1e-3) + VISCOUS * dtheta
        motor = (told - KP * theta - KD * dtheta - friction - spring) / rotor
        return np.array([dq, dtheta, (spring - WEIGHT * math.cos(q)) / link, motor])

    for k in range(count):
        logged[k] = state[:2]
        for _ in range(FINE):
            told = KP * float(q_des[k])
            state = state + h * rate(state + 0.5 * h * rate(state, told), told)
    rng = np.random.default_rng(3)
    q, theta = (logged[:, [side]] + 2e-6 * rng.standard_normal((count, 1)) for side in (0, 1))
    commands = {"q_des": q_des[:, None], "kp": np.full_like(q, KP), "kd": np.full_like(q, KD)}
    recording = Recording(("j",), DT, t, q, theta, np.full_like(q, np.nan), commands=commands,
                          segments=(Segment(0, count),), files=("elastic.h5",))  # fmt: skip
    write_recording(recording, tmp_path / "elastic.h5")
    read = read_recording([str(tmp_path / "elastic.h5")], arm)
    assert "motors' positions theta" in " ".join(read.notes)
    found = identify(arm, prepare(read, arm), EstimateOptions(fit="torque"))
    values = {item.name.split()[0]: item for item in found.parameters}
    for name, truth in (("K1", stiffness), ("Ja1", rotor), ("fs1", COULOMB), ("fv1", VISCOUS)):
        assert values[name].estimate == pytest.approx(truth, rel=0.01), name
        assert abs(values[name].estimate - truth) < 4 * values[name].std_error, name
