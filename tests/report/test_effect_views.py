"""Which variable a found effect is drawn against."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.report.figures.plots.effect import _followed
from elid_cli.robot.robot import Array

T = np.linspace(0.0, 20.0, 4000)
CHOICES: dict[str, Array] = {
    "velocity (rad/s)": np.cos(1.7 * T) + 0.6 * np.cos(4.1 * T),
    "position (rad)": np.sin(1.7 * T) / 1.7 + 0.6 * np.sin(4.1 * T) / 4.1,
    "time (s)": T,
}


@pytest.mark.parametrize(
    ("torque", "variable", "split"),
    [
        (np.sin(5 * CHOICES["position (rad)"]), "position (rad)", False),
        (np.sign(CHOICES["velocity (rad/s)"]) * np.abs(CHOICES["velocity (rad/s)"]) ** 2, "velocity (rad/s)", False),
        (np.where(np.gradient(CHOICES["velocity (rad/s)"]) > 0, 1.0, -1.0), "velocity (rad/s)", True),
        (0.1 * T - 1.0, "time (s)", False),
    ],
    ids=["position", "velocity", "two branches", "drift"],
)
def test_an_effect_is_drawn_against_what_it_follows(torque: Array, variable: str, split: bool) -> None:
    assert _followed(torque, CHOICES) == (variable, split)
