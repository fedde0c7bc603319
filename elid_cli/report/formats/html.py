"""One self-contained page that opens offline: four answers first, then their evidence, all else folded."""

from __future__ import annotations

import json
import platform
import re
from collections.abc import Iterable, Sequence
from html import escape
from importlib import metadata, resources

from elid_cli import __version__
from elid_cli.errors import visible
from elid_cli.report.formats import Style
from elid_cli.report.formats.terminal import TIE, UNITS
from elid_cli.report.glossary import TERMS, explained
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
    upper,
)

SUFFIXES, FIGURES = (".html", ".htm"), True
LONG, SHORT = 16, 24
"""Rows of a table beyond which it is folded, and characters of a cell up to which it stays on one line."""
PARTS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("Evidence", ("figure:effect", "figure:residual+left", "figure:errors", "figure:trended", "figure:drawn_sets",
                  "figure:change", "motor_side*", "figure:response", "parameters", "moved*", "unmoved*",
                  "member_errors", "values", "members", "effects*", "meaning", "waiting", "also_possible",
                  "before_after", "position", "error*", "unexplained", "triage", "differing", "by_log")),
    ("Parameters", ("figure:parameters", "drives", "joint_parameters", "base_parameters", "all_parameters", "reasons",
                    "physical*", "std_error")),
    ("What to record next", ("record", "next")),
    ("Over time", ("figure:torque", "figure:trajectory", "figure:replayed", "figure:signals")),
)  # fmt: skip
"""Heading -> keys of sections and kinds of figures under it, in that order; what is in none of them is folded."""
OPEN = 1
"""Figures over time that are not folded."""
LESS = "\\u003c"
"""``<`` inside JSON, where a browser would look for the end of a script."""
TOOLS = (
    '<div class=tools role=toolbar aria-label="zoom of all plots over time">'
    + "".join(f'<button type=button data-do="{do}">{words}</button>' for do, words in (
        ("in", "zoom in"), ("out", "zoom out"), ("back", "← earlier"), ("on", "later →"), ("all", "whole log"),
        ("before", "hide before")))
    + "<span>or drag over a plot; double-click for the whole log</span></div>"
)  # fmt: skip
"""What a keyboard can do with plots over time."""


def render(report: Report, style: Style) -> str:
    """Return the page; `style` does not matter, since a browser decides."""
    del style
    title = next((s.text for s in report.sections if isinstance(s, Text) and s.role == "heading"), report.command)
    said = [s for s in report.sections if not (isinstance(s, Text) and s.role == "heading")]
    body = [
        "<header>", f"<p class=kicker>elid {escape(report.command)}</p>", f"<h1>{escape(title)}</h1>", "</header>",
        *(_answered(said) if any(s.key == "answers" for s in said) else _plain(said)),
        f"<footer>{_command(report.invocation)}{_origin(report)}</footer>",
    ]  # fmt: skip
    timed = "class=plot " in "".join(body)
    if any("class=term " in part for part in body):
        body.insert(-1, _glossary())
    sheets = [_file("uPlot.min.css"), _file("page.css")] if timed else [_file("page.css")]
    scripts = "".join(f"<script>\n{_file(name)}</script>\n" for name in ("uPlot.iife.min.js", "page.js") if timed)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n<link rel="icon" href="data:,">\n'
        f"<title>{escape(title)}</title>\n<style>\n{''.join(sheets)}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(part for part in body if part)
        + f"\n</main>\n{scripts}</body>\n</html>\n"
    )


def fragment(sections: Sequence[Section]) -> str:
    """Return sections as part of somebody else's page, such as a notebook: plain elements in their order."""
    whole = "\n".join(_section(section) for section in sections)
    # the glossary that terms lead to stays behind
    return re.sub(r'<a class=term href="[^"]*"( title="[^"]*")>(.*?)</a>', r"<span\1>\2</span>", whole)


def _file(name: str) -> str:
    return resources.files(__package__).joinpath("page", name).read_text("utf-8")


def _answered(said: Sequence[Section]) -> list[str]:
    """Return a page that opens with answers: warnings under them, then the parts, then everything else, folded."""
    answers = next(s for s in said if s.key == "answers")
    assert isinstance(answers, KeyValues)
    warnings = [s for s in said if isinstance(s, Text) and s.role == "warning"]
    left = [s for s in said if s is not answers and s not in warnings]
    page = [_answers(answers) + _lights(left), *map(_section, warnings)]
    for heading, keys in PARTS:
        chosen = [s for key in keys for s in left if _is(s, key)]
        left = [s for s in left if s not in chosen]
        if not chosen:
            continue
        inner = "".join(_section(s, heading) for s in chosen)
        if [s.key for s in chosen] == ["next"]:
            heading = "Next"
        page.append(_over_time(chosen) if keys is PARTS[-1][1] else f"<section><h2>{heading}</h2>{inner}</section>")
    rest = "".join(_folded(s, True) for s in left)
    if not rest:
        return page
    return [*page, f"<section class=rest><h2>Everything else</h2>{rest}</section>"]


