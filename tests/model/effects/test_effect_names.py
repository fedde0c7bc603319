"""No file but an effect's own knows its name; twins may name one another, and readers of robots declare effects."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from elid_cli.model.effects import effect_classes

PACKAGE = Path(__file__).parents[3] / "elid_cli"
LIBRARY = PACKAGE / "model/effects/library"
NAMES = frozenset(effect_classes())
MJCF = {"contact", "link_spring", "link_viscous", "link_coulomb", "transmission_damping"}
"""In the reader of MJCF: an element that is spelled alike; what springs, damping and friction there are as effects."""

SPELLED_ALIKE = {
    "robot/beside.py": {"payload"},
    "robot/schema.py": {"payload"},
    "cli/values.py": {"payload"},
    "logs/formats/json_lines.py": {"payload"},
}
"""A known mass that a log was recorded with, as a key of robot files and an option, and the content of a message."""


def twins(tree: ast.AST) -> set[int]:
    """Return the strings of ``twins = …``, ``comes_with = …`` and of ``Same(…)``."""
    places = [
        node
        for node in ast.walk(tree)
        if (isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) in ("twins", "comes_with"))
        or (isinstance(node, ast.Call) and ast.unparse(node.func) == "Same")
    ]
    return {id(part) for place in places for part in ast.walk(place)}


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_file_but_its_own_names_an_effect(path: Path) -> None:
    spelled = SPELLED_ALIKE.get(str(path.relative_to(PACKAGE)), set())
    tree = ast.parse(path.read_text("utf-8"))
    allowed = twins(tree) if path.parent == LIBRARY else set()
    constants = (n for n in ast.walk(tree) if isinstance(n, ast.Constant) and id(n) not in allowed)
    strings = {n.value for n in constants if isinstance(n.value, str)}
    assert not strings & NAMES - {path.stem} - (MJCF if path.parent.name == "mjcf" else set()) - spelled
    if path.parent != LIBRARY:
        modules = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        assert not [name for name in modules if f"{name}.".startswith("elid_cli.model.effects.library.")]


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_file_compares_the_names_of_effects_that_it_looked_up(path: Path) -> None:
    """What an effect is, it is asked: `nuisance_of`, not ``name == effect_that(…).name``."""
    tree = ast.parse(path.read_text("utf-8"))
    names = {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("effect_that(")
        for target in node.targets
        if isinstance(target, ast.Name)
    } | {"DELAY", "OFFSET", "READING_GAIN", "READING_OFFSET"}
    if path.parts[-3:-1] == ("logs", "repair"):
        names -= {"OFFSET"}  # of a grid
    equalities = (
        part
        for node in ast.walk(tree)
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.Eq | ast.NotEq)
        for part in (node.left, *node.comparators)
    )
    assert not [ast.unparse(part) for part in equalities if isinstance(part, ast.Name) and part.id in names]
