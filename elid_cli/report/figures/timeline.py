"""A drawing over time as data for a browser's script: thinned to what a screen shows, in two bytes a value."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.report.figures.drawing import Drawing, Line, Panel, Rule, Spans
from elid_cli.report.figures.paint import thinned

POINTS = 4000
"""Instants of a line: some five for every pixel of a page's width, so that a stretch can be looked at closely."""
LEVELS = 32767
"""Steps on either side of the middle of a line's range; one below is a gap."""


def timeline(drawing: Drawing) -> dict[str, Any]:
    """Return panels over one time: ``t``, and per panel ``series``, ``rules``, ``spans`` and limits, for JSON."""
    lines = [mark for panel in drawing.panels for mark in panel.marks if isinstance(mark, Line)]
    kept = thinned([line.y for line in lines], POINTS)
    return {"t": packed(lines[0].x[kept]), "panels": [_panel(panel, kept) for panel in drawing.panels]}


def _panel(panel: Panel, kept: NDArray[np.intp]) -> dict[str, Any]:
    marks = panel.marks
    return {
        "title": panel.title, "xlabel": panel.xlabel, "ylabel": panel.ylabel, "height": panel.height,
        "limits": panel.ylim,
        "series": [{"label": m.label, "color": m.color, "dash": m.dash, "width": m.width, "y": packed(m.y[kept])}
                   for m in marks if isinstance(m, Line)],
        "rules": [{"y": m.y, "color": m.color, "dash": m.dash, "label": m.label}
                  for m in marks if isinstance(m, Rule) and m.y is not None],
        "spans": [{"pairs": [[round(a, 4), round(b, 4)] for a, b in m.pairs], "color": m.color, "label": m.label,
                   "strip": m.strip}
                  for m in marks if isinstance(m, Spans)],
    }  # fmt: skip


def packed(values: Array) -> dict[str, Any]:
    """Return values in two bytes each, base64: ``low`` and ``step`` turn them back, the least integer is a gap."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    step = (high - low) / (2 * LEVELS) or 1.0
    whole = np.where(np.isfinite(values), np.round((values - low) / step) - LEVELS, -LEVELS - 1)
    data = base64.b64encode(np.nan_to_num(whole).astype("<i2").tobytes()).decode("ascii")
    return {"low": low, "step": step, "data": data}
