"""YAML that remembers where it stands: every value knows its file and line, so that every error can name them.

PyYAML composes the text into nodes (no object is ever constructed); `Value` reads nodes as numbers, texts, lists and
mappings and refuses what does not fit. Size, depth, number of values and aliases are limited, so a hostile file costs
nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import yaml

from elid_cli.errors import RobotError, UsageError, did_you_mean
from elid_cli.files import LARGEST
from elid_cli.robot.expressions import evaluate
from elid_cli.robot.written_keys import Key

DEEPEST = 40
"""Levels of nesting."""
MOST_ALIASES = 500
MOST_VALUES = 100_000
"""Values in a document after its aliases are followed (a billion laughs stop here)."""

_TAG = "tag:yaml.org,2002:"
_SAFE = {_TAG + kind for kind in ("str", "int", "float", "bool", "null", "map", "seq", "timestamp", "merge", "value")}
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_FLOAT = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_WORDS: dict[str, bool | None] = {"true": True, "false": False, "null": None, "~": None, "": None}
_OTHERS_WORDS = {"yes", "no", "on", "off", "y", "n", "true", "false", "null"}
"""Texts that other YAML readers take for booleans: written in quotes."""
EXAMPLES = {"dh": "dh: standard (distal frames) or dh: modified (proximal)", "gravity": "gravity: [0, 0, -9.81]"}
"""Keys whose values a reader may not know -> how they are written."""


@dataclass(frozen=True)
class Value:
    """One node of a YAML document with its place in words, such as ``joint2``."""

    node: yaml.Node
    file: str
    place: str = ""
    fault: type[UsageError] = RobotError
    """The class of the errors raised."""

    def error(self, what: str, *, hint: str = "", detail: str = "") -> UsageError:
        """Return the error ``file:line: place: what``, to be raised."""
        return self.fault(f"{self.where}: {what}", hint=hint, detail=detail)

    @property
    def where(self) -> str:
        """``file:line: place`` of the value."""
        return f"{self.file}:{self.node.start_mark.line + 1}" + (f": {self.place}" if self.place else "")

    def numbers_by_name(self) -> Iterator[tuple[str, float]]:
        """Yield the mapping's keys with their values as numbers."""
        for key, entry in self.entries():
            yield key.text(), entry.within(_join(self.place, key.text())).number()

    def within(self, place: str) -> Value:
        """Return the same value under another place."""
        return replace(self, place=place)

    def fields(self, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, Value]:
        """Return the mapping's values by key; unknown, repeated and missing keys are errors."""
        needed = tuple(required)
        known = (*needed, *optional)
        found: dict[str, Value] = {}
        for key, value in self.entries():
            if key.text() not in known:
                raise key.error(f"unknown key {key.text()!r}", hint=did_you_mean(key.text(), known))
            found[key.text()] = value.within(_join(self.place, key.text()))
        for name in needed:
            if name not in found:
                near = next((key for key in found if key.lower() == name.lower()), "")
                raise self.error(
                    f"missing key {name!r}",
                    hint=f"{near!r} is there" if near else f"add {EXAMPLES.get(name, f'{name}: …')}",
                )
        return found

    def entries(self) -> list[tuple[Value, Value]]:
        """Return (key, value) pairs of a mapping in order, ``<<`` merges resolved; a repeated key is an error."""
        if not isinstance(self.node, yaml.MappingNode):
            raise self.error(f"{_kind(self.node)} where a mapping (key: value) is needed")
        own: dict[str, tuple[Value, Value]] = {}
        merged: dict[str, tuple[Value, Value]] = {}
        for key_node, value_node in self.node.value:
            key, value = replace(self, node=key_node), replace(self, node=value_node)
            if key_node.tag == _TAG + "merge":
                for source in value.items() if isinstance(value_node, yaml.SequenceNode) else [value]:
                    for pair in source.entries():
                        merged.setdefault(pair[0].text(), pair)
                continue
            if key.text() in own:
                first = own[key.text()][0].node.start_mark.line + 1
                raise key.error(f"key {key.text()!r} a second time", detail=f"it is already in line {first}")
            own[key.text()] = (key, value)
        return [*own.values(), *(pair for name, pair in merged.items() if name not in own)]

    def key(self) -> Key:
        """Return a scalar as it is written, with its place."""
        key = Key(self.text())
        key.where = f"{self.file}:{self.node.start_mark.line + 1}"
        return key

    def items(self) -> list[Value]:
        """Return the elements of a list."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error(f"{_kind(self.node)} where a list is needed")
        return [replace(self, node=node) for node in self.node.value]

    def text(self) -> str:
        """Return a scalar as it is written, without quotes."""
        if not isinstance(self.node, yaml.ScalarNode):
            raise self.error(f"{_kind(self.node)} where a text is needed")
        return str(self.node.value)

    def name(self) -> str:
        """Return a scalar that is a name: not empty, one line, no space at its ends."""
        text = self.text()
        if not text.strip() or text != text.strip() or not text.isprintable():
            raise self.error(f"{text!r} is not a name")
        return text

    def choice(self, options: Sequence[str]) -> str:
        """Return a text that is one of the options."""
        text = self.text()
        if text not in options:
            raise self.error(f"{text!r} is not one of {', '.join(options)}", hint=did_you_mean(text, options))
        return text

    def number(self) -> float:
        """Return a finite number, written plainly or as an expression such as ``-pi/2``."""
        if not isinstance(self.node, yaml.ScalarNode):
            raise self.error(f"{_kind(self.node)} where a number is needed")
        try:
            return evaluate(self.node.value)
        except ValueError as fault:
            raise self.error(str(fault)) from None

    def numbers(self, count: int) -> tuple[float, ...]:
        """Return a list of exactly `count` finite numbers."""
        items = self.items()
        if len(items) != count:
            raise self.error(f"{len(items)} numbers where {count} are needed")
        return tuple(item.number() for item in items)

    def plain(self, *, placed: bool = False) -> Any:
        """Return the value as plain dicts, lists, numbers, texts, booleans and None, uninterpreted.

        `placed`: keys of mappings know where they are written (`written_at`).
        """
        if isinstance(self.node, yaml.MappingNode):
            return {key.key() if placed else key.text(): value.plain(placed=placed) for key, value in self.entries()}
        if isinstance(self.node, yaml.SequenceNode):
            return [item.plain(placed=placed) for item in self.items()]
        quotes = getattr(self.node, "style", None)
        return self.text() if quotes else scalar(self.text())


def scalar(text: str) -> Any:
    """Return what an unquoted YAML scalar stands for: a number, true, false, null, or the text itself.

    Stricter than YAML 1.1 on purpose: ``on``, ``no`` and ``12:30`` stay texts, ``1e6`` is a number.
    """
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return int(text) if len(text) < 19 else float(text)
    return float(text) if _FLOAT.fullmatch(text) else text


def parse_yaml(text: str, file: str, fault: type[UsageError] = RobotError) -> Value:
    """Compose a YAML document into a `Value`.

    Parameters
    ----------
    text
        The document.
    file
        Its name for error messages.
    fault
        The class of the errors raised, here and by the value returned.

    Raises
    ------
    UsageError
        Of class `fault`: not YAML, empty, too large, too deep, cyclic, more than one document, unsafe tags.
    """
    if len(text) > LARGEST:
        raise fault(f"{file}: {len(text)} characters; a description of at most {LARGEST} is read")
    loader = None
    try:
        loader = _Composer(text)
        node = loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{file}:{mark.line + 1}" if mark else file
        raise fault(f"{where}: {error.problem or 'not YAML'}", detail=str(error.context or "")) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # the latter from escapes such as "\\UFFFFFFFF"
        raise fault(f"{file}: not a YAML text ({str(error).splitlines()[0]})") from None
    finally:
        if loader is not None:
            loader.dispose()
    if node is None:
        raise fault(f"{file}: empty")
    value = Value(node, file, fault=fault)
    _check(value, 0, [0])
    return value


class _Composer(yaml.SafeLoader):
    """Composes nodes while counting depth and aliases, so that hostile nesting ends early."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.depth = 0
        self.aliases = 0
        self.open: list[str] = []

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        anchor = getattr(event, "anchor", None)
        if isinstance(event, yaml.AliasEvent):
            self.aliases += 1
            if anchor in self.open:
                raise _marked(f"alias *{anchor} contains itself", event)
            if self.aliases > MOST_ALIASES:
                raise _marked(f"more than {MOST_ALIASES} aliases", event)
            return super().compose_node(parent, index)
        if self.depth >= DEEPEST:
            raise _marked(f"nested deeper than {DEEPEST} levels", event)
        self.depth += 1
        self.open.append(anchor or "")
        try:
            return super().compose_node(parent, index)
        finally:
            self.depth -= 1
            self.open.pop()


