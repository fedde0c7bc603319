"""What every effect of the library promises, whatever it is."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.model.effects import effect_classes, effect_that, twins_of
from elid_cli.model.effects.declared import as_observed, lost_effects, resolve
from elid_cli.model.effects.effect import Effect, Parameter
from elid_cli.model.effects.kinds import MemoryEffect
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.robot import EffectSpec
from tests.model.effects.effect_scenes import DT, instant, planar, scene_of, spatial
from tests.model.effects.test_effect_recipe import missing

LIBRARY = {name: kind for name, kind in effect_classes().items() if not missing(kind)}
"""Those that lack something fail in `test_effect_recipe.py`, which says what."""
BOTH = ("planar_scene", "spatial_scene")
IN_MOTION = "kp", "kd", "filter", "hold", "step"
"""How a drive filters, and when it acts, is in the simulated motion: no column holds it."""
CASES = [(name, which) for name in LIBRARY for which in BOTH if LIBRARY[name].of_drive not in IN_MOTION]
OVER_TIME = {name for name, kind in LIBRARY.items() if kind.corrects or kind.memory or kind.quasi_static}
AT_ONCE = [(name, which) for name, which in CASES if name not in OVER_TIME]
"""Without effects whose columns are derivatives over neighbouring samples; simulated in the log, not at an instant."""


def joints_of(kind: type[Effect], scene: Scene) -> list[int]:
    return [j for j in range(scene.robot.n) if kind.applies(scene.robot, j)]


def build(name: str, scene: Scene, joint: int) -> tuple[Effect, np.ndarray]:
    values = dict(LIBRARY[name].example)
    if name == "backlash":
        values["stiffness"] = float(scene.stiffness[joint])
    if name == "saturation":
        values["limit"] = float(np.quantile(np.abs(scene.tau[:, joint]), 0.9))
    if name == "velocity_coupling" and joint == 1:
        values["other"] = 1.0
    linear, shape = LIBRARY[name].coefficients(scene, joint, values)
    return LIBRARY[name](joint, shape), linear


@pytest.mark.parametrize("name", LIBRARY)
def test_an_example_names_parameters_and_is_within_their_bounds(name: str) -> None:
    kind = LIBRARY[name]
    specs = {p.name: p for p in (*kind.amplitudes, *kind.shapes)}
    assert kind.example
    for key, value in kind.example.items():
        assert specs[key].low <= value <= specs[key].high


@pytest.mark.parametrize("name", LIBRARY)
def test_metadata_is_complete(name: str) -> None:
    kind = LIBRARY[name]
    assert kind.__module__.rsplit(".", 1)[1] == kind.name == name
    for text in (kind.summary, kind.equation, kind.physics, kind.typical, kind.fingerprint, kind.record):
        assert isinstance(text, str)
        assert len(text) > 3
        assert "  " not in text.replace(",  ", "").replace(";  ", "")
    assert len(kind.summary) <= 72
    assert kind.place in ("motor", "link", "spring", "chain", "torque", "encoder", "sensor")
    assert kind.simulated in ("torque", "robot", "motor", "log", "loop")
    assert set(kind.twins) <= set(LIBRARY) - {name}
    specs = (*kind.amplitudes, *kind.shapes)
    assert kind.amplitudes
    assert len({p.name for p in specs}) == len(specs)
    for p in specs:
        assert isinstance(p, Parameter)
        assert p.unit
        assert p.meaning
        assert p.low < p.high
    assert not any(p.fixed for p in kind.amplitudes)


def test_twins_know_each_other() -> None:
    pairs = {(a, b) for a, kind in LIBRARY.items() for b in twins_of(kind)}
    assert pairs == {(b, a) for a, b in pairs}
    assert ("backlash", "encoder_offset") in pairs


@pytest.mark.parametrize("role", ["corrects", "nuisance", "turns_gravity"])
def test_a_role_that_one_effect_has_is_played_by_one(role: str) -> None:
    roles = [getattr(kind, role) for kind in LIBRARY.values() if getattr(kind, role)]
    assert len(roles) == len(set(roles)) >= 1
    for value in roles:
        assert getattr(effect_that(**{role: value}), role) == value


@pytest.mark.parametrize(("name", "which"), CASES)
def test_columns_have_the_shape_they_promise(name: str, which: str, request: pytest.FixtureRequest) -> None:
    scene = request.getfixturevalue(which)
    for joint in joints_of(LIBRARY[name], scene):
        effect, linear = build(name, scene, joint)
        columns = effect.columns(scene)
        assert columns
        for row, values in columns.items():
            assert isinstance(row, EquationRow)
            assert row.side in ("link", "motor")
            assert 0 <= row.joint < scene.robot.n
            assert values.shape == (len(effect.amplitudes), scene.samples) == (len(linear), scene.samples)
            assert np.all(np.isfinite(values))
        assert any(np.any(values) for values in columns.values())


@pytest.mark.parametrize("name", LIBRARY)
def test_columns_neither_change_what_is_given_nor_depend_on_what_was_asked_before(name: str) -> None:
    scene = scene_of(planar(), 800)
    effect, _ = build(name, scene, 0)
    before = [np.array(a) for a in (scene.motion.theta, scene.motion.ddq, scene.tau, scene.load, scene.predicted)]
    first = {row: np.array(values) for row, values in effect.columns(scene).items()}
    for values in effect.columns(scene).values():
        values += 1.0  # a caller may scale columns in place
    again = effect.columns(scene)
    after = (scene.motion.theta, scene.motion.ddq, scene.tau, scene.load, scene.predicted)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    assert all(np.array_equal(first[row], again[row]) for row in first)


@pytest.mark.parametrize(("name", "which"), CASES)
def test_named_parameters_and_coefficients_invert_each_other(
    name: str, which: str, request: pytest.FixtureRequest
) -> None:
    scene = request.getfixturevalue(which)
    for joint in joints_of(LIBRARY[name], scene):
        effect, linear = build(name, scene, joint)
        values = effect.named(scene, linear)
        assert set(values) <= {p.name for p in (*effect.amplitudes, *effect.shapes)}
        assert all(type(v) is float for v in values.values())
        back, shape = LIBRARY[name].coefficients(scene, joint, values)
        np.testing.assert_allclose(back, linear, rtol=1e-12, atol=1e-15)
        assert shape == effect.shape
        assert values.items() >= {
            k: pytest.approx(v) for k, v in LIBRARY[name].example.items() if k in values
        }.items() or (name in ("backlash", "saturation", "velocity_coupling"))


@pytest.mark.parametrize(("name", "which"), CASES)
def test_least_squares_on_its_own_column_gives_the_parameters_back(
    name: str, which: str, request: pytest.FixtureRequest
) -> None:
    scene = request.getfixturevalue(which)
    for joint in joints_of(LIBRARY[name], scene):
        if LIBRARY[name].from_torque and not scene.robot.joints[joint].elastic:
            continue  # the load of these scenes is a multiple of the torque there
        effect, linear = build(name, scene, joint)
        stacked = np.concatenate(list(effect.columns(scene).values()), axis=1)
        scale = np.linalg.norm(stacked, axis=1)
        live = scale > 0
        target = linear[live] @ stacked[live]
        found = np.zeros(len(linear))
        found[live] = np.linalg.lstsq((stacked[live] / scale[live, None]).T, target, rcond=1e-10)[0] / scale[live]
        fitted, true = effect.named(scene, found), effect.named(scene, linear)
        hidden = {p.name for p, seen in zip(effect.amplitudes, live, strict=True) if not seen}
        assert not hidden or name in ("payload", "gravity_direction")
        for key in true.keys() - hidden:
            value = true[key]
            assert fitted[key] == pytest.approx(value, rel=1e-6, abs=1e-7), key


@pytest.mark.parametrize(("name", "which"), AT_ONCE)
def test_one_instant_gives_what_the_log_gives(name: str, which: str, request: pytest.FixtureRequest) -> None:
    scene = request.getfixturevalue(which)
    for joint in joints_of(LIBRARY[name], scene):
        effect, _ = build(name, scene, joint)
        whole = effect.columns(scene)
        for k in (0, 701, 1499):
            alone = effect.columns(instant(scene, k))
            for row, values in whole.items():
                np.testing.assert_allclose(
                    alone[row][:, 0] if row in alone else 0.0, values[:, k], rtol=1e-9, atol=1e-9
                )


@pytest.mark.parametrize("which", BOTH)
@pytest.mark.parametrize("name", [name for name, kind in LIBRARY.items() if kind.of_motor_speed])
def test_what_follows_from_a_motors_speed_follows_from_nothing_else(
    name: str, which: str, request: pytest.FixtureRequest
) -> None:
    scene = request.getfixturevalue(which)
    for joint in joints_of(LIBRARY[name], scene):
        effect, _ = build(name, scene, joint)
        speed = np.roll(scene.motion.dtheta, 100, axis=0)
        speed[:, joint] = scene.motion.dtheta[:, joint]
        rolled = {field: np.roll(getattr(scene.motion, field), 200, axis=0) for field in FIELDS if field != "dtheta"}
        other = replace(
            scene, motion=replace(scene.motion, dtheta=speed, **rolled), tau=2 * scene.tau, load=3 * scene.load,
            predicted=4 * scene.predicted, stiffness=5 * scene.stiffness, cache={},
        )  # fmt: skip
        for row, values in effect.columns(scene).items():
            np.testing.assert_array_equal(effect.columns(other)[row], values)


@pytest.mark.parametrize(("name", "which"), CASES)
def test_grids_hold_shapes_that_can_be_built(name: str, which: str, request: pytest.FixtureRequest) -> None:
    scene = request.getfixturevalue(which)
    kind = LIBRARY[name]
    for joint in joints_of(kind, scene):
        grid = kind.grid(scene, joint)
        assert len(grid) == len(set(grid)) <= 140
        assert kind.looks(scene, joint) >= len(grid)
        if issubclass(kind, MemoryEffect):  # a loop over samples in Python for each
            assert len(grid) <= 6
        for shape in grid:
            effect = kind(joint, shape)
            for p, value in zip(kind.shapes, effect.shape, strict=True):
                assert p.low <= value <= p.high
        for shape in grid[:: max(len(grid) // 5, 1)]:
            columns = kind(joint, shape).columns(scene)
            assert all(np.all(np.isfinite(v)) for v in columns.values())


@pytest.mark.parametrize("name", LIBRARY)
def test_grids_of_a_log_without_motion_do_not_fail(name: str) -> None:
    scene = scene_of(planar(), 400)
    still = scene.motion[np.zeros(400, dtype=np.intp)]
    quiet = scene_of(planar(), motion=type(still)(scene.motion.t, *[getattr(still, k) * 0 for k in FIELDS]))
    for shape in LIBRARY[name].grid(quiet, 0):
        columns = LIBRARY[name](0, shape).columns(quiet)
        assert all(np.all(np.isfinite(v)) for v in columns.values())


FIELDS = ("q", "dq", "ddq", "theta", "dtheta", "ddtheta")


@pytest.mark.parametrize("name", LIBRARY)
def test_the_usual_size_is_plausible(name: str, planar_scene: Scene) -> None:
    scene = planar_scene
    effect, linear = build(name, scene, 0)
    if name == "saturation":  # its evidence is a prediction that stays near the limit
        limit = effect.shape[0]
        scene = replace(scene, predicted=np.clip(scene.tau, -1.02 * limit, 1.02 * limit), cache={})
    assert type(effect).plausible(scene, 0, effect.named(scene, linear))


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("backlash", {"stiffness": 1200.0, "gap": 1e-3}),
        ("backlash", {"stiffness": -3000.0, "gap": 1e-3}),
        ("hysteresis", {"torque": -3.0, "distance": 1e-3}),
        ("torque_delay", {"delay": -0.03}),
        ("torque_delay", {"delay": 0.2}),
        ("transmission_damping", {"damping": -4.0}),
        ("saturation", {"cut": 0.3, "limit": 50.0}),
        ("saturation", {"cut": -1.0, "limit": 50.0}),
        ("load_friction", {"coefficient": -0.1}),
        ("quadratic_viscous", {"amplitude": -0.2, "power": 0.4}),
        ("link_coulomb", {"friction": -1.0}),
        ("link_viscous", {"friction": -1.0}),
        ("cubic_stiffness", {"cubic": -1e9}),
        ("flexible_mode", {"inertia": -0.1, "frequency": 9.0, "damping": 0.02}),
        ("contact", {"torque": 1e5, "time": 0.5, "width": 0.2}),
        ("contact", {"torque": 5.0, "time": 50.0, "width": 0.2}),
        ("contact", {"torque": 5.0, "time": 0.5, "width": 3.0}),
        ("encoder_offset", {"offset": 5.0}),
        ("encoder_skew", {"skew": 0.5}),
        ("encoder_scale", {"scale": 0.1}),
        ("gravity_direction", {"roll": 1.2, "pitch": 0.0}),
        ("torque_gain", {"gain": -1.0}),
        ("velocity_coupling", {"viscous": 1.0, "coulomb": 1.0, "other": 1.0}),
        ("velocity_coupling", {"viscous": 1.0, "coulomb": 1.0, "other": 3.0}),
        ("kinematic_error", {"amplitude": 0.5, "phase": 0.0, "order": 9.0}),
        ("stribeck", {"amplitude": 1.0, "velocity": 30.0, "exponent": 1.0}),
        ("stribeck", {"amplitude": 1.0, "velocity": 2e-3, "exponent": 1.0}),
    ],
)
def test_what_physics_forbids_is_not_plausible(name: str, values: dict[str, float], planar_scene: Scene) -> None:
    assert not LIBRARY[name].plausible(planar_scene, 0, values)


@pytest.mark.parametrize("name", LIBRARY)
def test_a_sign_that_physics_forbids_is_refused(name: str, planar_scene: Scene) -> None:
    kind = LIBRARY[name]
    bounded = [p for p in kind.amplitudes if np.isfinite(p.low) and p.name != "phase"]
    assert bounded or kind.takes_energy or kind.either_sign
    for parameter in bounded:
        below = {**kind.example, parameter.name: parameter.low - 0.1}
        assert not kind.plausible(planar_scene, 0, below), parameter.name


@pytest.mark.parametrize("exponent", [1.0, 2.0, -1.0])
@pytest.mark.parametrize("joint", [0, 1])
def test_a_friction_curve_fades_within_the_speeds_of_the_log(exponent: float, joint: int, planar_scene: Scene) -> None:
    """One that does not is Coulomb and viscous friction; below the slowest speeds there is only sticking."""
    top = float(np.quantile(np.abs(planar_scene.motion.dtheta[:, joint]), 0.98))
    plausible = {
        part: LIBRARY["stribeck"].plausible(
            planar_scene, joint, {"amplitude": 0.5, "velocity": part * top, "exponent": exponent}
        )
        for part in (0.01, 0.02, 0.1, 0.5, 0.98, 1.02, 3.0)
    }
    assert [part for part, is_so in plausible.items() if is_so] == [0.02, 0.1, 0.5, 0.98]


@pytest.mark.parametrize("name", LIBRARY)
def test_a_missing_parameter_is_a_key_error(name: str, planar_scene: Scene) -> None:
    kind = LIBRARY[name]
    with pytest.raises(KeyError) as caught:
        kind.coefficients(planar_scene, 0, {})
    assert caught.value.args[0] in {p.name for p in (*kind.amplitudes, *kind.shapes)}


def test_a_wrong_number_of_shapes_is_refused() -> None:
    with pytest.raises(ValueError, match="stribeck has 2 shape parameters"):
        LIBRARY["stribeck"](0, (0.1,))


def test_rigid_and_single_joints_have_no_effects_of_a_spring_or_of_others() -> None:
    robot = spatial()
    lone = type(robot)(name="lone", joints=robot.joints[:1])
    for name in ("backlash", "hysteresis", "kinematic_error", "encoder_skew", "link_coulomb", "transmission_damping"):
        assert not LIBRARY[name].applies(robot, 1)
        assert LIBRARY[name].applies(robot, 0)
    for name in ("velocity_coupling", "torque_gain"):
        assert not LIBRARY[name].applies(lone, 0)
    assert not LIBRARY["gravity_direction"].applies(type(robot)("flat", robot.joints, gravity=(0, 0, 0)), 0)
    assert [j for j in range(3) if LIBRARY["payload"].applies(robot, j)] == [2]


@pytest.mark.parametrize(
    ("effect", "alone", "why"),
    [
        ("backlash", False, "elastic transmission, and that of slide is rigid"),
        ("torque_gain", True, "has only one"),
        ("velocity_coupling", True, "has only one"),
    ],
)
def test_an_effect_that_does_not_apply_says_why(effect: str, alone: bool, why: str) -> None:
    robot = replace(spatial(), joints=spatial().joints[1:2]) if alone else spatial()
    with pytest.raises(RobotError, match=rf"does not apply to slide\n.*{why}"):
        resolve(robot, EffectSpec(effect, "slide"))


def test_a_log_without_link_positions_leaves_out_the_effects_that_need_them() -> None:
    declared = (EffectSpec("backlash", "joint2"), EffectSpec("backlash", "joint1"), EffectSpec("stribeck", "joint2"))
    robot = replace(planar(), effects=declared)
    log = SimpleNamespace(missing_link=np.array([False, True]), link_torque=np.array([False, False]))
    lost = lost_effects(robot, robot.stiffened(log.missing_link))
    assert [spec for spec, _ in lost] == [declared[0]]
    assert "rigid" in lost[0][1]
    shown = as_observed(robot, log)
    assert shown.effects == declared[1:]
    assert [joint.elastic for joint in shown.joints] == [True, False]
    assert lost_effects(shown, shown) == []


def test_the_library_is_imported_without_heavy_or_printing_packages() -> None:
    code = (
        "import sys; from elid_cli.model.effects import effect_classes; effect_classes();"
        "print([m for m in ('scipy', 'click', 'rich', 'h5py') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_sensor_effects_need_a_sensor(planar_scene: Scene) -> None:
    blind = replace(planar_scene, tau_link=None, cache={})
    for name in ("sensor_gain", "sensor_offset"):
        assert LIBRARY[name].grid(planar_scene, 0) == [()]
        assert LIBRARY[name].grid(blind, 0) == []


def test_dt_of_the_scenes_is_that_of_their_time(planar_scene: Scene) -> None:
    assert np.allclose(np.diff(planar_scene.motion.t), DT)
