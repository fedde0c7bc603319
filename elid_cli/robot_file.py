"""Robot descriptions: from a YAML or URDF file, or by the bare name of a robot that ships with elid, and back.

`read_robot` is the only door: whatever ``--robot`` was given goes through it.
"""

from __future__ import annotations

import os
from pathlib import Path

from elid_cli.atomic import write_text
from elid_cli.errors import RobotError, UsageError, did_you_mean
from elid_cli.robot import Robot
from elid_cli.robot_schema import robot_of_yaml
from elid_cli.robot_text import fingerprint, text_of
from elid_cli.yaml_values import LARGEST

__all__ = ["fingerprint", "read_robot", "read_text", "robot_from_text", "shipped_robots", "write_robot"]

SUFFIXES = (".yaml", ".yml", ".urdf", ".xml")


def shipped_robots() -> dict[str, Path]:
    """Return the robots that ship with elid: bare name to file, sorted by name.

    They are inside the package when installed as a wheel, beside it in a source tree or an editable install.
    """
    package = Path(__file__).resolve().parent
    folder = package / "robots"
    if not folder.is_dir() and (package.parent / "pyproject.toml").is_file():
        folder = package.parent / "robots"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))} if folder.is_dir() else {}


def read_robot(source: str | Path) -> Robot:
    """Read a robot description.

    Parameters
    ----------
    source
        The bare name of a shipped robot (``puma560``), or a path to a YAML or URDF file.

    Raises
    ------
    RobotError
        No such robot or file, or a description that cannot be used: file, line, joint, key, nearest valid key.
    """
    path = Path(source)
    if _bare(source):
        shipped = shipped_robots()
        if str(source) in shipped:
            path = shipped[str(source)]
        elif not path.is_file():
            raise RobotError(
                f"no robot named {str(source)!r}",
                detail=f"'{source}' is a folder here" if path.is_dir() else "",
                hint=did_you_mean(str(source), shipped) or "give the path of a YAML or URDF file",
            )
    text = read_text(path)
    if _is_xml(text) or path.suffix.lower() == ".urdf":
        from elid_cli.urdf import read_urdf

        return read_urdf(text, path.name if _bare(source) else str(path), beside=path)
    return robot_of_yaml(text, str(path))


def robot_from_text(text: str, name: str) -> Robot:
    """Return the robot that a text describes, YAML or URDF; `name` stands for the file in errors."""
    if _is_xml(text):
        from elid_cli.urdf import read_urdf

        return read_urdf(text, name)
    return robot_of_yaml(text, name)


def write_robot(robot: Robot, path: str | Path) -> None:
    """Write a robot description as YAML that reads back to exactly the same robot, whole or not at all.

    Raises
    ------
    UsageError
        The file cannot be written.
    """
    write_text(path, text_of(robot))


def read_text(path: Path, fault: type[UsageError] = RobotError, most: int = LARGEST) -> str:
    """Return a small text file's content as UTF-8.

    Raises
    ------
    UsageError
        Of class `fault`: missing (with the nearest name), a folder, a pipe or device, unreadable, too large, binary.
    """
    try:
        if path.is_dir():
            raise fault(f"{path}: is a folder, not a file")
        if not path.exists():
            raise fault(f"{path}: no such file", hint=_similar(path))
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


def _bare(source: str | Path) -> bool:
    """Whether the source is a name and not a path: no separator, none of a description's suffixes."""
    if not isinstance(source, str):
        return False
    separators = {os.sep, os.altsep or os.sep}
    return bool(source) and not any(mark in source for mark in separators) and Path(source).suffix not in SUFFIXES


def _is_xml(text: str) -> bool:
    return text.lstrip("\ufeff \t\r\n").startswith("<")


def _similar(path: Path) -> str:
    """Return a hint: a file beside the missing one, or the shipped robot of that name."""
    stem = path.stem
    shipped = shipped_robots()
    if stem in shipped:
        return f"did you mean '{stem}', the robot that ships with elid?"
    beside = [str(p) for p in path.parent.iterdir() if p.suffix in SUFFIXES] if path.parent.is_dir() else []
    hint = did_you_mean(str(path), beside)
    return hint if hint.startswith("did") else did_you_mean(stem, shipped)
