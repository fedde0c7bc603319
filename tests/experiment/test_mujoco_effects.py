"""The snippet of the documentation applies in MuJoCo what an MJCF cannot hold, and the robot moves as elid's does."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from elid_cli.estimation.actuator_text import actuator_text
from elid_cli.estimation.actuators import Actuators
from elid_cli.estimation.mean_friction import MeanFriction, with_mean_friction
from elid_cli.experiment.mjcf import mjcf_text
from elid_cli.experiment.real_bodies import known_parameters
from elid_cli.experiment.simulation.effects_at_work import active_effects
from elid_cli.experiment.simulation.integration import System, reference_scene
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.effects import effect_classes
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Limits, Robot
from elid_cli.robot.urdf.write import with_parameters

mujoco = pytest.importorskip("mujoco")
SNIPPET = Path(__file__).parents[2] / "docs/how-to/mujoco_effects.py"
APPLIED = sorted(name for name, kind in effect_classes().items() if kind.acts_as and kind.nuisance is None)
OFFSET = next(name for name, kind in effect_classes().items() if kind.nuisance == "offset")


@pytest.fixture(scope="module")
def snippet() -> ModuleType:
    spec = importlib.util.spec_from_file_location("mujoco_effects", SNIPPET)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def arm(*effects: EffectSpec, rigid: bool = False) -> Robot:
    """Return the planar arm with effects, as it comes or with rigid joints of reflected inertia."""
    robot = read_robot("planar2")
    joints = []
    for joint in robot.joints:
        values = dict(joint.parameters)
        if rigid:
            del values["K"]
            values["Ja"] = 0.3
            del values["Jm"]
            joint = replace(joint, transmission="rigid", gear_ratio=None)
        joints.append(replace(joint, parameters=values, limits=Limits()))
    return replace(robot, joints=tuple(joints), effects=effects)


def of(name: str, **changes: float) -> EffectSpec:
    example = {k: v for k, v in effect_classes()[name].example.items() if k != "exponent"}
    return EffectSpec(name, "joint2", {**example, **changes})


def filed(
    robot: Robot, folder: Path, offsets: Mapping[str, float] | None = None, means: tuple[MeanFriction, ...] = ()
) -> Path:
    """Write the effects of a robot as --write-actuators does."""
    path = folder / "arm.json"
    told = json.loads(actuator_text(Actuators(robot, {}, robot.effects, means), yaml=False))
    told["actuators"] = {"offset": dict(offsets or {})}
    path.write_text(json.dumps(told), "utf-8")
    return path


def test_the_snippet_knows_every_effect_that_is_said_to_be_applied(snippet: ModuleType) -> None:
    assert set(snippet.LAWS) == set(APPLIED)


def accelerations(
    robot: Robot, snippet: ModuleType, path: Path, seed: int, means: tuple[MeanFriction, ...] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations of links and motors in one state, of elid and of MuJoCo, whose file holds mean frictions."""
    rng = np.random.default_rng(seed)
    elastic = bool(robot.elastic.any())
    q, dq, tau = rng.uniform(-1, 1, 2), rng.choice([-1.0, 1.0], 2) * rng.uniform(0.8, 2, 2), rng.uniform(-20, 20, 2)
    theta = q + (0.01 * rng.normal(size=2) if elastic else 0)
    dtheta = rng.choice([-1, 1], 2) * rng.uniform(0.8, 2, 2) if elastic else dq
    values = known_parameters(robot)
    dynamics = Dynamics(robot, values)
    system = System(dynamics, active_effects(robot, reference_scene(dynamics, 1e-3, 1.0)), 1e-3, 1.0)
    state = [*q, *theta, *dq, *dtheta] if elastic else [*q, *dq]
    ddq, ddtheta, _ = system.accelerations(0.0, state, tau.tolist())

    described = with_mean_friction(with_parameters(robot, values), means)
    model = mujoco.MjModel.from_xml_string(mjcf_text(described))
    data = mujoco.MjData(model)
    places = [model.joint(name).qposadr[0] for name in robot.joint_names]
    data.qpos[places], data.qvel[places] = q, dq
    ratio = robot.gear_ratios
    if elastic:
        rotors = [model.joint(f"{name}_rotor").qposadr[0] for name in robot.joint_names]
        data.qpos[rotors], data.qvel[rotors] = theta * ratio, dtheta * ratio
    data.ctrl[:] = tau
    mujoco.set_mjcb_passive(snippet.Effects(model, path))
    try:
        for _ in range(20):  # friction that follows the load follows the acceleration of the step before
            mujoco.mj_forward(model, data)
    finally:
        mujoco.set_mjcb_passive(None)
    found = [*data.qacc[places], *(data.qacc[rotors] / ratio if elastic else ())]
    return np.array([*ddq, *(ddtheta if elastic else ())]), np.array(found)


