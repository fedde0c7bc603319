"""README and documentation: every command, option and effect is in them, and what they show exists."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest

import elid_cli
from elid_cli import __version__
from elid_cli.cli.group import elid, summaries
from elid_cli.logs.mapping.language import parse_mapping
from elid_cli.logs.writing import formats
from elid_cli.model.effects import effect_classes
from elid_cli.robot.robot import Joint, Robot
from elid_cli.robot.schema import robot_of_yaml
from elid_cli.robot.yaml import parse_yaml
from elid_cli.signals.recording import GYRO
from tests.system.reproduce.readme import documents
from tests.system.reproduce.reference import REFERENCE, pages

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
WIDTH = 80
"""Columns of a terminal: what a code block may take."""
LARGEST = 12_000
"""Bytes of the README, so that it is read to its end."""
COMMON = {"--help", "--debug", "--quiet", "--color"}
SHELL = ("sh", "bash", "console", "shell")
GENERATED = {"commands.md", "effects.md", "json.md"}

TEXTS = {page.relative_to(ROOT).as_posix(): page.read_text("utf-8") for page in documents()}
BY_HAND = "\n".join(text for name, text in TEXTS.items() if Path(name).name not in GENERATED)


def command(verb: str) -> click.Command:
    found = elid.get_command(click.Context(elid), verb)
    assert found is not None
    return found


def blocks(text: str, *languages: str) -> list[str]:
    """Return the contents of a text's code blocks in some languages."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    return [code for language, code in found if not languages or language in languages]


@pytest.mark.parametrize("name", sorted(GENERATED))
def test_generated_pages_are_up_to_date(name: str) -> None:
    assert pages().keys() == GENERATED
    assert (REFERENCE / name).read_text("utf-8") == pages()[name](), "run python -m tests.system.reproduce.reference"


@pytest.mark.parametrize("verb", list(summaries()))
def test_every_command_is_in_the_reference_and_shown_at_work(verb: str) -> None:
    assert f"## elid {verb}" in TEXTS["docs/reference/commands.md"]
    assert verb == "completion" or f"elid {verb}" in BY_HAND


@pytest.mark.parametrize("verb", list(summaries()))
def test_every_option_is_in_the_reference(verb: str) -> None:
    section = TEXTS["docs/reference/commands.md"].split(f"## elid {verb}\n")[1].split("\n## elid ")[0]
    section += TEXTS["docs/reference/commands.md"].split("## Output options")[1]
    options = [param for param in command(verb).params if isinstance(param, click.Option)]
    names = {max(param.opts, key=len) for param in options} - {"--help"}
    assert sorted(name for name in names if name not in section) == []


def test_every_option_is_explained_in_a_guide() -> None:
    params = [param for verb in summaries() for param in command(verb).params if isinstance(param, click.Option)]
    names = {max(param.opts, key=len) for param in params} - COMMON
    assert sorted(name for name in names if name not in BY_HAND) == []


def test_every_effect_is_in_the_reference_in_the_words_of_elid() -> None:
    page = TEXTS["docs/reference/effects.md"]
    for name, effect in effect_classes().items():
        assert f"| [`{name}`](#{name}) | {effect.summary} |" in page
        assert f"\n## {name}\n" in page


def test_the_readme_is_short() -> None:
    assert len(README.read_bytes()) <= LARGEST


@pytest.mark.parametrize("name", TEXTS)
def test_code_fits_a_terminal(name: str) -> None:
    shown = [line for block in blocks(TEXTS[name]) for line in block.splitlines()]
    whole = ("python3 -m venv ", "Next: ")  # one command to paste; a command that elid proposes is never broken
    assert [line for line in shown if len(line) > WIDTH and not line.startswith(whole)] == []


@pytest.mark.parametrize("name", [name for name in TEXTS if blocks(TEXTS[name], "python")])
def test_python_code_runs(name: str) -> None:
    for code in blocks(TEXTS[name], "python"):
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", code], cwd=ROOT, capture_output=True, encoding="utf-8",
            env={**os.environ, "PYTHONIOENCODING": "utf-8"}, check=False,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")
        assert name != "README.md" or "stribeck joint2" in done.stdout
        if "found.drives.items()" in code:  # the truth is in the code: 0.02, 0.1, 0.05
            told = {line.split()[1]: line.split() for line in done.stdout.splitlines() if line.startswith("swing ")}
            assert {"Ja", "fs", "fv", "offset"} == told.keys()
            for parameter, truth in (("Ja", 0.02), ("fs", 0.1), ("fv", 0.05)):
                assert abs(float(told[parameter][2]) - truth) < 0.01 * truth
                assert told[parameter][4] == "supported"


