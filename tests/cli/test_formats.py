"""Every output format on one report made to be awkward; and what each of them promises."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest

from elid_cli.errors import UsageError
from elid_cli.report import formats
from elid_cli.report.answers.classification import folded
from elid_cli.report.tree import (
    Column,
    Figure,
    Folded,
    KeyValues,
    Mark,
    Quantity,
    Report,
    Table,
    Text,
    cell_text,
    number_text,
    percent,
)  # fmt: skip

LONG = " + ".join(f"{k}.25*Izz{k}" for k in range(1, 30))
PATH = "/data/" + "very_long_name_without_any_space_" * 4 + "/joint[1].mcap"


@pytest.fixture
def report() -> Report:
    columns = (
        Column("name", "base parameter"),
        Column("value", "value", align="right"),
        Column("unit", "unit"),
        Column("verdict", "verdict"),
    )
    rows = tuple(
        (name, Quantity(value, resolution=0.01), "[N·m]", Mark("weak", "warn"))
        for name, value in [("/joint[1]", -6.331), (LONG, 20013.0), ("m[red]1[/red]", math.nan), ("K1", 1e-9)]
    )
    return Report(
        command="identify",
        payload={"joints": ["/joint[1]"], "nan": math.nan, "array": np.array([[0.1, math.inf], [2, 3]]),
                 "int": np.int64(7), "flag": np.True_, "third": 1 / 3, "umlaut": "ü·"},
        sections=(
            Text("title", "planar2 · [bold]run[/bold] 07.mcap", "heading"),
            KeyValues("facts", (("recorded", PATH), ("share", percent(0.123)), ("used", LONG))),
            Table("base", columns, rows, title="base parameters"),
            Table("short", (Column("a", "a"),), tuple((f"row{k}",) for k in range(9)), shown=3),
            Figure("plot", "a plot", "singular", {"values": np.array([3.0, 1.0, 1e-9]), "rank": 2}),
            Text("why", "words [rad/s] " * 20),
            Text("next", f"elid diagnose {PATH} --robot planar2", "next"),
        ),
    )  # fmt: skip


TEXT_FORMATS = [name for name in formats.format_names() if name != "json"]


@pytest.mark.parametrize("name", formats.format_names())
def test_every_format_renders_and_is_deterministic(report: Report, name: str) -> None:
    first = formats.render(report, name, formats.Style())
    assert first == formats.render(report, name, formats.Style())
    assert first.endswith("\n")
    assert "\x1b" not in first


def squeezed(text: str) -> str:
    """Return the text without what folding adds."""
    return re.sub(r"\s+", "", text)


@pytest.mark.parametrize("width", [20, 40, 60, 80, 200])
@pytest.mark.parametrize("ascii_only", [False, True])
def test_the_terminal_cuts_nothing(report: Report, width: int, ascii_only: bool) -> None:
    text = formats.render(report, "terminal", formats.Style(width=width, ascii=ascii_only, everything=True))
    dot = "*" if ascii_only else "·"
    for piece in ("/joint[1]", f"[N{dot}m]", "[bold]run[/bold]", "m[red]1[/red]", "[rad/s]", PATH, "row8", "12.3%"):
        assert squeezed(piece) in squeezed(text)
    assert not ascii_only or text.isascii()
    assert "…" not in text
    assert PATH in text  # a path is never broken
    terms = [f"{k}.25*Izz{k}" for k in range(1, 30)]
    assert all(term in text for term in terms)
    for line in text.splitlines():
        assert line == line.rstrip()
        assert len(line) <= width or max(map(len, line.split())) > width - 20 or line.startswith("Next: ")


def test_a_table_keeps_its_columns_at_80(report: Report) -> None:
    lines = formats.render(report, "terminal", formats.Style(width=80)).splitlines()
    (head,) = [line for line in lines if line.split() == ["base", "parameter", "value", "unit", "verdict"]]
    (row,) = [line for line in lines if line.startswith("  /joint[1]")]
    assert row.index("-6.331") + len("-6.331") == head.index("value") + len("value")
    assert row.index("weak") == head.index("verdict")


def test_a_narrow_table_becomes_records(report: Report) -> None:
    lines = formats.render(report, "terminal", formats.Style(width=30)).splitlines()
    assert "  base parameter: /joint[1]" in lines
    assert "  value: -6.331" in lines
    assert "  unit: [N·m]" in lines


def test_a_label_longer_than_a_line_is_folded_before_its_value() -> None:
    label = "for " + ", ".join(f"m{k} with {k} others" for k in range(3, 12))
    report = Report("identify", {}, (KeyValues("record", ((label, "stronger accelerations of all joints"),)),))
    lines = formats.render(report, "terminal", formats.Style(width=80)).splitlines()
    assert squeezed("".join(lines)) == squeezed(f"{label}:stronger accelerations of all joints")
    assert 3 < len(lines) < 7
    assert max(map(len, lines)) <= 80


def test_long_tables_say_how_to_see_the_rest(report: Report) -> None:
    short = formats.render(report, "terminal", formats.Style())
    assert "row2" in short
    assert "row3" not in short
    assert "… (6 more: --all)" in short
    assert "6 more: `--all`" in formats.render(report, "markdown", formats.Style())


def test_a_terminal_shows_as_many_rows_as_it_has() -> None:
    rows = tuple((f"{'a wide' * 9} row {k}",) for k in range(40))
    table = Report("identify", {}, (Table("t", (Column("name", "name"),), rows, shown=10),))
    assert "row 30" not in formats.render(table, "terminal", formats.Style(rows=30))
    assert "row 29" in formats.render(table, "terminal", formats.Style(rows=30))
    assert "(30 more: --all)" in formats.render(table, "terminal", formats.Style(rows=5))
    assert "more" not in formats.render(table, "terminal", formats.Style(rows=39))


def test_a_long_combination_folds_in_lines_that_must_end_and_nowhere_else() -> None:
    terms = {f"Izz{k}": 1.0 for k in range(1, 9)}
    cells = (folded("Izz1 + Izz2", {"Izz1": 1, "Izz2": 1}), folded(LONG, terms))
    assert cells[0] == "Izz1 + Izz2"
    assert cells[1] == Folded(LONG, "Izz1 with 7 others")
    report = Report(
        "identify", {}, (Table("t", (Column("n", "n"), Column("u", "u")), tuple((c, "kg") for c in cells)),)
    )
    short = formats.render(report, "terminal", formats.Style())
    assert "Izz1 with 7 others  kg" in short
    assert "Izz1 + Izz2" in short
    for style in (formats.Style(everything=True, width=2000), formats.Style(whole_rows=True)):
        assert LONG in formats.render(report, "terminal", style)
    assert LONG in formats.render(report, "html", formats.Style())
    assert LONG.replace("*", "") in formats.render(report, "markdown", formats.Style()).replace("\\", "").replace(
        "*", ""
    )


def test_colour_is_only_there_when_wanted(report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    plain = formats.render(report, "terminal", formats.Style(color=False))
    colored = formats.render(report, "terminal", formats.Style(color=True))
    assert "\x1b" not in plain
    assert "\x1b[33mweak" in colored
    assert [line.rstrip() for line in re.sub(r"\x1b\[[\d;]*m", "", colored).splitlines()] == plain.splitlines()


def test_json_is_one_object_with_null_for_what_is_not_finite(report: Report) -> None:
    text = formats.render(report, "json", formats.Style())
    assert text.isascii()
    data = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))
    assert list(data)[:3] == ["schema", "command", "version"]
    assert (data["schema"], data["command"]) == ("elid/1", "identify")
    assert data["nan"] is None
    assert data["array"] == [[0.1, None], [2.0, 3.0]]
    assert (data["int"], data["flag"], data["third"], data["umlaut"]) == (7, True, 1 / 3, "ü·")


def test_json_refuses_what_it_cannot_say() -> None:
    with pytest.raises(TypeError, match="object"):
        formats.render(Report("x", {"a": object()}, ()), "json", formats.Style())


def test_markdown_escapes_data(report: Report) -> None:
    text = formats.render(report, "markdown", formats.Style())
    assert "## planar2 · \\[bold\\]run\\[/bold\\] 07.mcap" in text
    assert "| base parameter | value | unit | verdict |\n| --- | ---: | --- | --- |" in text
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert all(len(re.findall(r"(?<!\\)\|", row)) in (2, 5) for row in rows)
    assert f"```sh\nelid diagnose {PATH} --robot planar2\n```" in text


def test_unknown_formats_are_named() -> None:
    with pytest.raises(UsageError, match="no output format 'jsn'") as caught:
        formats.find_format("jsn")
    assert caught.value.hint == "did you mean 'json'?"


@pytest.mark.parametrize(
    ("value", "digits", "resolution", "text"),
    [
        (20013.4, 4, None, "20013"), (20013.4, 4, 41.0, "20013"), (-6.3312, 4, 0.004, "-6.331"),
        (-6.3312, 4, 0.0412, "-6.33"), (-6.3312, 4, 0.0213, "-6.331"), (0.0213, 4, 0.0213, "0.021"),
        (0.0, 4, None, "0"), (3, 4, None, "3"), (1000.0, 4, None, "1000"),
        (61.4321, 4, None, "61.43"), (0.00012345, 3, None, "0.000123"), (1.2345e-7, 3, None, "1.23e-07"),
        (7.5e8, 3, None, "7.50e+08"), (math.nan, 4, None, "–"), (None, 4, None, "–"), (-math.inf, 4, None, "-inf"),
        (12.34, 4, math.inf, "12.34"), (2.96, 4, 2.96, "3"), (0.00341, 4, 0.00341, "0.003"), (0.5, 4, 3.0, "0"),
        (0.0635, 4, None, "0.0635"), (24.84, 5, None, "24.84"), (12, 1, None, "12"), (9.99999975, 4, None, "10"),
    ],
)  # fmt: skip
def test_numbers(value, digits, resolution, text) -> None:
    assert number_text(value, digits, resolution) == text


def test_cells() -> None:
    assert cell_text(Quantity(29.6, "N·m", 3)) == "29.6 N·m"
    assert cell_text(Quantity(29.6, "N·m", 3), unit=False) == "29.6"
    assert cell_text(Quantity(None, "N·m")) == "–"
    assert (cell_text(True), cell_text(None), cell_text(7)) == ("yes", "–", "7")


def test_a_report_is_checked_when_made() -> None:
    with pytest.raises(ValueError, match="two sections called a"):
        Report("x", {}, (Text("a", ""), Text("a", "")))
    with pytest.raises(ValueError, match="1 cells in a row of 2"):
        Table("t", (Column("a", "a"), Column("b", "b")), (("x",),))


def test_a_spanning_cell_takes_a_line_of_its_own() -> None:
    columns = (Column("name", "base parameter", span=True), *(Column(k, k * 10, align="right") for k in "abcd"))
    rows = (("K1", *range(4)), ("m1 - 4*Izz1 + 4*Izz2 - 8*Izz3 + 16*Izz4", *range(4)))
    report = Report("x", {}, (Table("t", columns, rows),))
    lines = formats.render(report, "terminal", formats.Style(width=60)).splitlines()
    numbers = lines[2]
    assert numbers.split() == ["K1", "0", "1", "2", "3"]
    assert lines[3] == "  m1 - 4*Izz1 + 4*Izz2 - 8*Izz3 + 16*Izz4"
    assert lines[4] == numbers.replace("K1", "  ")


@pytest.mark.parametrize("width", [20, 40, 60, 80])
def test_what_is_to_be_pasted_is_not_broken_into_lines(width: int) -> None:
    line = 'theta: {from: "theta.{joint}", unit: deg, joints: {elbow: joint b}}'
    said = f"it looks like degrees; if so, map it: {line}; leave slow motion out: --min-velocity 0.03"
    command = f"elid diagnose 'a log {'of a long name ' * 9}.h5' --robot planar2 --map 'q=a column'"
    sections = (Text("w", said, "warning"), KeyValues("k", (("follows", said),)), Text("next", command, "next"))
    text = formats.render(Report("x", {}, sections), "terminal", formats.Style(width=width))
    assert text.count(line) == 2
    assert text.count("--min-velocity 0.03") == 2
    assert f"Next: {command}\n" in text
    assert "\N{NO-BREAK SPACE}" not in text


def test_a_row_is_one_line_in_a_pipe(report: Report) -> None:
    tables = [section for section in report.sections if isinstance(section, Table)]
    for width in (20, 80):
        text = formats.render(report, "terminal", formats.Style(width=width, everything=True, whole_rows=True))
        lines = text.splitlines()
        for table, row in [(one, row) for one in tables for row in one.rows]:
            cells = [cell_text(cell, unit=not column.unit) for column, cell in zip(table.columns, row, strict=True)]
            assert any(" ".join(cells).split() == line.split() for line in lines), cells


def test_a_spanning_table_folds_its_heads_before_it_falls_apart_into_records() -> None:
    columns = (Column("name", "base parameter", span=True), *(Column(k, f"{k * 4} (%)", align="right") for k in "abcd"))
    report = Report("x", {}, (Table("t", columns, (("m1 - 4*Izz1 + 4*Izz2", *("0.00011985",) * 2, 3, 4),)),))
    text = formats.render(report, "terminal", formats.Style(width=55))
    assert "base parameter:" not in text
    assert text.splitlines()[-1].split() == ["0.00011985", "0.00011985", "3", "4"]
    assert max(map(len, text.splitlines())) <= 55
