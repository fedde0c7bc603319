"""`elid excite`: within limits, from rest to rest, better than chance, and its predictions come true."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import DataError, UsageError
from elid_cli.estimation.identify import identify
from elid_cli.experiment.bounds import bounds_of
from elid_cli.experiment.excitation import Excitation, ExciteOptions, _Search, excite
from elid_cli.experiment.information import Information, Weights
from elid_cli.experiment.reference import random_reference, read_reference, write_trajectory
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.model.base_parameters import find_base
from elid_cli.model.consistency import consistency, prior
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Limits, Robot
from elid_cli.signals.signals import prepare

LIMITS = (Limits((-1.5, 2.0), 1.8, 7.0, 400.0), Limits((-2.0, 1.0), 2.5, 9.0, 90.0))


@pytest.fixture(scope="module")
def limited(planar: Robot) -> Robot:
    joints = tuple(replace(joint, limits=limits) for joint, limits in zip(planar.joints, LIMITS, strict=True))
    return replace(planar, joints=joints)


@pytest.fixture(scope="module")
def found(limited: Robot) -> Excitation:
    return excite(limited, ExciteOptions(duration=8.0, rounds=25, starts=4))


def test_it_stays_within_position_velocity_acceleration_and_torque(found: Excitation, limited: Robot) -> None:
    _, q, dq, ddq = found.trajectory.sampled(300.0)
    dynamics = Dynamics(limited)
    rows = [dynamics.inverse(*(a.tolist() for a in (x, v, a, x, v, a))) for x, v, a in zip(q, dq, ddq, strict=True)]
    torque = np.array([np.add(link, motor) for link, motor in rows])
    for k, limits in enumerate(LIMITS):
        assert limits.position is not None
        assert limits.position[0] <= q[:, k].min()
        assert q[:, k].max() <= limits.position[1]
        for value, limit in ((dq, limits.velocity), (ddq, limits.acceleration), (torque, limits.torque)):
            assert limit is not None
            assert np.abs(value[:, k]).max() <= 1.005 * limit


def test_the_limits_said_to_be_used_are_used(found: Excitation) -> None:
    assert max(float(np.nanmax(share)) for share in found.used.values()) > 0.8
    assert all(np.nanmax(share) <= 1.0 for share in found.used.values())


def test_it_starts_and_ends_at_rest_where_it_started(found: Excitation) -> None:
    _, q, dq, ddq = found.trajectory.sampled(100.0)
    assert np.abs(dq[[0, -1]]).max() < 1e-9
    assert np.abs(ddq[[0, -1]]).max() < 1e-7
    assert np.allclose(q[0], q[-1])


def test_velocity_and_acceleration_are_the_derivatives_of_position(found: Excitation) -> None:
    t, q, dq, ddq = found.trajectory.sampled(2000.0)
    assert np.allclose(np.gradient(q, t, axis=0)[1:-1], dq[1:-1], atol=1e-4)
    assert np.allclose(np.gradient(dq, t, axis=0)[1:-1], ddq[1:-1], atol=1e-3)


def test_it_conditions_better_than_random_motion_and_shows_no_less(found: Excitation) -> None:
    assert found.evaluation.condition < 0.9 * found.random.condition
    assert found.gain > 1.0


def test_aiming_at_a_parameter_shows_it_better(limited: Robot, found: Excitation) -> None:
    aimed = excite(limited, ExciteOptions(duration=8.0, rounds=25, starts=4, aims=("cy2",)))
    row = found.base.names.index("cy2")
    assert aimed.std_error[row] < 0.9 * found.std_error[row]
    assert aimed.std_error[row] < aimed.random_std_error[row]


def test_the_same_seed_gives_the_same_trajectory(limited: Robot) -> None:
    options = ExciteOptions(duration=8.0, rounds=3, starts=2)
    first, second = excite(limited, options).trajectory.sampled(50.0), excite(limited, options).trajectory.sampled(50.0)
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize("weights", [Weights(), Weights(0.0, 3.0), Weights(0.1, 0.0, (0, 5))])
def test_gradients_agree_with_differences(limited: Robot, weights: Weights) -> None:
    model = Regressor(limited)
    grid = np.linspace(0.0, 6.0, 80)
    start = random_reference(limited, 6.0, 0)
    parameters = prior(limited, consistency(limited, limited.reference()).scales)
    information = Information(model, find_base(model), parameters, np.ones((2, 2)), 1.0, start.evaluate(grid))
    search = _Search(information, bounds_of(limited), grid, weights, start)
    splines = zip(start.splines, search.reach, strict=True)
    x = 1.5 * np.concatenate([spline.points[4:-4] / reach for spline, reach in splines])
    _, slope = search._cost(20.0, x)
    direction = np.random.default_rng(1).standard_normal(len(x))
    up, down = (search._cost(20.0, x + step * direction)[0] for step in (1e-5, -1e-5))
    assert (up - down) / 2e-5 == pytest.approx(slope @ direction, rel=1e-4)


def test_predicted_standard_errors_come_true(found: Excitation, limited: Robot) -> None:
    """A log of the trajectory with white torque noise of the size that was assumed, over its filtered bandwidth."""
    rate = 500.0
    # 2 % of the torque behind the low-pass, which lets 8.4 Hz of the noise through, is this much before it
    noise = found.options.residual * np.sqrt(rate / 16.8)
    errors = []
    for seed in range(3):
        sensors = SensorOptions(position_noise=1e-6, torque_noise_relative=float(noise))
        options = SimulationOptions(duration=8.0, rate=rate, seed=seed, reference=found.trajectory, sensors=sensors)
        log = simulate(limited, options)
        errors.append(identify(limited, prepare(log, limited)).std_error)
    ratio = np.nanmedian(np.array(errors), axis=0) / found.std_error
    assert 0.8 < float(np.nanmedian(ratio)) < 1.4
    assert np.all((ratio > 0.5) & (ratio < 2.0))


def test_the_file_is_what_the_simulator_follows(found: Excitation, limited: Robot, tmp_path: Path) -> None:
    path = tmp_path / "a trajectory.csv"
    t, q, dq, ddq = found.trajectory.sampled(100.0)
    write_trajectory(path, limited.joint_names, t, q, dq, ddq)
    assert path.read_text().splitlines()[0] == "t,q.joint1,q.joint2,dq.joint1,dq.joint2,ddq.joint1,ddq.joint2"
    again = read_reference(str(path), limited).evaluate(t)
    assert np.allclose(again[0], q, atol=1e-6)
    assert np.allclose(again[1], dq, atol=1e-3)


def test_an_aim_that_nothing_shows_and_one_that_does_not_exist(limited: Robot) -> None:
    with pytest.raises(DataError, match="cz1"):
        excite(limited, ExciteOptions(aims=("cz1",)))
    with pytest.raises(UsageError) as caught:
        excite(limited, ExciteOptions(aims=("Jm9",)))
    assert "Jm" in caught.value.hint


UPRIGHT = """\
name: upright
gravity: [0, 0, -9.81]
dh: standard
joints:
  - {name: shoulder, a: 0.4, alpha: 0, d: 0.3, theta: 0, gear_ratio: 100}
  - {name: elbow, a: 0.3, alpha: pi, d: 0, theta: 0, gear_ratio: 80}
"""


def test_a_robot_without_reference_values_gets_a_motion_worth_making(tmp_path: Path) -> None:
    """Axes along gravity: some first moments act on nothing, and leave columns of rounding."""
    (tmp_path / "upright.yaml").write_text(UPRIGHT)
    found = excite(read_robot(str(tmp_path / "upright.yaml")), ExciteOptions(duration=8.0, rounds=10, starts=4))
    assert found.evaluation.condition < 50
    assert np.all(found.evaluation.std_error > 0)
    assert all(share.max() > 0.5 for kind, share in found.used.items() if kind in ("position", "velocity"))


def test_bodies_told_without_a_mass_get_one_where_nothing_else_tells_them_from_their_rotors() -> None:
    found = excite(read_robot("quanser_2dsfl"), ExciteOptions(duration=8.0, rounds=2, starts=2))
    assert found.massless == ("m1", "m2")
    assert np.isfinite(found.std_error).all()
