r"""JSON: exactly one object, full precision, NaN and infinity as null, the same bytes for the same report.

Written in ASCII (``\u00b7`` for ·), so that neither the locale nor a pipe can change a byte of it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from typing import Any

from elid_cli import __version__
from elid_cli.report.formats import Style
from elid_cli.report.tree import Report
from elid_cli.tables import SCHEMA

SUFFIXES = (".json",)


def render(report: Report, style: Style) -> str:
    """Return the report's payload as one JSON object."""
    head = {"schema": SCHEMA, "command": report.command, "version": __version__}
    return json.dumps({**head, **plain(report.payload)}, indent=2, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """Return a value in JSON's own types; arrays become lists, what is not finite becomes None.

    Raises
    ------
    TypeError
        The value has no counterpart in JSON.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(plain(item) for item in value)
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, without importing NumPy
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    raise TypeError(f"a report may not hold a {type(value).__name__}")
