"""Imports point one way, from commands down to errors, and only the outermost layers know click and rich."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "elid_cli"

# From the bottom up; modules of one line are one room and may import each other.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("__init__",),
    ("errors",),
    ("atomic", "text_file"),
    ("robot", "expressions", "yaml_values", "xml_values"),
    ("robot_schema", "robot_text", "inertials", "urdf", "urdf_gears", "urdf_write", "robot_file"),
    ("recording",),
    ("logs",),
    ("motion", "lowpass", "smoothing"),
    ("signals",),
    ("trace",),
    ("kinematics",),
    ("terms",),
    ("model",),
    ("reduction",),
    ("base",),
    ("effects",),
    ("estimate",),
    ("diagnosis",),
    ("dynamics", "folded", "ldl", "reference"),
    ("simulation", "rotors", "mjcf"),
    ("excitation",),
    ("report",),
    ("reports",),
    ("formats",),
    ("commands",),
    ("__main__",),
)
HEIGHT = {room: height for height, rooms in enumerate(LAYERS) for room in rooms}
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


def test_every_module_has_its_place() -> None:
    assert {room_of(path) for path in MODULES} <= set(HEIGHT), "name the new module in LAYERS"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_arrow_points_back(path: Path) -> None:
    here = room_of(path)
    for line, name in imports(path):
        head, *rest = name.split(".")
        if head != "elid_cli":
            continue
        there = rest[0] if rest and rest[0] in HEIGHT else "__init__"
        assert HEIGHT[there] <= HEIGHT[here], f"{path.name}:{line}: {here} imports {there}"


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
