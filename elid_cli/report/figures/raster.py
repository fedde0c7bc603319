"""Drawings as PNG, by matplotlib: for a document or a mail that takes no SVG."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from elid_cli.report.figures.drawing import (
    PALETTE,
    Band,
    Bars,
    Cells,
    Dots,
    Drawing,
    Line,
    Mark,
    Panel,
    Rule,
    Spans,
    Words,
    decade_text,
    decades,
)
from elid_cli.report.figures.svg import CHARACTER, WIDE, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DOTS, COLORS = 150, 128
"""Dots per inch and colours of a PNG: drawings need few."""
INCH = 90.0
"""px of a panel in an inch."""
KEY = 50.0
"""px beside a label of a legend."""
SHAPES = {"o": ".", "x": "x", "d": "D"}


def png(drawing: Drawing) -> bytes:
    """Return a drawing as PNG.

    Raises
    ------
    ModuleNotFoundError
        matplotlib is not installed (extra ``plots``).
    """
    import matplotlib
    from matplotlib.figure import Figure

    count, width = len(drawing.panels), WIDE if drawing.wide else WIDTH
    columns = drawing.columns
    rows = -(-count // columns)
    heights = [max(p.height for p in drawing.panels[r * columns : (r + 1) * columns]) for r in range(rows)]
    stream = io.BytesIO()
    with matplotlib.rc_context(_settings()):
        size = (width * columns / INCH, (sum(heights) + 30.0) / INCH)
        made = Figure(figsize=size, layout="constrained")
        axes = made.subplots(rows, columns, squeeze=False, height_ratios=heights).ravel()
        for place, panel in zip(axes, drawing.panels, strict=False):
            _panel(place, panel)
        for spare in axes[count:]:
            spare.set_axis_off()
        named = {label: h for a in axes for h, label in zip(*a.get_legend_handles_labels(), strict=True)}
        if named:
            fit = int(width * columns // (KEY + CHARACTER * max(map(len, named))))
            made.legend(list(named.values()), list(named), loc="outside upper left",
                        ncols=max(1, min(fit, 2 * max(columns, 1))))  # fmt: skip
        made.savefig(stream, format="png", metadata={"Software": None}, dpi=DOTS)
    return _small(stream)


def _small(png: io.BytesIO) -> bytes:
    """Return a PNG with a palette, about a third as large."""
    from PIL import Image  # matplotlib brings it

    small = io.BytesIO()
    with Image.open(png) as drawn:
        drawn.convert("RGB").quantize(COLORS, dither=Image.Dither.NONE).save(small, "PNG", optimize=True)
    return small.getvalue()


def _settings() -> dict[Any, Any]:
    ink, grey = PALETTE["ink"], PALETTE["grey"]
    return {
        "font.size": 9.0, "axes.titlesize": 9.5, "axes.titlelocation": "left", "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"], "axes.spines.top": False, "axes.spines.right": False,
        "axes.edgecolor": grey, "xtick.color": grey, "ytick.color": grey, "xtick.labelcolor": ink,
        "ytick.labelcolor": ink, "axes.grid": True, "grid.color": PALETTE["line"], "axes.axisbelow": True,
        "legend.frameon": False, "legend.fontsize": 8.5, "axes.unicode_minus": False,
        "text.parse_math": False,  # names of joints may hold a dollar sign
    }  # fmt: skip


def _panel(axes: Axes, panel: Panel) -> None:
    for mark in panel.marks:
        _mark(axes, mark)
    (x, y) = panel.limits()
    if panel.logarithmic:
        axes.set_yscale("log")
        rows = decades(*y)
        axes.set_yticks(rows, [decade_text(value) for value in rows])
        axes.tick_params(axis="y", which="minor", left=False)
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_title(panel.title)
    axes.set_xlabel(panel.xlabel)
    axes.set_ylabel(panel.ylabel)
    if panel.ynames is not None:
        axes.set_yticks(range(len(panel.ynames)), panel.ynames)
    if panel.bare:
        axes.grid(visible=False)
        axes.set_xticks([])
    if panel.xnames is not None:
        axes.set_xticks(range(len(panel.xnames)), panel.xnames)


def _mark(axes: Axes, mark: Mark) -> None:
    if isinstance(mark, Cells):
        _cells(axes, mark)
        return
    color = PALETTE[mark.color]
    label: Any = getattr(mark, "label", "") or None
    if isinstance(mark, Line):
        axes.plot(mark.x, mark.y, color=color, linewidth=mark.width, linestyle=_dashes(mark.dash), label=label)
    elif isinstance(mark, Dots):
        wide = mark.size * (1.0 if mark.shape == "x" else 0.7 if mark.shape == "d" else 1.8)
        face = "none" if mark.shape == "d" else color
        axes.plot(mark.x, mark.y, SHAPES[mark.shape], color=color, markersize=wide, alpha=mark.opacity, label=label,
                  markerfacecolor=face)  # fmt: skip
    elif isinstance(mark, Band):
        axes.fill_between(mark.x, mark.low, mark.high, color=color, alpha=0.22, linewidth=0, label=label)
    elif isinstance(mark, Rule):
        draw: Any = axes.axvline if mark.x is not None else axes.axhline
        draw(mark.x if mark.x is not None else mark.y, color=color, linewidth=0.8, linestyle=_dashes(mark.dash),
             label=label)  # fmt: skip
    elif isinstance(mark, Spans):
        _spans(axes, mark, color, label)
    elif isinstance(mark, Bars):
        axes.hlines(mark.y, mark.low, mark.high, color=color, linewidth=mark.width, label=label)
    elif isinstance(mark, Words):
        _words(axes, mark, color)


def _spans(axes: Axes, mark: Spans, color: str, label: Any) -> None:
    for number, (first, last) in enumerate(mark.pairs):
        axes.axvspan(first, last, color=color, alpha=0.18, linewidth=0, label=None if number else label)
        if mark.strip:
            axes.axvspan(first, last, 0.0, 0.03, color=color, linewidth=0)


def _cells(axes: Axes, mark: Cells) -> None:
    from matplotlib.patches import Rectangle

    for x, y, fill, letter in zip(mark.x, mark.y, mark.fills, mark.letters, strict=True):
        axes.add_patch(Rectangle((x - 0.48, y - 0.46), 0.96, 0.92, facecolor=fill, edgecolor="#bbbbbb"))
        axes.text(x, y, letter, ha="center", va="center", color=PALETTE["ink"])


def _words(axes: Axes, mark: Words, color: str) -> None:
    outside = mark.x is None
    across = axes.get_yaxis_transform() if outside else axes.transData
    align = {"start": "left", "middle": "center", "end": "right"}[mark.anchor]
    for k, text in enumerate(mark.texts):
        place = 1.02 if outside else float(np.asarray(mark.x)[k])
        axes.text(place, float(mark.y[k]), text, va="center", ha=align, color=color, transform=across, fontsize=8)


def _dashes(dash: str) -> Any:
    return (0, tuple(float(part) * 0.7 for part in dash.split())) if dash else "-"
