"""Keys of mappings in files that know where they are written."""

from __future__ import annotations


class Key(str):
    """A key of a mapping that knows where it is written."""

    where = ""
    """``file:line``."""


def written_at(key: object, otherwise: str) -> str:
    """Return ``file:line`` of a mapping's key where that is known."""
    return getattr(key, "where", "") or otherwise
