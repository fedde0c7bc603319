"""Identification of the paper's planar robot: exact without noise, honest with it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.estimation.identify import EstimateOptions, Identification, identify
from elid_cli.experiment.reference import ReferenceOptions
from elid_cli.experiment.simulation import ControlOptions, SimulationOptions, simulate
from elid_cli.model.effects.declared import resolve
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare

PLANAR = read_robot("planar2")


@cache
def planar_log() -> Recording:
    """Return 8.9 s of exact positions."""
    options = SimulationOptions(
        duration=8.9,
        seed=1,
        reference=ReferenceOptions(amplitude=0.75, interval=1.1),
        control=ControlOptions(continuous=True),
    )
    return simulate(PLANAR, options)


def noisy(seed: int, level: float = 80.0, torque: float = 0.0, pole: float = 0.0) -> Recording:
    """Return the log with white position noise (dB) and torque noise (share of rms, first-order coloured)."""
    from scipy.signal import lfilter

    generator = np.random.default_rng(seed)
    log = planar_log()

    def add(values: np.ndarray) -> np.ndarray:
        return values + values.std(axis=0) * 10 ** (-level / 20) * generator.standard_normal(values.shape)

    white = generator.standard_normal(log.tau.shape)
    coloured = lfilter([np.sqrt(1 - pole**2)], [1, -pole], white, axis=0)
    return replace(log, q=add(log.q), theta=add(log.theta), tau=log.tau + torque * log.tau.std(axis=0) * coloured)


def found(log: Recording, robot: Robot = PLANAR, **options: object) -> Identification:
    return identify(robot, prepare(log, robot), EstimateOptions(**options))  # type: ignore[arg-type]


def test_without_noise_every_base_parameter_is_exact() -> None:
    result = found(planar_log())
    relative = np.nan_to_num(result.relative_error())
    assert relative.max() < 0.005
    assert all(v == "supported" for v in result.verdict)
    assert max(e.relative for e in result.error.values()) < 0.003


def test_the_paper_estimator_is_biased_where_the_default_is_not() -> None:
    log = noisy(1, level=60)
    paper, default = found(log, estimator="paper"), found(log)
    assert paper.estimator == "paper"
    assert paper.normalised_mean_error() > 0.5
    assert default.normalised_mean_error() < 0.1


def test_the_collocation_beats_the_default_under_noise() -> None:
    log = noisy(2, level=70)
    accurate, default = found(log, accurate=True), found(log)
    assert accurate.estimator == "accurate"
    assert accurate.normalised_mean_error() < 0.006
    assert accurate.normalised_mean_error() < 0.7 * default.normalised_mean_error()


def test_the_collocation_falls_back_and_says_so() -> None:
    result = found(noisy(3, level=20), accurate=True)
    assert result.estimator == "default"
    assert any("default estimate stands" in note for note in result.notes)


def test_a_mistyped_parameter_of_a_declared_effect_is_refused() -> None:
    """Built in Python, past the robot file's own check: it would have been taken as not given, silently."""
    mistyped = replace(PLANAR, effects=(EffectSpec("stribeck", "joint2", {"amplitud": 1.0, "velocity": 0.2}),))
    with pytest.raises(RobotError, match="unknown parameter 'amplitud'") as refused:
        resolve(mistyped, mistyped.effects[0])
    assert refused.value.hint == "did you mean 'amplitude'?"


def test_declared_stribeck_friction_is_fitted() -> None:
    spec = EffectSpec("stribeck", "joint2", {"amplitude": 1.0, "velocity": 0.2, "exponent": 1.0})
    true = replace(PLANAR, effects=(spec,))
    options = SimulationOptions(duration=6.0, rate=500.0, seed=2, control=ControlOptions(continuous=True))
    log = simulate(true, options)
    declared = replace(PLANAR, effects=(replace(spec, parameters={"velocity": 0.1, "exponent": 1.0}),))
    result = found(log, declared)
    (effect,) = result.effects
    assert effect.parameters["amplitude"] == pytest.approx(1.0, rel=0.03)
    assert effect.parameters["velocity"] == pytest.approx(0.2, rel=0.03)
    assert result.normalised_mean_error() < 0.01
    assert found(log).normalised_mean_error() > 0.1


