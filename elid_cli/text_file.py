"""Small text files that users name: read as UTF-8, every way it can fail being one clear error."""

from __future__ import annotations

from pathlib import Path

from elid_cli.errors import UsageError, did_you_mean

LARGEST = 1_000_000
"""Bytes of a description that are read at all."""


def read_text(path: Path, fault: type[UsageError], *, suffixes: tuple[str, ...] = (), most: int = LARGEST) -> str:
    """Return a text file's content.

    Parameters
    ----------
    path
        The file.
    fault
        The class of the errors raised.
    suffixes
        Which files beside a missing one may have been meant.
    most
        The largest size in bytes.

    Raises
    ------
    UsageError
        Of class `fault`: missing, a folder, a pipe or device, unreadable, too large, binary.
    """
    try:
        if path.is_dir():
            raise fault(f"{path}: is a folder, not a file")
        if not path.exists():
            raise fault(f"{path}: no such file", hint=_similar(path, suffixes))
        if not path.is_file():
            raise fault(f"{path}: is a pipe or a device, not a file", hint="copy it to a file first")
        size = path.stat().st_size
        if size > most:
            raise fault(f"{path}: {size} bytes; a description of at most {most} is read")
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise fault(f"{path}: not a text file (byte {problem.start} is no UTF-8)") from None
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise fault(f"{path}: cannot be read ({reason.lower()})") from None


def _similar(path: Path, suffixes: tuple[str, ...]) -> str:
    beside = [str(p) for p in path.parent.iterdir() if p.suffix in suffixes] if path.parent.is_dir() else []
    hint = did_you_mean(str(path), beside)
    return hint if hint.startswith("did") else ""
