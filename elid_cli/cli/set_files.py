"""Where parameter sets are written: a table, or a folder of robot files with the table beside them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from elid_cli.errors import UsageError
from elid_cli.experiment.robot_file import not_held, write_described
from elid_cli.files import check_target, check_writable, filling

if TYPE_CHECKING:
    from elid_cli.estimation.sampling.sets import ParameterSets


TABLE = "sets.csv"
"""The table beside a folder's robot files."""
SET = re.compile(r"set_\d+\.")
"""Begin of the name of a set's file, and of files that belong to it."""


def check_sets(out: str | None, robot: str | None) -> None:
    """Refuse, before any work is done, a place where sets cannot be written or others are already (UsageError)."""
    from elid_cli.estimation.sampling.files import TABLES

    if out is None:
        return
    path = Path(out)
    if not _is_folder(path):
        check_target(path, TABLES, "parameter sets")
        return
    if robot is None:
        raise UsageError(f"-o {out}: a folder is for robot files", hint="--robot ROBOT, or -o sets.csv")
    earlier = _earlier(path) if path.is_dir() else []
    if earlier:
        more = f" and {len(earlier) - 1} more" if len(earlier) > 1 else ""
        raise UsageError(
            f"-o {out}: holds parameter sets already: {earlier[0]}{more}",
            detail="sets of two runs in one folder would be mixed", hint="name a new folder, or move these files away",
        )  # fmt: skip
    check_writable(path / TABLE if path.is_dir() else path)


def _earlier(folder: Path) -> list[str]:
    """Return the names of files of an earlier run, the table last."""
    names = sorted(item.name for item in folder.iterdir())
    return [name for name in names if SET.match(name)] + [name for name in names if name == TABLE]


def write_sets(sets: ParameterSets, path: Path) -> list[str]:
    """Write sets as a table, or into a folder: a robot file for each, and the table beside them.

    Returns
    -------
    list
        What the robot files cannot hold, in sentences.
    """
    from elid_cli.estimation.sampling.files import write_csv, write_npz

    if not _is_folder(path):
        (write_npz if path.suffix.lower() == ".npz" else write_csv)(sets, path)
        return []
    robots = sets.robots()
    suffix = Path(robots[0].source).suffix or ".yaml"
    digits = len(str(len(robots)))
    with filling(path) as within:
        for number, robot in enumerate(robots, start=1):
            write_described(robot, str(within(f"set_{number:0{digits}d}{suffix}")))
        write_csv(sets, within(TABLE))
    return [f"{path}: {sentence}" for sentence in not_held(robots[0], f"set{suffix}")]


def _is_folder(path: Path) -> bool:
    return path.is_dir() or not path.suffix
