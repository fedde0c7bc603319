"""The replay against an integration that shares no step with it, MuJoCo, and what must hold at rest."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace as changed
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import elid_cli.model.rollout as rollout
import elid_cli.model.rollout_steps as rollout_steps
from elid_cli.cli import main
from elid_cli.errors import LogError, RobotError, UsageError
from elid_cli.experiment.replay import ReplayOptions, replay
from elid_cli.experiment.replay.actuators import with_actuators
from elid_cli.experiment.replay.errors import runaways
from elid_cli.logs.reading import read_recording
from elid_cli.logs.writing import write_recording
from elid_cli.model.drives import Joints
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.linearised import Linearised
from elid_cli.model.rollout import motion_of
from elid_cli.model.runs import runs_of
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import EffectSpec, Limits, Robot
from elid_cli.signals.recording import Recording, Segment

KP, KD = np.array([400.0, 150.0]), np.array([30.0, 10.0])
DT = 0.005
STIFF = read_robot("planar2").reference()[[p.kind == "K" for p in read_robot("planar2").parameter_names()]]
Torques = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Torques of effects on (links, motors), each (n,), of q, theta and their velocities."""


def rigid(robot: Robot, friction: float = 1.0) -> Robot:
    joints = [
        changed(j, transmission="rigid", parameters={
            **{k: v for k, v in j.parameters.items() if k != "K"}, "fs": friction * 2.0, "fv": 1.5})
        for j in robot.joints
    ]  # fmt: skip
    return changed(robot, joints=tuple(joints))


def commanded(robot: Robot, duration: float = 3.0, offset: float = 0.0, springs: Sequence[float] = (0, 0)) -> Recording:
    """Return a log of the arm under held commands, integrated with an adaptive method of high order."""
    dynamics = Dynamics(robot, friction_width=1e-3)
    t = np.arange(round(duration / DT) + 1) * DT
    wanted = np.stack([0.6 * np.sin(1.3 * t) + 0.3 * np.sin(4.1 * t), 0.5 * np.sin(2.2 * t + 1)], axis=1) - 1.2
    speed = np.gradient(wanted, DT, axis=0)
    x, rows = np.concatenate([wanted[0], np.zeros(2)]), [np.concatenate([wanted[0], np.zeros(2)])]
    for k in range(len(t) - 1):

        def slope(_: float, s: np.ndarray, k: int = k) -> np.ndarray:
            q, v = s[:2], s[2:]
            tau = KP * (wanted[k] - q) + KD * (speed[k] - v) - offset - np.array(springs) * q
            a, _ = dynamics.acceleration(q.tolist(), v.tolist(), q.tolist(), v.tolist(), tau.tolist())
            return np.concatenate([v, a])

        x = solve_ivp(slope, (0.0, DT), x, method="LSODA", rtol=1e-7, atol=1e-9).y[:, -1]
        rows.append(x)
    states = np.array(rows)
    q, v = states[:, :2], states[:, 2:]
    gains = {"kp": np.tile(KP, (len(t), 1)), "kd": np.tile(KD, (len(t), 1))}
    return Recording(
        joints=robot.joint_names, dt=DT, t=t, q=q, theta=q, tau=np.full_like(q, np.nan), dq=v,
        commands={"q_des": wanted, "dq_des": speed, **gains}, segments=(Segment(0, len(t)),), files=("made.csv",),
    )  # fmt: skip


