"""The antiresonance that a robot file means, against a planar arm's mass matrix written out by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.model.antiresonance import expected_antiresonance, moved_inertias
from elid_cli.robot.files import read_robot

LENGTH, REACH, MASS, INERTIA, STIFFNESS, ROTOR = 0.4, (0.15, 0.2), (5.0, 3.0), (0.1, 0.06), (9000.0, 2500.0), 0.3
"""Of both links: m, kg, kg·m² about the centre of mass; N·m/rad, kg·m²."""


def arm(place: Path, angle: float) -> Path:
    """Return the file of a planar arm whose second joint stands at one angle."""
    bodies = [
        f"m: {m}, cx: {m * (c - back)}, Izz: {i + m * (c - back) ** 2}"
        for m, c, i, back in zip(MASS, REACH, INERTIA, (LENGTH, LENGTH), strict=True)
    ]
    path = place / "arm.yaml"
    frame = f"a: {LENGTH}, alpha: 0, d: 0, theta: 0, gear_ratio: 1"
    at = f"limits: {{position: [{angle - 1e-4}, {angle + 1e-4}]}}"
    path.write_text(
        f"""
name: arm
gravity: [0, 0, -9.81]
dh: standard
joints:
  - {{name: one, {frame}, transmission: elastic, limits: {{position: [-0.1, 0.1]}},
     parameters: {{{bodies[0]}, Jm: {ROTOR}, K: {STIFFNESS[0]}}}}}
  - {{name: two, {frame}, transmission: elastic, {at},
     parameters: {{{bodies[1]}, Jm: {ROTOR}, K: {STIFFNESS[1]}}}}}
"""
    )
    return path


def mass_matrix(angle: float) -> np.ndarray:
    """Return the links' mass matrix at an angle of the second joint."""
    coupling = MASS[1] * LENGTH * REACH[1] * np.cos(angle)
    outer = INERTIA[1] + MASS[1] * REACH[1] ** 2
    inner = INERTIA[0] + MASS[0] * REACH[0] ** 2 + MASS[1] * LENGTH**2 + outer + 2 * coupling
    return np.array([[inner, outer + coupling], [outer + coupling, outer]])


@pytest.mark.parametrize("angle", [0.0, 1.2, 2.5])
def test_it_is_highest_where_the_other_links_give_way_and_lowest_where_they_are_held(
    angle: float, tmp_path: Path
) -> None:
    robot, links = read_robot(str(arm(tmp_path, angle))), mass_matrix(angle)
    np.testing.assert_allclose(moved_inertias(robot), np.diag(links) + ROTOR, rtol=1e-3)
    for k, stiffness in enumerate(STIFFNESS):
        lowest = np.sqrt(stiffness / links[k, k]) / (2 * np.pi)
        highest = np.sqrt(stiffness * np.linalg.inv(links)[k, k]) / (2 * np.pi)
        assert expected_antiresonance(robot, k, others_move=False) == pytest.approx(lowest, rel=1e-3)
        assert expected_antiresonance(robot, k) == pytest.approx(highest, rel=1e-3)


@pytest.mark.parametrize("size", [0.0, -0.05])
def test_a_body_that_no_real_one_is_leaves_that_of_other_joints(size: float, tmp_path: Path) -> None:
    robot = read_robot(str(arm(tmp_path, 1.2)))
    first, second = robot.joints
    body = {name: 0.0 for name in second.parameters if name not in ("Jm", "K")} | {"Izz": size}
    robot = replace(robot, joints=(first, replace(second, parameters={**second.parameters, **body})))
    alone = INERTIA[0] + MASS[0] * REACH[0] ** 2 + size
    assert expected_antiresonance(robot, 0) == pytest.approx(np.sqrt(STIFFNESS[0] / alone) / (2 * np.pi), rel=0.15)
    assert expected_antiresonance(robot, 1) > expected_antiresonance(robot, 0)
