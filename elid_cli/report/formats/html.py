"""One self-contained page that opens offline: summary first, figures inline, every table whole."""

from __future__ import annotations

import base64
import platform
import re
from collections.abc import Iterable, Sequence
from html import escape
from importlib import metadata, resources

from elid_cli import __version__
from elid_cli.errors import UsageError, visible
from elid_cli.report.formats import Style
from elid_cli.report.tree import (
    Cell,
    Column,
    Figure,
    KeyValues,
    Mark,
    Quantity,
    Report,
    Section,
    Table,
    Text,
    cell_text,
    file_name,
)

SUFFIXES, FIGURES = (".html", ".htm"), True
LONG = 14
"""Rows of a table beyond which it is folded."""
RESULTS = ("facts", "effects", "effects_meaning", "also_possible", "before_after", "error", "physical")
"""Tables and facts that belong to the summary."""
_LARGEST = 600_000
"""Bytes of an SVG above which a figure goes into the page as PNG."""


def render(report: Report, style: Style) -> str:
    """Return the page; `style` does not matter, since a browser decides."""
    del style
    title = next((s.text for s in report.sections if isinstance(s, Text) and s.role == "heading"), report.command)
    first, rest = _ordered(report.sections)
    figures = [section for section in rest if isinstance(section, Figure)]
    body = [
        "<header>", f"<p class=kicker>elid {escape(report.command)}</p>", f"<h1>{escape(title)}</h1>",
        f"<pre class=command>{escape(report.invocation)}</pre>" if report.invocation else "", "</header>",
        '<section class="summary" aria-label="summary">', *(_section(s) for s in first), "</section>",
        _contents(figures),
        *(_section(s) for s in rest),
        f"<footer>{_origin(report)}</footer>",
    ]  # fmt: skip
    sheet = resources.files(__package__).joinpath("page.css").read_text("utf-8")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{escape(title)}</title>\n<style>\n{sheet}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(part for part in body if part)
        + "\n</main>\n</body>\n</html>\n"
    )


def fragment(sections: Sequence[Section]) -> str:
    """Return sections as part of somebody else's page, such as a notebook: plain elements in their order."""
    return "\n".join(_section(section) for section in sections)


def _ordered(sections: Sequence[Section]) -> tuple[list[Section], list[Section]]:
    """Return (summary, rest): warnings, results and the next command; then facts, tables, figures and long tables.

    Within each of these the report's own order stands.
    """
    said = [s for s in sections if not (isinstance(s, Text) and s.role == "heading")]
    first = [s for s in said if _is_result(s)]
    following = [s for s in said if isinstance(s, Text) and s.role == "next"]
    other = [s for s in said if s not in first and s not in following]
    figures = [s for s in other if isinstance(s, Figure)]
    folded = [s for s in other if isinstance(s, Table) and len(s.rows) > LONG]
    short = [s for s in other if s not in figures and s not in folded]
    first.sort(key=lambda s: not (isinstance(s, Text) and s.role == "warning"))
    return [*first, *following], [*short, *figures, *folded]


def _is_result(section: Section) -> bool:
    if isinstance(section, Text):
        return section.role in ("plain", "warning")
    return section.key in RESULTS and not (isinstance(section, Table) and len(section.rows) > LONG)


def _origin(report: Report) -> str:
    """Return what a reader needs to do it again: versions of the programs, and hashes of what was read."""
    versions = ", ".join(f"{name} {_version(name)}" for name in ("numpy", "scipy", "matplotlib"))
    lines = [f"elid {__version__}, Python {platform.python_version()}, {versions}"]
    log = report.payload.get("log") or {}
    hashes = zip(log.get("files", ()), log.get("sha256", ()), strict=False)
    lines += [f"{file} sha256 {digest}" for file, digest in hashes]
    return "<br>".join(escape(visible(line)) for line in lines)


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _contents(figures: Sequence[Figure]) -> str:
    if len(figures) < 3:
        return ""
    links = "".join(f'<li><a href="#{_anchor(f.key)}">{escape(f.title)}</a></li>' for f in figures)
    return f"<nav><details><summary>{len(figures)} figures</summary><ol>{links}</ol></details></nav>"