def stairs(robot: Robot, dt: float, later: float = 1.0) -> Recording:
    """Return a log, every `dt`, of the arm under commands that step every 20 ms, integrated as `commanded` is.

    In the second half by `later` of what they do in the first.
    """
    dynamics, rng, hold = Dynamics(robot), np.random.default_rng(3), round(0.02 / dt)
    steps = np.repeat([0.6, 0.6 * later], [37, 38])[:, None] * rng.uniform(-1, 1, (75, 2)) - 1.2
    wanted = np.repeat(steps, hold, axis=0)
    t, rows = np.arange(len(wanted) + 1) * dt, [np.concatenate([steps[0], np.zeros(2)])]
    for told in wanted:

        def slope(_: float, s: np.ndarray, told: np.ndarray = told) -> np.ndarray:
            q, v = s[:2].tolist(), s[2:].tolist()
            a, _ = dynamics.acceleration(q, v, q, v, (KP * (told - s[:2]) - 0.3 * KD * s[2:]).tolist())
            return np.concatenate([s[2:], a])

        rows.append(solve_ivp(slope, (0.0, dt), rows[-1], method="DOP853", rtol=1e-9, atol=1e-11).y[:, -1])
    q, v = np.split(np.array(rows), 2, axis=1)
    gains = {"kp": np.tile(KP, (len(t), 1)), "kd": np.tile(0.3 * KD, (len(t), 1))}
    return Recording(
        joints=robot.joint_names, dt=dt, t=t, q=q, theta=q, tau=np.full_like(q, np.nan), dq=v,
        commands={"q_des": np.concatenate([wanted, wanted[-1:]]), "dq_des": np.zeros_like(q), **gains},
        segments=(Segment(0, len(t)),), files=("stairs.csv",), smooth=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def arm() -> Robot:
    return rigid(read_robot("planar2"))


@pytest.fixture(scope="module")
def log(arm: Robot) -> Recording:
    return commanded(arm)


def test_it_moves_as_an_integration_of_high_order_does(arm: Robot, log: Recording) -> None:
    found = replay(arm, log)
    assert (found.driven_by, found.horizon) == ("commands", None)
    assert np.ptp(found.measured, axis=0).min() > 0.5
    assert max(e.rms for e in found.error.values()) < 4e-5


@pytest.mark.parametrize("dt", [0.02, 0.01, 0.005])
def test_fast_motion_is_simulated_as_well_in_a_slow_log(dt: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of 1 ms are no help where the equations that they take are those of samples 20 ms apart."""
    free = rigid(read_robot("planar2"), friction=0.0)
    robot = changed(free, joints=tuple(changed(joint, limits=Limits()) for joint in free.joints))
    log = stairs(robot, dt)
    assert np.abs(log.dq).max() > 3.0
    fine = max(e.rms for e in replay(robot, log).error.values())
    monkeypatch.setattr("elid_cli.model.runs.FAR", np.inf)
    coarse = max(e.rms for e in replay(robot, log).error.values())
    assert fine < 5e-5
    assert coarse > 3 * fine


def test_stretches_of_unequal_pace_are_simulated_side_by_side() -> None:
    free = rigid(read_robot("planar2"), friction=0.0)
    robot = changed(free, joints=tuple(changed(joint, limits=Limits()) for joint in free.joints))
    found = replay(robot, stairs(robot, 0.02, later=0.01), ReplayOptions(horizon=0.3))
    assert max(e.rms for e in found.error.values()) < 5e-5


def test_finer_steps_come_nearer(arm: Robot, log: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    fine = replay(arm, log).mean_abs
    monkeypatch.setattr("elid_cli.model.runs.STEP", 5.1e-3)
    assert replay(arm, log).mean_abs > 2.5 * fine


@pytest.mark.parametrize("share", [0.4, np.inf])
def test_steps_of_half_leave_a_quarter_where_joints_turn_and_drives_are_at_their_limits(
    arm: Robot, log: Recording, share: float
) -> None:
    (run,) = runs_of(log, arm, None, np.zeros(2), commanded=True)
    equations, none = Linearised(arm), np.zeros((1, 2))
    kp, kd, told = (log.commands[name] for name in ("kp", "kd", "q_des"))
    needed = kp * (told - log.q) + kd * (log.commands["dq_des"] - log.dq)
    limit = share * np.abs(needed).max(axis=0)
    joints = Joints(none, np.array([[12.0, 5.0]]), np.array([[1.5, 1.5]]), none)
    local, found = equations.about(run.near[:, None], np.gradient(run.near, DT, axis=0)[:, None]), []
    for finer in (1, 2, 4):
        moved = run.delayed(np.zeros(2), finer=finer)
        alone = changed(moved, drives=changed(moved.drives, limit=limit))
        alone = alone.together([alone])
        x, v = rollout.variants_of(equations, local, alone.start, alone.drives, joints, DT)
        found.append(x[:, 0, 0])
    turns = np.diff(np.sign(v[:, 0, 0]), axis=0) != 0
    assert (np.count_nonzero(turns, axis=0) >= 3).all()
    coarse, fine = (np.sqrt(np.mean((b - a) ** 2, axis=0)) for a, b in pairwise(found))
    assert (coarse > 3.0 * fine).all()


def test_wrong_friction_shows(arm: Robot, log: Recording) -> None:
    assert replay(rigid(arm, 3.0), log).mean_abs > 5 * replay(arm, log).mean_abs


def test_a_torque_offset_of_the_file_takes_part(arm: Robot) -> None:
    from elid_cli.robot.robot import EffectSpec

    log = commanded(arm, 1.5, offset=3.0)
    told = changed(arm, effects=tuple(EffectSpec("torque_offset", j, {"offset": 3.0}) for j in arm.joint_names))
    assert replay(told, log).mean_abs < 4e-4
    assert replay(arm, log).mean_abs > 3e-3


def test_friction_holds_a_joint_at_rest(arm: Robot) -> None:
    still = changed(rigid(arm, 100.0), gravity=(0.0, 0.0, 0.0))  # 200 N·m of friction
    count = 200
    q = np.zeros((count, 2))
    tau = np.tile([150.0, -150.0], (count, 1))
    log = Recording(joints=arm.joint_names, dt=DT, t=np.arange(count) * DT, q=q, theta=q, tau=tau, dq=q,
                    segments=(Segment(0, count),), files=("rest",))  # fmt: skip
    found = replay(still, log, ReplayOptions(horizon=0.9))
    assert np.abs(found.simulated).max() < 2e-6  # while the friction finds its size
    assert np.ptp(found.simulated[10:170], axis=0).max() < 1e-9


@pytest.mark.parametrize("few", [0, 10])
def test_arrays_and_plain_loops_take_the_steps_of_compiled_ones(
    arm: Robot, log: Recording, monkeypatch: pytest.MonkeyPatch, few: int
) -> None:
    pytest.importorskip("numba")
    fast = replay(arm, log).simulated
    monkeypatch.setattr(rollout_steps, "compiled_steps", lambda: None)
    monkeypatch.setattr(rollout_steps, "FEW", few)
    np.testing.assert_allclose(replay(arm, log).simulated, fast, rtol=0, atol=1e-9)


def swinging(robot: Robot, torques: Torques) -> Recording:
    """Return a log of an elastic arm that falls without torque, but for those of effects on (links, motors)."""
    dynamics = Dynamics(robot)
    x0 = [0.3, -0.2, 0.3, -0.2]

    def slope(_: float, s: np.ndarray) -> np.ndarray:
        q, theta, v, w = s[:2], s[2:4], s[4:6], s[6:]
        extra = tuple(side.tolist() for side in torques(q, theta, v, w))
        a, b = dynamics.acceleration(q.tolist(), v.tolist(), theta.tolist(), w.tolist(), [0.0, 0.0], extra)
        return np.concatenate([v, w, a, b])

    t = np.arange(61) * DT
    exact = solve_ivp(slope, (0.0, t[-1]), [*x0, 0, 0, 0, 0], t_eval=t, rtol=1e-9, atol=1e-11).y.T
    return Recording(joints=robot.joint_names, dt=DT, t=t, q=exact[:, :2], theta=exact[:, 2:4], tau=np.zeros((61, 2)),
                     dq=exact[:, 4:6], dtheta=exact[:, 6:], segments=(Segment(0, 61),), files=("fall",))  # fmt: skip


def test_an_elastic_arm_swings_as_its_equations_say() -> None:
    robot = read_robot("planar2")
    log = swinging(robot, lambda q, theta, v, w: (0 * q, 0 * q))
    assert np.abs(log.q[-1] - log.q[0]).max() > 0.2
    assert replay(robot, log, ReplayOptions(horizon=10.0)).mean_abs < 1e-3


EFFECTS_OF_ELASTIC_JOINTS: dict[str, tuple[dict[str, float], float, Torques]] = {
    "link_spring": (
        {"stiffness": 900.0, "preload": 60.0}, 1e-3, lambda q, theta, v, w: (900.0 * q + 60.0, 0 * q)
    ),
    "link_viscous": ({"friction": 60.0}, 1e-5, lambda q, theta, v, w: (60.0 * v, 0 * q)),
    "quadratic_viscous": (
        {"amplitude": 4.0, "power": 2.0}, 2e-4, lambda q, theta, v, w: (0 * q, 4.0 * np.abs(w) * w)
    ),
    "load_friction": (  # of the load that the spring carries
        {"coefficient": 0.3}, 8e-4,
        lambda q, theta, v, w: (0 * q, 0.3 * np.abs(STIFF * (theta - q)) * np.tanh(w / 5e-3)),
    ),
}  # fmt: skip
"""Values, error of a replay that the log's 5 ms leave (rad), and the torques by formulas of their own."""


@pytest.mark.parametrize("effect", EFFECTS_OF_ELASTIC_JOINTS)
def test_effects_of_an_elastic_joint_act_on_its_link_or_on_its_motor(effect: str) -> None:
    robot = read_robot("planar2")
    values, near, torques = EFFECTS_OF_ELASTIC_JOINTS[effect]
    log = swinging(robot, torques)
    told = changed(robot, effects=tuple(EffectSpec(effect, name, values) for name in robot.joint_names))
    right, without = (replay(arm, log, ReplayOptions(horizon=10.0)) for arm in (told, robot))
    assert not right.left_out
    assert right.mean_abs < near < 0.02 * without.mean_abs


def test_a_motion_that_runs_away_has_no_number(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = read_robot("planar2")
    fall = swinging(robot, lambda q, theta, v, w: (0 * q, 0 * q))
    log = changed(fall, tau=1e-3 * np.sin(40 * fall.t)[:, None] * np.ones(2))  # no torque at all would count as none
    push = changed(robot, effects=(EffectSpec("link_spring", "joint2", {"stiffness": -2e6, "preload": 0.0}),))
    found = replay(push, log)
    assert found.lost == robot.joint_names
    assert set(runaways(found.error)) == {"joint1", "joint2"}
    file, bad = tmp_path / "fall.h5", tmp_path / "bad.yaml"
    write_recording(log, file)
    write_robot(push, bad)
    line = ["replay", str(file), "--robot", str(bad)]
    assert main(line) == 0
    told = capsys.readouterr().out
    assert "runs away: no replay with this robot. Try --horizon 0.1." in " ".join(told.split())
    assert told.count("ran away") == 6
    assert "inf" not in told.split("how it was computed")[0].replace("inertia", "")
    assert "e+" not in told
    assert main([*line, "--max-error", "1mrad"]) == 1
    assert "joint1 ran away" in " ".join(capsys.readouterr().err.split())
    page = tmp_path / "page.html"
    assert main([*line, "--json", "--against", "planar2", "--report", str(page)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["error"]["joint1"] == {"rms": None, "mean_abs": None, "offset": None}
    assert told["mean_abs"] is None
    assert told["after"]["mean_abs"] < 1e-3
    drawn = page.read_text("utf-8")
    assert "inf mrad" not in drawn
    assert "NaN" not in drawn
    assert '"nan"' not in drawn


def test_restarts_keep_a_replay_of_torques_near(arm: Robot, log: Recording) -> None:
    q, v = log.q, log.dq
    assert v is not None
    tau = KP * (log.commands["q_des"] - q) + KD * (log.commands["dq_des"] - v)
    torques = changed(log, tau=tau, commands={})
    often, seldom = (replay(arm, torques, ReplayOptions(horizon=h)).mean_abs for h in (0.1, 2.0))
    assert often < 0.2 * seldom
    assert replay(arm, torques).horizon == 0.5


def test_what_is_missing_is_named(arm: Robot, log: Recording) -> None:
    with pytest.raises(LogError, match="no kp and no kd"):
        replay(arm, changed(log, commands={"q_des": log.commands["q_des"]}))
    with pytest.raises(LogError, match="joint1 has no torque"):
        replay(arm, changed(log, commands={}))
    with pytest.raises(UsageError, match="--horizon"):
        replay(arm, log, ReplayOptions(horizon=0.01))


ARM = """<mujoco model="arm"><compiler angle="radian"/><option gravity="0 -9.81 0"/><worldbody>
<body name="one"><joint name="joint1" axis="0 0 1" armature="0.4" damping="1.5" frictionloss="2"/>
<inertial pos="0.25 0.02 0" mass="8" diaginertia="0.1 0.3 0.3"/>
<body name="two" pos="0.5 0 0"><joint name="joint2" axis="0 0 1" armature="0.2" damping="1" frictionloss="1"/>
<inertial pos="0.2 0 0" mass="4" diaginertia="0.05 0.1 0.1"/></body></body></worldbody></mujoco>"""


def test_mujoco_moves_the_exported_model_alike(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "arm.xml").write_text(ARM)
    robot = adapted(read_robot(tmp_path / "arm.xml"))
    log = commanded(robot)
    ours, theirs = (replay(robot, log, ReplayOptions(engine=engine)) for engine in ("elid", "mujoco"))
    assert ours.mean_abs < 4e-5
    assert np.abs(ours.simulated - theirs.simulated).mean() < 3e-4


def adapted(robot: Robot) -> Robot:
    return changed(robot, joints=tuple(changed(j, transmission="rigid") for j in robot.joints))


def test_the_command_judges_and_compares(
    arm: Robot, log: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, good, bad = tmp_path / "run.h5", tmp_path / "good.yaml", tmp_path / "bad.yaml"
    write_recording(log, file)
    write_robot(changed(arm, control={"kp": dict(zip(arm.joint_names, KP.tolist(), strict=True)),
                                      "kd": dict(zip(arm.joint_names, KD.tolist(), strict=True))}), good)  # fmt: skip
    write_robot(changed(rigid(arm, 3.0), control=read_robot(good).control), bad)
    line = ["replay", str(file), "--robot", str(good)]
    assert main([*line, "--against", str(bad), "--max-error", "1mrad", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["driven_by"] == "commands"
    assert told["after"]["mean_abs"] > 5 * told["before"]["mean_abs"]
    assert set(told["error"]["joint1"]) == {"rms", "mean_abs", "offset"}
    assert main([*line, "--max-error", "0.0005deg"]) == 1
    assert "mrad on average" in capsys.readouterr().out
    page = tmp_path / "page.html"
    assert main([*line, "--report", str(page)]) == 0
    assert "measured and simulated" in page.read_text("utf-8")


def test_variants_side_by_side_are_those_alone(arm: Robot, log: Recording) -> None:
    (run,) = runs_of(log, arm, None, np.zeros(2), commanded=True)
    equations = Linearised(arm)
    together = run.together([run])
    values = np.array([[2.0, 2.0], [1.0, 4.0], [3.0, 0.5]])
    none = np.zeros_like(values)
    joints = Joints(none, values, 0.5 * values, none)
    single = [Joints(none[k : k + 1], v, 0.5 * v, none[k : k + 1]) for k, v in enumerate(np.split(values, 3))]
    x, v = motion_of(equations, together.start, together.near, together.drives, single[0], DT)
    local = equations.about(x, v)
    every, _ = rollout.variants_of(equations, local, together.start, together.drives, joints, DT)
    for k in range(3):
        alone, _ = rollout.variants_of(equations, local, together.start, together.drives, single[k], DT)
        np.testing.assert_allclose(every[:, k], alone[:, 0], atol=1e-12)


def test_mujoco_simulates_a_file_as_it_stands_with_what_is_beside_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    base = '<worldbody><body name="base"><freejoint/><inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/>'
    base += '<geom size="0.1"/>'
    free = ARM.replace("<worldbody>", base).replace("</worldbody>", "</body></worldbody>")
    model = tmp_path / "arm.xml"
    model.write_text(free.replace("</mujoco>", '<actuator><position joint="joint1" kp="50"/></actuator></mujoco>'))
    robot = adapted(read_robot(model))
    offsets = [EffectSpec("torque_offset", name, {"offset": 3.0}) for name in robot.joint_names]
    drag = EffectSpec("quadratic_viscous", "joint2", {"amplitude": 0.1, "power": 2.0})
    moved = changed(robot, effects=(*offsets, drag))
    beside = tmp_path / "beside.json"
    beside.write_text(json.dumps({
        "actuators": {"offset": {"joint1": 3.0, "joint2": 3.0}},
        "effects": [{"effect": "quadratic_viscous", "joint": "joint2", "parameters": {"amplitude": 0.1, "power": 2.0},
                     "in_mjcf": False}],
    }))  # fmt: skip
    log = tmp_path / "log.h5"
    write_recording(commanded(robot, 3.0, offset=3.0), log)
    line = ["replay", str(log), "--robot", str(model), "--kp", "400,150", "--kd", "30,10", "--json"]
    told = {}
    for engine in ("elid", "mujoco"):
        assert main([*line, "--engine", engine, "--actuators", str(beside)]) == 0
        told[engine] = json.loads(capsys.readouterr().out)
    assert told["elid"]["mean_abs"] == pytest.approx(
        replay(moved, read_recording([str(log)], moved)).mean_abs, rel=1e-6
    )
    assert told["mujoco"]["left_out"] == ["quadratic_viscous of joint2"]
    assert told["mujoco"]["mean_abs"] < 1e-3
    assert main([*line, "--engine", "mujoco"]) == 0  # without the offset
    assert json.loads(capsys.readouterr().out)["mean_abs"] > 3e-3
    beside.write_text("[]")
    assert main([*line, "--actuators", str(beside)]) == 2
    assert "not a file of actuators" in capsys.readouterr().err
    assert main([*line, "--actuators", str(model)]) == 2
    err = capsys.readouterr().err
    assert f"{model} is not a file of actuators (JSON or YAML as --write-actuators makes it)" in err
    assert "indices" not in err
    assert "hint: a robot file is given by --robot" in err


def test_a_declared_torque_gain_takes_part_and_one_that_leaves_no_torque_is_refused(arm: Robot, log: Recording) -> None:
    name = arm.joint_names[0]
    told = {
        n: v * np.where(np.arange(arm.n) == 0, 1.25, 1.0) if n in ("kp", "kd") else v for n, v in log.commands.items()
    }
    wrong = changed(log, commands=told)  # gains are logged a quarter too large

    def off(gain: float) -> float:
        robot = changed(arm, effects=(*arm.effects, EffectSpec("torque_gain", name, {"gain": gain})))
        return replay(robot, wrong).mean_abs

    assert off(0.25) == pytest.approx(replay(arm, log).mean_abs, rel=1e-6)
    assert off(0.25) < 0.1 * replay(arm, wrong).mean_abs
    with pytest.raises(RobotError, match="no torque"):
        off(-1.0)


def test_friction_that_fades_in_counts_from_the_file_beside_an_mjcf_that_holds_it(arm: Robot, tmp_path: Path) -> None:
    soft = {"effect": "soft_friction", "joint": "joint1", "parameters": {"friction": 1.0, "velocity": 0.1}}
    beside = tmp_path / "beside.json"
    beside.write_text(json.dumps({"actuators": {}, "effects": [{**soft, "in_mjcf": True}]}))
    found = with_actuators(arm, str(beside))  # elid takes friction of an MJCF to hold a joint at rest
    assert [spec.effect for spec in found.effects[len(arm.effects) :]] == ["soft_friction"]
