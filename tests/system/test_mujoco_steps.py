"""MuJoCo at the steps that it is usually run with: its integrators, told by the motion alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.logs.writing import write_recording
from elid_cli.robot.files import read_robot
from elid_cli.signals.recording import Recording, Segment

mujoco = pytest.importorskip("mujoco")

NAMES = ("hip", "thigh", "calf")
TRUTH = {"Ja": (0.012, 0.011, 0.02), "fv": (0.12, 0.1, 0.15), "fs": (0.25, 0.2, 0.3)}
KP, KD, DT, DURATION = 30.0, 0.8, 0.002, 12.0
QUANTUM = 2 * np.pi / 2**16
JOINT = '<joint name="{}" axis="{}" armature="{}" damping="{}" frictionloss="{}"/>'
INERTIAL = '<inertial pos="{}" mass="{}" diaginertia="{}"/>'
LINKS = (
    ("0 0 0", "1 0 0", ("0 0.03 0", 0.7, "0.001 0.001 0.001")),
    ("0 0.09 0", "0 1 0", ("0.005 -0.01 -0.05", 1.1, "0.006 0.006 0.001")),
    ("0 0 -0.21", "0 1 0", ("0.004 0 -0.12", 0.25, "0.003 0.003 0.0001")),
)


def model(integrator: str, drives: str, *, known: bool) -> str:
    """Return a leg's MJCF, with the drives' parameters or with others."""
    inner = ""
    for k in reversed(range(3)):
        place, axis, body = LINKS[k]
        values = [TRUTH[kind][k] if known else guess for kind, guess in (("Ja", 0.02), ("fv", 0.05), ("fs", 0.1))]
        own = JOINT.format(NAMES[k], axis, *values) + INERTIAL.format(*body)
        inner = f'<body name="link_{k}" pos="{place}">{own}{inner}</body>'
    option = f'<option timestep="{DT}" integrator="{integrator}"/>'
    return f'<mujoco model="leg">{option}<worldbody>{inner}</worldbody><actuator>{drives}</actuator></mujoco>'


def recorded(integrator: str) -> Recording:
    """Return a log of the leg under position actuators, at every step."""
    drives = "".join(f'<position joint="{name}" kp="{KP}" kv="{KD}"/>' for name in NAMES)
    plant = mujoco.MjModel.from_xml_string(model(integrator, drives, known=True))
    data, rng = mujoco.MjData(plant), np.random.default_rng(4)
    t = DT * np.arange(round(DURATION / DT))
    q_des = np.tile([0.0, 0.7, -1.4], (len(t), 1))
    for k in range(3):
        for f in rng.uniform(0.2, 3.0, 6):
            size = rng.uniform(0.05, 0.16) / max(np.sqrt(f), 0.6)
            q_des[:, k] += size * np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi))
    data.qpos[:] = data.ctrl[:] = q_des[0]
    for _ in range(500):
        mujoco.mj_step(plant, data)
    q = np.empty_like(q_des)
    for k, asked in enumerate(q_des):
        q[k], data.ctrl[:] = data.qpos, asked
        mujoco.mj_step(plant, data)
    q = QUANTUM * np.round(q / QUANTUM)
    gains = {"kp": np.full_like(q, KP), "kd": np.full_like(q, KD)}
    return Recording(
        joints=NAMES, dt=DT, t=t, q=q, theta=q, tau=np.full_like(q, np.nan),
        commands={"q_des": q_des, "dq_des": np.zeros_like(q), **gains}, segments=(Segment(0, len(t)),), files=("made",),
    )  # fmt: skip


@pytest.mark.parametrize(("integrator", "implicit"), [("Euler", 0), ("implicitfast", 1)])
def test_armature_is_the_models_in_the_steps_of_its_integrator(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], integrator: str, implicit: int
) -> None:
    robot = tmp_path / "leg.xml"
    robot.write_text(model(integrator, "", known=False))
    write_recording(recorded(integrator), tmp_path / "log.h5")
    assert main(["identify", str(tmp_path / "log.h5"), "--robot", str(robot), "--fit", "trajectory", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    steps = [item["parameters"] for item in found["nuisances"] if item["effect"] == "euler_steps"]
    assert [(own["step"], own["implicit"]) for own in steps] == [(pytest.approx(DT), implicit)] * 3
    values = found["settings"]["trajectory"]["joint_parameters"]
    assert max(found["settings"]["trajectory"]["noise_ratio"].values()) < 1.1
    for k, name in enumerate(NAMES):
        for kind, truth in TRUTH.items():
            own = values[name][kind]
            assert own["estimate"] == pytest.approx(truth[k], rel=2e-3), (name, kind)
            assert abs(own["estimate"] - truth[k]) < 4 * own["std_error"], (name, kind)
    assert read_robot(robot).n == 3
