"""Memory that was freed is kept for the next array instead of being given back to the system.

Arrays pass in blocks of some megabytes. The C library gives such memory back when it is freed and takes it anew for the
next block, and memory that is touched for the first time costs as much as the arithmetic on it.
"""

from __future__ import annotations

import os
import sys

KEPT = 128 << 20
"""Bytes of freed memory that are kept."""
APART = 32 << 20
"""Bytes from which an array is taken from the system by itself, and given back at once (glibc allows no more)."""
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3


def keep_freed_memory() -> None:
    """Set glibc's malloc so, unless the environment says otherwise; elsewhere do nothing."""
    if not sys.platform.startswith("linux") or any(name.startswith(("MALLOC_", "GLIBC_TUN")) for name in os.environ):
        return
    import ctypes

    try:
        library = ctypes.CDLL(None)
        library.mallopt(_MMAP_THRESHOLD, APART)
        library.mallopt(_TRIM_THRESHOLD, KEPT)
    except (AttributeError, OSError):
        pass  # another C library
