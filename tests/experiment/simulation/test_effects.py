"""Every effect of the library acts in a simulated log just as its own columns say (one formula, two uses)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from elid_cli.estimation.regression.scene_with_effects import with_effects
from elid_cli.experiment.simulation import ControlOptions, SensorOptions, Simulation, SimulationOptions, run
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.scene import Scene
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec
from elid_cli.signals.motion import Motion

ROBOT = read_robot("planar2")
DYNAMICS = Dynamics(ROBOT)
DURATION, LONG = 1.3, 2.0
"""Of a log, s; the latter where the columns explain the effect but for a share, which is larger where motion begins."""

CASES: dict[str, tuple[str | None, dict[str, float], float]] = {
    "asymmetric_coulomb": ("joint1", {"difference": 2.0}, 1e-6),
    "asymmetric_viscous": ("joint1", {"difference": 1.0}, 1e-6),
    "backlash": ("joint2", {"gap": 1.5e-3}, 1e-6),
    "contact": ("joint1", {"torque": 20.0, "time": 0.65, "width": 0.3}, 1e-6),
    "cubic_stiffness": ("joint2", {"cubic": 3e6}, 1e-6),
    "encoder_eccentricity": ("joint2", {"amplitude": 1e-3, "phase": 0.7}, 0.01),
    "encoder_offset": ("joint1", {"offset": 1e-3}, 1e-3),
    "encoder_scale": ("joint2", {"scale": 1e-3}, 0.02),
    "encoder_zero": ("joint1", {"offset": 0.01}, 0.05),
    "encoder_skew": ("joint2", {"skew": 1e-3}, 0.06),
    "flexible_mode": ("joint2", {"inertia": 0.3, "frequency": 9.0, "damping": 0.02}, 0.02),
    "friction_drift": ("joint1", {"coulomb": 1.0, "viscous": 1.0}, 1e-6),
    "gravity_direction": (None, {"roll": 0.0, "pitch": 0.01}, 0.05),
    "hysteresis": ("joint2", {"torque": 3.0, "distance": 1e-3}, 0.02),
    "kinematic_error": ("joint1", {"amplitude": 2e-4, "phase": 0.3, "order": 20.0}, 1e-6),
    "link_coulomb": ("joint1", {"friction": 2.0}, 1e-6),
    "link_spring": ("joint1", {"stiffness": 30.0, "preload": -10.0}, 1e-6),
    "link_viscous": ("joint2", {"friction": 2.0}, 1e-6),
    "load_friction": ("joint1", {"coefficient": 0.08}, 1e-6),
    "payload": (None, {"m": 2.0, "cx": -0.2, "cy": 0.1, "Izz": 0.3, "start": 0.6}, 1e-6),
    "position_delay": ("joint1", {"delay": 5e-4}, 0.08),
    "position_friction": ("joint2", {"amplitude": 2.0, "phase": 0.5, "order": 12.0}, 1e-6),
    "quadratic_viscous": ("joint1", {"amplitude": 1.0, "power": 2.0}, 1e-6),
    "saturation": ("joint2", {"limit": 14.0}, 1e-6),
    "soft_friction": ("joint1", {"friction": 3.0, "velocity": 0.4}, 1e-6),
    "stribeck": ("joint1", {"amplitude": 3.0, "velocity": 0.12}, 1e-6),
    "tanh_friction": ("joint1", {"friction": 3.0, "velocity": 0.4}, 1e-6),
    "torque_delay": ("joint1", {"delay": 1.3e-3}, 0.03),
    "torque_gain": ("joint2", {"gain": 0.05}, 0.06),
    "torque_offset": ("joint1", {"offset": 1.0}, 1e-6),
    "torque_ripple": ("joint2", {"amplitude": 1.0, "phase": 0.5, "order": 12.0}, 1e-6),
    "transmission_damping": ("joint2", {"damping": 4.0}, 1e-6),
    "velocity_coupling": ("joint1", {"viscous": 1.0, "coulomb": 1.0, "other": 2.0}, 1e-6),
}
"""Effect -> joint, parameters, residual that may stay (share of what the effect leaves when it is not modelled)."""
ELSEWHERE = {
    "lookup": "no physics of its own", "sensor_gain": "acts on tau_link", "sensor_offset": "acts on tau_link",
    "integral_action": "needs a position loop", "velocity_filter": "needs a drive's loop",
    "position_gain": "needs a drive's loop", "damping_gain": "needs a drive's loop",
    "held_loop": "needs a drive's loop", "euler_steps": "needs a drive's loop",
    "transmission_compliance": "needs a rigid joint",
}  # fmt: skip


def case(name: str) -> tuple[str | None, Mapping[str, float], float]:
    """Return an effect's joint, parameters and tolerance: its own example at the first joint where none is chosen."""
    kind = effect_classes()[name]
    return CASES.get(name, (None if kind.whole_robot else "joint1", kind.example, 1e-6))


def simulated(name: str) -> Simulation:
    joint, parameters, tolerance = case(name)
    duration = DURATION if tolerance <= 1e-6 else LONG
    robot = replace(ROBOT, effects=(EffectSpec(name, joint, parameters),))
    return run(
        robot, SimulationOptions(duration=duration, seed=4, control=ControlOptions(continuous=True), accuracy=0.5)
    )


