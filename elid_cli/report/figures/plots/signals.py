"""A log as it was recorded, one figure a joint: positions, velocity, torque and deflection over time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from elid_cli._types import Array
from elid_cli.report.figures.drawing import Color, Drawing, Line, Mark, Panel, Spans
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.report.figures.input import FigureInput
    from elid_cli.robot.robot import Joint
    from elid_cli.signals.recording import Recording

ORDER = 2
LINES: tuple[tuple[str, tuple[tuple[str, str, Color, str], ...]], ...] = (
    ("position", (("q", "joint q", "measured", ""), ("theta", "motor θ", "ink", "5 2"))),
    ("velocity", (("dq", "joint", "measured", ""), ("dtheta", "motor", "ink", "5 2"))),
    ("torque", (("tau", "motor", "ink", ""), ("tau_link", "joint torque sensor", "orange", "5 2"))),
    ("deflection", (("deflection", "θ − q", "ink", ""),)),
)
"""Panel -> signals in it: name, label, colour and dashes."""


def figures(told: FigureInput) -> Iterator[Figure]:
    """Yield a figure of every joint of a recording."""
    if (recording := told.recording) is None or told.robot is None:
        return
    caption = (
        "As recorded, after repair. Grey, with a bar below: gaps. Orange: samples that were missing or broken, and are "
        "interpolated. Repairs of the time base are listed above."
    )
    for k, joint in enumerate(told.robot.joints):
        unit = joint.units[0]
        bridged = {signal: spans_of(when, recording.dt) for signal, j, when in recording.bridged if j == k}
        data = {"t": recording.t, "unit": unit, "gaps": gaps(recording), "signals": joint_signals(recording, joint, k),
                "bridged": bridged}  # fmt: skip
        yield Figure(f"signals_{joint.name}", f"{joint.name}: as recorded", "signals", data, caption)


def joint_signals(recording: Recording, joint: Joint, k: int) -> dict[str, Array]:
    """Return what was recorded of a joint, each (N,): velocities from the positions where none was measured.

    Of a joint with one logged side the other is a copy, which is left out.
    """
    found = {
        name: values[:, k]
        for name in ("q", "theta", "dq", "dtheta", "tau", "tau_link")
        if (values := getattr(recording, name)) is not None and np.isfinite(values[:, k]).any()
    }
    for own, copy in (("q", "theta"), ("dq", "dtheta")):
        if own in found and copy in found and np.array_equal(found[own], found[copy], equal_nan=True):
            del found[copy]
    if "dq" not in found and "dtheta" not in found:
        position = "q" if "q" in found else "theta"
        if position in found:
            found["dq" if position == "q" else "dtheta"] = _velocity(recording, found[position])
    if joint.elastic and "q" in found and "theta" in found and np.nanmax(np.abs(found["theta"] - found["q"])) > 0:
        found["deflection"] = found["theta"] - found["q"]
    return found


def _velocity(recording: Recording, position: Array) -> Array:
    """Return differences of positions, within segments."""
    velocity = np.full(len(position), np.nan)
    for segment in recording.segments:
        if len(segment) > 1:
            inside = slice(segment.start, segment.stop)
            velocity[inside] = np.gradient(position[inside], recording.dt)
    return velocity


def gaps(recording: Recording) -> list[tuple[float, float]]:
    """Return the stretches of time, s, in which nothing is known, between segments."""
    return [(float(recording.t[a.stop - 1]), float(recording.t[b.start])) for a, b in pairwise(recording.segments)]


def spans_of(when: Array, dt: float) -> list[tuple[float, float]]:
    """Return the first and last time of every run of samples, half a sample wider on either side."""
    runs = np.split(when, np.flatnonzero(np.diff(when) > 1.5 * dt) + 1)
    return [(float(run[0]) - 0.5 * dt, float(run[-1]) + 0.5 * dt) for run in runs if run.size]


def draw(figure: Figure) -> Drawing:
    """Draw ``signals`` (name -> (N,)) over ``t`` (N,) with ``gaps`` (first, last), positions in ``unit``.

    ``bridged`` has the same spans of samples that are interpolated, by signal.
    """
    data, unit = figure.data, figure.data["unit"]
    units = {"position": unit, "velocity": f"{unit}/s", "torque": "N·m" if unit == "rad" else "N",
             "deflection": f"m{unit}"}  # fmt: skip
    # no line leads across a gap
    begins = np.searchsorted(data["t"], [first for first, _ in data["gaps"]], side="right")
    t = np.insert(data["t"], begins, [0.5 * (first + last) for first, last in data["gaps"]])
    panels = []
    for name, lines in LINES:
        factor = 1e3 if name == "deflection" else 1.0
        drawn: list[Mark] = [
            Line(t, np.insert(factor * data["signals"][key], begins, np.nan), color, dash,
                 2.4 if color == "measured" else 1.1, label)
            for key, label, color, dash in lines
            if key in data["signals"]
        ]  # fmt: skip
        if drawn:
            shades: list[Mark] = [Spans(data["gaps"], "grey", "gap", strip=True)] if data["gaps"] else []
            mended = [span for key, *_ in lines for span in data["bridged"].get(key, ())]
            shades += [Spans(mended, "orange", "interpolated", strip=True)] if mended else []
            panels.append(Panel([*shades, *drawn], "", "", f"{name} ({units[name]})", height=165))
    if panels:
        panels[-1] = replace(panels[-1], xlabel="time (s)")
    return Drawing(panels, over_time=True, wide=True)


def sizes(recording: Recording, joint: Joint, k: int) -> dict[str, Any]:
    """Return how far, how fast and under which torque a joint moved: least and largest position, top speed, rms."""
    found = joint_signals(recording, joint, k)
    position = found.get("q", found.get("theta"))
    speed = found.get("dq", found.get("dtheta"))
    # single differences of a coarse encoder are no speeds: what 99 % of the samples stay below
    top = None if speed is None else float(np.nanquantile(np.abs(speed), 0.99))
    return {
        "least": None if position is None else float(np.nanmin(position)),
        "most": None if position is None else float(np.nanmax(position)),
        "speed": top,
        "torque": _rms(found.get("tau")),
        "deflection": _rms(found.get("deflection")),
    }


def _rms(values: Array | None) -> float | None:
    return None if values is None else float(np.sqrt(np.nanmean(values**2)))
