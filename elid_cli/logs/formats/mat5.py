"""MATLAB files before v7.3 (`save` without options): variables named as the datasets of an HDF5 log."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from elid_cli.budget import Budget
from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat, RawLog
from elid_cli.logs.formats import hdf5
from elid_cli.logs.source import Source

MAGIC = b"MATLAB 5.0 MAT-file"
COMPRESSED = 15
"""Type of an element that is packed by zlib."""
AT_ONCE = 1 << 20
"""Bytes that are unpacked at a time while they are counted."""
DEEPEST = 4
"""Structures within structures that are looked into."""
MOST_ARRAYS = 1000
_FAULTS = (
    ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, MemoryError, NotImplementedError,
    OSError, EOFError, RuntimeError, zlib.error, struct.error, RecursionError,
)  # fmt: skip


def _open(source: Source) -> Sequence[RawLog]:
    """Return the numeric variables, those of structures by their path, as an HDF5 log in memory."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    data = source.read()
    _believe(data, Budget(source.name, source.size))
    try:
        found = loadmat(io.BytesIO(data), struct_as_record=False, squeeze_me=False)
        arrays = _arrays({name: value for name, value in found.items() if not name.startswith("__")})
        return hdf5.in_memory(source, islice(arrays, MOST_ARRAYS))
    except (*_FAULTS, MatReadError) as error:
        detail = str(error).lower()[:120]
        raise LogError(f"{source.name}: MATLAB file is cut or damaged", detail=detail) from error


def _believe(data: bytes, budget: Budget) -> None:
    """Ask for the memory that the file's elements take when they are unpacked (LogError)."""
    order, place = ("<" if data[126:128] == b"IM" else ">"), 128
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        budget.step()
        if kind == COMPRESSED:
            inflate, rest = zlib.decompressobj(), data[place + 8 : place + 8 + size]
            try:
                while rest and not inflate.eof:
                    budget.take(len(inflate.decompress(rest, AT_ONCE)))
                    rest = inflate.unconsumed_tail
            except zlib.error:
                return  # the reader says what is wrong
        place += 8 + size


def _arrays(held: Mapping[str, Any], depth: int = 0) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield numeric arrays, (N, k), by their path: ``log.q`` of a structure is ``log/q``."""
    for name, value in held.items():
        if isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.ndim <= 2 and value.size:
            yield name, value.reshape(-1) if 1 in value.shape else value
        elif isinstance(value, np.ndarray) and value.size == 1 and value.dtype == object and depth < DEEPEST:
            fields = getattr(value.flat[0], "_fieldnames", ())
            inner = {f"{name}/{field}": getattr(value.flat[0], field) for field in fields}
            yield from _arrays(inner, depth + 1)


FORMAT = LogFormat(
    name="MATLAB",
    suffixes=(".mat",),
    recognise=lambda source: source.head.startswith(MAGIC),
    open=_open,
    priority=20,
)
