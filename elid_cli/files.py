"""Files read as UTF-8 with clear errors, written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from elid_cli.errors import UsageError, did_you_mean


def check_writable(path: Path) -> None:
    """Refuse, before any work is done, a file that cannot be written.

    Raises
    ------
    UsageError
        Its folder does not exist or may not be written, or it is itself a folder.
    """
    folder = path.parent
    if path.is_dir():
        raise UsageError(f"{path}: is a folder", hint="name a file in it")
    if not folder.is_dir():
        there = [str(p) for p in folder.parent.iterdir() if p.is_dir()] if folder.parent.is_dir() else []
        near = did_you_mean(str(folder), there) if there else ""
        raise UsageError(f"{path}: no folder {folder}", hint=near if near.startswith("did") else f"mkdir -p {folder}")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise UsageError(f"{path}: not writable", hint="choose another folder")


def check_suffix(path: Path, suffixes: tuple[str, ...], content: str) -> None:
    """Refuse, before any work is done, a file whose name promises something else than its content.

    A name without a suffix promises nothing, nor does a device or a pipe.

    Parameters
    ----------
    path
        The file to write.
    suffixes
        What its name may end with, the usual one first.
    content
        What will be in it, in words.

    Raises
    ------
    UsageError
        Another suffix.
    """
    if path.suffix.lower() in ("", *suffixes) or (path.exists() and not path.is_file()):
        return
    raise UsageError(
        f"{path}: not a name for {content} ({' '.join(suffixes)})", hint=f"name it {path.with_suffix(suffixes[0])}"
    )


def check_target(name: str | Path, suffixes: tuple[str, ...], content: str) -> None:
    """Refuse, before any work is done, a file to write by its name or its place (`check_suffix`, `check_writable`)."""
    check_suffix(Path(name), suffixes, content)
    check_writable(Path(name))


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a name beside `path` to write to, and rename it onto `path` when the block ends well.

    Whatever ends the block early, Ctrl-C included, removes the unfinished file and leaves an older one as it was.
    A device or a pipe (``/dev/stdout``) cannot be renamed onto and is yielded itself. The suffix is kept, since
    some writers choose or add one by it.

    Raises
    ------
    UsageError
        The folder cannot be written or the disk is full.
    """
    target = Path(path)
    if target.exists() and not target.is_file():
        yield target  # before links are followed: what /dev/stdout leads to, pipe:[…], has no name to open
        return
    if target.is_symlink():
        target = target.resolve()
    check_writable(target)
    beside = target.with_name(f".{target.stem[:100]}.{os.getpid()}.part{target.suffix}")
    try:
        beside.unlink(missing_ok=True)
        # never a link that lies there, and never more readable than the file that it replaces
        mode = target.stat().st_mode & 0o777 if target.exists() else 0o666
        os.close(os.open(beside, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode))
        yield beside
        if target.exists():
            beside.chmod(mode)
        beside.replace(target)
    except OSError as problem:
        raise UsageError(f"{target}: cannot be written", detail=str(problem.strerror or problem).lower()) from problem
    finally:
        beside.unlink(missing_ok=True)


@contextlib.contextmanager
def filling(folder: str | Path) -> Iterator[Callable[[str], Path]]:
    """Make a folder if it is missing, and leave no new file in it where the block does not end well.

    Yielded is what returns the path of a file to write, by its name; files that were there before stay.

    Raises
    ------
    UsageError
        The folder cannot be made.
    """
    target, new = Path(folder), list[Path]()
    there = target.is_dir()

    def within(name: str) -> Path:
        path = target / name
        if not path.exists():
            new.append(path)
        return path

    try:
        target.mkdir(exist_ok=True)
    except OSError as problem:
        raise UsageError(f"{target}: cannot be made", detail=str(problem.strerror).lower()) from problem
    try:
        yield within
    except BaseException:
        for path in new:
            path.unlink(missing_ok=True)
        if not there:
            with contextlib.suppress(OSError):
                target.rmdir()
        raise


def refuse_overwriting(inputs: Iterable[tuple[str, str]], outputs: Iterable[tuple[str, str]]) -> None:
    """Refuse, before any work is done, to write a file over one that is read, or two outputs to one file.

    Parameters
    ----------
    inputs, outputs
        (How the user named it: an option, or empty; path) of each. Links are followed; devices and pipes are left out.

    Raises
    ------
    UsageError
        Naming both.
    """
    inputs = list(inputs)
    taken = {file: (option, name) for option, name in inputs if (file := _identity(name)) is not None}
    folders = {Path(name).resolve() for _, name in inputs if name and Path(name).is_dir()}
    written: dict[object, str] = {}
    for option, name in outputs:
        file = _identity(name)
        if file in taken:
            other, read = taken[file]
            raise UsageError(
                f"{option} {name}: the same file as {other + ' ' if other else ''}{read}, which is read",
                hint="name another file",
            )
        place = Path(name).resolve()
        if folders & set(place.parents) and place.exists():
            raise UsageError(f"{option} {name}: lies in a folder that is read", hint="name another file")
        key = file or place
        if key in written and not (place.exists() and not place.is_file()):
            raise UsageError(f"{option} {name}: the same file as {written[key]}", hint="name another file")
        written[key] = f"{option} {name}"


def _identity(name: str) -> tuple[int, int] | None:
    """Return what tells a regular file from all others; None where there is none of that name."""
    try:
        found = Path(name).stat()
    except (OSError, ValueError):
        return None
    return (found.st_dev, found.st_ino) if name and stat.S_ISREG(found.st_mode) else None


def write_text(path: str | Path, text: str) -> None:
    """Write a text as UTF-8, whole or not at all."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", errors="surrogateescape", newline="\n")


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
        line = problem.object[: problem.start].count(b"\n") + 1
        raise fault(f"{path}:{line}: not UTF-8 text", hint="save it as UTF-8") from None
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise fault(f"{path}: cannot be read ({reason.lower()})") from None


def _similar(path: Path, suffixes: tuple[str, ...]) -> str:
    beside = [str(p) for p in path.parent.iterdir() if p.suffix in suffixes] if path.parent.is_dir() else []
    hint = did_you_mean(str(path), beside)
    return hint if hint.startswith("did") else ""
