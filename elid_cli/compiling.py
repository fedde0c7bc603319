"""Loops compiled by Numba, where that can be imported; without it the same loops run as plain Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

PLAIN = "motion is simulated without Numba, in ten times the time and more: pip install numba"
"""What is said before long work where `has_numba` is false."""


@cache
def has_numba() -> bool:
    """Whether Numba can be imported: one that is older than NumPy refuses."""
    try:
        import numba  # noqa: F401
    except ImportError:
        return False
    return True


def compiled(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """Return a function compiled by Numba, kept on disk where there is a place for it; `options` are those of njit."""
    from numba import njit

    found: Callable[..., Any]
    try:
        found = njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to keep it
        found = njit(**options)(function)
    return found
