"""Text that stands in XML.

The standard library's module for it loads an HTTP client, which would cost every command a tenth of its start.
"""

from __future__ import annotations


def quoted(value: str) -> str:
    """Return a text as an XML attribute's value, quotes included."""
    from xml.sax.saxutils import quoteattr

    return quoteattr(value)


def escaped(text: str) -> str:
    """Return a text as the content of an XML element."""
    from xml.sax.saxutils import escape

    return escape(text)
