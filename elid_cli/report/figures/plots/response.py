"""Frequency response of a motor whose link nobody logged: rigid below, elastic above."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.report.figures.drawing import Dots, Drawing, Line, Mark, Panel, Rule
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput

ORDER = 3


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every joint whose stiffness the motor side found."""
    found = told.identified
    if found is None or found.motor_side is None:
        return
    for joint in found.motor_side.joints:
        if joint.response is None:
            continue
        data = asdict(joint.response) | {
            "rigid_to": joint.rigid_to, "antiresonance": joint.antiresonance, "resonance": joint.resonance,
            "unit": "{}/s² per {}".format(*found.robot.joints[joint.number].units),
        }  # fmt: skip
        title = f"{joint.joint}: frequency response of position over torque"
        caption = (
            f"Size of θ/τ, times (2πf)²: of rigid joints it is level. They hold within 5 % up to {joint.rigid_to:.3g}"
            f" Hz; antiresonance {joint.antiresonance:.3g} Hz, resonance {joint.resonance:.3g} Hz; other dips and"
            " peaks are other joints'. Lines: geometric mean over the poses of the log. Dots: quotient of the log's"
            " spectra, where its standard error is below 40 %; as the arm moves they smear what is sharp."
        )
        yield Figure(f"response_{joint.joint}", title, "response", data, caption)


def draw(figure: Figure) -> Drawing:
    """Draw ``elastic`` and ``rigid`` over ``frequency``, and ``measured`` over ``seen``."""
    told = figure.data
    f, size, unit = np.asarray(told["frequency"]), np.asarray(told["elastic"]), told["unit"]
    seen, measured = np.asarray(told["seen"]), np.asarray(told["measured"])
    marks: list[Mark] = [
        Rule(x=told["rigid_to"], color="grey", dash="2 3", label="rigid within 5 %"),
        Rule(x=told["antiresonance"], color="purple", dash="8 3 2 3", label="antiresonance"),
        Rule(x=told["resonance"], color="green", dash="6 3", label="resonance"),
        Line(f, np.asarray(told["rigid"]), "ink", "5 3", 1.2, "rigid joints"),
        Line(f, size, "blue", "", 1.6, "fitted model"),
        Dots(seen, measured, "orange", "o", 3.5, 0.9, "measured"),
    ]
    return Drawing([Panel(marks, "", "frequency (Hz)", f"θ/τ · (2πf)² ({unit})", (0.0, float(f[-1])), height=260,
                          logarithmic=True)], wide=True)  # fmt: skip
