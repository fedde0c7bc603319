"""Pictures of a report's figures. One file per kind in `plots`, with ``figures(told)`` and ``draw(figure)``.

A kind says what is drawn (`drawing`); how is the same for all: as SVG by elid itself, as PNG by matplotlib.
"""

from __future__ import annotations

import importlib
import math
import pkgutil
from collections.abc import Iterable
from typing import TYPE_CHECKING, Protocol, cast

from elid_cli.report.figures import plots
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from elid_cli.report.figures.drawing import Drawing
    from elid_cli.report.figures.input import FigureInput


class Kind(Protocol):
    """What a module in `plots` offers. ``ORDER``, its place among the kinds, may be left out: it then comes last."""

    def figures(self, told: FigureInput) -> Iterable[Figure]:
        """Return the figures of this kind that what was found gives, none where it gives none."""

    def draw(self, figure: Figure) -> Drawing:
        """Return the figure as panels of marks."""


def kinds() -> tuple[str, ...]:
    """Return the kinds of figures that can be drawn."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(plots.__path__)))


def _kind(name: str) -> Kind:
    return cast(Kind, importlib.import_module(f"{plots.__name__}.{name}"))


def figures_of(told: FigureInput) -> tuple[Figure, ...]:
    """Return the figures of every kind."""
    found = sorted((_kind(name) for name in kinds()), key=lambda kind: getattr(kind, "ORDER", math.inf))
    return tuple(figure for kind in found for figure in kind.figures(told))


def panels_of(figure: Figure) -> Drawing:
    """Return a figure as panels of marks.

    Raises
    ------
    KeyError
        There is no such kind of figure.
    """
    if figure.kind not in kinds():
        raise KeyError(figure.kind)
    return _kind(figure.kind).draw(figure)


def picture(figure: Figure, suffix: str) -> bytes:
    """Return a figure as a file of that format: ``svg`` or ``png``.

    Raises
    ------
    ModuleNotFoundError
        PNG: matplotlib is not installed (extra ``plots``).
    KeyError
        There is no such kind of figure.
    """
    if suffix == "svg":
        from elid_cli.report.figures.svg import file

        return file(panels_of(figure), figure.title).encode("utf-8")
    from elid_cli.report.figures.raster import png

    return png(panels_of(figure))
