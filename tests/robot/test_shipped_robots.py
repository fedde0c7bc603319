"""The numbers of the shipped robots against the publications they come from."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.robot.files import read_robot
from elid_cli.robot.parameter import LINK_PARAMETERS

GEARS = (-62.6111, 107.815, -53.7063, 76.0364, 71.923, 76.686)


def value(name: str, robot: str = "puma560") -> float:
    described = read_robot(robot)
    return float(described.reference()[described.parameter_names().index(name)])


def test_planar2_holds_the_papers_real_values_of_table_1():
    expected = {
        "K1": 3000, "K2": 1800, "Jm1": 21.18, "Jm2": 12.1, "fs1": 0.3302, "fs2": 0.3576, "fv1": 0.1434, "fv2": 0.1391,
    }  # fmt: skip
    for name, number in expected.items():
        assert value(name, "planar2") == number
    at = {name: value(name, "planar2") for name in ("m1", "m2", "cx1", "cx2", "Izz1", "Izz2")}
    assert at["m1"] - 4 * at["Izz1"] + 4 * at["Izz2"] == pytest.approx(-30.8333, abs=4e-4)
    assert at["m2"] - 4 * at["Izz2"] == pytest.approx(6.5667, abs=2e-4)
    assert at["cx1"] + 2 * at["Izz1"] == pytest.approx(22.6333, abs=2e-4)
    assert at["cx2"] + 2 * at["Izz2"] == pytest.approx(-0.7833, abs=2e-4)
    robot = read_robot("planar2")
    assert robot.gravity == (0, -9.81, 0)
    assert not robot.effects
    assert all(set(joint.parameters) == set(joint.kinds) for joint in robot.joints)


def test_puma560_moves_corkes_centre_of_mass_values_to_the_frame_origins():
    # m, centre of mass and inertia about it as published; the rest is Steiner and the rotor that rides along.
    bodies = {
        2: (17.4, (-0.3638, 0.006, 0.2275), (0.13, 0.524, 0.539), 200e-6),
        3: (4.8, (-0.0203, -0.0141, 0.070), (0.066, 0.086, 0.0125), 33e-6),
        4: (0.82, (0, 0.019, 0), (1.8e-3, 1.3e-3, 1.8e-3), 33e-6),
        6: (0.09, (0, 0, 0.032), (0.15e-3, 0.15e-3, 0.04e-3), 0),
    }
    for i, (mass, centre, inertia, rotor) in bodies.items():
        r = np.array(centre, dtype=float)
        about_origin = np.diag(inertia) + mass * (r @ r * np.eye(3) - np.outer(r, r)) + np.diag([0, 0, rotor])
        found = [value(f"{name}{i}") for name in LINK_PARAMETERS]
        xx, yy, zz = np.diag(about_origin)
        xy, xz, yz = about_origin[0, 1], about_origin[0, 2], about_origin[1, 2]
        np.testing.assert_allclose(found, [mass, *(mass * r), xx, yy, zz, xy, xz, yz], rtol=1e-9, atol=1e-12)


def test_puma560_agrees_with_the_papers_tables_3_to_6():
    assert [value(f"m{i}") for i in range(1, 7)] == [0.10, 17.4, 4.80, 0.82, 0.34, 0.09]
    assert [value(f"K{i}") for i in range(1, 7)] == [2000] * 6
    assert [round(value(f"c{x}2"), 4) for x in "xyz"] == [-6.3301, 0.1044, 3.9585]
    assert [round(value(f"c{x}3"), 4) for x in "xyz"] == [-0.0974, -0.0677, 0.336]
    # table 5 prints 1.031 3.727 2.842 0.037 1.440 -0.023, cut rather than rounded
    assert [int(1000 * value(f"I{xy}2")) / 1000 for xy in ("xx", "yy", "zz", "xy", "xz", "yz")] == [
        1.031, 3.727, 2.842, 0.037, 1.440, -0.023,
    ]  # fmt: skip
    assert value("Izz1") == value("Jm2")


def test_puma560_friction_is_the_motor_side_friction_seen_through_the_gear():
    coulomb = [(0.395, 0.435), (0.126, 0.071), (0.132, 0.105), (0.0112, 0.0169), (0.00926, 0.0145), (0.00396, 0.0105)]
    viscous = [1.48e-3, 0.817e-3, 1.38e-3, 71.2e-6, 82.6e-6, 36.7e-6]
    robot = read_robot("puma560")
    np.testing.assert_array_equal(robot.gear_ratios, GEARS)
    for i, (gear, both, slope) in enumerate(zip(GEARS, coulomb, viscous, strict=True), start=1):
        assert value(f"fs{i}") == pytest.approx(abs(gear) * sum(both) / 2, rel=1e-9)
        assert value(f"fv{i}") == pytest.approx(gear**2 * slope, rel=1e-9)


@pytest.mark.parametrize("name", ["planar2", "puma560"])
def test_the_simulated_robots_can_hold_themselves_within_their_torque_limits(name):
    robot = read_robot(name)
    for joint in robot.joints:
        limits = joint.limits
        assert limits.position is not None
        assert None not in (limits.velocity, limits.acceleration, limits.torque)


def test_measured_robots_have_the_structure_of_the_machines():
    emps, kr300, quanser = (read_robot(name) for name in ("emps", "kr300", "quanser_2dsfl"))
    assert [(joint.type, joint.transmission) for joint in emps.joints] == [("prismatic", "rigid")]
    assert emps.gravity[2] == 0  # across the rail
    assert [joint.transmission for joint in kr300.joints] == ["elastic"] * 3 + ["rigid"] * 3
    assert kr300.gravity == (0, 0, 9.81)
    assert [joint.parameters["K"] for joint in kr300.joints[:3]] == [4.58e6, 7.52e6, 4.10e6]
    assert quanser.gravity[:2] == (0, 0)
    assert "nominal" in quanser.description
    for robot in (emps, kr300, quanser):
        assert {"t", "q", "theta", "tau"} <= set(robot.log)
