"""How results show themselves: short tables in a terminal and a notebook, plain values, data frames.

What a table of a result holds is the report's concern, which lies above every result. Its module is loaded by its name
when something is printed or asked for, so that computing never waits for it and no result imports it.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from elid_cli.errors import UsageError

PRESENTER = "elid_cli.report.present"
"""Offers `text`, `html`, `payload` and `table` of every result."""
FEW = 4
"""Items of a collection that are named in a `repr`."""
LONG = 60
"""Characters of a value that a `repr` shows."""


class Brief:
    """A dataclass (``repr=False``) whose `repr` names large parts by their size instead of printing them."""

    def __repr__(self) -> str:
        parts = (f"{f.name}={_brief(getattr(self, f.name))}" for f in fields(self) if f.repr)  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(parts)})"


SCHEMA = "elid/1"
"""What the JSON object of every command names itself, first."""


class Shown(Brief):
    """A result that prints as the tables of its command's report, and gives them as values."""

    def __str__(self) -> str:
        return str(_presenter().text(self))

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(str(self))  # what IPython shows in a terminal

    def _repr_html_(self) -> str:
        return str(_presenter().html(self))

    def to_dict(self) -> dict[str, Any]:
        """Return the result in JSON's own types, keys and units as ``--json`` prints them (docs/reference/json.md).

        What only the command knows is not there: schema, command, version, and the log where the result does not hold
        it. A number that is not finite is None.
        """
        values: dict[str, Any] = _presenter().payload(self)
        return values

    def to_frame(self) -> Any:
        """Return the result's main table as a pandas DataFrame, numbers in SI units at the joint.

        Raises
        ------
        UsageError
            pandas is not installed (extra ``frames``).
        """
        try:
            pandas: Any = importlib.import_module("pandas")
        except ModuleNotFoundError:
            raise UsageError("to_frame: pandas is not installed", hint="pip install 'elid[frames]'") from None
        return pandas.DataFrame(_presenter().table(self))


def _presenter() -> Any:
    return importlib.import_module(PRESENTER)


def _brief(value: Any) -> str:
    """Return a value's `repr`, or what it is and how large where that would be long."""
    if getattr(value, "shape", ()):
        return f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
    if is_dataclass(value):
        return f"<{type(value).__name__}>"
    if isinstance(value, Mapping) and value:
        names = [key for key in value if isinstance(key, str)][:FEW]
        return f"<{len(value)} items{': ' if names else ''}{', '.join(names)}{', …' if len(value) > FEW else ''}>"
    if isinstance(value, tuple | list) and value and (len(value) > FEW or is_dataclass(value[0])):
        return f"<{len(value)} x {type(value[0]).__name__}>"
    text = repr(value)
    return text if len(text) <= LONG else f"<{type(value).__name__}>"
