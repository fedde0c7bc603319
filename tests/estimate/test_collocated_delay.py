"""A torque delay that the default fit imagines is an unknown of the collocation, which puts it right."""

import pytest

from elid_cli.robot_file import read_robot
from tests.reproduce.paper_logs import by_elid, motion_of, with_friction


def test_a_delay_that_is_none_ends_at_none() -> None:
    """Where friction's shapes are unknown, the default fit takes a part of the curve for a delay of 0.3 ms."""
    robot = read_robot("planar2")
    motion = motion_of(with_friction(robot, known=True), 5, 5.0)
    found = by_elid(with_friction(robot, known=False), motion, 80.0, 5, rates=False, accurate=True)
    assert found.estimator == "accurate"
    assert found.normalised_mean_error() < 0.02
    for nuisance in found.nuisances:
        assert nuisance.parameters["delay"] == pytest.approx(0.0, abs=2e-5)
