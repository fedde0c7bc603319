"""Drawings as SVG, written without a plotting library: small, quick, and in the colours of the page around them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape

import numpy as np

from elid_cli._types import Array
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
    tick_texts,
    ticks,
)
from elid_cli.report.figures.paint import envelope

WIDTH, WIDE = 370.0, 760.0
"""px of a panel that stands beside others, and of one that takes a page's width."""
TYPE, CHARACTER = 11.0, 6.1
"""px: size of type, and about the width of a character of it."""
STRIP = 4.0
"""px of a strip under a shaded stretch."""
STEP = 4.0
"""px of a column of a long line, of which only the smallest and the largest value are drawn."""

Place = Callable[[Array], Array]


def file(drawing: Drawing, title: str) -> str:
    """Return a drawing as an SVG file on white paper, its panels side by side, legend on top."""
    width = WIDE if drawing.wide else WIDTH
    columns = drawing.columns
    parts, legend_height = _legend_row(drawing, width * columns)
    x, y, tallest = 0.0, legend_height, 0.0
    for number, panel in enumerate(drawing.panels):
        if number and number % columns == 0:
            x, y, tallest = 0.0, y + tallest, 0.0
        inner, height = _panel(panel, width)
        parts.append(f'<g transform="translate({x:g} {y:g})">{inner}</g>')
        x, tallest = x + width, max(tallest, height)
    full, height = width * columns, y + tallest
    colors = ";".join(f"--{name}:{value}" for name, value in PALETTE.items())
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {full:g} {height:g}" width="{full:g}" '
        f'height="{height:g}" style="{colors};color:var(--ink)" font-family="system-ui, DejaVu Sans, sans-serif" '
        f'font-size="{TYPE:g}"><title>{escape(title)}</title><rect width="100%" height="100%" fill="var(--paper)"/>'
        f"{''.join(parts)}</svg>\n"
    )


def panels(drawing: Drawing, title: str) -> list[str]:
    """Return each panel as an SVG for a page, whose style sheet has the colours and the type.

    Only what is drawn over time is as wide as a page: on a telephone, its letters would be too small to read.
    """
    width = WIDE if drawing.over_time else WIDTH
    found = []
    for panel in drawing.panels:
        inner, height = _panel(panel, width)
        name = " ".join(part for part in (title, panel.title) if part)
        head = f'<svg class="panel" viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(name)}">'
        found.append(f"{head}{inner}</svg>")
    return found


def swatch(mark: Mark) -> str:
    """Return the SVG beside a mark's label in a legend, 22 by 10 px."""
    here = np.array([1.0, 21.0]), np.array([5.0, 5.0])
    return _mark(_at(mark, *here), lambda v: v, lambda v: v, (0.0, 22.0, 0.0, 10.0))


def _at(mark: Mark, x: Array, y: Array) -> Mark:
    if isinstance(mark, Line):
        return Line(x, y, mark.color, mark.dash, mark.width)
    if isinstance(mark, Dots):
        return Dots(np.array([11.0]), np.array([5.0]), mark.color, mark.shape, max(mark.size, 4.0))
    if isinstance(mark, Rule):
        return Line(x, y, mark.color, mark.dash, 1.0)
    if isinstance(mark, Bars):
        return Line(x, y, mark.color, "", min(mark.width, 8.0))
    return Spans([(1.0, 21.0)], getattr(mark, "color", "grey"), strip=getattr(mark, "strip", False))


def _legend_row(drawing: Drawing, width: float) -> tuple[list[str], float]:
    """Return the legend as a row that folds, and its height."""
    parts, x, y = [], 8.0, 6.0
    for mark in drawing.legend():
        label = getattr(mark, "label", "")
        takes = 44.0 + CHARACTER * len(label)
        if x + takes > width and x > 8.0:
            x, y = 8.0, y + 16.0
        parts.append(f'<g transform="translate({x:g} {y:g})">{swatch(mark)}</g>')
        parts.append(f'<text x="{x + 27:g}" y="{y + 9:g}" fill="currentColor">{escape(label)}</text>')
        x += takes
    return parts, (y + 18.0 if parts else 0.0)


