"""Parquet tables, read as CSV is; needs pyarrow."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat, RawLog
from elid_cli.logs.formats import csv
from elid_cli.logs.source import Source

WIDEST = 1000
"""Values of a list that become columns; what is longer is an image."""


def _open(source: Source) -> Sequence[RawLog]:
    try:
        import pyarrow as arrow
        from pyarrow import csv as arrow_csv
        from pyarrow import parquet
    except ImportError as error:
        raise LogError(
            f"{source.name}: a Parquet file, which needs pyarrow", hint="pip install 'elid[tables]'"
        ) from error
    text = io.BytesIO()
    try:
        table = _spread(parquet.read_table(io.BytesIO(source.read())))
        kept = [f.name for f in table.schema if not (arrow.types.is_nested(f.type) or arrow.types.is_binary(f.type))]
        arrow_csv.write_csv(table.select(kept), text)
    except (arrow.ArrowException, OSError, ValueError) as error:
        raise LogError(f"{source.name}: Parquet file is cut or damaged", detail=str(error).lower()[:120]) from error
    return csv.FORMAT.open(Source(source.name, data=text.getvalue(), listener=source.listener))


def _spread(table: Any) -> Any:
    """Return the table with lists of one length as columns: ``state`` becomes ``state[0] state[1] …``."""
    import pyarrow as arrow
    from pyarrow import compute

    for name in table.column_names:
        column = table[name].combine_chunks()
        if not (arrow.types.is_list(column.type) or arrow.types.is_fixed_size_list(column.type)):
            continue
        lengths = compute.min_max(compute.list_value_length(column)).as_py()
        if (
            not arrow.types.is_primitive(column.type.value_type)
            or lengths["min"] != lengths["max"]
            or not lengths["min"]
        ):
            continue
        for k in range(min(lengths["min"], WIDEST)):
            table = table.append_column(f"{name}[{k}]", compute.list_element(column, k))
    return table


FORMAT = LogFormat(
    name="Parquet",
    suffixes=(".parquet",),
    recognise=lambda source: source.head.startswith(b"PAR1"),
    open=_open,
    priority=20,
)
