"""Text that stands in XML.

The standard library's module for it loads an HTTP client, which would cost every command a tenth of its start.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping


def quoted(value: str) -> str:
    """Return a text as an XML attribute's value, quotes included."""
    from xml.sax.saxutils import quoteattr

    return quoteattr(value)


def escaped(text: str) -> str:
    """Return a text as the content of an XML element."""
    from xml.sax.saxutils import escape

    return escape(text)


def xml_number(value: float) -> str:
    """Return a number as the shortest text that reads back to it, zero without a sign."""
    return repr(float(value) + 0.0).removesuffix(".0")


def xml_numbers(values: Iterable[float]) -> str:
    """Return numbers as an attribute holds them, with spaces between."""
    return " ".join(map(xml_number, values))


def xml_attributes(values: Mapping[str, str]) -> str:
    """Return attributes as they stand in a tag."""
    return " ".join(f'{key}="{value}"' for key, value in values.items())
