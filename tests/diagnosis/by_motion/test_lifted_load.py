"""A body that is too heavy behind a joint that slides upwards, whose weight is an offset of that joint's drive."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.carried import load_by
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.logs.reading import read_recording
from elid_cli.logs.writing import write_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare

NAMES, DT, FINE = ("lift", "tip"), 0.005, 40
CARRIAGE, MASS, CENTRE, INERTIA, MORE = 8.0, 1.5, 0.12, 0.008, 0.4
ARMATURE, COULOMB, VISCOUS, OFFSET = (4.0, 0.02), (10.0, 0.25), (30.0, 0.15), (2.0, -0.05)
KP, KD, SIZES = (6e3, 25.0), (200.0, 1.0), (0.08, 0.5)


def described(folder: Path) -> Robot:
    path = folder / "lifted.xml"
    path.write_text(
        '<mujoco model="lifted"><worldbody><body name="carriage"><joint name="lift" type="slide" axis="0 0 1"/>'
        f'<inertial pos="0 0 0" mass="{CARRIAGE}" diaginertia="0.1 0.1 0.1"/>'
        f'<body name="arm"><joint name="tip" type="hinge" axis="0 1 0"/><inertial pos="{CENTRE} 0 0" mass="{MASS}" '
        f'diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body></body></worldbody></mujoco>'
    )
    return read_robot(path)


def moved(seed: int, more: float, seconds: float = 8.0) -> Recording:
    """Return a log of the arm with more mass in its centre, by Lagrange's equations of its two coordinates."""
    rng = np.random.default_rng(seed)
    count, h = round(seconds / DT) + 1, DT / FINE
    t, phase = DT * np.arange(count), rng.uniform(0, 2 * np.pi, (2, 3))
    waves = [(0.6, 1.4), (0.3, 3.3), (0.1, 8.1)]
    wanted = np.stack([sum(SIZES[k] * a * np.sin(w * (1 + 0.13 * k) * t + phase[k, n])
                           for n, (a, w) in enumerate(waves)) for k in range(2)], axis=1)  # fmt: skip
    mass = MASS + more
    moment, about = mass * CENTRE, INERTIA + mass * CENTRE**2

    def pulled(b: float, u: float, v: float, asked: tuple[float, float]) -> tuple[float, float]:
        x, y = (asked[k] - OFFSET[k] - VISCOUS[k] * w - COULOMB[k] * math.tanh(w / (1e-4 * SIZES[k]))
                for k, w in enumerate((u, v)))  # fmt: skip
        x -= moment * math.sin(b) * v * v + (CARRIAGE + mass) * 9.81
        y += moment * math.cos(b) * 9.81
        whole, near, last = CARRIAGE + mass + ARMATURE[0], -moment * math.cos(b), about + ARMATURE[1]
        det = whole * last - near * near
        return (last * x - near * y) / det, (whole * y - near * x) / det

    z, b, u, v = *wanted[0].tolist(), 0.0, 0.0
    q = np.empty((count, 2))
    for k, (first, second) in enumerate(wanted.tolist()):
        q[k] = z, b
        for _ in range(FINE):
            now = KP[0] * (first - z) - KD[0] * u, KP[1] * (second - b) - KD[1] * v
            p, r = pulled(b, u, v, now)
            z2, b2, u2, v2 = z + 0.5 * h * u, b + 0.5 * h * v, u + 0.5 * h * p, v + 0.5 * h * r
            now = KP[0] * (first - z2) - KD[0] * u2, KP[1] * (second - b2) - KD[1] * v2
            p, r = pulled(b2, u2, v2, now)
            z, b, u, v = z + h * u2, b + h * v2, u + h * p, v + h * r
    q += np.array([1e-5, 1e-4]) * rng.standard_normal(q.shape)
    gains = {"kp": np.tile(KP, (count, 1)), "kd": np.tile(KD, (count, 1))}
    return Recording(NAMES, DT, t, q, q, np.full_like(q, np.nan), commands={"q_des": wanted, **gains},
                     segments=(Segment(0, count),), files=("made.h5",))  # fmt: skip


def test_of_a_load_on_a_lift_the_mass_is_not_asked_for(tmp_path: Path) -> None:
    """Its weight is an offset of the lift's drive and its inertia that of a rotor."""
    assert load_by(described(tmp_path)).kept == (1, 3)


