"""Triangle files told from logs, by their first bytes."""

from __future__ import annotations

from pathlib import Path

ZIP = b"PK\x03\x04"


def is_triangle_file(path: str | Path) -> bool:
    """Return whether a file is one that `write_triangles` wrote, or what is left of one, by its content.

    NumPy's archives of other arrays are logs. A pipe or device is never opened.
    """
    try:
        if not Path(path).is_file():
            return False
        with Path(path).open("rb") as stream:
            head = stream.read(80)
    except OSError:
        return False
    return head.startswith(ZIP) and (b"elid.npy" in head or _holds_them(path))


def _holds_them(path: str | Path) -> bool:
    import zipfile

    try:
        with zipfile.ZipFile(path) as archive:
            return "elid.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False