@pytest.mark.parametrize("name", APPLIED)
@pytest.mark.parametrize("rigid", [False, True], ids=["elastic", "rigid"])
def test_every_effect_accelerates_as_in_elid(name: str, rigid: bool, snippet: ModuleType, tmp_path: Path) -> None:
    if rigid and effect_classes()[name].elastic_only:
        pytest.skip("needs an elastic joint")
    robot, sizes = arm(of(name), rigid=rigid), []
    for seed in range(4):
        elid, theirs = accelerations(robot, snippet, filed(robot, tmp_path), seed)
        without, _ = accelerations(arm(rigid=rigid), snippet, filed(arm(rigid=rigid), tmp_path), seed)
        sizes.append(float(np.abs(elid - without).max()))
        assert np.abs(elid - theirs).max() < 1e-6 * np.abs(elid).max() + 2e-3 * sizes[-1]
    # small at this speed, this deflection, or none while the motor drives
    least = {"stribeck": 0.0, "cubic_stiffness": 0.0, "backdriving_friction": max(sizes)}.get(name, min(sizes))
    assert least > 1e-3 or name in ("stribeck", "cubic_stiffness")


def test_what_the_mjcf_holds_of_a_friction_is_not_added_again(snippet: ModuleType, tmp_path: Path) -> None:
    robot = arm(of("position_friction"), of("stribeck"), rigid=True)
    means = (MeanFriction(robot.effects[0], -0.3), MeanFriction(robot.effects[1], 0.2))
    plain, held = (filed(robot, tmp_path, means=of_file).read_text("utf-8") for of_file in ((), means))
    path = tmp_path / "arm.json"
    for seed in range(3):
        path.write_text(held, "utf-8")
        ours, theirs = accelerations(robot, snippet, path, seed, means)
        assert theirs == pytest.approx(ours, rel=1e-6, abs=1e-6)
        path.write_text(plain, "utf-8")
        assert np.abs(accelerations(robot, snippet, path, seed, means)[1] - ours).max() > 1e-3


def test_rotors_of_other_names_are_those_of_the_file(snippet: ModuleType, tmp_path: Path) -> None:
    text = mjcf_text(arm()).replace('"joint2_rotor"', '"spinner"')
    (tmp_path / "own.xml").write_text(text)
    robot = read_robot(tmp_path / "own.xml")
    assert robot.rotors["joint2"] == ("spinner", 0.1)
    drag = replace(robot, effects=(of("quadratic_viscous"),))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "own.xml"))
    applied = snippet.Effects(model, filed(drag, tmp_path))
    ((_, joint, motor, turns, _),) = applied.effects
    assert (model.joint(joint).name, model.joint(motor).name, turns) == ("joint2", "spinner", 0.1)


def motion(robot: Robot, steps: int, h: float) -> np.ndarray:
    """Return elid's link positions under a known torque, (steps, n)."""
    dynamics = Dynamics(robot, known_parameters(robot))
    system = System(dynamics, active_effects(robot, reference_scene(dynamics, h, 1.0)), h, 1.0)
    x, found = [0.0] * 4, []
    for k in range(steps):
        tau = pushed(k * h).tolist()
        x = system.step(k * h, h, x, (lambda theta, dtheta, tau=tau: tau,) * 3)
        found.append(x[:2])
    return np.array(found)


