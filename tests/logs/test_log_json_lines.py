"""JSON lines and printed topics: what is told by name and stamp, what is left out and said, what is refused."""

import gzip
import json
import time
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import LogError
from elid_cli.logs import read_recording
from elid_cli.logs.inspect import inspect_log
from tests import peaks
from tests.logs.made_logs import JOINTS, ROBOT, read, recording, same

BASE = recording(400)


def lines(rows: list[object], path: Path) -> Path:
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def samples() -> list[dict[str, object]]:
    signals = [values.tolist() for values in (BASE.t, BASE.q, BASE.theta, BASE.tau)]
    return [dict(zip(("t", "q", "theta", "tau"), row, strict=True)) for row in zip(*signals, strict=True)]


def states(topic: bool = True) -> list[dict[str, object]]:
    """Return motor and joint states, each with its joints in an order of its own that changes on the way."""
    rows: list[dict[str, object]] = []
    for k, t in enumerate(BASE.t.tolist()):
        order = [0, 1, 2] if k < 40 else [2, 0, 1]
        stamp = {"sec": 1_700_000_000 + int(t), "nanosec": round(t % 1 * 1e9)}
        for place, position, effort in (("/joint_states", BASE.q, None), ("/motor_states", BASE.theta, BASE.tau)):
            message = {"header": {"stamp": stamp, "frame_id": "base"}, "name": [JOINTS[j] for j in order],
                       "position": [float(position[k, j]) for j in order],
                       "effort": [] if effort is None else [float(effort[k, j]) for j in order]}  # fmt: skip
            rows.append({"topic": place, "msg": message} if topic else message)
    return rows


def test_samples_are_read_exactly(tmp_path: Path) -> None:
    got = read(lines(samples(), tmp_path / "log.jsonl"))
    same(got, BASE)
    packed = tmp_path / "log.jsonl.gz"
    packed.write_bytes(gzip.compress((tmp_path / "log.jsonl").read_bytes()))
    same(read(packed), BASE)


def test_columns_by_name_and_objects_by_joint(tmp_path: Path) -> None:
    flat = [{"t": t, **{f"{s}.{j}": float(getattr(BASE, s)[k, n]) for s in ("q", "theta", "tau")
                        for n, j in enumerate(JOINTS)}} for k, t in enumerate(BASE.t.tolist())]  # fmt: skip
    nested = [{"t": t, **{s: {j: float(getattr(BASE, s)[k, n]) for n, j in enumerate(JOINTS)}
                          for s in ("q", "theta", "tau")}} for k, t in enumerate(BASE.t.tolist())]  # fmt: skip
    same(read(lines(flat, tmp_path / "flat.jsonl")), BASE)
    same(read(lines(nested, tmp_path / "nested.jsonl")), BASE)


def test_messages_are_told_by_topic_and_their_joints_by_name(tmp_path: Path) -> None:
    got = read(lines(states(), tmp_path / "log.jsonl"))
    for signal in ("q", "theta", "tau"):
        np.testing.assert_allclose(getattr(got, signal), getattr(BASE, signal), rtol=1e-12)
    assert got.rate == pytest.approx(BASE.rate)
    assert "time is taken from header.stamp" in " ".join(got.notes)


def test_lines_that_hold_no_object_are_left_out_and_counted(tmp_path: Path) -> None:
    path = lines(samples(), tmp_path / "log.jsonl")
    text = path.read_text().splitlines()
    text[30], text[31] = text[30][:20], "[1, 2]"
    text.append("1" * 5000)
    text.append('{"q": ' + "[" * 100_000)
    path.write_text("\n".join(text) + '\n{"t": 0.')
    said = " ".join(read(path).repairs)
    assert "5 lines without a JSON object left out: line 31, line 32, line 401 and 2 more" in said


def test_a_single_object_is_no_log(tmp_path: Path) -> None:
    for text in ('{"t": 0}', '{\n "t": 0,\n "q": [1]\n}\n', json.dumps({"schema": "elid/1", "x": "y" * 9000})):
        (path := tmp_path / "log.json").write_text(text)
        with pytest.raises(LogError):
            inspect_log(path, ROBOT)


@pytest.mark.parametrize("row", [lambda k: {f"k{k}": 1}, lambda k: {"t": k, f"k{k % 19_000}": 1.0}],
                         ids=["a key a row", "many keys"])  # fmt: skip
def test_columns_that_are_nearly_empty_take_no_memory_beyond_the_budget(tmp_path: Path, row: object) -> None:
    assert callable(row)
    path = lines([row(k) for k in range(25_000)], tmp_path / "log.jsonl")
    begin, before = time.process_time(), peaks.begin()
    with pytest.raises(LogError):
        read_recording([path], ROBOT)
    assert time.process_time() - begin < 10
    assert peaks.since() - before < 600


def echo(order: list[int] | None = None) -> list[str]:
    """Return the rows that ``ros2 topic echo --csv`` prints, joints in an order of its own from row 30 on."""
    rows = []
    for k, t in enumerate(BASE.t.tolist()):
        own = order if order is not None and k >= 30 else [0, 1, 2]
        stamp = [1_700_000_000 + int(t), round(t % 1 * 1e9)]
        cells = [*stamp, "", *(JOINTS[j] for j in own), *BASE.q[k, own], *(0.1 * BASE.q[k, own]), *BASE.tau[k, own]]
        rows.append(",".join(map(str, cells)))
    return rows


def test_a_printed_topic_is_joint_states(tmp_path: Path) -> None:
    (path := tmp_path / "echo.csv").write_text("\n".join(echo()) + "\n")
    robot = ROBOT.stiffened(np.ones(ROBOT.n, dtype=bool))
    got = read_recording([path], robot)
    np.testing.assert_allclose(got.q, BASE.q, rtol=1e-12)
    np.testing.assert_allclose(got.tau, BASE.tau, rtol=1e-12)
    assert got.rate == pytest.approx(BASE.rate)
    assert any("read as ros2 topic echo --csv prints joint states" in note for note in got.notes)


def test_a_printed_topic_of_changing_order_is_refused(tmp_path: Path) -> None:
    (path := tmp_path / "echo.csv").write_text("\n".join(echo([2, 0, 1])) + "\n")
    with pytest.raises(LogError, match="line 31 names other joints"):
        read_recording([path], ROBOT.stiffened(np.ones(ROBOT.n, dtype=bool)))


def test_two_numbers_a_joint_are_asked_for(tmp_path: Path) -> None:
    rows = [",".join(row.split(",")[:12]) for row in echo()]
    (path := tmp_path / "echo.csv").write_text("\n".join(rows) + "\n")
    robot = ROBOT.stiffened(np.ones(ROBOT.n, dtype=bool))
    with pytest.raises(LogError) as caught:
        read_recording([path], robot)
    assert "effort_or_rate.{joint}" in caught.value.hint
    mapped = read_recording([path], robot, {"tau": {"from": "/joint_states/effort_or_rate.{joint}"}})
    np.testing.assert_allclose(mapped.tau, 0.1 * BASE.q, rtol=1e-12)


def test_joint_states_without_a_header_keep_the_rows_own_time(tmp_path: Path) -> None:
    rows = [{"t": 0.004 * k, "name": ["b", "a"], "position": [k, 2 * k], "effort": [1, 2]} for k in range(50)]
    found = inspect_log(lines(list(rows), tmp_path / "log.jsonl"))
    assert found.resolved["t"] == {"from": "t"}
    assert "t" not in found.missing
