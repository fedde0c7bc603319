"""What is asked of a robot's structure is answered once, and never for another structure."""

from __future__ import annotations

import errno
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli import memory
from elid_cli.memory import MappedRows, Recent, alike, column_of, let_go, side_by_side
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot


def test_the_last_results_are_kept_and_older_ones_made_again() -> None:
    made: list[int] = []

    def make(k: int) -> int:
        made.append(k)
        return 10 * k

    recent: Recent[int] = Recent(2)
    assert [recent.of(k, lambda k=k: make(k)) for k in (1, 2, 1, 3, 1, 2)] == [10, 20, 10, 30, 10, 20]
    assert made == [1, 2, 3, 2]


def test_values_of_parameters_do_not_change_the_rows_but_everything_else_does() -> None:
    robot = read_robot("planar2")
    first, second = robot.joints
    heavier = replace(robot, joints=(replace(first, parameters={**first.parameters, "m": 99.0}), second))
    assert Regressor(robot).estimation is Regressor(heavier).estimation
    assert find_base(Regressor(robot)) is find_base(Regressor(heavier))
    changes = (
        replace(robot, gravity=(0.0, 0.0, -9.81)),
        replace(robot, joints=(replace(first, a=0.7), second)),
        replace(robot, joints=(replace(first, gear_ratio=3.0), second)),
        replace(robot, joints=(replace(first, motor_axis=(1.0, 0.0, 0.0)), second)),
        replace(robot, joints=(replace(first, transmission="rigid"), second)),
        replace(robot, joints=(replace(first, type="prismatic"), second)),
    )
    for other in changes:
        assert Regressor(other).estimation is not Regressor(robot).estimation
        assert Regressor(other).equations is not Regressor(robot).equations
        assert find_base(Regressor(other)) is not find_base(Regressor(robot))


def test_sensors_have_rows_of_their_own() -> None:
    model = Regressor(read_robot("planar2"))
    with_sensor = model.sensed(np.array([True, False]))
    assert with_sensor is not model.estimation
    assert with_sensor is Regressor(read_robot("planar2")).sensed(np.array([True, False]))


def grown(width: int = 3) -> tuple[MappedRows, np.ndarray]:
    """Return rows appended in pieces, and what they must be."""
    values = np.random.default_rng(0).standard_normal((1000, width))
    rows = MappedRows(width)
    for start in range(0, 1000, 70):
        rows.append(values[start : start + 70])
    return rows, values


def test_a_column_does_not_keep_the_table_it_was_read_with() -> None:
    table, rows = np.ones((20, 100)), MappedRows(1)
    rows.append(table[:1].T)
    assert not np.shares_memory(rows.finish(), table)


def test_many_rows_lie_in_a_file_and_come_back_when_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    rows, values = grown()
    np.testing.assert_array_equal(rows.finish(), values)
    monkeypatch.setattr(memory, "LEAST", 8000)
    monkeypatch.setattr(memory, "ROWS", 64)
    rows, _ = grown()
    mapped = rows.finish()
    assert not mapped.flags.writeable
    let_go(mapped)
    np.testing.assert_array_equal(mapped, values)
    np.testing.assert_array_equal(column_of(mapped, 1), values[:, 1])
    whole = side_by_side([mapped[:, :1], mapped[:, 1:]])
    assert np.shares_memory(whole, mapped)  # nothing to copy
    np.testing.assert_array_equal(whole, values)
    joined = side_by_side([mapped[:, 2:], mapped[:, :1]])
    assert not joined.flags.writeable
    np.testing.assert_array_equal(joined, values[:, [2, 0]])


def test_arrays_are_alike_where_all_values_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "ROWS", 64)
    _, values = grown()
    values[3, 1] = np.nan
    other = values.copy()
    assert alike(values, other)
    assert not alike(values, other[:-1])
    other[-1, 0] += 1e-12
    assert not alike(values, other)


@pytest.mark.parametrize("written", [0, 3])
def test_a_full_disk_keeps_rows_in_memory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, written: int) -> None:
    class Full:
        """A file that takes some pieces and no more."""

        def __init__(self) -> None:
            self.file, self.left = (tmp_path / "rows").open("w+b"), written

        def write(self, data: memoryview) -> int:
            if not self.left:
                self.file.write(data.tobytes()[:5])
                raise OSError(errno.ENOSPC, "no space left on device")
            self.left -= 1
            return self.file.write(data)

        def __getattr__(self, name: str) -> object:
            return getattr(self.file, name)

    monkeypatch.setattr(memory, "LEAST", 8000)
    full = iter([Full()])
    monkeypatch.setattr(memory, "_nameless", lambda: next(full, None))
    rows, values = grown()
    np.testing.assert_array_equal(rows.finish(), values)
