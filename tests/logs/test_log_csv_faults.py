"""CSV in every dialect, and broken in every way: the clean log's numbers, or one clear error."""

from __future__ import annotations

import gzip
import io
import math
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import LogError
from elid_cli.logs.contract import Pick
from elid_cli.logs.formats import csv_text
from elid_cli.logs.formats.csv import CsvLog
from elid_cli.logs.formats.csv_dialect import sniff
from elid_cli.logs.source import open_source
from tests.logs.faults import Table, table
from tests.logs.made_logs import JOINTS, read, recording, same

BASE = recording(500)
GOOD = table(BASE)


def save(folder: Path, text: str | bytes) -> Path:
    path = folder / "log.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@pytest.mark.parametrize(
    "separator", [",", ";", "\t", " ", ", ", "  "], ids=["comma", "semi", "tab", "space", "c s", "2s"]
)
@pytest.mark.parametrize("end", ["\n", "\r\n"], ids=["lf", "crlf"])
def test_separators_are_found(tmp_path: Path, separator: str, end: str) -> None:
    same(read(save(tmp_path, GOOD.text(separator, end=end))), BASE)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas(tmp_path: Path, separator: str) -> None:
    text = GOOD.text(separator).replace(".", ",").replace(",shoulder", ".shoulder")
    text = text.replace("q,", "q.").replace("theta,", "theta.").replace("tau,", "tau.")
    same(read(save(tmp_path, text)), BASE)


def test_bom_comments_units_row_and_blank_lines(tmp_path: Path) -> None:
    lines = GOOD.text().splitlines()
    units = ",".join(["s", *["rad"] * 6, *["N.m"] * 3])
    text = "\n".join(
        ["# recorded by hand", "% second comment", lines[0], units, "", *lines[1:200], "# stop", *lines[200:]]
    )
    for data in (b"\xef\xbb\xbf" + text.encode(), text.encode("utf-16"), text.encode()):
        got = read(save(tmp_path, data))
        same(got, BASE)
        assert got.samples == 500


def test_gzip_is_found_by_content(tmp_path: Path) -> None:
    same(read(save(tmp_path, gzip.compress(GOOD.text().encode()))), BASE)


