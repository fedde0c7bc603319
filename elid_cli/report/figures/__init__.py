"""Pictures of a report's figures. One file per kind in `plots`, with ``figures(told)`` and ``draw(figure, paper)``.

matplotlib is imported only when something is drawn, and pyplot never, so that no display and no global state matter.
"""

from __future__ import annotations

import importlib
import io
import math
import pkgutil
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Protocol, cast

from elid_cli.report.figures import plots
from elid_cli.report.tree import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from elid_cli.report.figures.input import FigureInput
    from elid_cli.report.figures.paint import Paper

SALT = "elid"
"""Salt of the identifiers in an SVG: the same figure gives the same bytes."""
RESOLUTION = 150
"""Dots per inch of a PNG."""
COLORS = 128
"""Colours of a PNG."""


class Kind(Protocol):
    """What a module in `plots` offers. ``ORDER``, its place among the kinds, may be left out: it then comes last."""

    def figures(self, told: FigureInput) -> Iterable[Figure]:
        """Return the figures of this kind that what was found gives, none where it gives none."""

    def draw(self, figure: Figure, paper: Paper) -> Canvas:
        """Return the picture, as wide as the paper."""


def kinds() -> tuple[str, ...]:
    """Return the kinds of figures that can be drawn."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(plots.__path__)))


def _kind(name: str) -> Kind:
    return cast(Kind, importlib.import_module(f"{plots.__name__}.{name}"))


def figures_of(told: FigureInput) -> tuple[Figure, ...]:
    """Return the figures of every kind."""
    found = sorted((_kind(name) for name in kinds()), key=lambda kind: getattr(kind, "ORDER", math.inf))
    return tuple(figure for kind in found for figure in kind.figures(told))


def picture(figure: Figure, suffix: str, *, narrow: bool = False) -> bytes:
    """Return a figure as a file of that format: ``svg`` or ``png``; `narrow` for a telephone's width.

    Raises
    ------
    ModuleNotFoundError
        matplotlib is not installed (extra ``plots``).
    KeyError
        There is no such kind of figure.

    """
    from elid_cli.report.figures.paint import PAGE, TELEPHONE, settings

    if figure.kind not in kinds():
        raise KeyError(figure.kind)
    import matplotlib

    stream = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None, "Creator": None} if suffix == "svg" else {"Software": None}
    chosen: Any = {**settings(), "svg.hashsalt": f"{SALT}-{figure.key}{narrow:d}"}
    with matplotlib.rc_context(chosen):
        drawn = _kind(figure.kind).draw(figure, TELEPHONE if narrow else PAGE)
        drawn.savefig(stream, format=suffix, metadata=metadata, dpi=RESOLUTION)
    return stream.getvalue() if suffix == "svg" else _small(stream)


def _small(png: io.BytesIO) -> bytes:
    """Return a PNG with a palette, about a third as large: drawings need few colours."""
    from PIL import Image  # matplotlib brings it

    small = io.BytesIO()
    with Image.open(png) as drawn:
        drawn.convert("RGB").quantize(COLORS, dither=Image.Dither.NONE).save(small, "PNG", optimize=True)
    return small.getvalue()