def _panel(panel: Panel, width: float) -> tuple[str, float]:
    """Return the elements of one panel and its height."""
    (x0, x1), (y0, y1) = panel.limits()
    rows = _y_ticks(panel, y0, y1)
    outside = [len(text) for mark in panel.marks if isinstance(mark, Words) and mark.x is None for text in mark.texts]
    # names are written in smaller type than numbers are measured in
    left = min(14.0 + CHARACTER * max((len(text) for _, text in rows), default=1), 0.55 * width)
    left += 16.0 if panel.ylabel else 0.0
    right = 10.0 + CHARACTER * max(outside, default=0)
    top = 20.0 if panel.title else 8.0
    bottom = 8.0 + (16.0 if not panel.bare or panel.xnames else 0.0) + (15.0 if panel.xlabel else 0.0)
    height = panel.height
    box = (left, width - right, top, height - bottom)

    def across(v: Array) -> Array:
        return box[0] + (np.asarray(v, dtype=float) - x0) / (x1 - x0) * (box[1] - box[0])

    def up(v: Array) -> Array:
        v, low, high = (np.log10(np.maximum(w, 1e-300)) if panel.logarithmic else np.asarray(w, dtype=float)
                        for w in (v, y0, y1))  # fmt: skip
        return np.asarray(box[3] - (v - low) / (high - low) * (box[3] - box[2]))

    parts = [_frame(panel, box, across, up, rows, (x0, x1))]
    parts += [_mark(mark, across, up, box) for mark in panel.marks]
    if panel.title:
        parts.append(f'<text x="{left:g}" y="13" fill="currentColor" font-weight="600">{escape(panel.title)}</text>')
    middle = 0.5 * (box[0] + box[1])
    if panel.xlabel:
        parts.append(_text(panel.xlabel, middle, height - 4, "middle"))
    if panel.ylabel:
        place = 0.5 * (box[2] + box[3])
        parts.append(f'<g transform="translate(11 {place:.0f}) rotate(-90)">{_text(panel.ylabel, 0, 0, "middle")}</g>')
    return "".join(parts), height


def _y_ticks(panel: Panel, low: float, high: float) -> list[tuple[float, str]]:
    if panel.ynames is not None:
        return [(float(k), name) for k, name in enumerate(panel.ynames)]
    if panel.logarithmic:
        return [(value, decade_text(value)) for value in decades(low, high)]
    found = [t for t in ticks(low, high, max(3, int(panel.height / 38))) if low <= t <= high]
    return list(zip(found, tick_texts(found), strict=True))


def _frame(
    panel: Panel, box: tuple[float, float, float, float], across: Place, up: Place,
    rows: Sequence[tuple[float, str]], limits: tuple[float, float],
) -> str:  # fmt: skip
    left, right, top, bottom = box
    if panel.xnames is not None:
        columns = [(float(k), name) for k, name in enumerate(panel.xnames)]
    else:
        found = [t for t in ticks(*limits, 5 if right - left < 400 else 9) if limits[0] <= t <= limits[1]]
        columns = list(zip(found, tick_texts(found), strict=True))
    ys = [float(v) for v in up(np.array([value for value, _ in rows]))]
    xs = [float(v) for v in across(np.array([value for value, _ in columns]))]
    parts = []
    if not panel.bare:
        grid = "".join(f"M{left:.1f} {y:.1f}H{right:.1f}" for y in ys)
        grid += "".join(f"M{x:.1f} {top:.1f}V{bottom:.1f}" for x in xs)
        parts.append(f'<path d="{grid}" stroke="var(--line)" fill="none"/>')
        parts.append(f'<path d="M{left:.1f} {top:.1f}V{bottom:.1f}H{right:.1f}" stroke="var(--grey)" fill="none"/>')
    parts += [_text(text, left - 5, y + 4, "end") for y, (_, text) in zip(ys, rows, strict=True)]
    if not panel.bare or panel.xnames:
        parts += [_text(text, x, bottom + 13, "middle") for x, (_, text) in zip(xs, columns, strict=True)]
    return "".join(parts)


def _text(text: str, x: float, y: float, anchor: str, color: str = "currentColor") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{color}">{escape(text)}</text>'


def _mark(mark: Mark, across: Place, up: Place, box: tuple[float, float, float, float]) -> str:
    left, right, top, bottom = box
    color = f"var(--{getattr(mark, 'color', 'ink')})"
    if isinstance(mark, Line):
        dash = f' stroke-dasharray="{mark.dash}"' if mark.dash else ""
        drawn = _path(across(mark.x), np.clip(up(mark.y), top, bottom))
        return f'<path d="{drawn}" stroke="{color}" stroke-width="{mark.width:g}" fill="none"{dash}/>'
    if isinstance(mark, Dots):
        return _dots(mark, across(mark.x), up(mark.y), box, color)
    if isinstance(mark, Band):
        return f'<path d="{_area(across(mark.x), up(mark.low), up(mark.high))}" fill="{color}" opacity=".22"/>'
    if isinstance(mark, Rule):
        dash = f' stroke-dasharray="{mark.dash}"' if mark.dash else ""
        if mark.x is not None:
            line = f"M{float(across(np.array(mark.x))):.1f} {top:.1f}V{bottom:.1f}"
        else:
            line = f"M{left:.1f} {float(up(np.array(mark.y))):.1f}H{right:.1f}"
        return f'<path d="{line}" stroke="{color}" fill="none"{dash}/>'
    if isinstance(mark, Spans):
        pairs = [(max(float(a), left), min(float(b), right)) for a, b in
                 (across(np.array(pair)) for pair in mark.pairs)]  # fmt: skip
        line = "".join(f"M{a:.1f} {top:.1f}H{b:.1f}V{bottom:.1f}H{a:.1f}z" for a, b in pairs)
        strip = "".join(f"M{a:.1f} {bottom - STRIP:.1f}H{b:.1f}V{bottom:.1f}H{a:.1f}z" for a, b in pairs)
        below = f'<path d="{strip}" fill="{color}"/>' if mark.strip else ""
        return f'<path d="{line}" fill="{color}" opacity=".18"/>{below}'
    if isinstance(mark, Bars):
        low, high = (np.clip(across(v), left, right) for v in (mark.low, mark.high))
        line = "".join(
            f"M{p:.1f} {r:.1f}H{q:.1f}" for p, q, r in zip(low, high, up(mark.y), strict=True) if np.isfinite(p + q)
        )
        return f'<path d="{line}" stroke="{color}" stroke-width="{mark.width:g}" fill="none"/>'
    if isinstance(mark, Words):
        xs = np.full(len(mark.texts), right + 6) if mark.x is None else across(mark.x)
        return "".join(
            _text(text, float(x), float(y) + 4, mark.anchor, color)
            for text, x, y in zip(mark.texts, xs, up(mark.y), strict=True)
        )
    return _cells(mark, across, up)