def test_every_public_name_is_on_the_page_for_python() -> None:
    page = TEXTS["docs/how-to/python.md"]
    assert [name for name in elid_cli.__all__ if not re.search(rf"`{name}\b", page)] == []


def test_every_command_is_in_the_table_for_python_or_said_to_have_no_function() -> None:
    page = TEXTS["docs/how-to/python.md"]
    told = page.split(" is a function")[0] + page.split("| command | functions |")[1].split("\n\n")[0]
    assert [verb for verb in summaries() if not re.search(rf"`{verb}\b", told)] == []


def test_every_log_format_is_in_the_table_with_its_suffixes_and_what_it_lacks() -> None:
    told = TEXTS["docs/reference/formats.md"].split("| format | suffix | written by elid |\n")[1].split("\n\n")[0]
    rows = {cells[1].strip(): cells for line in told.splitlines()[1:] if (cells := line.split("|"))}
    named = {name: tuple(re.findall(r"`(\.[\w.]+)`", cells[2])) for name, cells in rows.items()}
    assert named == {fmt.name: fmt.suffixes for fmt in formats() if fmt.suffixes}
    assert {name for name, cells in rows.items() if "yes" in cells[3]} == {f.name for f in formats() if f.write}
    lacks = {name: tuple(re.findall(r"`(\w+)`", cells[3])) for name, cells in rows.items()}
    assert lacks == {fmt.name: fmt.lacks for fmt in formats() if fmt.suffixes}


def commands_of(text: str) -> list[list[str]]:
    """Return every elid command line in the code blocks of a Markdown text."""
    lines = [
        line.removeprefix("$ ").strip()
        for block in blocks(text, *SHELL, "yaml")
        for line in block.replace("\\\n", " ").splitlines()
    ]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("elid ")]


@pytest.mark.parametrize("words", [words for text in TEXTS.values() for words in commands_of(text)], ids=" ".join)
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


@pytest.mark.parametrize("name", TEXTS)
def test_links_lead_somewhere(name: str) -> None:
    targets = re.findall(r"\]\((?!https?:|#)([^)#\s]+)", TEXTS[name])
    assert [target for target in targets if not (ROOT / name).parent.joinpath(target).exists()] == []


YAML = [
    (name, block) for name, text in TEXTS.items() if Path(name).name not in GENERATED for block in blocks(text, "yaml")
]


@pytest.mark.parametrize(("name", "block"), [(n, b) for n, b in YAML if "dh:" in b], ids=lambda v: v.split("\n")[0])
def test_robot_files_that_are_shown_are_read(name: str, block: str) -> None:
    robot = robot_of_yaml(block, name)
    assert {spec.effect for spec in robot.effects} <= effect_classes().keys()


@pytest.mark.parametrize(("name", "block"), [(n, b) for n, b in YAML if "field:" in b], ids=lambda v: v.split("\n")[0])
def test_mappings_that_are_shown_are_read(name: str, block: str) -> None:
    raw = parse_yaml(block, name).plain()
    named = raw["q"]["joints"] if "q" in raw else [f"joint{k + 1}" for k, _ in enumerate(raw["gyro_x"]["from"])]
    signals, _ = parse_mapping(raw, Robot("shown", tuple(Joint(joint) for joint in named)), name)
    assert {"q", "theta", "tau"} <= signals.keys() or set(GYRO) <= signals.keys()


def test_one_version_stands_everywhere() -> None:
    assert f'\nversion = "{__version__}"\n' in (ROOT / "pyproject.toml").read_text("utf-8")
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\n## {__version__}" in (ROOT / "CHANGELOG.md").read_text("utf-8")


GUIDES = [*TEXTS, *(path.name for path in (ROOT / "ARCHITECTURE.md", ROOT / "CONTRIBUTING.md") if path.exists())]


@pytest.mark.parametrize("name", GUIDES)
def test_files_that_are_named_exist(name: str) -> None:
    text = (ROOT / name).read_text("utf-8")
    named = re.findall(r"`((?:elid_cli|tests|robots|sample_logs|docs)/[\w./]*\w)/?`", text)
    named += re.findall(r"python (tests/[\w/]+\.py)", text)
    named += [f"{module.replace('.', '/')}.py" for module in re.findall(r"python -m (tests\.[\w.]+)", text)]
    assert [path for path in named if not (ROOT / path).exists()] == []
