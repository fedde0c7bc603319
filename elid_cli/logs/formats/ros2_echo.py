"""What ``ros2 topic echo --csv`` prints of joint states: no header, the names of the joints in every row.

A row is ``sec, nanosec, frame_id``, the names, then positions, velocities and efforts, each of them as long as the
names or left out: as many numbers as names are positions, three times as many are all. Twice as many may be positions
with velocities or with efforts, which the text does not say: those are columns to map.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat
from elid_cli.logs.formats.csv import CsvLog
from elid_cli.logs.formats.csv_dialect import to_number
from elid_cli.logs.source import Source

HEADER = 3
"""Cells before the names: seconds, nanoseconds, frame."""
BLOCKS = {1: ("position",), 2: ("position", "effort_or_rate"), 3: ("position", "velocity", "effort")}
"""Fields by how many numbers there are per name."""
TOPIC = "/joint_states"


def _layout(line: str) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return the names and fields of a row; None where it is no joint state."""
    cells = [cell.strip() for cell in line.rstrip("\r").split(",")]
    if len(cells) < HEADER + 2 or not all(re.fullmatch(r"\d{1,10}", cell) for cell in cells[:2]):
        return None
    count = next((k for k, c in enumerate(cells[HEADER:]) if to_number(c, False) is not None and c), 0)
    names, numbers = tuple(cells[HEADER : HEADER + count]), cells[HEADER + count :]
    framed = not cells[2] or to_number(cells[2], False) is None
    if not names or not all(names) or len(set(names)) < count or not framed:
        return None
    fields = BLOCKS.get(len(numbers) // count) if len(numbers) % count == 0 else None
    return (names, fields) if fields and all(to_number(c, False) is not None for c in numbers) else None


class EchoLog(CsvLog):
    """A text of joint states; its columns are named as PlotJuggler names them."""

    def __init__(self, source: Source) -> None:
        super().__init__(source)
        found = _layout(self._head.splitlines()[0])
        if found is None:
            raise LogError(f"{source.name}: no joint states")
        self._names, fields = found
        columns = [f"{TOPIC}/{field}.{name}" for field in fields for name in self._names]
        told = ("t", "nanosec", "frame_id", *(f"name{k + 1}" for k in range(len(self._names))), *columns)
        self._dialect = replace(self._dialect, separator=",", decimal_comma=False, names=told, named=True, units=())
        losses = self.losses
        self._name_columns()
        self.channels = [c for c in self.channels if c.source == "t" or c.source in columns]
        self.losses = losses
        self.notes = [f"no header row: read as ros2 topic echo --csv prints joint states, of {' '.join(self._names)}"]
        if "effort_or_rate" in fields:
            said = f"whether the second {len(self._names)} numbers of a row are velocities or efforts is not written"
            self.notes.append(
                f"{said}: map them, as tau: {{from: {TOPIC}/effort_or_rate.{{joint}}}} where they are efforts"
            )

    def _parsed(self, wanted: Sequence[Sequence[str]]) -> tuple[list[Array], list[str]]:
        """Return a table per group of wanted columns, stamps in s since the first (LogError: other joints)."""
        self._check_names()
        whole = [["t", "nanosec"] if list(group) == ["t"] else group for group in wanted]
        tables, said = super()._parsed(whole)
        for k, group in enumerate(wanted):
            if list(group) == ["t"]:
                seconds, rest = np.array(tables[k]).T
                tables[k] = ((seconds - seconds[0]) + 1e-9 * rest)[:, None]
        return tables, said

    def _check_names(self) -> None:
        """Refuse a log whose rows name other joints, or the same in another order (LogError)."""
        own = re.compile(r"[^,\n]*,[^,\n]*,[^,\n]*," + ",".join(rf"\s*{re.escape(n)}\s*" for n in self._names) + ",")
        for number, line in enumerate(self._text.splitlines(), start=1):
            if line.strip() and own.match(line) is None and _layout(line) is not None:
                raise LogError(
                    f"{self._name}: line {number} names other joints, or in another order, than the first",
                    detail=f"the first row is of {' '.join(self._names)}",
                    hint="record the topic as it is: ros2 bag record, and give elid the folder",
                )


def _recognise(source: Source) -> bool:
    if source.is_folder or not re.match(rb"\s*\d{1,10},\d{1,10},", source.head):
        return False
    lines = source.head.decode("utf-8", errors="replace").split("\n")
    return _layout(lines[0]) is not None if len(lines) > 1 else False


FORMAT = LogFormat(
    name="ros2 topic echo",
    suffixes=(),
    recognise=_recognise,
    open=lambda source: [EchoLog(source)],
    priority=80,
)
