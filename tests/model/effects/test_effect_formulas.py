"""Columns against formulas written a second time, by other means."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline

from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.bodies import body_columns, gravity_torque
from elid_cli.model.effects.harmonics import MANY
from elid_cli.model.effects.library.flexible_mode import FlexibleMode
from elid_cli.model.effects.library.hysteresis import Hysteresis
from elid_cli.model.effects.library.lookup import Lookup, b_splines
from elid_cli.model.effects.library.payload import independent
from elid_cli.model.effects.rows import derivative
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.motion import Motion
from tests.model.effects.effect_scenes import DT, motion_of, planar, scene_of, spatial, torque_of

LIBRARY = effect_classes()


def total(name: str, scene: Scene, joint: int = 0, **changes: float) -> dict[EquationRow, np.ndarray]:
    """Return the torque of an effect at its usual size, (N,) per row."""
    linear, shape = LIBRARY[name].coefficients(scene, joint, {**LIBRARY[name].example, **changes})
    columns = LIBRARY[name](joint, shape).columns(scene)
    return {row: linear @ values for row, values in columns.items()}


MOTOR = {
    "asymmetric_coulomb": lambda s, w: -0.4 * np.abs(s),
    "asymmetric_viscous": lambda s, w: -0.3 * np.abs(w),
    "quadratic_viscous": lambda s, w: 0.6 * s * w**2,
    "stribeck": lambda s, w: -0.25 * s * np.exp(-np.abs(w) / 0.1),
    "torque_offset": lambda s, w: 0.9 + 0 * w,
}


@pytest.mark.parametrize("name", MOTOR)
def test_friction_in_the_motor_row(name: str, planar_scene: Scene) -> None:
    for joint in (0, 1):
        w = planar_scene.motion.dtheta[:, joint]
        found = total(name, planar_scene, joint)
        assert set(found) == {EquationRow("motor", joint)}
        np.testing.assert_allclose(found[EquationRow("motor", joint)], MOTOR[name](np.tanh(w / 5e-3), w), atol=1e-12)


def test_the_papers_friction_is_two_stribeck_effects(planar_scene: Scene) -> None:
    f3, f4, f5, f6 = 0.2499, 0.0537, 0.2991, 16.624
    w = planar_scene.motion.dtheta[:, 0]
    w = np.where(np.abs(w) < 0.05, 0.05, w)
    scene = replace(planar_scene, motion=replace(planar_scene.motion, dtheta=np.stack([w, w], 1)), cache={})
    row = EquationRow("motor", 0)
    found = total("stribeck", scene, amplitude=-f3, velocity=f4)[row]
    found = found + total("stribeck", scene, amplitude=-f5, velocity=1 / f6, exponent=-1)[row]
    expected = -f3 * np.sign(w) * np.exp(-np.abs(w) / f4) - f5 * np.sign(w) * np.exp(-1 / (f6 * np.abs(w)))
    np.testing.assert_allclose(found, expected, atol=1e-8)
    assert LIBRARY["stribeck"].coefficients(scene, 0, {"amplitude": 1, "velocity": 0.2})[1] == (0.2, 1.0)


def test_the_rising_stribeck_term_vanishes_at_standstill(planar_scene: Scene) -> None:
    still = replace(planar_scene.motion, dtheta=np.zeros_like(planar_scene.motion.dtheta))
    scene = replace(planar_scene, motion=still, cache={})
    assert not np.any(total("stribeck", scene, exponent=-1.0)[EquationRow("motor", 0)])


def test_drift_has_no_mean_and_ends_at_half_the_change(planar_scene: Scene) -> None:
    s = planar_scene
    t, w = s.motion.t, s.motion.dtheta[:, 1]
    expected = (t / (3000 * DT) - 0.5) * (-0.3 * np.tanh(w / 5e-3) + 0.15 * w)
    np.testing.assert_allclose(total("friction_drift", s, 1)[EquationRow("motor", 1)], expected, atol=1e-12)


def test_friction_of_the_load_follows_the_spring_or_the_motor(spatial_scene: Scene) -> None:
    s = spatial_scene
    elastic = 0.1 * np.abs(4000 * (s.motion.theta[:, 0] - s.motion.q[:, 0])) * np.tanh(s.motion.dtheta[:, 0] / 5e-3)
    np.testing.assert_allclose(total("load_friction", s, 0)[EquationRow("motor", 0)], elastic, atol=1e-9)
    rigid = 0.1 * np.abs(s.load[:, 1]) * np.tanh(s.motion.dq[:, 1] / 5e-4)  # prismatic
    np.testing.assert_allclose(total("load_friction", s, 1)[EquationRow("motor", 1)], rigid, atol=1e-9)


def test_harmonics(planar_scene: Scene) -> None:
    s = planar_scene
    th, w = s.motion.theta[:, 1], s.motion.dtheta[:, 1]
    row = EquationRow("motor", 1)
    np.testing.assert_allclose(total("torque_ripple", s, 1)[row], 0.8 * np.sin(12 * th + 2.5), atol=1e-12)
    swing = 0.5 * np.sin(3 * th - 2.0) * np.tanh(w / 5e-3)
    np.testing.assert_allclose(total("position_friction", s, 1)[row], swing, atol=1e-12)
    error = 1800 * 4e-4 * np.sin(20 * th + 0.7)
    found = total("kinematic_error", s, 1)
    np.testing.assert_allclose(found[EquationRow("link", 1)], error, atol=1e-12)
    np.testing.assert_allclose(found[row], -error, atol=1e-12)


def test_harmonics_need_a_period_within_the_angle_covered(planar_scene: Scene) -> None:
    for name in ("torque_ripple", "position_friction", "kinematic_error"):
        for joint in (0, 1):
            span = np.ptp(planar_scene.motion.theta[:, joint])
            grid = [order for (order,) in LIBRARY[name].grid(planar_scene, joint)]
            assert min(grid) * span >= 2 * np.pi * LIBRARY[name].periods
            assert {12.0, 20.0} <= set(grid)


def test_every_order_in_between_resembles_one_of_the_grid(planar_scene: Scene) -> None:
    theta = planar_scene.motion.theta[:, 0]
    waves = np.array(
        [f(k * theta) for (k,) in LIBRARY["torque_ripple"].grid(planar_scene, 0) for f in (np.sin, np.cos)]
    )
    waves /= np.linalg.norm(waves, axis=1)[:, None]
    most = 2 * np.pi * MANY / np.ptp(theta)  # of less than half a turn
    assert most > 20
    for order in np.linspace(8.3, most, 14):
        wave = np.sin(order * theta)
        pairs = (waves @ wave / np.linalg.norm(wave)).reshape(-1, 2)
        assert np.max(np.hypot(pairs[:, 0], pairs[:, 1])) > 0.6, order


SPRING = {
    "backlash": lambda e, de, K, dq: -3000.0 * np.clip(e, -1.5e-3, 1.5e-3),
    "cubic_stiffness": lambda e, de, K, dq: 4e6 * e**3,
    "encoder_offset": lambda e, de, K, dq: K * 1e-3 + 0 * e,
    "sensor_gain": lambda e, de, K, dq: -0.04 * K * e,
    "sensor_offset": lambda e, de, K, dq: 1.5 + 0 * e,
    "transmission_damping": lambda e, de, K, dq: 8.0 * de,
}


@pytest.mark.parametrize("name", SPRING)
def test_effects_in_the_transmission(name: str, planar_scene: Scene) -> None:
    m = planar_scene.motion
    found = total(name, planar_scene)
    expected = SPRING[name]((m.q - m.theta)[:, 0], (m.dq - m.dtheta)[:, 0], 3000.0, m.dq[:, 0])
    np.testing.assert_allclose(found[EquationRow("link", 0)], expected, atol=1e-9)
    np.testing.assert_allclose(found[EquationRow("motor", 0)], -expected, atol=1e-9)


def test_a_scale_moves_the_spring_and_what_the_rotor_needs(planar_scene: Scene) -> None:
    m, joint = planar_scene.motion, planar_scene.robot.joints[0]
    found = total("encoder_scale", planar_scene)
    share = 1e-3 / (1 + 1e-3)
    np.testing.assert_allclose(found[EquationRow("link", 0)], 3000.0 * share * m.theta[:, 0], atol=1e-9)
    values = {
        p.kind: planar_scene.parameters[k] for k, p in enumerate(planar_scene.robot.parameter_names()) if p.joint == 0
    }
    rotor = values["Jm"] * (joint.gear_ratio or 1.0) ** 2 * m.ddtheta[:, 0] + values["fv"] * m.dtheta[:, 0]
    expected = -share * (3000.0 * m.theta[:, 0] + rotor)
    np.testing.assert_allclose(found[EquationRow("motor", 0)], expected, atol=1e-6)


def test_an_eccentric_encoder_moves_the_spring_and_what_the_bodies_need(planar_scene: Scene) -> None:
    scene, amplitude, phase = planar_scene, 1e-3, 0.7
    m, found = scene.motion, total("encoder_eccentricity", planar_scene)
    wrong, slope = amplitude * np.sin(m.q[:, 0] + phase), amplitude * np.cos(m.q[:, 0] + phase)
    np.testing.assert_allclose(found[EquationRow("motor", 0)], 3000.0 * wrong, atol=1e-9)
    q, dq, ddq = m.q.copy(), m.dq.copy(), m.ddq.copy()
    q[:, 0] -= wrong
    dq[:, 0] -= slope * m.dq[:, 0]
    ddq[:, 0] -= slope * m.ddq[:, 0] - wrong * m.dq[:, 0] ** 2
    bodies = [
        sum(
            scene.parameters[k] * body_columns(scene.robot, p.joint, motion)[:, LINK_PARAMETERS.index(p.kind)]
            for k, p in enumerate(scene.robot.parameter_names())
            if p.kind in LINK_PARAMETERS
        )
        for motion in (m.changed(q=q, dq=dq, ddq=ddq), m)
    ]
    expected = bodies[0] - bodies[1]
    expected[0] -= 3000.0 * wrong
    for joint in range(2):
        size = float(np.abs(expected[joint]).max())
        np.testing.assert_allclose(found[EquationRow("link", joint)], expected[joint], atol=2e-3 * size)


def test_a_skew_moves_the_spring_and_what_the_bodies_need(planar_scene: Scene) -> None:
    m = planar_scene.motion
    found = total("encoder_skew", planar_scene)
    spring = 3000.0 * 2e-3 * m.dq[:, 0]
    np.testing.assert_allclose(found[EquationRow("motor", 0)], -spring, atol=1e-9)
    bodies = found[EquationRow("link", 0)] - spring
    assert 0 < np.sqrt(np.mean(bodies**2)) < np.sqrt(np.mean(spring**2))
    assert np.any(found[EquationRow("link", 1)])  # the next link is moved along


def test_backlash_leaves_the_spring_of_a_dead_zone(planar_scene: Scene) -> None:
    e = planar_scene.deflection(0)
    spring = 3000 * e + total("backlash", planar_scene)[EquationRow("link", 0)]
    dead = 3000 * (np.maximum(e - 1.5e-3, 0) + np.minimum(e + 1.5e-3, 0))
    np.testing.assert_allclose(spring, dead, atol=1e-9)
    assert LIBRARY["backlash"].coefficients(planar_scene, 0, {"gap": 1e-3})[0] == pytest.approx([-3000.0])


def test_link_side(planar_scene: Scene) -> None:
    m, row = planar_scene.motion, EquationRow("link", 1)
    np.testing.assert_allclose(total("link_spring", planar_scene, 1)[row], 30 * m.q[:, 1] - 12, atol=1e-12)
    np.testing.assert_allclose(total("link_viscous", planar_scene, 1)[row], 0.8 * m.dq[:, 1], atol=1e-12)
    np.testing.assert_allclose(total("link_coulomb", planar_scene, 1)[row], 1.5 * np.tanh(m.dq[:, 1] * 200), atol=1e-12)


def test_velocity_coupling_takes_the_other_joints_speed(spatial_scene: Scene) -> None:
    w = spatial_scene.motion.dtheta[:, 2]
    found = total("velocity_coupling", spatial_scene, 0, other=3.0)[EquationRow("motor", 0)]
    np.testing.assert_allclose(found, 0.4 * w + 0.6 * np.tanh(w / 5e-3), atol=1e-12)
    assert LIBRARY["velocity_coupling"].grid(spatial_scene, 0) == [(2.0,), (3.0,)]


def test_saturation_is_the_torque_beyond_the_limit(planar_scene: Scene) -> None:
    tau = planar_scene.tau[:, 0]
    excess = np.sign(tau) * np.maximum(np.abs(tau) - 60, 0)
    np.testing.assert_allclose(total("saturation", planar_scene)[EquationRow("motor", 0)], excess, atol=1e-9)
    effect = LIBRARY["saturation"](0, (60.0,))
    for command in (-70.0, -60.0, 10.0, 60.0, 81.5):
        assert float(effect.delivered(np.array(command), np.ones(1))) == pytest.approx(np.clip(command, -60, 60))


def test_knees_are_tried_only_where_torque_is_missing(planar_scene: Scene) -> None:
    kind = LIBRARY["saturation"]
    limit = float(np.quantile(np.abs(planar_scene.tau[:, 0]), 0.9))
    tau = np.array(planar_scene.predicted)
    cut = replace(planar_scene, tau=tau, predicted=np.clip(tau, -limit, limit), cache={})
    assert any(abs(knee / limit - 1) < 0.2 for (knee,) in kind.grid(cut, 0))
    assert kind.grid(replace(planar_scene, tau=tau, cache={}), 0) == []


def test_the_delays_column_is_the_derivative_within_each_segment() -> None:
    scene = scene_of(planar(), 2000)
    t = scene.motion.t
    tau = np.stack([np.sin(3 * t), np.where(t < 1.0, np.sin(5 * t), 4 + np.cos(5 * t))], 1)
    scene = replace(scene, tau=tau, starts=(0, 1000))
    found = total("torque_delay", scene, 1)[EquationRow("motor", 1)]
    expected = np.where(t < 1.0 - 1e-9, 5 * np.cos(5 * t), -5 * np.sin(5 * t))
    np.testing.assert_allclose(found, 3e-3 * expected, atol=3e-6)
    assert not np.any(derivative(np.arange(2.0), DT))


def test_gravity_columns_are_the_difference_of_tilted_models(spatial_scene: Scene) -> None:
    s = spatial_scene
    flat = Motion(
        s.motion.t, s.motion.q, *[np.zeros_like(s.motion.q)] * 2, s.motion.q, *[np.zeros_like(s.motion.q)] * 2
    )
    effect = LIBRARY["gravity_direction"](0)
    columns = effect.columns(s)
    h = 1e-5
    for k in range(2):
        tilted = [effect.altered(s.robot, s.parameters, sign * h * np.eye(2)[k]).robot for sign in (1, -1)]
        plus, minus = (torque_of(robot, flat, s.parameters).sum(axis=0) for robot in tilted)
        for joint in range(3):
            expected = (plus - minus)[:, joint] / (2 * h)
            found = columns[EquationRow("link", joint)][k] if EquationRow("link", joint) in columns else 0 * expected
            np.testing.assert_allclose(found, expected, atol=1e-5 * (1 + np.abs(expected).max()))


def test_a_turned_gravity_keeps_its_size(spatial_scene: Scene) -> None:
    s = spatial_scene
    altered = LIBRARY["gravity_direction"](0).altered(s.robot, s.parameters, np.array([0.2, -0.1]))
    assert np.linalg.norm(altered.robot.gravity) == pytest.approx(np.linalg.norm(s.robot.gravity))
    assert altered.start == 0
    assert altered.parameters is s.parameters


def test_payload_columns_are_the_difference_of_the_models_with_and_without(spatial_scene: Scene) -> None:
    s = spatial_scene
    kind = LIBRARY["payload"]
    linear, shape = kind.coefficients(s, 2, LIBRARY["payload"].example)
    effect = kind(2, shape)
    linear = linear * independent(s.robot, 2)
    changed = effect.altered(s.robot, s.parameters, linear)
    assert changed.start == 0.7
    with_it, without = (torque_of(s.robot, s.motion, p).sum(axis=0) for p in (changed.parameters, s.parameters))
    for joint in range(3):
        found = linear @ effect.columns(s)[EquationRow("link", joint)]
        expected = (with_it - without)[:, joint] * (s.motion.t >= 0.7)
        np.testing.assert_allclose(found, expected, atol=1e-8)


def test_the_instant_of_a_payload_is_found_in_the_missing_torque(spatial_scene: Scene) -> None:
    s = spatial_scene
    linear, shape = LIBRARY["payload"].coefficients(s, 2, {"m": 0.8, "cx": 0.05, "start": 1.37})
    columns = LIBRARY["payload"](2, shape).columns(s)
    tau = np.array(s.predicted) + 0.5 * np.random.default_rng(0).normal(size=s.predicted.shape)
    for row, values in columns.items():
        tau[:, row.joint] += linear @ values
    # as a fit would have it: the mean payload is within the last body
    whole = np.concatenate(list(LIBRARY["payload"](2, (0.0,)).columns(s).values()), axis=1)
    rest = (tau - s.predicted).T.reshape(-1)
    rest = rest - np.linalg.lstsq(whole.T, rest, rcond=1e-9)[0] @ whole
    found = LIBRARY["payload"].grid(replace(s, tau=s.predicted + rest.reshape(3, -1).T, cache={}), 2)
    assert abs(found[0][0] - 1.37) < 0.02
    assert len(found) <= 3


def test_a_planar_arm_shows_mass_first_moment_and_one_inertia_of_a_payload() -> None:
    kept = dict(zip(LINK_PARAMETERS, independent(planar(), 1), strict=True))
    assert [name for name, keep in kept.items() if keep] == ["m", "cx", "cy", "Izz"]


def test_the_named_changes_of_a_payload_are_as_many_as_the_chain_can_show() -> None:
    robot = spatial()
    motion = motion_of(robot, 200)
    columns = body_columns(robot, 2, motion).transpose(1, 0, 2).reshape(10, -1)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=1), 1e-12)[:, None]
    assert independent(robot, 2).sum() == np.linalg.matrix_rank(columns, tol=1e-9)


def test_gravity_torques_are_the_models_at_rest(spatial_scene: Scene) -> None:
    s = spatial_scene
    rest = np.zeros_like(s.motion.q)
    flat = Motion(s.motion.t, s.motion.q, rest, rest, s.motion.q, rest, rest)
    expected = torque_of(s.robot, flat, s.parameters).sum(axis=0)
    found = gravity_torque(s.robot, s.motion.q, s.parameters, s.robot.gravity)
    np.testing.assert_allclose(found, expected.T, atol=1e-9)


def test_contact_is_a_raised_cosine(planar_scene: Scene) -> None:
    t = planar_scene.motion.t
    found = total("contact", planar_scene)[EquationRow("link", 0)]
    assert found[np.abs(t - 0.8) >= 0.15 + 1e-9].max() == 0
    assert found[800] == pytest.approx(12.0)
    assert found.sum() * DT == pytest.approx(12 * 0.3 / 2, rel=1e-4)


def test_contact_windows_are_where_torque_departs_from_its_prediction(planar_scene: Scene) -> None:
    bump = total("contact", planar_scene, time=1.9, width=0.25)[EquationRow("link", 0)]
    tau = np.array(planar_scene.predicted)
    tau[:, 0] += bump + 0.3 * np.sin(2 * planar_scene.motion.t)
    grid = LIBRARY["contact"].grid(replace(planar_scene, tau=tau, cache={}), 0)
    assert any(abs(time - 1.9) < 0.03 and width == 0.3 for time, width in grid)
    assert len(grid) <= 12


@pytest.mark.parametrize("distance", [1e-4, 1e-3, 1e-2])
def test_hysteresis_is_dahls_equation(distance: float) -> None:
    scene = scene_of(planar(), 1500)
    effect = Hysteresis(0, (distance,))
    t, e = scene.motion.t, scene.deflection(0)
    de = scene.motion.dq[:, 0] - scene.motion.dtheta[:, 0]
    done = solve_ivp(
        lambda s, z: (np.interp(s, t, de) - abs(np.interp(s, t, de)) * z) / distance,
        (0, t[-1]), [0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=DT,
    )  # fmt: skip
    z = effect.history(scene)
    assert np.abs(z).max() <= 1
    np.testing.assert_allclose(z, done.y[0], atol=3e-3)
    # in one step or in many
    state = 0.0
    for a, b in pairwise(e[:51]):
        state = effect.advance(effect.advance(state, a, (a + b) / 2), (a + b) / 2, b)
    assert state == pytest.approx(z[50], abs=1e-12)


def test_hysteresis_starts_afresh_in_every_segment() -> None:
    scene = scene_of(planar(), 600)
    apart = replace(scene, starts=(0, 300))
    z = Hysteresis(0, (1e-3,)).history(apart)
    again = Hysteresis(0, (1e-3,)).history(replace(scene, motion=scene.motion[300:], cache={}))
    assert z[0] == z[300] == 0
    np.testing.assert_allclose(z[300:], again)
    slow = super(Hysteresis, Hysteresis(0, (1e-3,))).history(apart)
    np.testing.assert_allclose(z, slow, atol=1e-12)


def swung_out(scene: Scene) -> Scene:
    """Return a scene whose torque shows no oscillator that swings already."""
    return replace(scene, tau=scene.predicted, cache={})


def test_flexible_mode_is_the_oscillators_torque() -> None:
    scene = swung_out(scene_of(planar(), 2000))
    effect = FlexibleMode(0, (9.0, 0.02))
    t, a = scene.motion.t, scene.motion.ddq[:, 0]
    om = 2 * np.pi * 9
    done = solve_ivp(
        lambda s, y: [y[1], -(om**2) * y[0] - 2 * 0.02 * om * y[1] - np.interp(s, t, a)],
        (0, t[-1]), [-a[0] / om**2, 0.0], t_eval=t, rtol=1e-9, atol=1e-12, max_step=DT,
    )  # fmt: skip
    history = effect.history(scene)
    np.testing.assert_allclose(history[0], done.y[0], atol=1e-6 * np.abs(done.y[0]).max())
    column = -(om**2 * done.y[0] + 2 * 0.02 * om * done.y[1])
    np.testing.assert_allclose(
        effect.columns(scene)[EquationRow("link", 0)][0], column, atol=1e-5 * np.abs(column).max()
    )
    rates = effect.rates(scene, history)
    np.testing.assert_allclose(rates[0], history[1])
    np.testing.assert_allclose(rates[1][5:-5], np.gradient(history[1], DT)[5:-5], atol=2e-3 * np.abs(rates[1]).max())


def test_a_stiff_mode_is_a_rigid_inertia() -> None:
    scene = swung_out(scene_of(planar(), 1000))
    column = FlexibleMode(0, (200.0, 0.5)).columns(scene)[EquationRow("link", 0)][0]
    np.testing.assert_allclose(column, scene.motion.ddq[:, 0], atol=0.02 * np.abs(scene.motion.ddq[:, 0]).max())


def test_the_frequency_grid_holds_the_line_of_the_spectrum(planar_scene: Scene) -> None:
    tau = np.array(planar_scene.predicted)
    tau[:, 0] += 0.5 * np.sin(2 * np.pi * 13.3 * planar_scene.motion.t)
    grid = FlexibleMode.grid(replace(planar_scene, tau=tau, cache={}), 0)
    assert min(abs(f - 13.3) for f, _ in grid) < 0.4


def test_a_lookup_is_a_cubic_spline(planar_scene: Scene) -> None:
    knots = np.arange(-3, 9) / 5
    x = np.linspace(0, 1, 101)[:-1]
    for k in range(8):
        np.testing.assert_allclose(
            b_splines(x, 8)[k], np.nan_to_num(BSpline.basis_element(knots[k : k + 5], False)(x)), atol=1e-12
        )
    wide = b_splines(np.linspace(-1, 2, 50), 8)
    np.testing.assert_allclose(wide.sum(axis=0), 1)
    for variable, rows, values, sides in (
        ("velocity", "link", planar_scene.motion.dq[:, 1], {"link"}),
        ("deflection", "transmission", planar_scene.deflection(1), {"link", "motor"}),
        ("angle", "motor", planar_scene.motion.theta[:, 1], {"motor"}),
        ("load", "motor", planar_scene.load[:, 1], {"motor"}),
        ("time", "motor", planar_scene.motion.t, {"motor"}),
    ):
        curve = Lookup.over(planar_scene, 1, variable, rows)
        assert curve is not None
        columns = curve.columns(planar_scene)
        assert {row.side for row in columns} == sides
        target = np.sin(values / np.abs(values).max())
        basis = next(iter(columns.values())).T
        rest = target - basis @ np.linalg.lstsq(basis, target, rcond=1e-9)[0]
        assert np.std(rest) < 0.01 * np.std(target)
    assert Lookup.grid(planar_scene, 0) == []


def test_a_skew_of_nanoseconds_is_none(planar_scene: Scene) -> None:
    kind = effect_classes()["encoder_skew"]
    for part, expected in ((0.001, False), (-0.003, False), (0.1, True), (-3.0, True)):
        assert kind.plausible(planar_scene, 0, {"skew": part * planar_scene.dt}) is expected


def test_a_tilt_that_pulls_at_slides_alone_is_an_offset_of_their_torque() -> None:
    def joint(name: str, kind: Literal["revolute", "prismatic"], axis: tuple[float, float, float]) -> Joint:
        parameters = {"m": 4.0, "cy": 0.1, "cz": -0.3, "Ixx": 0.2}
        return Joint(name, type=kind, axis=axis, transmission="rigid", parameters=parameters)

    along, wrist = (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)
    robot = Robot("gantry", (joint("x", "prismatic", along), joint("wrist", "revolute", wrist)), dh="urdf")
    tilt, scene = LIBRARY["gravity_direction"](0), scene_of(robot)
    columns = tilt.columns(scene)
    assert set(columns) == {EquationRow("link", 1)}, "pitch pulls at x alone, by the weight of all"
    roll, pitch = columns[EquationRow("link", 1)]
    assert np.ptp(roll) > 1.0
    assert not np.any(pitch)
    assert tilt.named(scene, np.array([0.01, 0.0])) == {"roll": 0.01}
    turned = replace(robot, joints=(robot.joints[0], replace(robot.joints[1], axis=(0.0, 1.0, 0.0))))
    shown = tilt.columns(scene_of(turned))
    assert np.ptp(shown[EquationRow("link", 1)][1]) > 0.5
    weight = shown[EquationRow("link", 0)][1]
    np.testing.assert_allclose(np.abs(weight), 8.0 * 9.81, rtol=1e-12)


def test_an_offset_at_a_level_slide_may_be_a_base_that_is_not_level() -> None:
    drives = {"m": 4.0, "cy": 0.1, "cz": -0.3, "Ixx": 0.2, "Ja": 1.0}
    slide = Joint("x", type="prismatic", axis=(1.0, 0.0, 0.0), transmission="rigid", parameters=drives)
    wrist = Joint("wrist", type="revolute", axis=(1.0, 0.0, 0.0), transmission="rigid", parameters=drives)
    offset = LIBRARY["torque_offset"]
    scene = scene_of(Robot("gantry", (slide, wrist), dh="urdf"))
    assert [twin.effect for twin in offset.same_here(scene, 0, {"offset": 1.0})] == ["gravity_direction"]
    assert offset.same_here(scene, 1, {"offset": 1.0}) == ()
    carried = scene_of(Robot("swing", (wrist, slide), dh="urdf"))
    assert offset.same_here(carried, 1, {"offset": 1.0}), "a slide along the axis that it turns about feels no angle"
    across = replace(slide, axis=(0.0, 1.0, 0.0))
    assert offset.same_here(scene_of(Robot("swing", (wrist, across), dh="urdf")), 1, {"offset": 1.0}) == ()


def test_the_sign_of_velocity_is_sharp_where_instants_count() -> None:
    scene = scene_of(planar())
    sharp = replace(scene, rounding=np.array([1e-4, 1e-4]), cache={})
    slow = np.abs(scene.motion.dtheta[:, 0]) < 5e-3
    assert slow.any()
    assert np.all(np.abs(scene.direction(0)[slow]) < 0.77)
    counted = slow & (np.abs(scene.motion.dtheta[:, 0]) > 4e-4)
    assert np.all(np.abs(sharp.direction(0)[counted]) > 0.999)


def test_a_factor_is_on_the_model_and_on_what_is_beside_it_once(planar_scene: Scene) -> None:
    row = EquationRow("motor", 1)
    spring, friction = LIBRARY["link_spring"](1), LIBRARY["stribeck"](1, (0.1, 1.0))
    mode = LIBRARY["flexible_mode"](1, (9.0, 0.02))
    gain, other = LIBRARY["torque_gain"](1), LIBRARY["stribeck"](0, (0.1, 1.0))
    found = (
        (gain, np.array([0.1])), (spring, np.array([3.0, 1.0])), (friction, np.array([2.0])),
        (mode, np.full(len(mode.amplitudes), 0.1)), (other, np.array([5.0])),
    )  # fmt: skip
    q, w = planar_scene.motion.q[:, 1], planar_scene.motion.dtheta[:, 1]
    beside = 3.0 * q + 1.0 + 2.0 * np.tanh(w / 5e-3) * np.exp(-np.abs(w) / 0.1)
    whole = planar_scene.predicted[:, 1] + beside
    scene = replace(planar_scene, found=found, cache={})
    np.testing.assert_allclose(gain.columns(scene)[row][0], whole, atol=1e-9)
    # where the prediction holds the effects, the factor's own torque among them
    full = np.array(planar_scene.predicted)
    full[:, 1] = 1.1 * whole
    scene = replace(planar_scene, predicted=full, alone=planar_scene.predicted, found=found, cache={})
    np.testing.assert_allclose(gain.columns(scene)[row][0], whole, atol=1e-9)
