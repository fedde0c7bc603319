"""A recording written as a log: the format is found by the file's suffix, among those in `formats`."""

from __future__ import annotations

import hashlib
import importlib
import pkgutil
from functools import cache
from pathlib import Path

from elid_cli.checks import path as file_name
from elid_cli.errors import LogError, UsageError
from elid_cli.files import replacing
from elid_cli.logs import formats as library
from elid_cli.logs.contract import LogFormat
from elid_cli.logs.source import Source
from elid_cli.signals.fitting_robot import check_shapes
from elid_cli.signals.recording import Recording


@cache
def formats() -> tuple[LogFormat, ...]:
    """Return every format, in the order in which they are asked."""
    modules = [importlib.import_module(f"{library.__name__}.{m.name}") for m in pkgutil.iter_modules(library.__path__)]
    found = [module.FORMAT for module in modules if hasattr(module, "FORMAT")]
    return tuple(sorted(found, key=lambda fmt: (fmt.priority, fmt.name)))


def log_suffixes() -> tuple[str, ...]:
    """Return the suffixes of logs: those of all formats, and of what packs them."""
    return (*dict.fromkeys(suffix for fmt in formats() for suffix in fmt.suffixes), ".tsv", ".zip", ".gz")


def recognise(source: Source) -> LogFormat:
    """Return the format of a log by its content.

    Raises
    ------
    LogError
        If no format recognises it.
    """
    for candidate in formats():
        if candidate.recognise(source):
            return candidate
    raise LogError(
        f"{source.name}: not a log that elid can read",
        detail=f"its content is none of: {', '.join(fmt.name for fmt in formats() if fmt.write)}",
        hint="export it as CSV with a header row, HDF5 or MCAP, as docs/reference/formats.md says",
    )


def writer_for(path: str | Path) -> LogFormat:
    """Return the format that writes files with this suffix.

    Raises
    ------
    UsageError
        If the suffix belongs to no format that can be written.
    """
    name = Path(path).name.lower()
    writable = [fmt for fmt in formats() if fmt.write is not None]
    for fmt in writable:
        if name.endswith(fmt.suffixes):
            return fmt
    known = ", ".join(suffix for fmt in writable for suffix in fmt.suffixes)
    raise UsageError(f"{path}: cannot tell the log format from the name", hint=f"use one of the suffixes {known}")


def write_recording(recording: Recording, path: str | Path) -> str:
    """Write a `recording` in the canonical layout of the suffix of `path` (``.csv .csv.gz .h5 .hdf5 .mcap``).

    The same recording gives the same bytes. The file appears whole or not at all.

    Returns
    -------
    str
        The SHA-256 of what was written: a pipe cannot be read again.

    Raises
    ------
    UsageError
        If the suffix belongs to no format, or the folder cannot be written; or an argument of another kind.
    LogError
        If the arrays of the recording do not fit together.
    """
    file_name("write_recording: path", path)
    check_shapes(recording)
    fmt = writer_for(path)
    assert fmt.write is not None
    data = fmt.write(recording, Path(path).name)
    with replacing(path) as beside:
        beside.write_bytes(data)
    return hashlib.sha256(data).hexdigest()
