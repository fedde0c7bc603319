"""Imports point one way, from the command line down to errors; only the outermost rooms know click and rich."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "elid_cli"

# From the bottom up: every file below the package belongs to one of these, and imports only from itself or below.
ROOMS = (
    "_types", "errors", "checks", "budget", "files", "memory", "tables", "lapack", "compiling",
    "robot", "signals", "model", "logs", "estimation", "diagnosis", "experiment", "report", "cli",
)  # fmt: skip
DOORS = ("__init__", "__main__")
"""What stands in front of all rooms: the public names and ``python -m elid_cli``."""
MODULES = sorted(PACKAGE.rglob("*.py"))


def room_of(path: Path) -> str:
    """Return the module or folder directly below the package."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@cache
def imports(path: Path) -> list[tuple[int, str]]:
    """Return (line, dotted name) of everything a file imports, inside functions too, type checking excepted."""
    nodes = list(ast.walk(ast.parse(path.read_text("utf-8"))))
    skipped = {
        id(node)
        for branch in nodes
        if isinstance(branch, ast.If) and "TYPE_CHECKING" in ast.unparse(branch.test)
        for node in ast.walk(branch)
    }
    found: list[tuple[int, str]] = []
    for node in nodes:
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            assert node.module is not None
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found += [(node.lineno, name) for name in names]
    return found


@cache  # and not where tests are collected, which every worker does
def arrows() -> dict[str, set[str]]:
    """Return room -> rooms that it imports."""
    rooms = {room_of(path) for path in MODULES}
    graph: dict[str, set[str]] = {room: set() for room in rooms}
    for path in MODULES:
        for _, name in imports(path):
            head, *rest = name.split(".")
            if head == "elid_cli" and rest and rest[0] in rooms:
                graph[room_of(path)].add(rest[0])
    return {room: found - {room} for room, found in graph.items()}


def test_every_file_belongs_to_a_room() -> None:
    assert set(arrows()) == {*ROOMS, *DOORS}


@pytest.mark.parametrize("room", ROOMS)
def test_no_arrow_points_back(room: str) -> None:
    below = ROOMS[: ROOMS.index(room)]
    found = arrows()[room]
    assert found <= {*below, "__init__"}, f"{room} imports {sorted(found - set(below))}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_only_reports_and_the_command_line_know_the_terminal(path: Path) -> None:
    outer = {"formats": {"rich"}, "cli": {"rich", "click"}}.get(
        path.parent.name if room_of(path) == "report" else room_of(path), set()
    )
    used = {name.split(".")[0] for _, name in imports(path)} & {"rich", "click"}
    assert used <= outer


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_the_core_never_prints_or_exits(path: Path) -> None:
    if room_of(path) in ("cli", "__main__"):
        return
    tree = ast.parse(path.read_text("utf-8"))
    calls = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    assert not calls & {"print", "exit", "quit", "sys.exit", "os._exit", "sys.stdout.write", "sys.stderr.write"}
    if path.parent.name in ("answers", "formats") and room_of(path) == "report":
        assert "numpy" not in {name.split(".")[0] for _, name in imports(path)}, "no numerics in answers and formats"


def test_distributions_come_from_scipy_special() -> None:
    """`scipy.stats` takes longer to import than most logs to identify, and older ones write a file while they do."""
    assert not [(path, line) for path in MODULES for line, name in imports(path) if name.startswith("scipy.stats")]


HEAVY = ("scipy", "h5py", "mcap", "matplotlib", "pandas", "polars", "pyarrow", "numba", "dask", "mujoco")
LIGHT = ("scipy.special",)


def test_heavy_packages_are_imported_where_they_are_used() -> None:
    """One import at the top of a file cost every diagnosis most of a second."""
    heavy = []
    for path in MODULES:
        for node in ast.parse(path.read_text("utf-8")).body:
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            heavy += [(path, name) for name in names if name.split(".")[0] in HEAVY and name not in LIGHT]
    assert not heavy


def test_the_tests_mirror_the_rooms() -> None:
    here = Path(__file__).parent
    folders = {path.name for path in here.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders - {"system"} <= set(ROOMS)


def test_places_of_later_features_exist_once() -> None:
    from tests.system.reproduce.sizes import LATER, feature_of

    places = [place for text in LATER.values() for place in text.split()]
    assert len(places) == len(set(places))
    assert {feature_of(path) for path in MODULES} == {None, *LATER}
    for place in places:
        assert (PACKAGE / place).is_dir() or (PACKAGE / f"{place}.py").is_file(), place
