"""Tables whose rows name their channel (time, name, value): every channel has its own rate, as in a log of topics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import LogError, UsageError
from elid_cli.logs import read_map_options, read_recording
from elid_cli.logs.inspect import inspect_log
from elid_cli.robot.robot import Joint, Robot

ROBOT = Robot("arm", tuple(Joint(name, transmission="rigid") for name in ("shoulder", "elbow")))
T = np.arange(0, 4, 0.004)
Q = np.column_stack([np.sin(2 * T), np.cos(3 * T)])
TAU = np.column_stack([3 * np.cos(2 * T), np.sin(T)])
Row = Sequence[object]


def table(path: Path, header: str, rows: Sequence[Row], separator: str = ",", comma: bool = False) -> Path:
    cells = (
        [f"{x:.9g}".replace(".", "," if comma else ".") if isinstance(x, float) else str(x) for x in r] for r in rows
    )
    path.write_text("\n".join([header, *(separator.join(row) for row in cells)]) + "\n")
    return path


def by_time(q: str, tau: str, clock: float = 1.0) -> list[Row]:
    """Return rows as a recorder writes them: positions of both joints at every instant, torques at every second."""
    rows: list[Row] = []
    for k, t in enumerate(T * clock):
        for j in range(2):
            rows.append((float(t), *q.format(j=ROBOT.joint_names[j], i=j + 1).split("|"), float(Q[k, j])))
            if k % 2 == 0:
                name = tau.format(j=ROBOT.joint_names[j], i=j + 1).split("|")
                rows.append((float(t + 0.001 * clock), *name, float(TAU[k, j])))
    return rows


def assert_read(path: Path, lines: Sequence[str] = ()) -> None:
    found = read_recording([path], ROBOT, read_map_options(lines) or None)
    assert abs(found.dt - 0.004) < 1e-9
    at = found.t - found.t[0]
    start = 0.001 if found.t.size < T.size else 0.0  # before the first torque nothing is known
    for values, true in ((found.q, Q), (found.tau, TAU)):
        want = np.column_stack([np.interp(at, T, column) for column in true.T])
        near = np.column_stack([np.interp(at + max(start, 0.004), T, column) for column in true.T])
        assert np.minimum(np.abs(values - want), np.abs(values - near))[10:-10].max() < 2e-2


def test_canonical_names_need_no_mapping(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", "time,name,value", by_time("q.{j}", "tau.{j}"))
    assert_read(path)
    notes = read_recording([path], ROBOT).notes
    assert "long form: each row holds value of the channel in name, 4 in all" in notes


def test_a_molten_table_with_channels_one_below_the_other(tmp_path: Path) -> None:
    names = [f"{s}.{joint}" for s in ("q", "tau") for joint in ROBOT.joint_names]
    columns = zip(names, np.hstack([Q, TAU]).T, strict=True)
    rows = [(float(t), name, float(x)) for name, column in columns for t, x in zip(T, column, strict=True)]
    assert_read(table(tmp_path / "a.csv", "t,variable,value", rows))


@pytest.mark.parametrize(
    ("header", "rows"),
    [
        ("time,topic,value", by_time("/arm/{j}/position", "/arm/{j}/torque")),
        ("stamp,joint,field,value", by_time("{j}|position", "{j}|effort")),
        ("stamp,axis,signal,value", by_time("{i}|angle", "{i}|torque")),
    ],
)
def test_the_hint_of_one_pasted_reads_the_log(tmp_path: Path, header: str, rows: list[Row]) -> None:
    path = table(tmp_path / "a.csv", header, rows)
    info = inspect_log(path, ROBOT)
    assert info.missing == ("q", "tau")
    assert_read(path, info.mapping.splitlines())


@pytest.mark.parametrize("numbered", [False, True])
def test_a_row_per_joint_with_several_values(tmp_path: Path, numbered: bool) -> None:
    rows = [(float(t), j + 1 if numbered else name, float(Q[k, j]), float(TAU[k, j]))
            for k, t in enumerate(T) for j, name in enumerate(ROBOT.joint_names)]  # fmt: skip
    path = table(tmp_path / "a.csv", "timestamp,joint,position,effort", rows)
    assert_read(path, inspect_log(path, ROBOT).mapping.splitlines())


def test_german_columns_with_units(tmp_path: Path) -> None:
    path = table(
        tmp_path / "a.csv", "Zeit [ms];Achse;Kanal;Wert", by_time("{i}|Winkel", "{i}|Drehmoment", 1000.0), ";", True
    )
    lines = inspect_log(path, ROBOT).mapping.splitlines()
    assert "t: {from: Zeit, unit: ms}" in lines
    assert_read(path, lines)


def test_times_of_day_go_on_over_midnight(tmp_path: Path) -> None:
    rows = []
    for t, *rest in by_time("q.{j}", "tau.{j}"):
        at = (86398.0 + float(str(t))) % 86400
        rows.append((f"{at // 3600:02.0f}:{at // 60 % 60:02.0f}:{at % 60:06.3f}", *rest))
    path = table(tmp_path / "a.csv", "time,name,value", rows)
    assert_read(path)
    assert "time: times of day that pass midnight" in read_recording([path], ROBOT).notes


def test_units_of_rows_are_said(tmp_path: Path) -> None:
    rows = [(*row, "deg" if "position" in str(row[1]) else "N.m") for row in by_time("{j}/position", "{j}/torque")]
    path = table(tmp_path / "a.csv", "time,name,value,unit", rows)
    assert 'q: {from: "{joint}/position", unit: deg}' in inspect_log(path, ROBOT).mapping.splitlines()


def test_the_mapping_says_which_columns(tmp_path: Path) -> None:
    """Two columns of text of which only one names channels, and names that never mix: nothing tells them."""
    rows = [(float(t), name, f"run{k % 3}", float(Q[k, j]), float(TAU[k, j]))
            for j, name in enumerate(ROBOT.joint_names) for k, t in enumerate(T)]  # fmt: skip
    path = table(tmp_path / "a.csv", "t,who,note,angle,load", rows)
    long = "long: {name: who, value: [angle, load]}"
    info = inspect_log(path, ROBOT, read_map_options([long]))
    assert info.resolved["long"] == {"name": "who", "value": ["angle", "load"]}
    lines = [long, 'q: {from: "angle.{joint}"}', 'tau: {from: "load.{joint}"}']
    assert_read(path, lines)
    assert inspect_log(path, replace(ROBOT, log=read_map_options(lines))).missing == ()


def test_wrong_columns_are_named_with_the_nearest(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", "time,name,value", by_time("q.{j}", "tau.{j}"))
    with pytest.raises(LogError, match="long: no column 'nam'") as caught:
        read_recording([path], ROBOT, {"long": {"name": "nam", "value": "value"}})
    assert "name" in caught.value.hint
    with pytest.raises(UsageError, match="long: unknown key 'names'"):
        read_recording([path], ROBOT, {"long": {"names": "name", "value": "value"}})
    with pytest.raises(UsageError, match="long: no 'value'"):
        read_recording([path], ROBOT, {"long": {"name": "name"}})


def test_a_column_of_states_makes_no_long_form(tmp_path: Path) -> None:
    """A wide table with text in it, whether that changes seldom or in every row."""
    for words in (["idle"] * 500 + ["run"] * 500, ["a", "b"] * 500, [f"12:00:0{k}" for k in range(1000)]):
        rows = [(float(t), words[k], *map(float, Q[k]), *map(float, TAU[k])) for k, t in enumerate(T)]
        assert_read(table(tmp_path / "a.csv", "t,state,q.shoulder,q.elbow,tau.shoulder,tau.elbow", rows),
                    ['q: {from: "q.{joint}"}'])  # fmt: skip


def test_cut_rows_and_text_for_numbers_are_missing(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", "time,name,value", by_time("q.{j}", "tau.{j}"))
    lines = path.read_text().splitlines()
    lines[50] = lines[50].rpartition(",")[0] + ",oops"
    path.write_text("\n".join([*lines, "3.9,q.sh"]) + "\n")
    found = read_recording([path], ROBOT)
    assert any("1 rows of other lengths" in repair for repair in found.repairs)
