"""A joint that its command presses against a stop is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.logs.checks.stops import at_stops
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Limits

T = np.linspace(0, 10, 2000)


def said(q_des: np.ndarray, q: np.ndarray, limits: tuple[float, float] | None) -> list[str]:
    robot = read_robot("planar2")
    joints = tuple(replace(joint, limits=Limits(position=limits)) for joint in robot.joints)
    both = np.stack([q_des, np.zeros_like(q)], axis=1)
    own = np.stack([q, np.zeros_like(q)], axis=1)
    return list(at_stops({"q_des": both}, own, replace(robot, joints=joints)))


def test_a_joint_pressed_against_its_stop_is_told() -> None:
    wanted = 0.5 * np.sin(2 * T)
    (line,) = said(wanted, np.clip(wanted, -0.305, 0.301), (-0.3, 0.3))
    assert line.startswith("commands press joint1 (5")
    assert "joint2" not in line


@pytest.mark.parametrize(
    ("size", "limits"),
    [(0.3, (-0.3, 0.3)), (0.29, (-0.3, 0.3)), (0.5, (-0.3, 0.3)), (0.5, None)],
)
def test_a_joint_that_does_as_it_is_told_met_no_stop(size: float, limits: tuple[float, float] | None) -> None:
    wanted = size * np.sin(2 * T)  # the third goes beyond the limits of the file, freely
    assert said(wanted, size * np.sin(2 * T - 0.02), limits) == []


def unequal(size: float) -> np.ndarray:
    """Return a motion whose turns are at different places."""
    return size * np.sin(4 * T) * (1.0 + 0.4 * np.sin(0.9 * T))


@pytest.mark.parametrize("limits", [None, (-3.0, 3.0)])
def test_a_stop_that_the_robot_file_does_not_know_is_told(limits: tuple[float, float] | None) -> None:
    wanted = unequal(0.6)
    (line,) = said(wanted, np.clip(wanted, -2.0, 0.301), limits)  # rigid
    assert line.startswith("joint1 at 0.301 rad goes no farther")


def test_stops_at_both_ends_are_told_together() -> None:
    wanted = unequal(0.6)
    (line,) = said(wanted, np.clip(wanted, -0.25, 0.301), None)
    assert line.startswith("joint1 at 0.301 rad and joint1 at -0.25 rad go no farther")


def test_a_stop_may_yield() -> None:
    wanted = unequal(0.6)
    (line,) = said(wanted, np.where(wanted > 0.3, 0.3 + 0.1 * (wanted - 0.3), wanted), None)
    assert line.startswith("joint1 at 0.3")


@pytest.mark.parametrize("share", [0.7, 1.0, 1.3])
def test_a_joint_that_falls_short_of_its_commands_met_none(share: float) -> None:
    noise = np.random.default_rng(0).normal(0.0, 1e-3, len(T))
    assert said(unequal(0.6), share * unequal(0.6) + noise, None) == []
    assert said(0.6 * np.sin(4 * T), share * 0.6 * np.sin(4 * T) + noise, None) == []


def test_without_commands_nothing_is_said() -> None:
    assert list(at_stops({}, np.zeros((10, 2)), read_robot("planar2"))) == []
