"""Write the reference pages that follow from the program: commands, effects and JSON.

    python -m tests.system.reproduce.reference

``docs/reference/commands.md`` comes from the command line's own options, ``effects.md`` from the library of effects,
and ``json.md`` from the schema ``elid-1.schema.json`` beside them. A test compares the pages with what this script
returns.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from elid_cli.cli.group import elid, summaries
from elid_cli.model.effects import effect_classes, twins_of
from elid_cli.model.effects.effect import Effect, Parameter
from elid_cli.report.answers.effects import WHERE

REFERENCE = Path(__file__).parents[3] / "docs" / "reference"
SCHEMA = REFERENCE / "elid-1.schema.json"
MADE = "<!-- Made by `python -m tests.system.reproduce.reference`; do not edit. -->"
OUTPUT = "Output"
"""Heading of the options that every command has."""


def main() -> None:
    """Write the pages."""
    for name, page in pages().items():
        (REFERENCE / name).write_text(page(), "utf-8")


def pages() -> dict[str, Callable[[], str]]:
    """Return the generated pages: file name -> what makes its text."""
    return {"commands.md": commands_page, "effects.md": effects_page, "json.md": json_page}


def commands_page() -> str:
    """Return the page of commands and options."""
    verbs = {name: _command(name) for name in summaries()}
    common = _common(verbs)
    intro = """`elid COMMAND --help` prints what is on this page and opens with an example. Options may stand
        before or after the log. The environment variable `ELID_ROBOT` may stand for `--robot`. A log named
        `-` is CSV from standard input."""
    lines = [
        "# Commands and options", "", MADE, "", *_paragraph(intro), "", "| command | what it does |", "|---|---|",
        *(f"| [`elid {name}`](#elid-{name}) | {_cell(line)} |" for name, line in summaries().items()),
        "", "`elid --version` prints the version, `elid --help` the list of commands.",
    ]  # fmt: skip
    for name, command in verbs.items():
        lines += ["", *_verb(name, command, common)]
    lines += ["", "## Output options", "", "Every command but `completion` has these:", "", *_options(common)]
    return "\n".join(lines) + "\n"


def _command(name: str) -> click.Command:
    found = elid.get_command(click.Context(elid), name)
    assert found is not None
    return found


def _common(verbs: Mapping[str, click.Command]) -> dict[str, str]:
    """Return the output options that all reports share."""
    groups = [_groups(command).get(OUTPUT, {}) for name, command in verbs.items() if name != "completion"]
    return {names: text for names, text in groups[0].items() if all(group.get(names) == text for group in groups)}


def _groups(command: click.Command) -> dict[str, dict[str, str]]:
    """Return heading -> option -> help."""
    context = click.Context(command, info_name=command.name, max_content_width=10_000, terminal_width=10_000)
    groups: dict[str, dict[str, str]] = {}
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None and isinstance(parameter, click.Option) and "--help" not in parameter.opts:
            groups.setdefault(getattr(parameter, "heading", "Options"), {})[record[0]] = record[1]
    return groups


def _verb(name: str, command: click.Command, common: Mapping[str, str]) -> Iterator[str]:
    arguments = [p.metavar or "" for p in command.params if isinstance(p, click.Argument)]
    yield from (f"## elid {name}", "")
    yield from (
        " ".join((command.help or "").split()),
        "",
        "```text",
        " ".join(["elid", name, "[OPTIONS]", *arguments]),
    )
    yield from ("```", "", "Examples:", "", "```bash")
    for example in getattr(command, "examples", ()):
        yield from _folded(example)
    yield "```"
    for heading, options in _groups(command).items():
        own = {names: text for names, text in options.items() if common.get(names) != text}
        if own:
            yield from ("", f"**{heading}**", "", *_options(own))
    if name != "completion":
        yield from ("", "Also the [output options](#output-options).")


def _folded(example: str, width: int = 80) -> Iterator[str]:
    """Yield a command line, broken before options where it is too wide."""
    line = ""
    for part in re.split(r" (?=-)", example):
        if line and len(line) + 1 + len(part) + 2 > width:
            yield f"{line} \\"
            line = f"    {part}"
        else:
            line = f"{line} {part}" if line else part
    yield line


def _paragraph(text: str) -> list[str]:
    return textwrap.wrap(" ".join(text.split()), 118, break_long_words=False, break_on_hyphens=False)


def _options(options: Mapping[str, str]) -> list[str]:
    rows = [f"| `{names.replace('|', '/')}` | {_cell(text)} |" for names, text in options.items()]
    return ["| option | meaning |", "|---|---|", *rows]


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("*", "\\*")


def effects_page() -> str:
    """Return the page of effects."""
    library = effect_classes()
    intro = f"""elid knows {len(library)} effects that a model may lack. `elid effects` prints this list, `elid
        effects NAME` one effect. A robot file declares an effect under `effects:`; it is then fitted along
        with the rest. Amplitudes that the file leaves out are estimated; shapes are estimated from the
        value that it gives."""
    reading = """In the equations, q is the link's position, θ the motor's (divided by the gear ratio), and a
        prime is a derivative with respect to time. Each term is part of the torque that the model predicts,
        so that a positive coefficient is friction against the motion. *Residual* says what measured less
        predicted torque looks like where the effect is missing: in which equations, and what it follows.
        *Motor side* is the motor's own equation, with the transmission's torque from the measured deflection;
        *whole joint* is the sum of the motor's and the link's equation, which is free of the spring."""
    lines = [
        "# Effects", "", MADE, "", *_paragraph(intro), "", "| effect | what it is |", "|---|---|",
        *(f"| [`{name}`](#{name}) | {_cell(kind.summary)} |" for name, kind in library.items()),
        "", *_paragraph(reading),
    ]  # fmt: skip
    for name, kind in library.items():
        lines += ["", *_effect(name, kind)]
    return "\n".join(lines) + "\n"


def _effect(name: str, kind: type[Effect]) -> Iterator[str]:
    parameters = (*kind.amplitudes, *kind.shapes)
    yield from (f"## {name}", "", *_paragraph(f"{_sentence(kind.summary)} {_plain(kind.physics)}"), "")
    yield from ("```text", *_wrapped(kind.equation), "```", "")
    yield f"- **Acts in**: {WHERE.get(kind.place, kind.place)}"
    yield f"- **Typical**: {_plain(kind.typical)}"
    yield f"- **Residual**: {_plain(kind.fingerprint)}"
    yield f"- **Easily confused with**: {', '.join(f'[`{twin}`](#{twin})' for twin in twins_of(kind)) or 'nothing'}"
    yield f"- **To see it, record**: {_plain(kind.record)}"
    yield from ("", "| parameter | unit | kind | meaning |", "|---|---|---|---|")
    for parameter in parameters:
        kindred = "amplitude" if parameter in kind.amplitudes else "shape"
        yield f"| `{parameter.name}` | {parameter.unit} | {kindred} | {_cell(parameter.meaning)} |"
    yield from ("", *_declared(name, kind, parameters))


def _declared(name: str, kind: type[Effect], parameters: tuple[Parameter, ...]) -> Iterator[str]:
    yield from ("```yaml", "effects:", f"  - effect: {name}")
    if not kind.whole_robot:
        yield "    joint: joint1"
    yield from _wrapped(f"    parameters: {{{', '.join(f'{p.name}: …' for p in parameters)}}}", indent=6)
    yield "```"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}.".replace("*", "\\*")


def _plain(text: str) -> str:
    return " ".join(text.split()).replace("*", "\\*").replace("<", "&lt;")


def _wrapped(text: str, indent: int = 4) -> list[str]:
    return textwrap.wrap(text, 80, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)


def json_page() -> str:
    """Return the page of the JSON output, from its schema."""
    schema = json.loads(SCHEMA.read_text("utf-8"))
    definitions = dict(schema["$defs"])
    commands = {c: definitions.pop(f"command_{c}") for c in summaries() if f"command_{c}" in definitions}
    shared = schema["properties"]
    intro = """`--json` prints exactly one JSON object and nothing else on standard output. It is ASCII, in full
        precision, without NaN (`null` stands for a number that is not finite or not known), and the same
        input gives the same bytes. The [JSON Schema](elid-1.schema.json) describes it for programs; the
        tests validate outputs of every command against it. The keys below keep their meaning; further keys
        may be added."""
    words = """Reports use other words for some things: `supported` is printed as known, `weak` as known roughly,
        `refused` as not shown, and `quarters` as the four stretches of the log, of which a table shows the worst.
        `sum` is printed as whole joint, and `motor` as motor side."""
    lacking = [[f"`{c}`" for c, own in commands.items() if key not in own["properties"]] for key in ("joints", "log")]
    jointless, logless = (", ".join(names) for names in lacking)
    robots = f"""Commands that know a robot name it and its joints (`robot`, `joints`): all but {jointless}.
        Those that read logs or results of logs say which (`log`): all but {logless}."""
    lines = [
        "# JSON output", "", MADE, "", *_paragraph(intro), "", *_paragraph(words), "",
        "Every command gives these:", "", *_keys(shared, ()), "", *_paragraph(robots),
    ]  # fmt: skip
    for name, command in commands.items():
        own = {key: value for key, value in command["properties"].items() if key not in shared}
        lines += ["", f"## elid {name}", "", command["description"], "", *_keys(own, command["required"])]
    lines += ["", "## Objects"]
    for name, definition in definitions.items():
        if "properties" in definition or name == "error":
            lines += ["", f"### {name.replace('_', ' ')}", "", definition["description"]]
        if "properties" in definition:
            lines += ["", *_keys(definition["properties"], definition.get("required", ()))]
    return "\n".join(lines) + "\n"


def _keys(properties: Mapping[str, Any], required: Any) -> list[str]:
    rows = [
        f"| `{key}` | {_type(value)} | {_cell(_meaning(key, value, required))} |" for key, value in properties.items()
    ]
    return ["| key | type | meaning |", "|---|---|---|", *rows]


def _meaning(key: str, value: Mapping[str, Any], required: Any) -> str:
    text = str(value.get("description", ""))
    optional = "" if not required or key in required else "not always there"
    return "; ".join(part for part in (text, optional) if part)


def _type(value: Mapping[str, Any]) -> str:
    """Return a type in words, with a link to the object that it is."""
    if "$ref" in value:
        name = value["$ref"].rsplit("/", 1)[1]
        return "number" if name == "number" else f"[{name.replace('_', ' ')}](#{name.replace('_', '-')})"
    if "const" in value or "enum" in value:
        return ", ".join(f"`{item}`" for item in value.get("enum", [value.get("const")]))
    kind = value.get("type", "any")
    if kind == "array":
        return f"list of {_type(value['items'])}"
    if kind == "object" and isinstance(value.get("additionalProperties"), dict):
        return f"object of {_type(value['additionalProperties'])}"
    if kind == "object" and "properties" in value:
        return "object with " + ", ".join(f"`{key}`" for key in value["properties"])
    return kind if isinstance(kind, str) else " or ".join(kind)


if __name__ == "__main__":
    main()
