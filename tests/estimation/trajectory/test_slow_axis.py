"""A sliding axis that creeps from point to point: a fit with friction that holds loses it, and begins anew."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.trajectory import decided
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare

MASS, ARMATURE, COULOMB, VISCOUS, WIDTH = 35.0, 9.0, 18.0, 60.0, 0.008
KP, KD, DT, STEP, NOISE = 9e4, 3800.0, 0.005, 0.00025, 6e-6


@pytest.fixture(scope="module")
def axis(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path = tmp_path_factory.mktemp("axis") / "axis.xml"
    path.write_text(
        f'<mujoco model="axis"><worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0"/><inertial '
        f'pos="0 0 0" mass="{MASS}" diaginertia="1 1 1"/></body></worldbody></mujoco>'
    )
    robot = read_robot(path)
    return replace(robot, joints=tuple(replace(joint, transmission="rigid") for joint in robot.joints))


def crept(seed: int = 3, duration: float = 18.0, move: float = 1.2, rest: float = 0.4) -> Recording:
    """Return a log of moves of some centimetres."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(round(duration / DT))
    goals = np.concatenate([[0.0], rng.uniform(-0.05, 0.05, round(duration / (move + rest)) + 2)])
    number, part = np.divmod(t, move + rest)
    s = np.minimum(part / move, 1.0)
    a, b = goals[number.astype(int)], goals[number.astype(int) + 1]
    told = a + (b - a) * (10 * s**3 - 15 * s**4 + 6 * s**5)
    rate = (b - a) * (30 * s**2 - 60 * s**3 + 30 * s**4) / move
    x, v, places = 0.0, 0.0, []
    inertia = MASS + ARMATURE

    def pull(where: float, speed: float, q: float, dq: float) -> float:
        return (KP * (q - where) + KD * (dq - speed) - VISCOUS * speed - COULOMB * math.tanh(speed / WIDTH)) / inertia

    for q, dq in zip(told.tolist(), rate.tolist(), strict=True):
        places.append(x)
        for _ in range(round(DT / STEP)):
            one = pull(x, v, q, dq)
            two = pull(x + 0.5 * STEP * v, v + 0.5 * STEP * one, q, dq)
            x, v = x + STEP * (v + 0.5 * STEP * one), v + STEP * two
    place = (np.array(places) + rng.normal(0.0, NOISE, len(t)))[:, None]
    commands = {"q_des": told[:, None], "dq_des": rate[:, None],
                "kp": np.full((len(t), 1), KP), "kd": np.full((len(t), 1), KD)}  # fmt: skip
    tau = KP * (told[:, None] - place) + KD * (rate[:, None] - np.gradient(place, DT, axis=0))
    return Recording(("x",), DT, t, place, place, tau, commands=commands, segments=(Segment(0, len(t)),),
                     sources={"tau": "command"})  # fmt: skip


def test_a_creeping_axis_is_found_again(axis: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    log = crept()
    runs, start = commanded_runs(log, axis), started_from(axis, prepare(log, axis))
    found = fit_trajectory(axis, runs, start)
    error = found.unknowns.joint_values(found.deviation)[0]
    assert abs(found.values[0, 0] - ARMATURE) < 3 * error[0]
    assert found.values[0, 1] == pytest.approx(COULOMB, rel=0.05)
    assert found.settled_rms[0] < 1.4 * NOISE

    # without a second start as well: an inertia that a step would take away goes to its bound, and comes back
    monkeypatch.setattr(decided, "_lost", lambda fit, start: False)
    alone = fit_trajectory(axis, runs, start)
    assert abs(alone.values[0, 0] - ARMATURE) < 3 * error[0]
