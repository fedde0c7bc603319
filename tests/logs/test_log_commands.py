"""Logs that hold what the drives were told in place of a torque: kp (q_des - q) + kd (dq_des - dq) + tau_ff."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.errors import LogError, UsageError
from elid_cli.logs import read_map_options, write_recording
from elid_cli.logs.inspect import inspect_log
from elid_cli.logs.mapping.language import parse_mapping
from elid_cli.robot.robot import Limits, Robot
from elid_cli.robot.schema import robot_of_yaml
from elid_cli.robot.text import text_of
from elid_cli.signals.recording import Recording
from tests.logs.made_logs import JOINTS, ROBOT, read, recording

KP, KD = np.array([60.0, 40.0, 25.0]), np.array([1.5, 1.0, 0.5])
RIGID = replace(ROBOT, joints=tuple(replace(joint, transmission="rigid") for joint in ROBOT.joints))
CONTROLLED = replace(
    RIGID, control={"kp": dict(zip(JOINTS, KP, strict=True)), "kd": dict(zip(JOINTS, KD, strict=True))}
)
GO2 = Path(__file__).parents[3] / "shared" / "data" / "go2_0.h5"


def told() -> tuple[Recording, np.ndarray]:
    """Return a log of commands, and the torque that they made: the mean over the sample about each instant."""
    base = recording(2000, 500.0, velocities=True)
    assert base.dq is not None
    tau_ff = 2.0 * np.cos(3.0 * base.t)[:, None] * np.ones(3)
    wanted = base.tau - tau_ff
    q_des = base.q + (wanted + KD * base.dq) / KP
    commands = {"q_des": q_des, "tau_ff": tau_ff}
    before = {name: np.vstack([values[:1], values[:-1]]) for name, values in commands.items()}
    mean = {name: (values + before[name]) / 2 for name, values in commands.items()}
    return replace(base, commands=commands), KP * (mean["q_des"] - base.q) - KD * base.dq + mean["tau_ff"]


def without_torque(folder: Path, name: str, **gains: np.ndarray | float) -> Path:
    base, _ = told()
    path = folder / name
    write_recording(replace(base, tau=np.full_like(base.tau, np.nan)), path)
    if gains:
        with h5py.File(path, "a") as file:
            file.attrs.update(gains)
    return path


@pytest.mark.parametrize("name", ["log.csv", "log.h5"])
def test_the_torque_is_computed_from_commands_and_the_robots_gains(tmp_path: Path, name: str) -> None:
    log = read(without_torque(tmp_path, name), robot=CONTROLLED)
    np.testing.assert_allclose(log.tau, told()[1], rtol=1e-12, atol=1e-12)
    assert log.sources["tau"] == "command"
    assert any("tau is computed: kp (q_des - q)" in note for note in log.notes)
    assert set(log.commands) == {"q_des", "tau_ff", "kp", "kd"}


def test_gains_may_be_attributes_of_the_log_which_win_over_the_robots(tmp_path: Path) -> None:
    path = without_torque(tmp_path, "log.h5", kp=KP, kd=KD)
    np.testing.assert_allclose(read(path, robot=RIGID).tau, told()[1], rtol=1e-12, atol=1e-12)
    other = replace(CONTROLLED, control={"kp": dict.fromkeys(JOINTS, 1.0), "kd": CONTROLLED.control["kd"]})
    log = read(path, robot=other)
    np.testing.assert_allclose(log.tau, told()[1], rtol=1e-12, atol=1e-12)
    assert any("kp of shoulder is 60 in the log and 1 in the robot file" in note for note in log.notes)


def test_gains_may_be_one_number_or_arrays_or_constant_columns(tmp_path: Path) -> None:
    base, _ = told()
    scalar = without_torque(tmp_path, "scalar.h5", kp=60.0, kd=1.5)
    held = replace(base, tau=np.full_like(base.tau, np.nan))
    columns = {**held.commands, "kp": np.full_like(base.q, 60.0), "kd": np.full_like(base.q, 1.5)}
    write_recording(replace(held, commands=columns), tmp_path / "columns.csv")
    with h5py.File(without_torque(tmp_path, "arrays.h5"), "a") as file:
        file["kp"], file["kd"] = np.full(3, 60.0), 1.5
    logs = [read(path, robot=RIGID) for path in (scalar, tmp_path / "columns.csv", tmp_path / "arrays.h5")]
    given = read(without_torque(tmp_path, "log.h5"), robot=RIGID, mapping={"kp": {"value": 60}, "kd": {"value": 1.5}})
    for log in logs:
        np.testing.assert_allclose(log.tau, given.tau, rtol=1e-12, atol=1e-12)
        assert np.isfinite(log.tau).all()


def test_a_measured_torque_wins_unless_the_command_is_asked_for(tmp_path: Path) -> None:
    base, computed = told()
    write_recording(base, tmp_path / "log.h5")
    np.testing.assert_array_equal(read(tmp_path / "log.h5", robot=CONTROLLED).tau, base.tau)
    log = read(tmp_path / "log.h5", robot=CONTROLLED, mapping=read_map_options(["tau=command"]))
    np.testing.assert_allclose(log.tau, computed, rtol=1e-12, atol=1e-12)
    assert np.abs(log.tau - base.tau).max() > 0.1
    assert not any("whose name says that it is the commanded torque" in note for note in log.notes)


def test_the_torque_is_cut_at_the_joints_limit(tmp_path: Path) -> None:
    limited = tuple(replace(joint, limits=Limits(torque=15.0)) for joint in CONTROLLED.joints)
    log = read(without_torque(tmp_path, "log.h5"), robot=replace(CONTROLLED, joints=limited))
    np.testing.assert_allclose(log.tau, np.clip(told()[1], -15, 15), rtol=1e-12, atol=1e-12)
    assert any("the computed torque is above the robot file's limit of 15 N·m" in note for note in log.notes)


def test_commands_of_another_rate_are_held_and_not_interpolated(tmp_path: Path) -> None:
    t = np.arange(2000) / 500.0
    q = np.sin(2 * t)[:, None]
    slow = np.floor(np.arange(200) / 20) * 0.3 % 0.7
    robot = Robot("one", RIGID.joints[:1], control={"kp": {"shoulder": 10.0}, "kd": {"shoulder": 0.0}})
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["t"], file["q"], file["stamps"], file["told"] = t, q, t[::10], slow[:, None]
    log = read(tmp_path / "log.h5", robot=robot, mapping={"q_des": {"from": "/told", "time": "/stamps"}})
    held = np.repeat(slow, 10)[: log.samples]
    np.testing.assert_array_equal(log.commands["q_des"][:, 0], held)


def test_without_gains_the_error_says_what_to_give(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no gains kp kd to compute it from q_des") as caught:
        read(without_torque(tmp_path, "log.h5"), robot=RIGID)
    assert "--kp 20 --kd 0.5" in caught.value.hint
    assert "control: {kp: 20, kd: 0.5}" in caught.value.hint


@pytest.mark.parametrize(
    ("kp", "said", "detail"),
    [
        ("sixty", "no torque, and no usable gains kp to", "kp: /kp cannot be read: 'sixty', which is no number"),
        (KP[:2], "no torque, and no usable gains kp to", "kp: /kp holds 2 unnamed values per sample for 3 joint"),
        (KP * [1, -1, 1], f"kp of {JOINTS[1]} is -", "read from /kp"),
    ],
)
def test_gains_of_a_log_that_cannot_be_are_named_and_those_that_are_given_win(
    tmp_path: Path, kp: Any, said: str, detail: str
) -> None:
    path = without_torque(tmp_path, "log.h5", kp=kp, kd=KD)
    with pytest.raises(LogError, match=said) as caught:
        read(path, robot=RIGID)
    assert detail in caught.value.detail
    assert "--kp 20" in caught.value.hint
    log = read(path, robot=RIGID, mapping={"kp": {"value": KP.tolist()}})
    np.testing.assert_allclose(log.tau, told()[1], rtol=1e-12, atol=1e-12)


def test_a_wrong_number_of_gains_names_its_option() -> None:
    with pytest.raises(UsageError, match=r"^--kp: 2 numbers for 3 joints"):
        parse_mapping({"kp": {"value": [1.0, 2.0]}}, RIGID, "--map")


def test_control_of_a_robot_file_is_checked_and_comes_back() -> None:
    text = text_of(CONTROLLED)
    assert robot_of_yaml(text, "arm.yaml") == CONTROLLED
    plain = text[: text.index("control:")]
    assert robot_of_yaml(plain + "control: {kp: 20, kd: [1, 2, 3]}\n", "arm.yaml").control == {
        "kp": dict.fromkeys(JOINTS, 20.0),
        "kd": dict(zip(JOINTS, (1.0, 2.0, 3.0), strict=True)),
    }
    for wrong, said in (
        ("{ki: 3}", "ki"),
        ("{kp: [1, 2]}", "2 numbers where 3"),
        ("{kp: {hand: 1}}", "no joint 'hand'"),
        ("{kp: -1}", "not negative"),
    ):
        with pytest.raises(UsageError, match=said):
            robot_of_yaml(plain + f"control: {wrong}\n", "arm.yaml")


PLACES = {"FL_hip_joint": ("[0.1934, 0.0465, 0]", "[1, 0, 0]"), "FL_thigh_joint": ("[0, 0.0955, 0]", "[0, 1, 0]")}
PLACES["FL_calf_joint"] = ("[0, 0, -0.213]", "[0, 1, 0]")
LEG = "name: leg\ngravity: [0, 0, -9.81]\ndh: urdf\njoints:\n" + "".join(
    f"  - {{name: {name}, xyz: {xyz}, rpy: [0, 0, 0], axis: {axis}, gear_ratio: 6.33, motor_axis: {axis},\n"
    "     transmission: rigid}\n"
    for name, (xyz, axis) in PLACES.items()
)


@pytest.mark.skipif(not GO2.exists(), reason="needs the measured logs")
def test_a_quadrupeds_leg_is_identified_from_its_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "leg.yaml").write_text(LEG)
    assert main(["identify", str(GO2), "--robot", str(tmp_path / "leg.yaml"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert all(error["relative"] < 0.1 for error in found["error"].values())
    values = {p["name"]: p["estimate"] for p in found["base_parameters"]}
    # the laboratory's own fit by replay: armature 0.0426 kg·m² at the joint, damping 0.333, friction loss 0.714
    assert values["Jm3"] * 6.33**2 == pytest.approx(0.0426, rel=0.3)
    assert values["fs3"] == pytest.approx(0.714, rel=0.15)


@pytest.mark.parametrize("goal", ["", "goal_position"])
def test_commands_without_positions_are_asked_for_these(tmp_path: Path, goal: str) -> None:
    """What the log has of the commands is no answer to what it lacks."""
    base = recording(1200, 500.0, velocities=True)
    assert base.dq is not None
    columns = {f"q.{j}": base.q[:, k] for k, j in enumerate(JOINTS)} | {"t": base.t}
    columns |= {f"dq_des.{j}": base.dq[:, k] for k, j in enumerate(JOINTS)}
    columns |= {f"{goal}.{j}": base.q[:, k] for k, j in enumerate(JOINTS) if goal}
    path = tmp_path / "log.csv"
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    with pytest.raises(LogError, match="no torque, and no q_des to compute it from") as caught:
        read(path, robot=CONTROLLED)
    assert "of commands it has dq_des and no q_des (the log has no 'q_des." in caught.value.detail
    info = inspect_log(path, CONTROLLED)
    assert info.reasons["tau"].startswith("of commands it has dq_des and no q_des")
    if not goal:
        assert caught.value.hint.endswith("--map q_des=PLACE, or --map tau=PLACE")
        assert info.mapping == ""
        return
    assert caught.value.hint.endswith(f"--map {shlex.quote(info.mapping)}")
    log = read(path, robot=CONTROLLED, mapping=read_map_options([info.mapping]))
    assert log.sources["tau"] == "command"
    assert np.array_equal(log.commands["q_des"], base.q)


@pytest.mark.parametrize("still", [True, False])
def test_commands_that_make_no_torque_are_told_why(tmp_path: Path, still: bool) -> None:
    base, _ = told()
    q = np.tile(base.q[:1], (len(base.t), 1)) if still else base.q
    gains = (KP, KD) if still else (np.zeros(3), np.zeros(3))
    path = tmp_path / "log.h5"
    none = np.full_like(base.tau, np.nan)
    write_recording(replace(base, q=q, theta=q, dq=None, dtheta=None, tau=none, commands={"q_des": q.copy()}), path)
    with h5py.File(path, "a") as file:
        file.attrs.update(kp=gains[0], kd=gains[1])
    with pytest.raises(LogError, match="what the commands make is 0 throughout") as raised:
        read(path, robot=RIGID)
    assert raised.value.detail is not None
    assert raised.value.detail.startswith("nothing moves" if still else "kp and kd are 0 throughout")
