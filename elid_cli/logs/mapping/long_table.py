"""``long:`` of a mapping: the columns of a table whose rows each name the channel that they are a sample of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from elid_cli.errors import LogError, UsageError, did_you_mean
from elid_cli.logs.contract import RawLog
from elid_cli.robot.written_keys import written_at

KEY = "long"
"""The mapping's key, beside the signals and t."""
EXAMPLE = "long: {name: channel, value: value}"


@dataclass(frozen=True)
class LongTable:
    """Which columns name the channel of a row, and which hold its values."""

    names: tuple[str, ...]
    values: tuple[str, ...]

    @property
    def written(self) -> dict[str, Any]:
        """The entry of a mapping that says the same."""
        parts = {"name": self.names, "value": self.values}
        return {key: columns[0] if len(columns) == 1 else list(columns) for key, columns in parts.items()}


@runtime_checkable
class Table(Protocol):
    """An opened log that is a table with columns."""

    def in_long_form(self, table: LongTable) -> RawLog:
        """Return the log with one channel per name (LogError: a column is not there)."""


def parse_long(entry: Any, where: str) -> LongTable:
    """Return the columns that `long:` of a mapping names.

    Raises
    ------
    UsageError
        Naming `where` and the key, with the nearest valid one.
    """
    if not isinstance(entry, Mapping):
        raise UsageError(f"{where}: {KEY}: expected columns", detail=f"found {entry!r:.60}", hint=EXAMPLE)
    for key in entry:
        if key not in ("name", "value"):
            raise UsageError(f"{where}: {KEY}: unknown key {key!r}", hint=did_you_mean(str(key), ("name", "value")))
    for key in ("name", "value"):
        if key not in entry:
            raise UsageError(f"{where}: {KEY}: no {key!r}", hint=EXAMPLE)
    return LongTable(*(_columns(entry[key], f"{where}: {KEY}: {key}") for key in ("name", "value")))


def _columns(value: Any, where: str) -> tuple[str, ...]:
    columns = value if isinstance(value, list) else [value]
    if not columns or not all(isinstance(column, str) and column for column in columns):
        raise UsageError(f"{where}: expected a column or a list of them", detail=f"found {value!r:.60}", hint=EXAMPLE)
    return tuple(columns)


def reshaped(raw: RawLog, mapping: Mapping[str, Any] | None, robot_log: Mapping[str, Any] | None) -> RawLog:
    """Return a table as the user's mapping or the robot's says that it is to be read, else as it is.

    Raises
    ------
    LogError
        The log is no table of text, or lacks a column.
    """
    for where, given in (("--map", mapping), ("the robot's log block", robot_log)):
        if given and KEY in given:
            place = next((written_at(key, where) for key in given if key == KEY), where)
            table = parse_long(given[KEY], place)
            if isinstance(raw, Table):
                return raw.in_long_form(table)
            if given is mapping:
                raise LogError(f"{where}: {KEY}: this log is no table of text (CSV or Parquet)")
    return raw
