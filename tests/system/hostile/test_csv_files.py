"""CSV as it is written in the field."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from tests.logs.faults import Table
from tests.system.hostile.hostile import JOINTS, SIGNALS, base, elid, refused, used

NAMES = ("t", *(f"{signal}.{joint}" for signal in SIGNALS for joint in JOINTS))


def table() -> Table:
    return Table(NAMES, np.hstack([base().t[:, None], *(getattr(base(), signal) for signal in SIGNALS)]))


def saved(folder: Path, text: str | bytes, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def lines() -> list[str]:
    return table().text().splitlines()


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "  ", "; ", " ; "])
def test_separators_and_decimal_marks(tmp_path: Path, separator: str, decimal: str) -> None:
    if separator == decimal:
        pytest.skip("not a CSV")
    used(saved(tmp_path, table().text(separator=separator, decimal=decimal)), tolerance=1e-9)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_encodings_and_line_ends(tmp_path: Path, encoding: str, end: str) -> None:
    text = table().text(end=end).replace("t,q.", "t,Gerät,q.", 1) if encoding == "latin-1" else table().text(end=end)
    if encoding == "latin-1":
        head, *rows = text.split(end)
        text = end.join([head, *(row.replace(",", ",1,", 1) for row in rows)])
    used(saved(tmp_path, text.encode(encoding)), tolerance=1e-9)


def test_comments_blank_lines_and_a_units_row(tmp_path: Path) -> None:
    head, *rows = lines()
    text = ["# recorded 2026-11-21, arm 3", "% more", head, "s,rad,rad,rad,rad,N.m,N.m", "", *rows[:900], "# pause"]
    done = used(saved(tmp_path, "\n".join([*text, *(row + " # ok" for row in rows[900:])])), tolerance=1e-9)
    assert done.err == ""


@pytest.mark.parametrize("where", ["row", "names"])
def test_units_that_are_written_are_told_and_never_applied(tmp_path: Path, where: str) -> None:
    head, *rows = lines()
    units = ["s", "deg", "deg", "rad", "rad", "N·m", "N·m"]
    if where == "row":
        text = [head, ",".join(units), *rows]
    else:
        text = [",".join(f"{name} [{unit}]" for name, unit in zip(NAMES, units, strict=True)), *rows]
    done = used(saved(tmp_path, "\n".join(text)), "'deg'", "unit: deg", tolerance=1e-9)
    assert "warning: q is in 'deg' by its header" in done.err
    assert "theta is written" not in done.err


def test_names_with_units_are_mapped_either_way(tmp_path: Path) -> None:
    units = ["s", "rad", "rad", "rad", "rad", "Nm", "Nm"]
    log = saved(
        tmp_path,
        "\n".join([",".join(f"{name} ({unit})" for name, unit in zip(NAMES, units, strict=True)), *lines()[1:]]),
    )
    assert used(log, tolerance=1e-9).err == ""
    used(log, more=("--map", "tau=tau.{joint} (Nm)"), tolerance=1e-9)


def test_no_header_needs_a_mapping(tmp_path: Path) -> None:
    log = saved(tmp_path, "\n".join(lines()[1:]))
    refused(log, "no position", "column1, column2")
    path = tmp_path / "map.yaml"
    path.write_text("t: column1\nq: [column2, column3]\ntheta: [column4, column5]\ntau: {from: [column6, column7]}\n")
    used(log, "no header row", more=("--map", path), tolerance=1e-9)


@pytest.mark.parametrize(("old", "new"), [("q.joint2", "q.joint1"), ("theta.joint1", "t")])
def test_duplicate_names_are_refused(tmp_path: Path, old: str, new: str) -> None:
    refused(saved(tmp_path, table().text().replace(old, new, 1)), f"'{new}' appears 2 times", "rename")


def test_empty_cells_are_missing_values(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rows = table().rows
    holes = (rng.random(rows.shape) < 0.01) & (np.arange(rows.shape[1]) > 0)
    text = Table(NAMES, np.where(holes, np.nan, rows)).text()
    used(saved(tmp_path, text), "values are not numbers", "bridged")
    used(saved(tmp_path, text.replace("nan", "")), "values are not numbers", "bridged")


def test_ragged_rows_are_named_by_line(tmp_path: Path) -> None:
    rows = lines()
    rows[500], rows[700] = "1,2", rows[700] + ",9,9"
    log = saved(tmp_path, "\n".join(rows))
    used(log, "line 501 has 2 cells of 7", "line 701 has 9 cells of 7")
    refused(log, "line 501 has 2 cells of 7", "--strict", more=("--strict",))


def test_a_last_line_cut_short_is_left_out(tmp_path: Path) -> None:
    text = table().text()
    used(saved(tmp_path, text[: text.rindex(",")]), "line 3001 has 6 cells of 7", tolerance=1e-3)


def test_gzip_whole_cut_damaged_and_bombs(tmp_path: Path) -> None:
    packed = gzip.compress(table().text().encode())
    used(saved(tmp_path, packed, "log.csv.gz"), tolerance=1e-9)
    log = saved(tmp_path, packed[: len(packed) // 2], "log.csv.gz")
    used(log, "gzip data end early", tolerance=0.02)
    refused(log, "gzip data end early", "--strict", more=("--strict",))
    refused(saved(tmp_path, packed[:5000] + bytes(50) + packed[5050:], "log.csv.gz"), "damaged gzip data", "copy")
    bomb = gzip.compress(b"t,q.joint1\n" + b"1,2\n" * 50_000_000)
    assert len(bomb) < 500_000
    refused(saved(tmp_path, bomb, "log.csv.gz"), "MiB of text", "refused before")


STYLES = {
    "plotjuggler": ("__time", "/joint_states/{joint}/position", "/motor_states/{joint}/position",
                    "/motor_states/{joint}/effort"),
    "plotjuggler, dotted": ("__time", "/joint_states/position.{joint}", "/motor_states/position.{joint}",
                            "/motor_states/effort.{joint}"),
    "plotjuggler, numbered": ("__time", "/joint_states/position[{i0}]", "/motor_states/position[{i0}]",
                              "/motor_states/effort[{i0}]"),
    "writetable": ("Time", "q_{joint}", "theta_{joint}", "tau_{joint}"),
    "array2table": ("t", "q{i}", "theta{i}", "tau{i}"),
    "matlab index": ("time", "q({i})", "theta({i})", "tau({i})"),
    "underscore": ("time [s]", "q_{i} [rad]", "theta_{i} [rad]", "tau_{i} [N.m]"),
}  # fmt: skip


@pytest.mark.parametrize("style", STYLES)
def test_headers_of_other_programs(tmp_path: Path, style: str) -> None:
    t, *patterns = STYLES[style]
    names = [pattern.format(joint=joint, i=k + 1, i0=k) for pattern in patterns for k, joint in enumerate(JOINTS)]
    used(saved(tmp_path, "\n".join([",".join([t, *names]), *lines()[1:]])), tolerance=1e-9)


@pytest.mark.parametrize("style", ["index", "pandas index", "quoted", "iso time"])
def test_columns_and_cells_that_come_along(tmp_path: Path, style: str) -> None:
    head, *rows = lines()
    text = {
        "index": lambda: [f",{head}", *(f"{k},{row}" for k, row in enumerate(rows))],
        "pandas index": lambda: [f"Unnamed: 0,{head}", *(f"{k},{row}" for k, row in enumerate(rows))],
        "quoted": lambda: [",".join(f'"{name}"' for name in NAMES), *rows],
        "iso time": lambda: [head, *(f"2026-11-21T10:00:{float(row.split(',')[0]):09.6f}Z,{row.split(',', 1)[1]}"
                                     for row in rows)],
    }[style]()  # fmt: skip
    used(saved(tmp_path, "\n".join(text)), tolerance=1e-3)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("t,q.joint1,tau.joint1", "no row of numbers"), ("a,b\nx,y\n", "not a log"), ("   \n \n", "not a log"),
        ("", "empty"), ("<a>1</a>", "not a log"), ('{"a": 1}', "not a log"), ("1," * 300_000, "columns"),
        ("t,q.joint1\n" + "9" * 2_000_000, "joint"), ("name: planar2\ndh: standard # 1\n", "no row of numbers"),
    ],
    ids=["header", "text", "blank", "empty", "xml", "json", "one giant line", "one giant cell", "yaml"],
)  # fmt: skip
def test_what_is_no_table_is_refused_at_once(tmp_path: Path, text: str, word: str) -> None:
    refused(saved(tmp_path, text), word)


def test_a_table_with_thousands_of_columns_is_read(tmp_path: Path) -> None:
    head, *rows = lines()
    spare = ",".join(f"c{k}" for k in range(2000))
    log = saved(tmp_path, "\n".join([f"{head},{spare}", *(row + ",0" * 2000 for row in rows[:1500])]))
    used(log, tolerance=0.02)
    done = elid("identify", log, "--robot", "puma560")
    assert done.code == 3
    assert len(done.err) < 2000