@pytest.mark.parametrize("joint", [0, 1])
def test_a_turned_torque_is_named(joint: int) -> None:
    log = noisy(4)
    tau = log.tau.copy()
    tau[:, joint] *= -1
    warnings = found(replace(log, tau=tau)).warnings
    assert any(f"torque of joint{joint + 1} looks as if its sign" in line for line in warnings)
    assert not any(f"torque of joint{2 - joint} looks" in line for line in warnings)


@pytest.mark.parametrize("joint", [0, 1])
def test_turned_positions_of_link_and_motor_are_told_from_a_turned_torque(joint: int) -> None:
    log = noisy(4)
    turn = np.ones(2)
    turn[joint] = -1.0
    warnings = found(replace(log, q=turn * log.q, theta=turn * log.theta)).warnings
    assert [line for line in warnings if "look" in line] == [
        f"q and theta of joint{joint + 1} look as if their signs were wrong"
    ]


@pytest.mark.parametrize("joint", [0, 1])
def test_an_axis_that_points_the_other_way_is_told_of_its_own_joint_alone(joint: int) -> None:
    log = noisy(4)
    turn = np.ones(2)
    turn[joint] = -1.0
    warnings = found(replace(log, q=turn * log.q, theta=turn * log.theta, tau=turn * log.tau)).warnings
    (said,) = [line for line in warnings if "look" in line]
    assert said.startswith(f"q, theta and tau of joint{joint + 1} look as if they all had the wrong sign, or its axis")


def test_swapped_torques_are_named() -> None:
    log = noisy(4)
    assert any("look swapped" in line for line in found(replace(log, tau=log.tau[:, ::-1].copy())).warnings)


def test_degrees_are_named() -> None:
    log = noisy(4)
    degrees = replace(log, q=np.degrees(log.q), theta=np.degrees(log.theta))
    assert any("degrees" in line for line in found(degrees).warnings)


@pytest.mark.parametrize("joint", [0, 1])
def test_degrees_of_one_joint_are_named_with_that_joint(joint: int) -> None:
    log = noisy(4)
    factor = np.ones(2)
    factor[joint] = 180 / np.pi
    warnings = found(replace(log, q=factor * log.q, theta=factor * log.theta)).warnings
    (said,) = [line for line in warnings if "degrees" in line]
    assert said.startswith(f"the positions of joint{joint + 1} look as if they were in degrees")
    assert said.endswith(f"unit: {{joint{joint + 1}: deg}}")


@pytest.mark.parametrize("size", [6.0, 20.0])
def test_positions_of_one_joint_that_are_merely_too_large_are_not_called_degrees(size: float) -> None:
    """Made 57 times smaller they fit better, too; they would fit still better at another size."""
    log, factor = noisy(4), np.array([1.0, size])
    assert not any("degrees" in w for w in found(replace(log, q=factor * log.q, theta=factor * log.theta)).warnings)


def test_a_wrong_gear_ratio_sign_is_named() -> None:
    joints = (PLANAR.joints[0], replace(PLANAR.joints[1], gear_ratio=-0.1))
    assert any("gear_ratio of joint2" in w for w in found(noisy(4), replace(PLANAR, joints=joints)).warnings)


def test_a_good_log_raises_no_warning() -> None:
    assert found(noisy(5)).warnings == ()


def test_a_deflection_below_the_encoders_noise_refuses_the_stiffness() -> None:
    joints = tuple(replace(j, parameters={**j.parameters, "K": 3e7}) for j in PLANAR.joints)
    stiff = replace(PLANAR, joints=joints)
    log = planar_log()
    # the same motion seen through springs ten thousand times as stiff
    theta = log.q + (log.theta - log.q) * 1e-4
    generator = np.random.default_rng(0)
    shape = log.q.shape
    log = replace(log, q=log.q + 1e-4 * generator.standard_normal(shape), theta=theta)
    result = found(log, stiff)
    assert result.this_log["K1"] == "not excited"
    assert "encoder noise" in result.reasons["K1"] or "deviation" in result.reasons["K1"]