def _plain(said: Sequence[Section]) -> list[str]:
    """Return a page in the report's own order, with what is drawn over time at its end."""
    _, keys = PARTS[-1]
    timed = [s for s in said if any(_is(s, key) for key in keys)]
    tables = [s for s in said if isinstance(s, Table)]
    main = tables[0] if len(tables) == 1 else None  # the one table is what the page is for
    return [*(_section(s, whole=s is main) for s in said if s not in timed), _over_time(timed)]


def _over_time(timed: Sequence[Section]) -> str:
    chosen = [s for s in timed if isinstance(s, Figure) and s.data.get("first")]
    first: Sequence[Section] = chosen or timed
    inner = "".join(_folded(s, s not in first[:OPEN]) for s in timed)
    return f"<section><h2>{PARTS[-1][0]}</h2>{TOOLS}{inner}</section>" if timed else ""


def _is(section: Section, key: str) -> bool:
    """Whether a section has a key, one that begins like it (``effects*``), or a figure's kind (``figure:torque``).

    After a plus sign stands a mark that the figure's data must have (``figure:residual+left``).
    """
    head, _, rest = key.partition(":")
    kind, _, mark = rest.partition("+")
    if kind or isinstance(section, Figure):
        return (head == "figure" and isinstance(section, Figure) and section.kind == kind
                and (not mark or bool(section.data.get(mark))))  # fmt: skip
    return section.key.startswith(key[:-1]) if key.endswith("*") else section.key == key


def _answers(answers: KeyValues) -> str:
    cards = "".join(
        f"<div><h2>{escape(upper(question))}</h2><p>{_linked(_prose(cell_text(answer)))}</p></div>"
        for question, answer in answers.items
    )
    return f'<section class=answers aria-label="answers">{cards}</section>'


def _linked(text: str) -> str:
    """Return an answer whose "next command" leads to it."""
    return text.replace("(next command)", '(<a href="#next">next command</a>)')


def _lights(said: Sequence[Section]) -> str:
    """Return how far each joint can be trusted, in a word and a colour, from the first table that says it."""
    table = next((s for s in said if isinstance(s, Table) and any(c.key == "trust" for c in s.columns)), None)
    if table is None:
        return ""
    place = [c.key for c in table.columns].index("trust")
    items = "".join(
        f'<li>{escape(cell_text(row[0]))} <span class="{mark.tone}"><i class=light aria-hidden=true></i>'
        f"{escape(mark.text)}</span></li>"
        for row in table.rows
        if isinstance(mark := row[place], Mark)
    )
    return f'<ul class=lights aria-label="model of each joint">{items}</ul>'


def _folded(section: Section, closed: bool) -> str:
    """Return a section behind its own name, or as it is where it folds itself or is a sentence."""
    if isinstance(section, Text):
        return _section(section)
    figure = isinstance(section, Figure)
    name = section.title if figure else upper(section.title or section.key.replace("_", " "))
    inner = _figure(section, titled=False) if isinstance(section, Figure) else _bare(section)
    return f"<details{'' if closed else ' open'}><summary>{escape(name)}</summary>{inner}</details>"


def _glossary() -> str:
    terms = "".join(
        f'<dt id="{_term(term)}">{escape(term)}</dt><dd>{escape(meaning)}</dd>' for term, meaning in TERMS.items()
    )
    return f"<details id=glossary><summary>What the words mean</summary><dl>{terms}</dl></details>"


def _term(term: str) -> str:
    return "g-" + re.sub(r"[^a-z]", "-", term.lower().replace("×", "x").replace("±", "pm"))


def _words(text: str) -> str:
    """Return a head or a label, with a link to its meaning where the glossary has one."""
    term = explained(text)
    if term is None:
        return escape(text)
    return f'<a class=term href="#{_term(term)}" title="{escape(TERMS[term])}">{escape(text)}</a>'


def _command(line: str) -> str:
    return f"<pre>{escape(line)}</pre>" if line else ""


