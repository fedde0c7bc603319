"""NumPy archives (`.npz`): arrays named as the datasets of an HDF5 log; a single array (`.npy`) is called ``array``."""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from elid_cli.budget import Budget
from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat, RawLog
from elid_cli.logs.formats import hdf5
from elid_cli.logs.mapping.language import SIGNALS
from elid_cli.logs.source import Source

ZIP = b"PK\x03\x04"
SINGLE = b"\x93NUMPY"
MOST_ARRAYS = 1000
FAULTS = (
    ValueError, TypeError, KeyError, OverflowError, MemoryError, RuntimeError, OSError, EOFError, SyntaxError,
    tokenize.TokenError, zlib.error, zipfile.BadZipFile,
)  # fmt: skip
"""What reading damaged arrays raises: a header is parsed as an expression."""


NEEDED = {*SIGNALS, *hdf5.TIME_NAMES, "joint_names"}
"""Arrays that must not be passed over."""


def is_npz(head: bytes) -> bool:
    """Whether a zip archive begins with a NumPy array that is not elid's own."""
    length = int.from_bytes(head[26:28], "little")
    return head.startswith(ZIP) and head[30 : 30 + length].endswith(b".npy") and b"elid.npy" not in head[:80]


def _open(source: Source) -> Sequence[RawLog]:
    """Return the arrays as an HDF5 log in memory; names of joints are the array ``joint_names``."""
    if source.head.startswith(SINGLE):
        return _single(source)
    objects: list[str] = []
    try:
        with zipfile.ZipFile(io.BytesIO(source.read())) as archive:
            logs = hdf5.in_memory(source, _arrays(archive, Budget(source.name, source.size), objects))
    except FAULTS as error:
        raise LogError(f"{source.name}: NumPy archive is cut or damaged", detail=str(error).lower()[:120]) from error
    for name in (name for name in objects if name in NEEDED):
        raise LogError(
            f"{source.name}: {name} holds Python objects, which elid does not read",
            hint=f"save it as plain values: {name}=numpy.array({name}.tolist())",
        )
    if objects:
        for log in logs:
            log.notes.append(f"{', '.join(objects)[:120]} hold{'s' * (len(objects) == 1)} Python objects: not read")
    return logs


def _arrays(archive: zipfile.ZipFile, budget: Budget, objects: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield the arrays of an archive by name, as many as are read; names of those of Python objects go to `objects`."""
    for member in [m for m in archive.infolist() if m.filename.endswith(".npy")][:MOST_ARRAYS]:
        budget.take(member.file_size)
        name = member.filename.removesuffix(".npy")
        try:
            array = np.lib.format.read_array(io.BytesIO(archive.read(member)), allow_pickle=False)
        except ValueError as error:
            if "Object arrays" not in str(error):
                raise
            objects.append(name)
            continue
        yield name, array


def _single(source: Source) -> Sequence[RawLog]:
    """Return a file of one array as an HDF5 log in memory."""
    data = io.BytesIO(source.read())
    try:
        version = np.lib.format.read_magic(data)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(data)
        if dtype.names:
            raise LogError(
                f"{source.name}: the array is structured: its fields are {', '.join(dtype.names)[:120]}",
                hint="save each field as an array of its own: numpy.savez",
            )
        if dtype.hasobject:
            raise LogError(
                f"{source.name}: the array holds Python objects, which elid does not read",
                hint="save plain values: numpy.savez with one array per signal",
            )
        if dtype.kind not in "fiub" or math.prod(shape) * dtype.itemsize > source.size:
            raise ValueError(f"{dtype} of shape {shape} in {source.size} bytes")
        data.seek(0)
        return hdf5.in_memory(source, [("array", np.lib.format.read_array(data, allow_pickle=False))])
    except FAULTS as error:
        raise LogError(f"{source.name}: NumPy array is cut or damaged", detail=str(error).lower()[:120]) from error


FORMAT = LogFormat(
    name="NumPy",
    suffixes=(".npz", ".npy"),
    recognise=lambda source: is_npz(source.head) or source.head.startswith(SINGLE),
    open=_open,
    priority=20,
)
