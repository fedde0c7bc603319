"""Arrays mapped from files and let go; freed memory kept; last results kept.

What has been passed over can be let go again, and comes back from the file when it is asked for: a long log is then
held in memory only as far as it is being looked at. Such arrays are read-only; who must change one takes a copy
(`writable`).

Arrays pass in blocks of some megabytes. The C library gives such memory back when it is freed and takes it anew for the
next block, and memory that is touched for the first time costs as much as the arithmetic on it.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import sys
import tempfile
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from threading import Lock
from typing import IO, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array

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


class MappedRows:
    """Rows appended to one array; from `LEAST` bytes on it lies in a file without a name, as far as there is room.

    The array is read-only there, and can be let go.
    """

    def __init__(self, width: int) -> None:
        self._width = width
        self._parts: list[Array] = []
        self._file: IO[bytes] | None = None
        self.rows = 0

    def append(self, rows: Array) -> None:
        """Append rows, (m, width)."""
        self.rows += len(rows)
        # a copy: a view of one column would keep the whole table that it was read with
        self._parts.append(np.array(rows, dtype=np.float64, order="C"))
        if self._file is None and 8 * self._width * self.rows >= LEAST:
            self._file = _nameless()
        if self._file is not None:
            self._write(self._file)

    def _write(self, file: IO[bytes]) -> None:
        """Move what is in memory to the file; all of it back where that is full."""
        start = file.tell()
        try:
            for part in self._parts:
                file.write(part.data)
        except OSError:
            file.seek(0)
            kept = np.frombuffer(file.read(start), dtype=np.float64).reshape(-1, self._width)
            self._parts, self._file = [kept, *self._parts], None
            file.close()
        else:
            self._parts = []

    def finish(self) -> Array:
        """Return all rows, (N, width)."""
        if self._file is None:
            parts, self._parts = self._parts, []
            return parts[0] if len(parts) == 1 else np.concatenate(parts or [np.empty((0, self._width))])
        with self._file as file:  # the map outlives it
            file.flush()
            return np.memmap(file, dtype=np.float64, mode="r", shape=(self.rows, self._width)).view(np.ndarray)


def _nameless() -> IO[bytes] | None:
    """Return a file that is gone when it is closed, or None where there is no place for one."""
    try:
        return tempfile.TemporaryFile(prefix="elid-")
    except OSError:
        return None


def side_by_side(arrays: Sequence[Array]) -> Array:
    """Return the columns of arrays (N, k) in one (N, sum of k), mapped where it is large.

    Where they are all columns of one array in its own order, it is that array.
    """
    whole = arrays[0].base
    if isinstance(whole, np.ndarray) and whole.shape == (len(arrays[0]), sum(array.shape[1] for array in arrays)):
        starts = np.cumsum([0] + [array.shape[1] for array in arrays])
        own = [whole[:, a:b] for a, b in pairwise(starts.tolist())]
        if all(_is(array, part) for array, part in zip(arrays, own, strict=True)):
            return whole.view(np.ndarray)
    if sum(array.nbytes for array in arrays) < LEAST:
        return np.hstack(arrays)
    grown = MappedRows(sum(array.shape[1] for array in arrays))
    for start in range(0, len(arrays[0]), ROWS):
        grown.append(np.hstack([array[start : start + ROWS] for array in arrays]))
        let_go(*arrays)
    return grown.finish()


def _is(array: Array, other: Array) -> bool:
    """Whether two arrays are the same memory, seen alike."""
    a, b = array.__array_interface__, other.__array_interface__
    same = a["data"] == b["data"] and a["shape"] == b["shape"] and a["typestr"] == b["typestr"]
    return bool(same) and array.strides[0] == other.strides[0]


def alike(array: Array, other: Array) -> bool:
    """Whether two arrays hold the same values, NaN where the other has NaN."""
    if array is other or array.shape != other.shape:
        return array is other
    starts = range(0, len(array), ROWS)
    return all(np.array_equal(array[k : k + ROWS], other[k : k + ROWS], equal_nan=True) for k in starts)


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


def column_of(array: Array, place: int) -> Array:
    """Return a column in memory, (N,)."""
    column, start = np.empty(len(array)), 0
    for block in passed(array):
        column[start : start + len(block)] = block[:, place]
        start += len(block)
    return column


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


T = TypeVar("T")


class Recent(Generic[T]):
    """Keeps the last `most` results by key; results are shared, so nobody may change them."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: OrderedDict[Hashable, T] = OrderedDict()
        self._lock = Lock()

    def of(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return the result kept for a key, or make it."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        made = make()
        with self._lock:
            self._kept[key] = made
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return made


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