def _dots(mark: Dots, x: Array, y: Array, box: tuple[float, float, float, float], color: str) -> str:
    inside = np.isfinite(x) & np.isfinite(y) & (x >= box[0] - 1) & (x <= box[1] + 1)
    inside &= (y >= box[2] - 1) & (y <= box[3] + 1)
    x, y, r = x[inside], y[inside], mark.size / 2
    opacity = f' opacity="{mark.opacity:g}"' if mark.opacity < 1 else ""
    if mark.shape == "o":
        line = "".join(f"M{a:.0f} {b:.1f}h0" for a, b in zip(x, y, strict=True))
        look = f'stroke-width="{mark.size:g}" stroke-linecap="round" fill="none"{opacity}'
        return f'<path d="{line}" stroke="{color}" {look}/>'
    cross = f"l{r:g} {r:g}m{-r:g} 0l{r:g} {-r:g}" if mark.shape == "x" else f"m{r / 2:g} {-r / 2:g}"
    if mark.shape == "x":
        line = "".join(f"M{a - r / 2:.0f} {b - r / 2:.1f}{cross}" for a, b in zip(x, y, strict=True))
    else:
        line = "".join(
            f"M{a - r:.1f} {b:.1f}l{r:g} {r:g}l{r:g} {-r:g}l{-r:g} {-r:g}z" for a, b in zip(x, y, strict=True)
        )
    return f'<path d="{line}" stroke="{color}" fill="none"{opacity}/>'


def _cells(mark: Cells, across: Place, up: Place) -> str:
    wide = abs(float(across(np.array(0.96)) - across(np.array(0.0))))
    high = abs(float(up(np.array(0.92)) - up(np.array(0.0))))
    parts = []
    for x, y, fill, letter in zip(across(mark.x), up(mark.y), mark.fills, mark.letters, strict=True):
        ink = "#ffffff" if _dark(fill) else "#222222"
        parts.append(
            f'<rect x="{x - wide / 2:.1f}" y="{y - high / 2:.1f}" width="{wide:.1f}" height="{high:.1f}" fill="{fill}" '
            f'stroke="#bbbbbb" stroke-width=".5"/>{_text(letter, float(x), float(y) + 4, "middle", ink)}'
        )
    return "".join(parts)


def _dark(color: str) -> bool:
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return 0.299 * red + 0.587 * green + 0.114 * blue < 140


def _path(x: Array, y: Array) -> str:
    """Return a polyline, broken where a value is missing; points closer than half a pixel are left out."""
    if np.all(np.diff(x) >= 0) and len(x) > 1:
        x, y = envelope(x, y, max(2, int((x[-1] - x[0]) / STEP)))
    parts, drawn, last = [], False, (0.0, 0.0)
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if a != a or b != b:
            drawn = False
        elif not drawn:
            last = (round(a, 1), round(b, 1))
            parts.append(f"M{last[0]:g} {last[1]:g}h0")
            drawn = True
        elif abs(a - last[0]) + abs(b - last[1]) >= 0.5:
            dx, dy = round(a - last[0], 1), round(b - last[1], 1)
            parts.append(f"l{dx:g} {dy:g}")
            last = (last[0] + dx, last[1] + dy)
    return "".join(parts)


def _area(x: Array, low: Array, high: Array) -> str:
    """Return the outline between two lines, one closed piece between gaps."""
    fine = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
    pieces = np.split(np.arange(len(x)), np.flatnonzero(~fine))
    parts = []
    for piece in pieces:
        piece = piece[fine[piece]]
        if piece.size:
            there = [f"{a:.1f} {b:.1f}" for a, b in zip(x[piece], high[piece], strict=True)]
            back = [f"{a:.1f} {b:.1f}" for a, b in zip(x[piece][::-1], low[piece][::-1], strict=True)]
            parts.append(f"M{'L'.join([*there, *back])}z")
    return "".join(parts)