def test_a_joint_that_does_not_move_is_named_and_noise_changes_no_structural_class() -> None:
    log = noisy(6)
    q, theta = log.q.copy(), log.theta.copy()
    q[:, 1], theta[:, 1] = q[0, 1], theta[0, 1]
    result = found(replace(log, q=q, theta=theta))
    assert any("joint2 did not move" in note for note in result.notes)
    assert result.base.classes == found(log).base.classes


@pytest.mark.parametrize("pole", [0.0, 0.98], ids=["white", "coloured"])
def test_intervals_hold_the_truth(pole: float) -> None:
    scores = []
    for seed in range(24):
        result = found(noisy(seed, level=90, torque=0.02, pole=pole), guards=False)
        scores.append((result.estimate - result.reference) / result.std_error)
    inside = np.mean(np.abs(np.array(scores)) < 1.96)
    assert 0.88 < inside < 0.995


def test_swapped_motor_positions_are_named() -> None:
    log = noisy(4)
    warnings = found(replace(log, theta=log.theta[:, ::-1].copy())).warnings
    assert any("motor positions of joint1 and joint2 look swapped" in line for line in warnings)


def test_links_and_motors_exchanged_are_named() -> None:
    log = noisy(4)
    q, theta = log.q.copy(), log.theta.copy()
    q[:, 0], theta[:, 0] = log.theta[:, 0], log.q[:, 0]
    assert any("q and theta of joint1 look swapped" in line for line in found(replace(log, q=q, theta=theta)).warnings)


def test_a_turned_motor_position_is_named() -> None:
    log = noisy(4)
    theta = log.theta.copy()
    theta[:, 1] *= -1
    assert any("theta of joint2 moves against q" in line for line in found(replace(log, theta=theta)).warnings)


def test_reversals_of_a_joint_with_a_declared_effect_stay_masked() -> None:
    """Also where the effect has the name of a nuisance."""
    log, options = noisy(0, 100.0, 0.01), SignalOptions(cutoff=10.0)
    for names in ((), ("torque_offset",), ("torque_offset", "torque_ripple")):
        effects = tuple(EffectSpec(name, f"joint{k + 1}") for k, name in enumerate(names))
        robot = replace(PLANAR, effects=effects)
        masked = identify(robot, prepare(log, robot, options), EstimateOptions(guards=False)).settings["masked"]
        assert [share > 0 for share in masked] == [k < len(names) for k in range(2)]


@pytest.mark.parametrize("coefficient", [0.1, 0.2])
def test_load_friction_of_a_rigid_joint_leaves_its_parameters_alone(coefficient: float) -> None:
    # with the load that the model predicts without it they came out larger by 1 / (1 - coefficient²)
    joints = (PLANAR.joints[0], replace(PLANAR.joints[1], transmission="rigid"))
    robot = replace(PLANAR, joints=joints)
    known, asked = (
        replace(robot, effects=(EffectSpec("load_friction", "joint2", values),))
        for values in ({"coefficient": coefficient}, {})
    )
    log = simulate(known, SimulationOptions(duration=4.0, control=ControlOptions(continuous=True)))
    found = identify(asked, prepare(log, asked), EstimateOptions(guards=False))
    own = [k for k, name in enumerate(found.base.names) if name in ("Jm2", "fs2", "fv2")]
    assert len(own) == 3
    assert np.abs(found.relative_error()[own]).max() < 1e-3
    assert found.effects[0].parameters["coefficient"] == pytest.approx(coefficient, rel=1e-3)


def test_the_papers_estimator_takes_sliding_joints() -> None:
    # 0.5 m/s is faster than most of them ever move
    emps = read_robot("emps")
    log = simulate(emps, SimulationOptions(duration=10.0, control=ControlOptions(continuous=True)))
    assert np.abs(np.gradient(log.q[:, 0], log.t)).max() < 0.5
    result = identify(emps, prepare(log, emps), EstimateOptions(estimator="paper"))
    assert np.nan_to_num(result.relative_error(), nan=1.0).max() < 0.02
