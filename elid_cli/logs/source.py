"""Where a log's bytes come from: a file, a folder (rosbag2) or standard input."""

from __future__ import annotations

import hashlib
import io
import os
import stat
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import IO

from elid_cli.errors import LogError, UsageError, nearest

MOST_PIPED = 1 << 30
"""Bytes that are read from standard input, which may have no end."""
HEAD = 4096
"""Bytes that a format may look at to recognise itself."""


@dataclass(frozen=True)
class Source:
    """The bytes of one log; `name` is what the user typed."""

    name: str
    path: Path | None = None
    data: bytes | None = None
    listener: Callable[[float], None] | None = field(default=None, compare=False, repr=False)
    """Told the share of the log that has been read (0 to 1)."""

    def tell(self, share: float) -> None:
        """Tell how much of the log has been read."""
        if self.listener is not None:
            self.listener(share)

    @property
    def is_folder(self) -> bool:
        """Whether the log is a folder of files."""
        return self.path is not None and self.path.is_dir()

    @cached_property
    def head(self) -> bytes:
        """The first bytes of the log (empty for a folder)."""
        if self.is_folder:
            return b""
        with self.stream() as stream:
            return stream.read(HEAD)

    def stream(self) -> IO[bytes]:
        """Open the bytes for reading from the start."""
        if self.data is not None:
            return io.BytesIO(self.data)
        assert self.path is not None
        try:
            return self.path.open("rb")
        except OSError as error:
            raise _unreadable(self.name, error) from error

    def read(self, most: int = -1) -> bytes:
        """Return all bytes, or the first `most`."""
        if self.data is not None:
            return self.data if most < 0 else self.data[:most]
        with self.stream() as stream:
            return stream.read(most)

    @property
    def size(self) -> int:
        """Size in bytes (0 for a folder)."""
        if self.data is not None:
            return len(self.data)
        assert self.path is not None
        return 0 if self.is_folder else self.path.stat().st_size

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the bytes; of a folder: of its files' names and hashes in order of name."""
        if self.is_folder:
            assert self.path is not None
            total = hashlib.sha256()
            for file in sorted(p for p in self.path.rglob("*") if p.is_file()):
                part = Source(str(file), file)
                total.update(f"{file.relative_to(self.path).as_posix()} {part.sha256}\n".encode())
            return total.hexdigest()
        with self.stream() as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()  # type: ignore[arg-type]


def open_source(path: str | Path, listener: Callable[[float], None] | None = None) -> Source:
    """Return the source that `path` names; ``-`` is standard input. The listener is told how much has been read.

    Raises
    ------
    LogError
        If the path does not exist, cannot be read, or is neither a file nor a folder.
    UsageError
        If it is empty, or no path.
    """
    if not isinstance(path, str | os.PathLike):
        raise UsageError(
            "a log is a path, not a list" if isinstance(path, list | tuple) else "a log is a path",
            detail=f"found {path!r:.60}",
            hint="give one log after the other" if isinstance(path, list | tuple) else "",
        )
    name = str(path)
    if not name.strip():
        raise UsageError("an empty name is no log", hint="name the log, or the folder as .")
    if name == "-":
        data = _standard_input()
        if not data.strip():
            raise LogError("standard input: empty", hint="pipe a CSV log into elid, or name a file")
        return Source("-", data=data, listener=listener)
    file = Path(name)
    try:
        mode = file.stat().st_mode
    except OSError as error:
        raise _unreadable(name, error) from error
    if stat.S_ISDIR(mode):
        return Source(name, file, listener=listener)
    if not stat.S_ISREG(mode):
        raise LogError(f"{name}: not a regular file", hint="a pipe can be read as standard input: elid … - < PIPE")
    source = Source(name, file, listener=listener)
    if not source.head.strip(b"\x00"):
        what = "empty" if source.size == 0 else "holds only zero bytes"
        raise LogError(f"{name}: {what}", hint="record the log again, or name another file")
    return source


@cache
def _standard_input() -> bytes:
    """Return all of standard input, which can be read once but is asked for twice: what it holds, then the numbers."""
    data = sys.stdin.buffer.read(MOST_PIPED + 1)
    if len(data) > MOST_PIPED:
        hint = "write the log to a file first"
        raise LogError(f"standard input: more than {MOST_PIPED >> 20} MiB, and no end", hint=hint)
    return data


def _unreadable(name: str, error: OSError) -> LogError | UsageError:
    if isinstance(error, FileNotFoundError):
        folder = Path(name).parent
        siblings = [p.name for p in folder.iterdir()] if folder.is_dir() else []
        near = nearest(Path(name).name, siblings)
        hint = f"did you mean {str(folder / near)!r}?" if near else "check the path"
        return LogError(f"{name}: no such file", hint=hint)
    return LogError(f"{name}: cannot be read", detail=(error.strerror or str(error)).lower())