@pytest.mark.parametrize("seed", [1, 2])
def test_of_a_load_on_a_lift_its_moments_are_told(tmp_path: Path, seed: int) -> None:
    arm = described(tmp_path)
    write_recording(moved(seed, MORE), tmp_path / "log.h5")
    found = diagnose_motion(arm, prepare(read_recording([str(tmp_path / "log.h5")], arm), arm))
    (load,) = found.effects
    assert (load.effect, load.joint) == ("payload", None)
    assert "m" not in load.parameters
    for name, value in (("cx", MORE * CENTRE), ("cz", 0.0)):
        assert abs(load.parameters[name] - value) < 4 * load.std_error[name]
    assert load.std_error["cx"] < 0.02 * MORE * CENTRE
    assert not found.unexplained
    truth = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)
    np.testing.assert_allclose(found.fit_after.values[:, :3], truth[:, :3], rtol=0.02)
    np.testing.assert_allclose(found.fit_after.values[:, 3], truth[:, 3], atol=0.05)


TURNED = """<mujoco model="turned"><worldbody><body name="b1"><joint name="lift" type="slide" axis="0 0 1"/>
<inertial pos="0.05 0 0.1" mass="8" diaginertia="0.1 0.1 0.08"/><body name="b2" pos="0 0 0.3">
<joint name="turn" type="hinge" axis="0 0 1"/><inertial pos="0.15 0.01 0" mass="3" diaginertia="0.02 0.03 0.03"/>
<body name="b3" pos="0.35 0 0"><joint name="tip" type="hinge" axis="0 1 0"/>
<inertial pos="0.12 0 -0.02" mass="1.5" diaginertia="0.004 0.008 0.008"/></body></body></body></worldbody></mujoco>"""


def test_a_load_goes_before_wrong_gains_of_several_joints(tmp_path: Path) -> None:
    """More mass in the last body's centre is, to all but the drives, a torque of another size at every joint."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(TURNED)
    model.body_mass[-1] += MORE
    h, count, each = 5e-5, 2001, 100
    model.opt.timestep, model.dof_armature[:] = h, (4.0, 0.05, 0.02)
    mujoco.mj_setConst(model, state := mujoco.MjData(model))
    rng, t = np.random.default_rng(6), DT * np.arange(count)
    waves = [(0.6, 1.4), (0.3, 3.3), (0.1, 8.1)]
    sizes = np.array([0.08, 0.5, 0.5])
    wanted, rates = np.zeros((2, count, 3))
    for k, size in enumerate(sizes):
        for share, w in waves:
            w, phase = w * (1 + 0.13 * k), rng.uniform(0, 2 * np.pi)
            wanted[:, k] += size * share * np.sin(w * t + phase)
            rates[:, k] += size * share * w * np.cos(w * t + phase)
    kp, kd = np.array([6e3, 80.0, 25.0]), np.array([200.0, 4.0, 1.0])
    coulomb, viscous, offset = np.array([[10, 0.6, 0.25], [30, 0.5, 0.15], [2, 0.1, -0.05]])
    state.qpos[:] = wanted[0]
    q = np.empty((count, 3))
    for k in range(count):
        q[k] = state.qpos
        for _ in range(each):
            slid = coulomb * np.tanh(state.qvel / (1e-4 * sizes)) + viscous * state.qvel + offset
            state.qfrc_applied[:] = kp * (wanted[k] - state.qpos) + kd * (rates[k] - state.qvel) - slid
            mujoco.mj_step(model, state)
    q += np.array([1e-5, 1e-4, 1e-4]) * rng.standard_normal(q.shape)
    told = {"q_des": wanted, "dq_des": rates, "kp": np.tile(kp, (count, 1)), "kd": np.tile(kd, (count, 1))}
    log = Recording(("lift", "turn", "tip"), DT, t, q, q, np.full_like(q, np.nan), commands=told,
                    segments=(Segment(0, count),), files=("made.h5",))  # fmt: skip
    write_recording(log, tmp_path / "log.h5")
    (tmp_path / "turned.xml").write_text(TURNED)
    arm = read_robot(tmp_path / "turned.xml")
    # the moment along the last axis is none but for rounding, which had been taken for one that joints feel
    assert {0, 1, 2, 3} & set(load_by(arm).kept) == {1, 3}
    found = diagnose_motion(arm, prepare(read_recording([str(tmp_path / "log.h5")], arm), arm))
    (load,) = found.effects
    assert (load.effect, load.joint) == ("payload", None)
    assert load.parameters["cx"] == pytest.approx(0.12 * MORE, rel=0.02)
    assert load.parameters["cz"] == pytest.approx(-0.02 * MORE, abs=4 * load.std_error["cz"])
    np.testing.assert_allclose(found.fit_after.values[:, 1], coulomb, rtol=0.01)