def pushed(t: float) -> np.ndarray:
    """Return the motors' torques, N·m."""
    return np.array([250.0 + 60 * np.sin(5 * t), 40.0 + 40.0 * np.sin(9 * t)])


def test_a_second_with_reversals_is_alike_and_unlike_without_the_snippet(snippet: ModuleType, tmp_path: Path) -> None:
    h, steps = 2.5e-4, 4000
    effects = (
        of("stribeck", amplitude=1.5, velocity=0.3), of("load_friction"), of("link_spring"), of("torque_ripple"),
        EffectSpec(OFFSET, "joint1", {"offset": 4.0}),
    )  # fmt: skip
    robot = arm(*effects, rigid=True)
    elid = motion(robot, steps, h)
    assert np.ptp(elid, axis=0).min() > 0.5

    def theirs(path: Path | None) -> np.ndarray:
        model = mujoco.MjModel.from_xml_string(mjcf_text(robot))
        model.opt.timestep = h
        data = mujoco.MjData(model)
        mujoco.set_mjcb_passive(snippet.Effects(model, path) if path else None)
        found = []
        try:
            for k in range(steps):
                data.ctrl[:] = pushed(k * h)
                mujoco.mj_step(model, data)
                found.append(data.qpos.copy())
        finally:
            mujoco.set_mjcb_passive(None)
        return np.array(found)

    kept = tuple(spec for spec in effects if spec.effect != OFFSET)
    path = filed(replace(robot, effects=kept), tmp_path, {"joint1": 4.0})
    with_it, without = (np.abs(theirs(p) - elid).max() for p in (path, None))
    assert with_it < 4e-3  # MuJoCo's steps are of first order, and its friction holds where elid's creeps
    assert without > 30 * with_it


def test_an_effect_that_is_no_passive_force_is_refused(snippet: ModuleType, tmp_path: Path) -> None:
    robot = arm(EffectSpec("friction_drift", "joint1", effect_classes()["friction_drift"].example))
    model = mujoco.MjModel.from_xml_string(mjcf_text(replace(robot, effects=())))
    with pytest.raises(ValueError, match="friction_drift of joint1 is no passive force"):
        snippet.Effects(model, filed(robot, tmp_path))


def test_what_the_mjcf_holds_or_is_the_drives_does_not_stop_the_rest(snippet: ModuleType, tmp_path: Path) -> None:
    soft = next(kind for kind in effect_classes().values() if kind.softens)
    drives = [kind for kind in effect_classes().values() if kind.place == "torque" and not kind.nuisance]
    assert {kind.of_drive for kind in drives} >= {"gain", "hold", "step"}
    own = (EffectSpec(soft.name, "joint1", soft.example), of("torque_ripple"))
    robot = arm(*own, *(EffectSpec(kind.name, "joint1", kind.example) for kind in drives), rigid=True)
    path = filed(robot, tmp_path)
    told = json.loads(path.read_text())
    assert [e["in_mjcf"] for e in told["effects"][:2]] == [True, False]
    told["actuators"]["delay"] = {"joint1": 0.003, "joint2": None}
    path.write_text(json.dumps(told))
    model = mujoco.MjModel.from_xml_string(mjcf_text(replace(robot, effects=own[:1])))
    with pytest.warns(UserWarning, match="not applied, as it is the drive's") as heard:
        applied = snippet.Effects(model, path)
    assert [effect["effect"] for effect, *_ in applied.effects] == ["torque_ripple"]
    (said,) = (str(item.message) for item in heard)
    assert "joint1: delay 0.003 s" in said
    assert all(f"joint1: {kind.name}" in said for kind in drives)
    assert soft.name not in said