def _origin(report: Report) -> str:
    """Return what a reader needs to do it again: versions of the programs, and hashes of what was read."""
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "scipy"))
    lines = [f"elid {__version__}, Python {platform.python_version()}, {versions}"]
    log = report.payload.get("log") or {}
    hashes = zip(log.get("files", ()), log.get("sha256", ()), strict=False)
    lines += [f"{file} sha256 {digest}" for file, digest in hashes]
    return "<br>".join(escape(visible(line)) for line in lines)


def _section(section: Section, under: str = "", *, whole: bool = False) -> str:
    """Return a section, with its title unless that is the heading it stands `under`; `whole`: a long table, too."""
    if isinstance(section, Text):
        return _text(section)
    if isinstance(section, Figure):
        return _figure(section)
    if isinstance(section, Table) and len(section.rows) > LONG and not whole:
        return _folded(section, True)
    name = section.title or (section.key.replace("_", " ") if isinstance(section, Table) else "")
    return (f"<h3>{escape(upper(name))}</h3>" if name and upper(name) != under else "") + _bare(section)


def _bare(section: KeyValues | Table) -> str:
    return _key_values(section) if isinstance(section, KeyValues) else _table(section)


def _text(section: Text) -> str:
    if section.role == "next":
        return f"<p class=next id=next>Next command</p><pre>{escape(section.text)}</pre>"
    if section.role == "code":
        return f"<pre>{escape(section.text)}</pre>"
    if section.role == "warning":
        return f'<p class="warning">Warning: {_prose(section.text)}</p>'
    return f'<p class="meaning">{_prose(section.text)}</p>'


def _key_values(section: KeyValues) -> str:
    rows = "".join(f"<dt>{_words(label)}</dt><dd>{_prose(cell_text(cell))}</dd>" for label, cell in section.items)
    return f"<dl>{rows}</dl>"


def _table(section: Table) -> str:
    head = "".join(f'<th scope=col class="{c.align}">{_words(c.head)}</th>' for c in section.columns)
    rows = "".join(_row(section.columns, row) for row in section.rows)
    name = escape(section.title or section.key.replace("_", " "))
    table = f'<table aria-label="{name}"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
    note = f"<p class=note>{_prose(section.note)}</p>" if section.note else ""
    return f'<div class=scroll tabindex=0 role=region aria-label="{name}">{table}</div>{note}'


def _row(columns: Iterable[Column], cells: Iterable[Cell]) -> str:
    parts = []
    for number, (column, cell) in enumerate(zip(columns, cells, strict=True)):
        told = f' data-head="{escape(column.head)}"' if number else ""
        tone = cell.tone if isinstance(cell, Mark | Quantity) else "plain"
        text = escape(cell_text(cell, unit=not column.unit))
        light = "<i class=light aria-hidden=true></i>" if column.key == "trust" and text else ""
        tag = "th scope=row" if number == 0 else "td"
        short = " short" if 0 < len(text) <= SHORT else ""
        parts.append(f'<{tag} class="{column.align} {tone}{short}"{told}>{light}{text}</{tag[:2]}>')
    return f"<tr>{''.join(parts)}</tr>"


def _figure(figure: Figure, *, titled: bool = True) -> str:
    from elid_cli.report.figures import panels_of, svg

    drawn = panels_of(figure)
    title = f"<h3>{escape(figure.title)}</h3>" if titled else ""
    caption = f"<figcaption>{escape(figure.caption)}</figcaption>" if figure.caption else ""
    legend = "".join(
        f"<li><svg viewBox='0 0 22 10' aria-hidden=true>{svg.swatch(mark)}</svg>{escape(label)}</li>"
        for mark in drawn.legend()
        if (label := getattr(mark, "label", ""))
    )
    kind = {1: "panels wide" if drawn.over_time else "panels", 2: "panels two"}.get(drawn.columns, "panels")
    pictures = (f"<ul class=legend>{legend}</ul>" if legend else "") + (
        f'<div class="{kind}">{"".join(svg.panels(drawn, figure.title))}</div>'
    )
    if drawn.over_time:
        from elid_cli.report.figures.timeline import timeline

        data = json.dumps(timeline(drawn), separators=(",", ":"), allow_nan=False)
        script = f'<script type="application/json">{data.replace("<", LESS)}</script>'
        name = escape(figure.title)
        pictures = f'<div class=plot role=group aria-label="{name}">{script}</div><noscript>{pictures}</noscript>'
    return f'<figure id="{_anchor(figure.key)}">{title}<div class=paper>{pictures}</div>{caption}</figure>'


def _anchor(key: str) -> str:
    return "f-" + re.sub(r"[^A-Za-z0-9_-]", "_", file_name(key))


def _prose(text: str) -> str:
    """Return a text with numbers tied to their units: no line ends between them."""
    return escape(UNITS.sub(TIE, text))