def _marked(problem: str, event: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)


def _check(value: Value, depth: int, seen: list[int]) -> None:
    """Refuse unsafe tags and documents that grow too large or too deep once their aliases are followed."""
    node = value.node
    seen[0] += 1
    if seen[0] > MOST_VALUES:
        raise value.error(f"more than {MOST_VALUES} values (through aliases)")
    if depth > DEEPEST:
        raise value.error(f"nested deeper than {DEEPEST} levels")
    if node.tag not in _SAFE:
        raise value.error(f"tag {node.tag!r} is not read", hint="write plain numbers, texts, lists and mappings")
    if isinstance(node, yaml.SequenceNode):
        for child in node.value:
            _check(replace(value, node=child), depth + 1, seen)
    elif isinstance(node, yaml.MappingNode):
        for pair in node.value:
            for child in pair:
                _check(replace(value, node=child), depth + 1, seen)


def _kind(node: yaml.Node) -> str:
    if isinstance(node, yaml.MappingNode):
        return "a mapping"
    if isinstance(node, yaml.SequenceNode):
        return "a list"
    return f"{node.value!r}" if node.value else "nothing"


def _join(place: str, key: str) -> str:
    return f"{place}: {key}" if place else key


def emit(data: Any, indent: int = 0) -> list[str]:
    """Return plain data (as `Value.plain` gives) as lines of block YAML that read back to the same data."""
    pad = "  " * indent
    lines: list[str] = []
    if isinstance(data, Mapping) and data:
        for key, value in data.items():
            if isinstance(value, Mapping | list | tuple) and value and not _short(value):
                lines += [f"{pad}{quoted(str(key))}:", *emit(value, indent + 1)]
            else:
                lines.append(f"{pad}{quoted(str(key))}: {inline(value)}")
        return lines
    if isinstance(data, list | tuple) and data:
        return [f"{pad}- {inline(value)}" for value in data]
    return [pad + inline(data)]


def inline(data: Any) -> str:
    """Return plain data as one line of flow YAML."""
    if isinstance(data, Mapping):
        return "{" + ", ".join(f"{quoted(str(key))}: {inline(value)}" for key, value in data.items()) + "}"
    if isinstance(data, list | tuple):
        return "[" + ", ".join(inline(value) for value in data) + "]"
    if data is None:
        return "null"
    if isinstance(data, bool):
        return "true" if data else "false"
    return quoted(data) if isinstance(data, str) else repr(data)


def quoted(text: str) -> str:
    """Return a text as a YAML scalar: bare where that reads back as the same text, double-quoted otherwise."""
    bare = re.fullmatch(r"[A-Za-z_/][A-Za-z0-9_./ -]*(?<! )", text) is not None
    if bare and scalar(text) == text and text.lower() not in _OTHERS_WORDS:
        return text
    return '"' + "".join(_escaped(letter) for letter in text) + '"'


def _escaped(letter: str) -> str:
    if letter in '"\\':
        return "\\" + letter
    return letter if letter.isprintable() else f"\\U{ord(letter):08x}"


def _short(data: Any) -> bool:
    return len(inline(data)) <= 90
