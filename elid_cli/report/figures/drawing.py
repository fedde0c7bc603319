"""What a figure is made of, whoever draws it: panels of marks in the units of the data.

`svg` draws them as text, for pages and files; `raster` draws them with matplotlib, as PNG; a page with a browser's
script draws those over time itself. Colours are names: a page gives them the values that suit light and dark.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Literal, TypeAlias

import numpy as np

from elid_cli._types import Array

Color = Literal["ink", "grey", "pale", "blue", "orange", "green", "purple", "before", "measured"]
PALETTE: dict[str, str] = {
    "ink": "#222222", "grey": "#6b6b6b", "pale": "#c4c4c4", "blue": "#0072b2", "orange": "#d55e00",
    "green": "#009e73", "purple": "#aa4499", "before": "#e9a978", "measured": "#86bbdf", "paper": "#ffffff",
    "line": "#e6e6e6",
}  # fmt: skip
"""Name -> value on white paper: of Okabe and Ito's palette; in grey they differ in lightness, lines in dashes too."""
CYCLE: tuple[tuple[Color, str], ...] = (
    ("blue", ""), ("orange", "6 3"), ("green", "8 3 2 3"), ("purple", "2 2"), ("ink", "10 3"), ("grey", "4 2 1 2"),
    ("before", "1 2"),
)  # fmt: skip
"""Colour and dashes of lines that stand side by side."""


@dataclass(frozen=True)
class Line:
    """A line through points; NaN is a gap."""

    x: Array
    y: Array
    color: Color = "ink"
    dash: str = ""
    width: float = 1.2
    label: str = ""


@dataclass(frozen=True)
class Dots:
    """Points: ``o`` dots, ``x`` crosses, ``d`` empty diamonds, as wide as `size` in px."""

    x: Array
    y: Array
    color: Color = "blue"
    shape: Literal["o", "x", "d"] = "o"
    size: float = 2.0
    opacity: float = 1.0
    label: str = ""


@dataclass(frozen=True)
class Band:
    """The area between two lines over x; NaN is a gap."""

    x: Array
    low: Array
    high: Array
    color: Color = "blue"
    label: str = ""


@dataclass(frozen=True)
class Rule:
    """A straight line across the panel at x or at y."""

    x: float | None = None
    y: float | None = None
    color: Color = "grey"
    dash: str = ""
    label: str = ""


@dataclass(frozen=True)
class Spans:
    """Stretches of x that are shaded over the whole height: pairs (first, last); with a `strip` at their bottom."""

    pairs: Sequence[tuple[float, float]]
    color: Color = "grey"
    label: str = ""
    strip: bool = False


@dataclass(frozen=True)
class Bars:
    """Level strokes from `low` to `high` at heights y, `width` px thick: intervals, or bars of a chart."""

    y: Array
    low: Array
    high: Array
    color: Color = "blue"
    width: float = 1.6
    label: str = ""


@dataclass(frozen=True)
class Words:
    """Texts at points; at the panel's right edge, outside it, where x is None."""

    y: Array
    texts: Sequence[str]
    x: Array | None = None
    color: Color = "grey"
    anchor: Literal["start", "middle", "end"] = "start"


@dataclass(frozen=True)
class Cells:
    """Squares of side 1 around points, filled, with a letter each."""

    x: Array
    y: Array
    fills: Sequence[str]
    letters: Sequence[str]


Mark: TypeAlias = Line | Dots | Band | Rule | Spans | Bars | Words | Cells


