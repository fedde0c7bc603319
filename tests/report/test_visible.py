"""Texts from files go to terminals, pages and pictures through one door, which makes their controls visible."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import visible
from elid_cli.report import formats
from elid_cli.report.figures import picture
from elid_cli.report.tree import Column, Figure, KeyValues, Mark, Quantity, Report, Table, Text, file_name, shown

EVIL = "\x1b]0;x\x07<script>alert(1)</script>\x9b31m\u202e$\\frac{$```--><!--\r\n\t\x00\x7f|"
BAD = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def evil_report() -> Report:
    """Return a report in which every text that may come from a file is as bad as can be."""
    roles = ("heading", "plain", "warning", "code", "next")
    columns = (Column("a", EVIL, EVIL, span=True), Column("b", EVIL, align="right"))
    rows = ((EVIL, Quantity(1.0, EVIL)), (Mark(EVIL, "bad"), EVIL), ("x", 1))
    residual = {"name": EVIL, "residual": np.zeros(5), "before": None, "floor": None}
    data = {
        "t": np.arange(5.0),
        "measured": np.ones(5),
        "unit": EVIL,
        "used": np.ones(5, bool),
        "residuals": [residual],
    }
    return Report(
        "identify",
        {"log": {"files": [EVIL], "sha256": ["0"]}, "robot": EVIL},
        (
            *(Text(f"t{k}", EVIL, role) for k, role in enumerate(roles)),  # type: ignore[arg-type]
            KeyValues("k", ((EVIL, EVIL), ("x", (EVIL))), EVIL),
            Table("table", columns, rows, EVIL, note=EVIL),
            Figure(f"torque_{EVIL}", EVIL, "torque", data, EVIL),
            Figure("errors", EVIL, "errors", {"cases": ((EVIL, {EVIL: 0.1}),), "sides": (), "unit": ""}, EVIL),
        ),
        EVIL,
    )


@pytest.mark.parametrize("name", formats.format_names())
@pytest.mark.parametrize("width", [40, 120])
@pytest.mark.parametrize("ascii_only", [False, True])
def test_no_format_lets_a_control_through(name: str, width: int, ascii_only: bool) -> None:
    text = formats.render(evil_report(), name, formats.Style(width=width, ascii=ascii_only))
    assert not BAD.search(text), BAD.search(text)
    if name == "html":
        assert "<script>alert" not in text
        assert "<!--" not in text
    if name == "markdown":
        outside = re.sub(r"(?ms)^(`{3,})\w*\n.*?^\1$", "", text)
        assert not re.search(r"(?<!\\)<script", outside)


@pytest.mark.parametrize("suffix", [".txt", ".md", ".html", ".json"])
def test_no_file_holds_a_control(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"report{suffix}"
    formats.write_report(evil_report(), path)
    assert not BAD.search(path.read_text("utf-8"))


@pytest.mark.parametrize("joint", ["arm/joint1", "../../x", "$$", r"$\frac{$", "a" * 3000, "q\x1b[31m", ".", "ä"])
def test_pictures_of_joints_with_any_name(tmp_path: Path, joint: str) -> None:
    data = evil_report().figures[0].data | {"unit": joint}
    report = Report("identify", {}, (Figure(f"torque_{joint}", joint, "torque", data),))
    formats.draw(report, tmp_path / "figures", "svg")
    (drawn,) = (tmp_path / "figures").iterdir()
    assert not BAD.search(drawn.read_text("utf-8"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["figures"]


def test_every_kind_of_figure_draws_a_dollar(tmp_path: Path) -> None:
    for text in ("$$", r"$\frac{$", "a_b^c"):
        figure = shown(evil_report()).figures[0]
        assert picture(dataclasses.replace(figure, title=text, data={**figure.data, "unit": text}), "png")


def test_names_of_files_differ_where_keys_do() -> None:
    keys = ["a/b", "a_b", "a b", "ab", "..", ".", "a" * 200, "a" * 201, "A/b"]
    assert len({file_name(key) for key in keys}) == len(keys)
    assert file_name("torque_joint1") == "torque_joint1"


def test_visible_texts() -> None:
    assert visible("\x1b]0;x\x07") == r"\x1b]0;x\x07"
    assert visible("a\nb\tc") == r"a\nb\tc"
    assert visible("a\nb", lines=True) == "a\nb"
    assert visible("N·m\N{NO-BREAK SPACE}µ ± ẋ") == "N·m\N{NO-BREAK SPACE}µ ± ẋ"
    assert visible("gr\udcfc\udc9b") == "gr\udcfc\\x9b"
    assert visible("\U000e0001\u202e") == "\\U000e0001\\u202e"
    assert len(visible("x" * 100_000)) < 400
    assert visible(visible(EVIL)) == visible(EVIL)
