"""The public names: listed once each in three places that agree, imported when they are asked for, typed, described."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import elid_cli

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "elid_cli" / "__init__.py"
NAMES = [name for name in elid_cli.__all__ if name != "__version__"]
FUNCTIONS = [name for name in NAMES if inspect.isfunction(inspect.unwrap(getattr(elid_cli, name)))]
CLASSES = [name for name in NAMES if inspect.isclass(getattr(elid_cli, name))]


def typed() -> dict[str, str]:
    """Return name -> module as type checkers read them."""
    tree = ast.parse(SOURCE.read_text("utf-8"))
    (branch,) = [node for node in tree.body if isinstance(node, ast.If)]
    return {
        alias.name: node.module or ""
        for node in branch.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def run(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_names_are_sorted_and_agree_with_what_type_checkers_read() -> None:
    order = sorted(elid_cli.__all__, key=lambda name: (not name[0].isupper(), name))
    assert elid_cli.__all__ == order
    assert set(typed()) == set(NAMES) == set(FUNCTIONS) | set(CLASSES)
    assert {name: f"elid_cli.{home}" for name, home in elid_cli._HOMES.items()} == typed()
    assert {name for name in dir(elid_cli) if not re.fullmatch(r"__\w+__", name)} == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_that_of_its_module_and_hides_no_folder(name: str) -> None:
    assert getattr(elid_cli, name) is getattr(importlib.import_module(typed()[name]), name)
    assert getattr(elid_cli, name).__module__ == typed()[name]
    assert not (ROOT / "elid_cli" / name).exists()
    assert not (ROOT / "elid_cli" / f"{name}.py").exists()


def test_importing_the_package_imports_nothing_else() -> None:
    loaded = run("import sys; before = set(sys.modules); import elid_cli; print(*sorted(set(sys.modules) - before))")
    assert {name.split(".")[0] for name in loaded.split()} <= {"elid_cli", *sys.stdlib_module_names}
    assert "numpy" not in run("import sys, elid_cli; elid_cli.UsageError; dir(elid_cli); print(*sys.modules)").split()


def test_a_star_import_and_an_unknown_name() -> None:
    assert run("from elid_cli import *; print(identify.__name__, ElidError.__name__)") == "identify ElidError\n"
    with pytest.raises(AttributeError, match="has no attribute 'identfy'"):
        elid_cli.identfy  # noqa: B018


def test_the_package_says_that_it_is_typed_and_runs_as_a_module() -> None:
    assert (ROOT / "elid_cli" / "py.typed").exists()
    assert run("import runpy, sys; sys.argv = ['elid', '--version']; runpy.run_module('elid_cli', run_name='x')") == ""
    done = subprocess.run([sys.executable, "-m", "elid_cli", "--version"], capture_output=True, text=True, check=True)
    assert elid_cli.__version__ in done.stdout


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_say_what_they_take_and_what_they_raise(name: str) -> None:
    function = getattr(elid_cli, name)
    text = inspect.getdoc(function) or ""
    signature = inspect.signature(function)
    if len(signature.parameters) > 1:
        listed = set(re.findall(r"^(\w+(?:, \w+)*)$", text, re.MULTILINE))
        named = {part for entry in listed for part in entry.split(", ")} | set(re.findall(r"`(\w+)`", text))
        assert set(signature.parameters) <= named
    raises = "raise " in inspect.getsource(function)
    assert "Raises\n------" in text or not raises
    assert signature.return_annotation is not inspect.Signature.empty


UNIT = re.compile(r"\bs\b|\bHz\b|rad\b|N·m|°C|\bSI\b|units\b|[Ss]hare|in standard deviations")
SHAPE = re.compile(r"\((?:[\w…]+, ?)*[\w…]*\)")


@pytest.mark.parametrize("name", CLASSES)
def test_arrays_of_public_classes_give_shape_and_unit(name: str) -> None:
    cls = getattr(elid_cli, name)
    assert inspect.getdoc(cls)
    if not dataclasses.is_dataclass(cls):
        return
    described = attribute_texts(cls)
    for field in dataclasses.fields(cls):
        kind = described.annotations.get(field.name, "")
        text = f"{described.texts.get(field.name, '')} {inspect.getdoc(cls)}"
        if "Array" in kind:
            assert SHAPE.search(text), f"{name}.{field.name}: no shape in {text!r}"
        if "Array" in kind.replace("NDArray", ""):  # masks and positions have no unit
            assert UNIT.search(text), f"{name}.{field.name}: no unit in {text!r}"


@dataclasses.dataclass
class Described:
    annotations: dict[str, str]
    texts: dict[str, str]


def attribute_texts(cls: type) -> Described:
    """Return the annotations of a class's fields and the strings that stand under them."""
    (node,) = ast.parse(inspect.cleandoc(inspect.getsource(cls))).body
    assert isinstance(node, ast.ClassDef)
    found = Described({}, {})
    for item, after in zip(node.body, [*node.body[1:], None], strict=True):
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
            found.annotations[item.target.id] = ast.unparse(item.annotation)
            if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                found.texts[item.target.id] = str(after.value.value)
    return found


@pytest.mark.parametrize("name", NAMES)
def test_methods_say_what_they_return(name: str) -> None:
    value = getattr(elid_cli, name)
    if not inspect.isclass(value):
        return
    own = {
        k: v
        for k, v in vars(value).items()
        if not k.startswith("_") and (inspect.isfunction(v) or isinstance(v, property))
    }
    assert [k for k, v in own.items() if not inspect.getdoc(v)] == []


SOURCED = {"find_base": "eq", "BaseParameters": "eq", "Regressor": "eq", "simulate": "eq", "identify": "Zollo"}
"""Names whose equations are somebody's: their docstring, class, or module says whose."""


@pytest.mark.parametrize("name", SOURCED)
def test_names_whose_equations_are_published_say_where(name: str) -> None:
    value = getattr(elid_cli, name)
    module = importlib.import_module(value.__module__)
    assert SOURCED[name] in (inspect.getdoc(value) or "") + (module.__doc__ or "")