@dataclass(frozen=True)
class Panel:
    """One pair of axes. Limits that are None come from the marks."""

    marks: Sequence[Mark]
    title: str = ""
    xlabel: str = ""
    ylabel: str = ""
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None
    height: float = 190.0
    """px, of a panel `WIDTH` wide."""
    logarithmic: bool = False
    """Whether y is on a logarithmic scale."""
    xnames: Sequence[str] | None = None
    """Names at x = 0, 1, … instead of numbers."""
    ynames: Sequence[str] | None = None
    """Names at y = 0, 1, …, from the top, instead of numbers."""
    bare: bool = False
    """Without grid and numbers on x."""

    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the limits of x and y, with a margin where the marks set them."""
        return self.xlim or _reach(self._values("x"), False), self.ylim or _reach(self._values("y"), self.logarithmic)

    def _values(self, axis: str) -> Array:
        found: list[Array] = []
        for mark in self.marks:
            if isinstance(mark, Band):
                found += [mark.x] if axis == "x" else [mark.low, mark.high]
            elif isinstance(mark, Bars):
                found += [mark.y] if axis == "y" else [mark.low, mark.high]
            elif isinstance(mark, Rule):
                value = mark.x if axis == "x" else mark.y
                found += [] if value is None else [np.array([value])]
            elif isinstance(mark, Spans):
                found += [np.array(list(chain(*mark.pairs)))] if axis == "x" else []
            elif (values := getattr(mark, axis)) is not None:
                found.append(values)
        everything = np.concatenate([np.asarray(f, dtype=float).ravel() for f in found]) if found else np.zeros(1)
        return everything[np.isfinite(everything)]


def _reach(values: Array, logarithmic: bool) -> tuple[float, float]:
    if not values.size:
        return 0.0, 1.0
    if logarithmic:
        values = values[values > 0]
        return float(values.min()) / 1.6, float(values.max()) * 1.6
    low, high = float(values.min()), float(values.max())
    margin = 0.04 * (high - low) or abs(high) or 1.0
    return low - margin, high + margin


@dataclass(frozen=True)
class Drawing:
    """Panels, side by side where there is room, and below each other on a telephone."""

    panels: Sequence[Panel]
    over_time: bool = False
    """Whether x of all panels is one time, which a page lets its reader zoom."""
    wide: bool = False
    """Whether every panel takes the whole width of a page."""

    @property
    def columns(self) -> int:
        """Panels side by side, at most."""
        return 1 if self.wide else min(len(self.panels), 2 if len(self.panels) in (2, 4) else 3)

    def legend(self) -> tuple[Mark, ...]:
        """Return the marks with a label, one of each."""
        labelled = [m for panel in self.panels for m in panel.marks if getattr(m, "label", "")]
        return tuple({getattr(m, "label", ""): m for m in reversed(labelled)}.values())[::-1]


def alike(panels: Sequence[Panel], *axes: Literal["x", "y"]) -> tuple[Panel, ...]:
    """Return panels with the same limits of x, y or both."""
    found = [panel.limits() for panel in panels]
    shared = [(min(f[k][0] for f in found), max(f[k][1] for f in found)) for k in (0, 1)]
    changes = {f"{axis}lim": shared["xy".index(axis)] for axis in axes}
    return tuple(replace(panel, **changes) for panel in panels)  # type: ignore[arg-type]


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Return round numbers (1, 2 or 5 times a power of ten apart) between two, at most about `most`."""
    span = high - low
    if not (np.isfinite(span) and span > 0):
        return [low]
    raw = span / most
    power = 10.0 ** np.floor(np.log10(raw))
    step = next(power * f for f in (1, 2, 5, 10) if power * f >= raw * 0.999)
    first = np.ceil(low / step - 1e-9)
    return [float((first + k) * step) for k in range(int((high / step + 1e-9) - first) + 1)]


def decades(low: float, high: float, most: int = 7) -> list[float]:
    """Return powers of ten between two, at most about `most`; with twice and five times them where they are few."""
    first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
    found = [10.0**k for k in range(first, last + 1) if low <= 10.0**k <= high]
    if len(found) < 3:
        return [f * 10.0**k for k in range(first, last + 1) for f in (1, 2, 5) if low <= f * 10.0**k <= high]
    return found[:: -(-len(found) // most)]


def decade_text(value: float) -> str:
    """Return a tick of a logarithmic scale as text."""
    return f"{value:.10g}" if 1e-3 <= value < 1e4 else f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")


def tick_texts(values: Sequence[float]) -> list[str]:
    """Return ticks as text, all with the decimals that their step needs."""
    if len(values) < 2:
        return [f"{v:.3g}" if abs(v) < 1e-4 or abs(v) >= 1e6 else f"{v:.5g}" for v in values]
    step, most = abs(values[1] - values[0]), max(abs(v) for v in values)
    if most >= 1e6 or most < 1e-4:
        return ["0" if v == 0 else f"{v:.{max(0, int(np.ceil(np.log10(most / step))))}e}" for v in values]
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return [f"{v + 0.0:.{decimals}f}" for v in values]
