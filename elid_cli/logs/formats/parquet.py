"""Parquet tables, named as CSV's columns are; needs pyarrow."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.budget import Budget
from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat
from elid_cli.logs.formats.csv import CsvLog
from elid_cli.logs.formats.csv_dialect import Dialect, number_of, without_units
from elid_cli.logs.formats.csv_text import floats_of, parted
from elid_cli.logs.mcap.bulk_decode import GrowingArray
from elid_cli.logs.source import Source

WIDEST = 1000
"""Values of a list that become columns; what is longer is an image."""
HEAD = 1000
"""Rows by which a table in long form is known."""
AT_ONCE = 1 << 16
"""Rows that are read together."""


@dataclass(frozen=True)
class _Column:
    """A column of the table, or one value of its lists."""

    name: str
    place: int | None = None

    @property
    def title(self) -> str:
        """What the user calls it."""
        return self.name if self.place is None else f"{self.name}[{self.place}]"

    def of(self, batch: Any) -> Any:
        """Return its values in some rows; null where a list is shorter."""
        import pyarrow as arrow
        from pyarrow import compute

        column = batch.column(self.name)
        if self.place is None:
            return column
        lengths = compute.fill_null(compute.list_value_length(column), 0).to_numpy(zero_copy_only=False)
        there, values = lengths > self.place, np.full(len(lengths), np.nan)
        values[there] = _numbers(column.flatten())[(np.cumsum(lengths) - lengths + self.place)[there]]
        return arrow.array(values)


class ParquetLog(CsvLog):
    """One table; columns are read when they are loaded."""

    def __init__(self, source: Source) -> None:
        self._name, self._tell = source.name, source.tell
        self._file = _opened(source)
        self._budget = Budget(source.name, source.size)
        self._budget.take(8 * _values(self._file.metadata))  # a few bytes may stand for many rows
        schema = self._file.schema_arrow
        self._columns = (*(_Column(field.name) for field in schema if _is_plain(field.type)), *self._lists())
        names, units = without_units(tuple(column.title for column in self._columns))
        self._head = self._as_text(HEAD)
        self._dialect = Dialect(",", False, names, True, self._head.find("\n") + 1, 2, units)
        self._name_columns()

    def _lists(self) -> Iterator[_Column]:
        """Yield the values of lists of one length as columns: ``state`` becomes ``state[0] state[1] …``."""
        from pyarrow import compute

        names = [field.name for field in self._file.schema_arrow if _is_list(field.type)]
        first = next(self._batches(HEAD, [_Column(name) for name in names]), None) if names else None
        for name in names:
            if first is None:
                break
            lengths = compute.min_max(compute.list_value_length(first.column(name))).as_py()
            if lengths["min"] == lengths["max"]:
                yield from (_Column(name, k) for k in range(min(lengths["min"] or 0, WIDEST)))

    def _batches(self, rows: int, columns: Sequence[_Column]) -> Iterator[Any]:
        """Yield some rows at a time (LogError where the file is damaged)."""
        import pyarrow as arrow

        try:
            yield from self._file.iter_batches(rows, columns=[*{c.name: 0 for c in columns}], use_threads=False)
        except (arrow.ArrowException, OSError, ValueError) as error:
            raise _damaged(self._name, error) from error

    @property
    def _text(self) -> str:
        """The whole table as CSV, for one in long form."""
        return self._as_text(self._file.metadata.num_rows)

    def _as_text(self, rows: int) -> str:
        """Return the first rows as CSV."""
        import pyarrow as arrow
        from pyarrow import csv

        text = io.BytesIO()
        for number, batch in enumerate(self._batches(min(rows, HEAD) or 1, self._columns)):
            if number * HEAD >= rows:
                break
            self._budget.take(_spelt(batch))
            table = arrow.table([_plain_text(c.of(batch)) for c in self._columns], [c.title for c in self._columns])
            csv.write_csv(table, text, csv.WriteOptions(include_header=number == 0))
        return text.getvalue().decode("utf-8", errors="replace")

    def _parsed(self, wanted: Sequence[Sequence[str]]) -> tuple[list[Array], list[str]]:
        """Return a table per group of wanted columns and what had to be said."""
        own = [self._columns[self._dialect.names.index(name)] for group in wanted for name in group]
        rows = max(self._file.metadata.num_rows, 1)
        table = GrowingArray(len(own), hint=rows)
        for batch in self._batches(AT_ONCE, own):
            part = table.extend(batch.num_rows)
            for k, column in enumerate(own):
                part[:, k] = _numbers(column.of(batch))
            self._tell(table.rows / rows)
        if not table.rows:
            raise LogError(f"{self._name}: no readable row")
        return parted(table.finish(), wanted), []


def _opened(source: Source) -> Any:
    """Return the file, its texts as numbers of what they are: the same long text may stand in every row.

    Checksums of pages are compared where the file has them; most writers leave them out.
    """
    try:
        import pyarrow as arrow
        from pyarrow import parquet
    except ImportError as error:
        raise LogError(
            f"{source.name}: a Parquet file, which needs pyarrow", hint="pip install 'elid[tables]'"
        ) from error
    try:
        data = source.path if source.data is None else io.BytesIO(source.data)
        texts = [field.name for field in parquet.read_schema(data) if arrow.types.is_string(field.type)]
        return parquet.ParquetFile(data, read_dictionary=texts, page_checksum_verification=True)
    except (arrow.ArrowException, OSError, ValueError) as error:
        raise _damaged(source.name, error) from error


def _damaged(name: str, error: Exception) -> LogError:
    return LogError(f"{name}: Parquet file is cut or damaged", detail=str(error).lower()[:120])


def _values(metadata: Any) -> int:
    """Return how many values all columns hold, those of lists counted one by one."""
    groups = (metadata.row_group(k) for k in range(metadata.num_row_groups))
    return sum(int(group.column(k).num_values) for group in groups for k in range(group.num_columns))


def _is_list(kind: Any) -> bool:
    """Whether a type of Arrow is one of lists of numbers."""
    from pyarrow import types

    return bool((types.is_list(kind) or types.is_fixed_size_list(kind)) and types.is_primitive(kind.value_type))


def _is_plain(kind: Any) -> bool:
    """Whether a type of Arrow is one of numbers, moments or text."""
    from pyarrow import types

    moment = types.is_timestamp(kind) or types.is_duration(kind)
    number = types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind)
    return bool(moment or number or types.is_string(kind) or types.is_dictionary(kind))


def _spelt(batch: Any) -> int:
    """Return how many bytes the texts of some rows take where each is written out."""
    total = 0
    for column in batch.columns:
        if hasattr(column, "dictionary"):
            sizes = np.array([len(str(text)) for text in column.dictionary.to_pylist()] + [0])
            total += int(sizes[column.indices.fill_null(-1).to_numpy(zero_copy_only=False)].sum())
    return total


def _plain_text(column: Any) -> Any:
    """Return a column with its texts written out."""
    return column.dictionary_decode() if hasattr(column, "dictionary") else column


def _numbers(column: Any) -> Array:
    """Return a column's numbers, moments in s since 1970; NaN where there is none."""
    import pyarrow as arrow
    from pyarrow import types

    if types.is_dictionary(column.type):
        known = [number_of(str(text)) for text in column.dictionary.to_pylist()]
        values = np.array([np.nan if value is None else value for value in known] + [np.nan])
        return np.asarray(values[column.indices.fill_null(len(known)).to_numpy(zero_copy_only=False)])
    if types.is_timestamp(column.type) or types.is_duration(column.type):
        second = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[column.type.unit]
        return _numbers(column.cast(arrow.int64())) / second
    return floats_of(column.cast(arrow.float64(), safe=False))


FORMAT = LogFormat(
    name="Parquet",
    suffixes=(".parquet",),
    recognise=lambda source: source.head.startswith(b"PAR1"),
    open=lambda source: [ParquetLog(source).narrowed()],
    priority=20,
)
