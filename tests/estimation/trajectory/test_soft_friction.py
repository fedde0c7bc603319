"""Friction that fades in over a speed: its steps, and whether a fit finds it where it is, and only there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.errors import RobotError
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.result import Identification
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.experiment.mjcf import mjcf_text
from elid_cli.experiment.replay import ReplayOptions, replay
from elid_cli.experiment.simulation.effects_at_work import active_effects
from elid_cli.model.effects.library.soft_friction import SoftFriction
from elid_cli.model.rollout_loops import faded
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

WIDTH = 0.08
TRUTH = {"Ja": plant.ARMATURE, "fs": plant.COULOMB, "fv": plant.VISCOUS}


def smooth(x: np.ndarray, v: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Return friction as a simulator smooths it."""
    return plant.COULOMB * np.clip(v / WIDTH, -1.0, 1.0)


def none_dry(x: np.ndarray, v: np.ndarray, load: np.ndarray) -> np.ndarray:
    return -plant.COULOMB


@pytest.fixture(scope="module")
def pendulums(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    bare = plant.robot(tmp_path_factory.mktemp("pendulums"))
    return replace(bare, joints=tuple(replace(joint, transmission="rigid") for joint in bare.joints))


def computed(recording: Recording) -> Recording:
    """Return the log with the torque of its commands, as reading a file gives it."""
    told = recording.commands
    tau = told["kp"] * (told["q_des"] - recording.q) + told["kd"] * (told["dq_des"] - recording.dq)
    return replace(recording, tau=tau)


@pytest.fixture(scope="module")
def softly() -> Recording:
    return computed(plant.moved(3, delay=0.0025, push=smooth, grip=none_dry))


@pytest.fixture(scope="module")
def found(pendulums: Robot, softly: Recording) -> Identification:
    return identify(pendulums, prepare(softly, pendulums), EstimateOptions(fit="trajectory"))


@pytest.mark.parametrize("lead", [0.0, 0.004])
@pytest.mark.parametrize(("v", "push"), [(0.5, 0.0), (0.02, -3.0), (0.3, -9.0), (-0.004, 0.3), (0.0, 4.0)])
def test_one_joint_is_braked_as_its_equation_of_motion_says(v: float, push: float, lead: float) -> None:
    mass, friction, width, h, steps = 0.7, 2.0, 0.05, 1e-3, 60

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        # force of friction f = F sat((v + lead a) / w), a = (push - f) / m: solved for f
        slope = friction / width
        f = slope * (y + lead * push / mass) / (1.0 + slope * lead / mass)
        return (push - np.clip(f, -friction, friction)) / mass

    exact = solve_ivp(rate, (0, steps * h), [v], rtol=1e-10, atol=1e-12, max_step=1e-4).y[0, -1]
    now = v
    for _ in range(steps):
        free = now + h * push / mass
        now = free - faded(now, free, 1 / mass, h * friction, width, lead / h) / mass
    assert now == pytest.approx(exact, abs=2e-5)


def test_steps_that_are_long_beside_the_width_do_not_ring() -> None:
    now, speeds = 0.0103, []
    for _ in range(40):
        now = (free := now + 2e-3) - faded(now, free, 1.0, 5e-3, 1e-5, 0.0)
        speeds.append(now)
    # at rest but for the creep at which friction is 2/5 of itself
    np.testing.assert_allclose(speeds[10:], 0.4 * 1e-5, rtol=1e-6)


def test_width_and_drives_are_found_and_replay_as_the_log_moves(found: Identification, pendulums: Robot,
                                                                softly: Recording, tmp_path: Path) -> None:  # fmt: skip
    assert [(e.effect, e.joint) for e in found.effects] == [("soft_friction", name) for name in plant.NAMES]
    for item in found.effects:
        values, errors = item.parameters, item.std_error
        assert abs(values["velocity"] - WIDTH) < max(3 * errors["velocity"], 0.05 * WIDTH)
        assert values["lead"] < 1e-3
    drives = found.settings["trajectory"]["joint_parameters"]
    for kind, truth in TRUTH.items():
        for name, value in zip(plant.NAMES, truth, strict=True):
            assert drives[name][kind]["estimate"] == pytest.approx(value, rel=0.03), (name, kind)
    assert any("fades in over a speed" in note for note in found.notes)
    assert all(gain > 0.04 for gain in found.settings["trajectory"]["fading_friction"].values())
    # the robot file holds it, and elid's replay follows
    write_robot(identified_robot(found), str(tmp_path / "found.yaml"))
    again = read_robot(tmp_path / "found.yaml")
    assert replay(again, softly).mean_abs < 1.1 * 1e-4 * np.sqrt(2 / np.pi)


def test_friction_that_holds_is_not_found_to_fade(pendulums: Robot) -> None:
    for seed, delay in ((0, 0.0), (1, 0.006)):
        log = computed(plant.moved(seed, delay=delay))
        signals = prepare(log, pendulums)
        runs = commanded_runs(log, pendulums)
        fit = fit_trajectory(pendulums, runs, started_from(pendulums, signals))
        assert not fit.effects
        assert fit.held is None


def test_a_diagnosis_finds_it_behind_an_effect_that_hid_it(pendulums: Robot) -> None:
    def push(x: np.ndarray, v: np.ndarray, load: np.ndarray) -> np.ndarray:
        return smooth(x, v, load) + np.array([0.0, 1.2 * x[1], 0.0])

    log = computed(plant.moved(5, 5.0, delay=0.0025, push=push, grip=none_dry, sweep=0.28))
    told = diagnose_motion(pendulums, prepare(log, pendulums))
    named = {(e.effect, e.joint): e for e in told.effects}
    assert set(named) == {("link_spring", "two"), *(("soft_friction", name) for name in plant.NAMES)}
    assert named["link_spring", "two"].parameters["stiffness"] == pytest.approx(1.2, rel=1e-2)
    assert all(0.04 < e.gain <= 1 for e in told.effects)
    drives = told.fit_after.values
    truth = np.stack([plant.ARMATURE, plant.COULOMB, plant.VISCOUS], axis=1)
    np.testing.assert_allclose(drives[:, :3], truth, rtol=0.02)
    assert not told.fit_before.effects


def test_friction_that_an_effect_adds_fades_in_as_well(pendulums: Robot) -> None:
    def push(x: np.ndarray, v: np.ndarray, load: np.ndarray) -> np.ndarray:
        more = np.array([0.0, 0.25 * np.exp(-abs(v[1]) / 0.2), 0.0])
        return (plant.COULOMB + more) * np.clip(v / WIDTH, -1.0, 1.0)

    log = computed(plant.moved(6, push=push, grip=none_dry))
    told = diagnose_motion(pendulums, prepare(log, pendulums))
    named = {(e.effect, e.joint) for e in told.effects}
    assert named == {("stribeck", "two"), *(("soft_friction", name) for name in plant.NAMES)}
    # how the two share what is slower than the width is not seen, what is faster is
    truth = np.stack([plant.ARMATURE, plant.COULOMB, plant.VISCOUS], axis=1)
    np.testing.assert_allclose(told.fit_after.values[:, :3], truth, rtol=0.02)


@pytest.mark.parametrize("few", [0, 10])
def test_arrays_and_plain_loops_take_the_steps_of_compiled_ones(
    pendulums: Robot, monkeypatch: pytest.MonkeyPatch, few: int
) -> None:
    pytest.importorskip("numba")
    drives = zip(pendulums.joints, plant.ARMATURE, plant.COULOMB, plant.VISCOUS, strict=True)
    joints = tuple(
        replace(joint, parameters={**joint.parameters, "Ja": float(a), "fs": float(c), "fv": float(v)})
        for joint, a, c, v in drives
    )
    specs = (
        EffectSpec("soft_friction", "one", {"friction": 0.3, "velocity": 0.003, "lead": 0.0095}),
        EffectSpec("load_friction", "one", {"coefficient": -0.2}),
        EffectSpec("soft_friction", "two", {"friction": 0.1, "velocity": 0.05}),  # half of it holds
    )
    robot = replace(pendulums, joints=joints, effects=specs)
    short = computed(plant.moved(3, duration=2.0))
    fast = replay(robot, short).simulated
    monkeypatch.setattr("elid_cli.model.rollout_steps.compiled_steps", lambda: None)
    monkeypatch.setattr("elid_cli.model.rollout_steps.FEW", few)
    np.testing.assert_allclose(replay(robot, short).simulated, fast, rtol=0, atol=1e-9)


def test_a_declared_width_is_kept_and_nothing_else_is_asked(pendulums: Robot, softly: Recording) -> None:
    specs = tuple(EffectSpec("soft_friction", name, {"friction": 0.1, "velocity": WIDTH}) for name in plant.NAMES)
    robot = replace(pendulums, effects=specs)
    found = identify(robot, prepare(softly, robot), EstimateOptions(fit="trajectory"))
    assert [item.parameters["velocity"] for item in found.effects] == [WIDTH] * 3
    assert [item.parameters["friction"] for item in found.effects] == pytest.approx(list(plant.COULOMB), rel=0.03)
    assert found.settings["trajectory"]["fading_friction"] == {}


def test_a_simulation_refuses_a_lead(pendulums: Robot) -> None:
    from tests.model.effects.effect_scenes import planar, scene_of

    robot = planar()
    spec = EffectSpec("soft_friction", robot.joint_names[0], {"friction": 0.1, "velocity": 0.05, "lead": 0.01})
    with pytest.raises(RobotError, match="does not hold its lead"):
        active_effects(replace(robot, effects=(spec,)), scene_of(planar(), 10))
    assert SoftFriction.softens


def test_mujoco_has_the_same_friction_in_the_exported_file(
    pendulums: Robot, softly: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    mujoco = pytest.importorskip("mujoco")
    widths, lead = (0.002, 0.01, 0.05), 0.0095
    drives = zip(pendulums.joints, plant.ARMATURE, plant.COULOMB, plant.VISCOUS, strict=True)
    joints = tuple(
        replace(joint, parameters={**joint.parameters, "Ja": float(a), "fs": float(c), "fv": float(v)})
        for joint, a, c, v in drives
    )
    specs = tuple(
        EffectSpec("soft_friction", name, {"friction": float(c), "velocity": w, "lead": lead})
        for name, c, w in zip(plant.NAMES, plant.COULOMB, widths, strict=True)
    )
    robot = replace(pendulums, joints=joints, effects=specs)
    model = mujoco.MjModel.from_xml_string(mjcf_text(robot))
    impedance = model.dof_solimp[:, 0]
    time = impedance * model.dof_solref[:, 0] / 2
    speed = model.dof_frictionloss * time * model.dof_invweight0 * (1 - impedance) / impedance
    np.testing.assert_allclose(time, lead, rtol=1e-9)
    np.testing.assert_allclose(speed, widths, rtol=1e-9)
    assert "not in this file" not in mjcf_text(robot)
    # MuJoCo's steps are of first order: what they leave falls with their length, what friction makes does not
    monkeypatch.setattr("elid_cli.experiment.replay.engine.FINER", 32)
    ours, theirs, hard = (
        replay(machine, softly, ReplayOptions(engine=engine)).simulated
        for machine, engine in ((robot, "elid"), (robot, "mujoco"), (replace(robot, effects=()), "elid"))
    )
    assert np.abs(ours - theirs).mean() < 0.2 * np.abs(ours - hard).mean()
