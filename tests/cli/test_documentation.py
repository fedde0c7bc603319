"""The README names every command and every option, and its commands exist."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest

from elid_cli.cli.group import elid, summaries
from elid_cli.model.effects import effect_classes

README = Path(__file__).parents[2] / "README.md"
TEXT = README.read_text("utf-8")
COMMON = {"--help", "--debug", "--quiet", "--color"}

written = pytest.mark.skipif("elid identify" not in TEXT, reason="the README does not describe the commands yet")


def command(verb: str) -> click.Command:
    found = elid.get_command(click.Context(elid), verb)
    assert found is not None
    return found


@written
@pytest.mark.parametrize("verb", list(summaries()))
def test_every_command_is_in_the_readme(verb: str) -> None:
    assert f"elid {verb}" in TEXT


@written
@pytest.mark.parametrize("verb", list(summaries()))
def test_every_option_is_in_the_readme(verb: str) -> None:
    options = [param for param in command(verb).params if isinstance(param, click.Option)]
    names = {max(param.opts, key=len) for param in options} - COMMON
    assert sorted(name for name in names if name not in TEXT) == []


@written
def test_every_effect_is_in_the_readme_in_the_words_of_elid() -> None:
    for name, effect in effect_classes().items():
        assert f"| `{name}` | {effect.summary} |" in TEXT


@written
def test_code_of_the_readme_fits_a_terminal_where_elid_wrote_it() -> None:
    for block in re.findall(r"```console\n(.*?)```", TEXT, re.DOTALL):
        answer = [line for line in block.splitlines() if not line.startswith(("$ ", "    --", "Next: "))]
        assert max(map(len, answer)) <= 80


@written
def test_the_readme_runs_from_python() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=README.parent, capture_output=True, encoding="utf-8",
        env={**os.environ, "PYTHONIOENCODING": "utf-8"}, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "stribeck joint2" in done.stdout


def commands_of(text: str) -> list[list[str]]:
    """Return every elid command line in the code blocks of a Markdown text."""
    blocks = re.findall(r"```(?:sh|bash|console|shell)\n(.*?)```", text, re.DOTALL)
    lines = [line.removeprefix("$ ").strip() for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("elid ")]


@pytest.mark.parametrize("words", commands_of(TEXT), ids=" ".join)
def test_the_options_of_every_line_exist(words: list[str]) -> None:
    _, verb, *rest = words
    if verb.startswith("-"):
        return
    known = {name for param in command(verb).params for name in (*param.opts, *param.secondary_opts)} | {"--help", "-h"}
    rest = rest[: rest.index("|")] if "|" in rest else rest
    assert [word for word in rest if word.startswith("--") and word.split("=")[0] not in known] == []


@pytest.mark.parametrize("verb", list(summaries()))
def test_examples_in_help_use_options_that_exist(verb: str) -> None:
    for example in getattr(command(verb), "examples", ()):
        if example.startswith("elid "):
            test_the_options_of_every_line_exist(shlex.split(example))