def logged_motion(result: Simulation) -> Motion:
    """Return the motion as the log has it: the exact one, unless the log's positions differ from it."""
    log, exact = result.recording, result.motion
    if np.array_equal(log.q, exact.q) and np.array_equal(log.theta, exact.theta):
        return exact
    q, theta = CubicSpline(exact.t, log.q), CubicSpline(exact.t, log.theta)
    t = exact.t
    return Motion(t, log.q, q(t, 1), q(t, 2), log.theta, theta(t, 1), theta(t, 2))


def residuals(result: Simulation, motion: Motion) -> dict[EstimationRow, np.ndarray]:
    """Return torque minus model, row by row of eq. (2)."""
    model = DYNAMICS.model
    rows = model.dense(motion, model.equations) @ DYNAMICS.parameters
    return {
        plan.row: (result.recording.tau[:, plan.row.joint] if plan.row.kind == "motor" else 0.0) - row
        for plan, row in zip(model.equations.rows, rows, strict=True)
    }


def scene_of(result: Simulation, motion: Motion) -> Scene:
    load = DYNAMICS.stiffness * (motion.theta - motion.q)
    rows = DYNAMICS.model.dense(motion, DYNAMICS.model.estimation) @ DYNAMICS.parameters
    predicted = np.stack([rows[k] for k, p in enumerate(DYNAMICS.model.estimation.rows) if p.row.kind == "sum"], axis=1)
    seconds = 1e-3 * motion.samples
    return Scene(
        ROBOT, motion, 1e-3, result.recording.tau, load, predicted, DYNAMICS.parameters, seconds, DYNAMICS.stiffness
    )


@pytest.mark.parametrize("name", [name for name in effect_classes() if name not in ELSEWHERE])
def test_columns_explain_what_the_effect_did(name: str) -> None:
    joint, parameters, tolerance = case(name)
    # friction that follows the torque it is part of is found in a few rounds
    tolerance = max(tolerance, 0.02) if effect_classes()[name].from_torque else tolerance
    number = effect_classes()[name].number(ROBOT, joint)
    result = simulated(name)
    motion = logged_motion(result)
    scene = scene_of(result, motion)
    kind = effect_classes()[name]
    coefficients, shape = kind.coefficients(scene, number, parameters)
    effect = kind(number, shape)
    columns = effect.columns(with_effects(scene, [(effect, coefficients)]))
    # the ends are where interpolation and shifts of a log effect run out; reversals where sign(v) is rounded
    inner = (np.arange(motion.samples) > 20) & (np.arange(motion.samples) < motion.samples - 20)
    before, after = 0.0, 0.0
    for row, residual in residuals(result, motion).items():
        moving = inner & (np.abs(motion.dtheta[:, row.joint]) > 0.05)
        values = columns.get((row.kind, row.joint))  # type: ignore[call-overload]
        explained = coefficients @ values if values is not None else np.zeros(motion.samples)
        before += float(np.sum(residual[moving] ** 2))
        after += float(np.sum((residual - explained)[moving] ** 2))
    assert before**0.5 > 1.0, "the effect has to show"
    assert after**0.5 < tolerance * before**0.5


def test_sensor_effects_act_on_the_torque_sensor() -> None:
    effects = (
        EffectSpec("sensor_gain", "joint1", {"gain": 0.1}),
        EffectSpec("sensor_offset", "joint2", {"offset": 2.0}),
    )
    options = SimulationOptions(duration=0.2, sensors=SensorOptions(tau_link=True))
    plain, wrong = (
        run(ROBOT, options).recording.tau_link,
        run(replace(ROBOT, effects=effects), options).recording.tau_link,
    )
    assert plain is not None
    assert wrong is not None
    np.testing.assert_allclose(wrong[:, 0], 1.1 * plain[:, 0])
    np.testing.assert_allclose(wrong[:, 1], plain[:, 1] + 2.0)


def test_the_papers_friction_is_two_stribeck_terms() -> None:
    """Eq. (43) with the coefficients of (44): the torque of the two declared terms at any speed."""
    f3, f4, f5, f6 = 0.2499, 0.0537, 0.2991, 16.624
    terms = (
        EffectSpec("stribeck", "joint1", {"amplitude": -f3, "velocity": f4}),
        EffectSpec("stribeck", "joint1", {"amplitude": -f5, "velocity": 1 / f6, "exponent": -1}),
    )
    result = run(replace(ROBOT, effects=terms), SimulationOptions(duration=1.0))
    residual = residuals(result, result.motion)[EstimationRow("motor", 0)]
    v = result.motion.dtheta[:, 0]
    moving = np.abs(v) > 0.05
    speed = np.abs(v[moving])
    expected = np.sign(v[moving]) * (-f3 * np.exp(-speed / f4) - f5 * np.exp(-1 / (f6 * speed)))
    np.testing.assert_allclose(residual[moving], expected, atol=1e-5)


def test_memory_is_of_one_run_only() -> None:
    robot = replace(ROBOT, effects=(EffectSpec("hysteresis", "joint2", {"torque": 3.0, "distance": 1e-3}),))
    first, second = (run(robot, SimulationOptions(duration=0.3)).recording for _ in range(2))
    np.testing.assert_array_equal(first.tau, second.tau)
