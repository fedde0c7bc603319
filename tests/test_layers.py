"""Imports point one way, from commands down to errors, and only the outermost layers know click and rich."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "elid_cli"

# From the bottom up. Modules that are not named here may stand anywhere, but make no arrow between these point back.
ROOMS = (
    "errors", "robot", "recording", "logs", "signals", "kinematics", "terms", "model", "reduction", "base", "estimate",
    "diagnosis", "simulation", "excitation", "report", "reports", "formats", "commands",
)  # fmt: skip
MODULES = sorted(PACKAGE.rglob("*.py"))


def room_of(path: Path) -> str:
    """Return the module or folder directly below the package."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path: Path) -> list[tuple[int, str]]:
    """Return (line, dotted name) of everything a file imports, inside functions too, type checking excepted."""
    tree = ast.parse(path.read_text("utf-8"))
    skipped = {
        id(node)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and "TYPE_CHECKING" in ast.unparse(branch.test)
        for node in ast.walk(branch)
    }
    found: list[tuple[int, str]] = []
    for node in ast.walk(tree):
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


def path_between(graph: dict[str, set[str]], start: str, goal: str) -> list[str]:
    """Return a chain of imports from one room to another, or [] where there is none."""
    chains, seen = [[start]], {start}
    while chains:
        chain = chains.pop(0)
        for room in sorted(graph.get(chain[-1], set())):
            if room == goal:
                return [*chain, room]
            if room not in seen:
                seen.add(room)
                chains.append([*chain, room])
    return []


GRAPH = arrows()


@pytest.mark.parametrize("room", sorted(GRAPH))
def test_no_room_imports_itself_in_a_circle(room: str) -> None:
    assert path_between(GRAPH, room, room) == []


@pytest.mark.parametrize("room", ROOMS)
def test_no_arrow_points_back(room: str) -> None:
    for above in ROOMS[ROOMS.index(room) + 1 :]:
        assert path_between(GRAPH, room, above) == []


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_only_formats_and_commands_know_the_terminal(path: Path) -> None:
    outer = {"formats": {"rich"}, "commands": {"rich", "click"}}.get(room_of(path), set())
    used = {name.split(".")[0] for _, name in imports(path)} & {"rich", "click"}
    assert used <= outer


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_the_core_never_prints_or_exits(path: Path) -> None:
    if room_of(path) in ("commands", "__main__"):
        return
    tree = ast.parse(path.read_text("utf-8"))
    calls = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    assert not calls & {"print", "exit", "quit", "sys.exit", "os._exit", "sys.stdout.write", "sys.stderr.write"}
    if room_of(path) in ("reports", "formats"):
        assert "numpy" not in {name.split(".")[0] for _, name in imports(path)}, "no numerics in reports and formats"
