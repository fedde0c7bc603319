"""Write a recording as a log: the format by the suffix, the file whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path

from elid_cli.errors import UsageError
from elid_cli.logs.registry import writer_for
from elid_cli.signals.recording import Recording


def write_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording in the canonical layout of its suffix (``.csv .csv.gz .h5 .hdf5 .mcap``).

    The same recording gives the same bytes. The file appears whole or not at all.

    Raises
    ------
    UsageError
        If the suffix belongs to no format, or the folder cannot be written.
    """
    fmt = writer_for(path)
    assert fmt.write is not None
    data = fmt.write(recording, Path(path).name)
    target = Path(path)
    try:
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written", detail=(error.strerror or str(error)).lower()) from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        umask = os.umask(0)
        os.umask(umask)
        Path(temporary).chmod(0o666 & ~umask)
        Path(temporary).replace(target)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written", detail=(error.strerror or str(error)).lower()) from error
    finally:
        with contextlib.suppress(FileNotFoundError):
            Path(temporary).unlink()
