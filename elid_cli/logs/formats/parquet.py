"""Parquet tables, read as CSV is; needs pyarrow."""

from __future__ import annotations

import io
from collections.abc import Sequence

from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat, RawLog
from elid_cli.logs.formats import csv
from elid_cli.logs.source import Source


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
        table = parquet.read_table(io.BytesIO(source.read()))
        kept = [f.name for f in table.schema if not (arrow.types.is_nested(f.type) or arrow.types.is_binary(f.type))]
        arrow_csv.write_csv(table.select(kept), text)
    except (arrow.ArrowException, OSError, ValueError) as error:
        raise LogError(f"{source.name}: Parquet file is cut or damaged", detail=str(error).lower()[:120]) from error
    return csv.FORMAT.open(Source(source.name, data=text.getvalue(), listener=source.listener))


FORMAT = LogFormat(
    name="Parquet",
    suffixes=(".parquet",),
    recognise=lambda source: source.head.startswith(b"PAR1"),
    open=_open,
    priority=20,
)
