"""Large arrays of numbers taken from the file where they lie, instead of being copied into memory.

What has been passed over can be let go again, and comes back from the file when it is asked for: a long log is then
held in memory only as far as it is being looked at. Such arrays are read-only; who must change one takes a copy
(`writable`).
"""

from __future__ import annotations

import contextlib
import mmap
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST = 64 << 20
"""Bytes from which an array is mapped rather than read."""
ROWS = 1 << 17
"""Rows looked at before they are let go."""


def mapped_dataset(dataset: Any, path: Path | None) -> Array | None:
    """Return a dataset of HDF5 as a read-only array on its file, or None where it is not there in one plain piece."""
    size = dataset.size * dataset.dtype.itemsize
    plain = dataset.chunks is None and dataset.dtype == np.dtype("<f8") and sys.byteorder == "little"
    if path is None or not plain or size < LEAST:
        return None
    offset = dataset.id.get_offset()
    if offset is None or offset % 8 or path.stat().st_size < offset + size:
        return None
    return np.memmap(path, dtype=np.float64, mode="r", offset=offset, shape=dataset.shape).view(np.ndarray)


def let_go(*arrays: NDArray[Any] | None) -> None:
    """Drop from memory what of these arrays lies in a file."""
    if not hasattr(mmap, "MADV_DONTNEED"):
        return
    for array in arrays:
        owner: Any = array
        while owner is not None and not isinstance(owner, mmap.mmap):
            owner = getattr(owner, "base", None)
        if owner is not None:
            with contextlib.suppress(OSError, ValueError):
                owner.madvise(mmap.MADV_DONTNEED)


def passed(array: Array, rows: int = ROWS) -> Iterator[Array]:
    """Yield an array's rows in blocks, and let go of each when the next is asked for."""
    for start in range(0, len(array), rows):
        yield array[start : start + rows]
        let_go(array)


def extremes(array: Array) -> tuple[Array, Array]:
    """Return the smallest and the largest number of every column; NaN where it has none."""
    low, high = (np.full(array.shape[1], np.nan) for _ in range(2))
    for block in passed(array):
        low, high = np.fmin(low, along(np.fmin, block)), np.fmax(high, along(np.fmax, block))
    return low, high


def along(operation: np.ufunc, rows: Array) -> Array:
    """Return an operation reduced over rows (N, k), (k,): over many short rows at once, which NumPy does faster."""
    width, together = rows.shape[1], 64
    whole = len(rows) // together * together
    if not rows.flags.c_contiguous or not whole:
        return np.asarray(operation.reduce(rows, axis=0))
    folded = operation.reduce(rows[:whole].reshape(-1, together * width), axis=0).reshape(together, width)
    return np.asarray(operation.reduce(np.concatenate([folded, rows[whole:]]), axis=0))


def writable(array: Array) -> Array:
    """Return the array, or a copy where it may not be written to."""
    return array if array.flags.writeable else array.copy()
