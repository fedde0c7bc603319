"""rosbag2 folders: the MCAP splits of one recording, read as one log in time order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from elid_cli.errors import LogError
from elid_cli.logs.contract import LogFormat, RawLog
from elid_cli.logs.formats.db3 import open_bags
from elid_cli.logs.formats.foreign import kind_of, refuse
from elid_cli.logs.formats.mcap import McapLog
from elid_cli.logs.source import Source

if TYPE_CHECKING:
    import yaml

MOST_NAMED = 5
LARGEST_METADATA = 10 << 20


def _open(source: Source) -> Sequence[RawLog]:
    assert source.path is not None
    files, missing, listed = _splits(source.path)
    files = [replace(file, listener=source.listener) for file in files]
    databases = [file for file in files if re.search(r"\.db3(\.zstd)?$", file.name)]
    if databases and len(databases) == len(files):
        return open_bags(source.name, databases, missing, listed)
    for file in files:
        known = kind_of(file.head)
        if known is not None and "MCAP" not in known[0]:
            refuse(file)
    if not files:
        held = ", ".join(sorted(p.name for p in source.path.iterdir())[:6]) or "nothing"
        raise LogError(
            f"{source.name}: a folder without MCAP files",
            detail=f"it holds {held}",
            hint="name the log itself, or the folder that `ros2 bag record -s mcap` made",
        )
    return [McapLog(source.name, files, missing, listed)]


def _splits(folder: Path) -> tuple[list[Source], list[str], list[str]]:
    """Return the bag's files in recording order, as metadata.yaml lists them, else by number; what is missing.

    The last are the names of the files that it lists.
    """
    present = {p.name: p for p in folder.iterdir() if p.is_file() and p.name != "metadata.yaml"}
    listed = _listed(folder / "metadata.yaml")
    names = list(dict.fromkeys(name for name in (Path(entry).name for entry in listed) if name in present))
    rest = [name for name in present if name not in names and re.search(r"\.(mcap|db3)(\.zstd)?$", name)]
    files = [Source(str(present[name]), present[name]) for name in [*names, *sorted(rest, key=_numbered)]]
    gone = [name for name in (Path(entry).name for entry in listed) if name not in present]
    lost = [f"{name} is listed in metadata.yaml and missing" for name in gone]
    lost = lost[:MOST_NAMED] or [f"{name} is missing between its neighbours" for name in _skipped(names + rest)]
    return files, lost, [str(present[name]) for name in names]


def _skipped(names: Sequence[str]) -> list[str]:
    """Return the names that a numbered series leaves out."""
    series: dict[tuple[str, str], set[int]] = {}
    for name in names:
        match = re.fullmatch(r"(.*?)(\d{1,6})(\.\D*)", name)
        if match:
            series.setdefault((match[1], match[3]), set()).add(int(match[2]))
    return [
        f"{before}{number}{after}"
        for (before, after), numbers in series.items()
        for number in range(min(numbers), max(numbers))
        if number not in numbers and max(numbers) - min(numbers) < 10 * len(numbers)
    ][:MOST_NAMED]


def _numbered(name: str) -> list[int | str]:
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _listed(metadata: Path) -> list[str]:
    """Return the files that metadata.yaml names, each once; nothing where it is missing, no file, or damaged."""
    import yaml

    try:
        if not metadata.is_file() or metadata.stat().st_size > LARGEST_METADATA:
            return []
        # composed, never constructed: aliases and merges stay references, dates and numbers stay texts
        top = yaml.compose(metadata.read_text("utf-8"), Loader=yaml.SafeLoader)
    except (OSError, ValueError, yaml.YAMLError, RecursionError):
        return []
    paths = _child(_child(top, "rosbag2_bagfile_information"), "relative_file_paths")
    listed = paths.value if isinstance(paths, yaml.SequenceNode) else []
    return list(dict.fromkeys(entry.value for entry in listed if isinstance(entry, yaml.ScalarNode)))


def _child(node: yaml.Node | None, key: str) -> yaml.Node | None:
    """Return the value of a mapping's key, None where there is none."""
    import yaml

    pairs = node.value if isinstance(node, yaml.MappingNode) else []
    return next((value for name, value in pairs if name.value == key), None)


FORMAT = LogFormat(
    name="rosbag2",
    suffixes=(),
    recognise=lambda source: source.is_folder,
    open=_open,
    priority=0,
)