def _section(section: Section) -> str:
    if isinstance(section, Text):
        return _text(section)
    if isinstance(section, KeyValues):
        return _key_values(section)
    if isinstance(section, Table):
        return _table(section)
    return _figure(section)


def _text(section: Text) -> str:
    if section.role == "next":
        return f"<p class=next>Next</p><pre class=command>{escape(section.text)}</pre>"
    if section.role == "code":
        return f"<pre>{escape(section.text)}</pre>"
    kind = "warning" if section.role == "warning" else "meaning"
    return f'<p class="{kind}">{escape(section.text)}</p>'


def _key_values(section: KeyValues) -> str:
    rows = "".join(f"<dt>{escape(label)}</dt><dd>{escape(cell_text(cell))}</dd>" for label, cell in section.items)
    return f"{_title(section.title)}<dl>{rows}</dl>"


def _table(section: Table) -> str:
    head = "".join(_head(column) for column in section.columns)
    rows = [_row(section.columns, row) for row in section.rows]
    table = f"<div class=scroll><table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    note = f"<p class=note>{escape(section.note)}</p>" if section.note else ""
    name = section.title or {"error": "torque error"}.get(section.key, section.key.replace("_", " "))
    if len(rows) > LONG:
        return f"<details><summary>{escape(name[:1].upper() + name[1:])} ({len(rows)})</summary>{table}{note}</details>"
    return f"{_title(name)}{table}{note}"


def _head(column: Column) -> str:
    return f'<th class="{column.align}">{escape(column.head)}</th>'


def _row(columns: Iterable[Column], cells: Iterable[Cell]) -> str:
    parts = []
    for column, cell in zip(columns, cells, strict=True):
        tone = cell.tone if isinstance(cell, Mark | Quantity) else "plain"
        text = escape(cell_text(cell, unit=not column.unit))
        parts.append(f'<td class="{column.align} {tone}">{text}</td>')
    return f"<tr>{''.join(parts)}</tr>"


def _figure(figure: Figure) -> str:
    caption = f"<figcaption>{escape(figure.caption)}</figcaption>" if figure.caption else ""
    wide, narrow = (_picture(figure, narrow=narrow) for narrow in (False, True))
    return (
        f'<figure id="{_anchor(figure.key)}"><h2>{escape(figure.title)}</h2>'
        f'<div class="paper wide">{wide}</div><div class="paper narrow">{narrow}</div>{caption}</figure>'
    )


def _picture(figure: Figure, *, narrow: bool) -> str:
    try:
        from elid_cli.report.figures import picture

        drawn = picture(figure, "svg", narrow=narrow)
        if len(drawn) > _LARGEST:
            data = base64.b64encode(picture(figure, "png", narrow=narrow)).decode("ascii")
            return f'<img alt="{escape(figure.title)}" src="data:image/png;base64,{data}">'
    except ModuleNotFoundError as missing:
        raise UsageError(f"--report: {missing.name} is not installed", hint="pip install 'elid[plots]'") from None
    return _inline(drawn.decode("utf-8"), figure, "narrow-" if narrow else "")


def _inline(svg: str, figure: Figure, variant: str) -> str:
    """Return an SVG as part of a page: without prologue, its identifiers made unique by the figure's key."""
    svg = svg[svg.index("<svg") :]
    prefix = f"{_anchor(figure.key)}-{variant}"
    svg = re.sub(r'\bid="', f'id="{prefix}', svg)
    svg = re.sub(r"url\(#", f"url(#{prefix}", svg)
    svg = re.sub(r'href="#', f'href="#{prefix}', svg)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{escape(figure.title)}" ', 1)


def _anchor(key: str) -> str:
    return "f-" + re.sub(r"[^A-Za-z0-9_-]", "_", file_name(key))


def _title(title: str) -> str:
    return f"<h2>{escape(title[:1].upper() + title[1:])}</h2>" if title else ""