def test_a_cut_gzip_gives_what_is_whole(tmp_path: Path) -> None:
    data = gzip.compress(GOOD.text().encode())
    got = read(save(tmp_path, data[: len(data) // 2]))
    same(got, BASE)
    assert 100 < got.samples < 500


def test_empty_cells_are_missing_values(tmp_path: Path) -> None:
    rows = GOOD.rows.copy()
    rows[[50, 51, 200], 4] = np.nan
    rows[300:320, GOOD.column("tau.elbow")] = np.nan
    got = read(Table(GOOD.names, rows).save(tmp_path / "log.csv"))
    same(got, BASE, 1e-6)
    assert [len(s) for s in got.segments] == [300, 180]
    said = " | ".join(got.repairs)
    assert "theta of shoulder: 3 of 500" in said
    assert "tau of elbow: 20 of 500" in said
    assert "bridged" in said


def test_ragged_rows_are_named_by_line(tmp_path: Path) -> None:
    lines = GOOD.text().splitlines()
    lines[100] = lines[100].rpartition(",")[0]
    lines[250] += ",1,2"
    got = read(save(tmp_path, "\n".join(lines)))
    same(got, BASE, 1e-5)
    said = " | ".join(got.repairs)
    assert "line 101 has 9 cells of 10" in said
    assert "line 251 has 12 cells of 10" in said


def test_a_last_line_cut_short_is_left_out(tmp_path: Path) -> None:
    text = GOOD.text()
    got = read(save(tmp_path, text[:-40]))
    same(got, BASE)
    assert got.samples == 499
    with pytest.raises(LogError, match="line 501"):
        read(save(tmp_path, text[:-40]), strict=True)


def test_text_where_numbers_belong_is_missing_and_said(tmp_path: Path) -> None:
    lines = GOOD.text().splitlines()
    cells = lines[77].split(",")
    cells[2] = "ERR"
    lines[77] = ",".join(cells)
    got = read(save(tmp_path, "\n".join(lines)))
    same(got, BASE, 1e-6)
    assert any("line 78" in text for text in got.repairs)


def test_other_columns_may_hold_anything(tmp_path: Path) -> None:
    lines = GOOD.text().splitlines()
    text = "\n".join([f"state,{lines[0]},note", *(f'"run, {k}",{line},' for k, line in enumerate(lines[1:]))])
    same(read(save(tmp_path, text)), BASE)


def test_duplicate_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"'q.shoulder' appears 2 times"):
        read(GOOD.renamed(q__elbow="q.shoulder").save(tmp_path / "log.csv"))


@pytest.mark.parametrize(
    "style",
    [
        {s: f"{s}_{{}}" for s in ("q", "theta", "tau")},
        {"q": "/joint_states/{}/position", "theta": "/motor_states/{}/position", "tau": "/motor_states/{}/effort"},
    ],
    ids=["matlab", "plotjuggler"],
)
def test_headers_of_other_programs(tmp_path: Path, style: dict[str, str]) -> None:
    names = ["__time" if "/" in style["q"] else "Time"]
    names += [style[signal].format(joint) for signal in ("q", "theta", "tau") for joint in JOINTS]
    same(read(Table(tuple(names), GOOD.rows).save(tmp_path / "log.csv")), BASE)


def test_no_header_needs_a_mapping(tmp_path: Path) -> None:
    body = GOOD.text().split("\n", 1)[1]
    path = save(tmp_path, body)
    with pytest.raises(LogError) as caught:
        read(path)
    assert "column1" in str(caught.value)
    columns = {s: [f"column{2 + 3 * k + j}" for j in range(3)] for k, s in enumerate(("q", "theta", "tau"))}
    same(read(path, mapping={"t": "column1", **columns}), BASE)


@pytest.mark.parametrize(
    ("text", "word"),
    [("", "empty"), ("\n\n", "no"), ("a,b,c\nx,y,z\n", "log"), ("hello world\n", "not a log"), ("{}", "not a log")],
)
def test_what_is_no_table_is_refused(tmp_path: Path, text: str, word: str) -> None:
    with pytest.raises(LogError) as caught:
        read(save(tmp_path, text))
    assert word in str(caught.value)
    assert caught.value.exit_code == 3


def test_columns_of_different_rates_have_their_own_stamps(tmp_path: Path) -> None:
    rows = GOOD.rows.copy()
    rows[1::2, 1:4] = np.nan
    got = read(Table(GOOD.names, rows).save(tmp_path / "log.csv"))
    assert np.abs(got.q - BASE.q[: got.samples]).max() < 1e-9
    assert np.array_equal(got.tau, BASE.tau[: got.samples])
    assert any("500 Hz" in text for text in got.repairs)


def test_reading_a_long_log_is_fast(tmp_path: Path) -> None:
    import time

    path = table(recording(24_000)).save(tmp_path / "log.csv")
    read(path)
    begin = time.process_time()
    read(path)
    assert time.process_time() - begin < 0.6  # 0.1 s here; room for a loaded machine


@pytest.mark.parametrize("large", [0, 1 << 30], ids=["arrow", "numpy"])
def test_faults_are_read_around_block_by_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, large: int) -> None:
    lines = GOOD.text().splitlines()
    lines[100] = lines[100].rpartition(",")[0]  # ragged
    lines[300] = lines[300].replace(",", ",x", 1)
    lines[400] = lines[400].rpartition(",")[0] + ","  # an empty cell
    lines.insert(250, "# stop")
    text = "\n".join(lines)[:-25]  # cut
    dialect = sniff(text, "log")
    wanted = dialect.names
    whole, said = csv_text.parse_columns(text, dialect, wanted, "log")
    monkeypatch.setattr(csv_text, "PART", 1 << 12)
    monkeypatch.setattr(csv_text, "LARGE", large)
    body = text[dialect.first :].encode()
    groups = [wanted[:1], wanted[4:7], wanted[1:]]  # a column may be asked for twice
    found, told = csv_text.parse_blocks(io.BytesIO(body), len(body), dialect, groups)
    for part, columns in zip(found, (whole[:, :1], whole[:, 4:7], whole[:, 1:]), strict=True):
        np.testing.assert_array_equal(part, columns)
    assert told == said
    assert said[0] == "2 CSV rows left out: line 101 has 9 cells of 10, line 502 has 9 cells of 10"
    assert said[1] == "text in place of numbers, taken as missing: line 302"


@pytest.mark.parametrize("named", [True, False])
def test_units_in_every_cell_are_told_and_their_numbers_read(tmp_path: Path, named: bool) -> None:
    names = ("time", "q", "tau") if named else ("column1", "column2", "column3")
    rows = [f"{4 * k:.1f} ms,{math.sin(0.04 * k) * 57.3:.5f}°,{0.5 * k:.3f} Nm\n" for k in range(200)]
    path = save(tmp_path, (f"{','.join(names)}\n" if named else "") + "".join(rows))
    log = CsvLog(open_source(path))
    assert log.units == dict(zip(names, ("ms", "°", "Nm"), strict=True))
    (stream,) = log.load([Pick(names[2], "", (0,), time=names[0])])
    np.testing.assert_array_equal(stream.values[:, 0], 0.5 * np.arange(200))
    np.testing.assert_array_equal(stream.clocks["t"], 4.0 * np.arange(200))


def test_a_cell_in_another_unit_than_its_column_is_missing_and_told(tmp_path: Path) -> None:
    rows = [f"{k} ms,1\n" for k in range(100)]
    rows[50] = "0.05 s,1\n"
    log = CsvLog(open_source(save(tmp_path, "t,x\n" + "".join(rows))))
    (stream,) = log.load([Pick("t", "", (0,))])
    assert np.flatnonzero(np.isnan(stream.values[:, 0])).tolist() == [50]
    assert any("text in place of numbers, taken as missing: line 52" in said for said in log.losses)
