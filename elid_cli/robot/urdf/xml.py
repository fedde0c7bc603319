"""XML that remembers its lines and refuses what could cost or leak: no DOCTYPE, no entities, limited depth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

import numpy as np

from elid_cli.errors import RobotError
from elid_cli.robot.expressions import LARGEST

DEEPEST = 250
MOST_ELEMENTS = 200_000


@dataclass
class Element:
    """One element: tag, attributes, children, the text directly inside it, and its place."""

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""
    start: int = 0
    """Its first byte in the text, as UTF-8."""
    stop: int = 0
    """The byte after its last."""
    faults: list[str] = field(default_factory=list)
    """Small faults of the whole document, which its elements share."""
    owner: str = ""
    """The nearest named element around this one, as errors call it: ``joint 'elbow'``."""

    @property
    def label(self) -> str:
        """How errors call this element."""
        if "name" in self.attributes:
            return f"{self.tag} {self.attributes['name']!r}"
        return f"{self.tag} of {self.owner}" if self.owner else self.tag

    @property
    def place(self) -> tuple[str, int]:
        """The file, and its first byte there: where it is among all that a model includes."""
        return self.file, self.start

    def error(self, what: str, *, hint: str = "") -> RobotError:
        """Return the error ``file:line: <tag name>: what``, to be raised."""
        return RobotError(f"{self.file}:{self.line}: {self.label}: {what}", hint=hint)

    def all(self, tag: str) -> Iterator[Element]:
        """Yield the children of a tag."""
        return (child for child in self.children if child.tag == tag)

    def one(self, tag: str) -> Element | None:
        """Return the first child of a tag, None where there is none; of a second one `faults` tells."""
        found = list(self.all(tag))
        for other in found[1:]:
            self.fault(f"a second <{tag}> in line {other.line} is not read")
        return found[0] if found else None

    def fault(self, what: str) -> None:
        """Note a small fault that leaves the meaning plain."""
        text = f"{self.file}:{self.line}: {self.label}: {what}"
        if text not in self.faults:
            self.faults.append(text)

    def need(self, key: str) -> str:
        """Return an attribute that must be there."""
        if not self.attributes.get(key):
            raise self.error(f"missing attribute {key!r}")
        return self.attributes[key]

    def number(self, key: str, default: float) -> float:
        """Return a finite number from an attribute."""
        if key not in self.attributes:
            return default
        return self.numbers(key, (default,))[0]

    def numbers(self, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return as many finite numbers, separated by spaces, as `default` has."""
        if key not in self.attributes:
            return default
        return self.parsed(self.attributes[key], len(default), key)

    def parsed(self, text: str, count: int, what: str) -> tuple[float, ...]:
        """Return `count` finite numbers from a text of this element."""
        try:
            values = tuple(float(part) for part in text.split())
        except ValueError:
            raise self.error(f"{what}={text!r} is not made of numbers") from None
        if len(values) != count:
            raise self.error(f"{what}={text!r}: {len(values)} numbers where {count} are needed")
        if not all(math.isfinite(value) for value in values):
            raise self.error(f"{what}={text!r} is not finite")
        if self.tag != "limit" and any(abs(value) > LARGEST for value in values):  # which 1e38 means there is none
            raise self.error(f"{what}={text!r} is no quantity of a robot: more than {LARGEST:g}")
        return values


def unit_axis(joint: Element, direction: tuple[float, ...]) -> tuple[float, float, float]:
    """Return a joint's unit axis, as it is written where its length is 1; one of no length is refused (RobotError)."""
    axis = np.array(direction)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise joint.error("axis 0 0 0")
    x, y, z = (axis if abs(length - 1) < 1e-14 else axis / length).tolist()
    return x, y, z


def parse_xml(text: str, file: str) -> Element:
    """Return the root element of an XML text.

    Raises
    ------
    RobotError
        Not XML, a DOCTYPE or entity declaration, too deep, too many elements: with file and line.
    """
    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    open_elements: list[Element] = []
    roots: list[Element] = []
    count = [0]
    faults: list[str] = []
    data = text.encode("utf-8", "surrogatepass")

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, file, parser.CurrentLineNumber, start=parser.CurrentByteIndex, faults=faults)
        if open_elements:
            around = open_elements[-1]
            element.owner = around.label if "name" in around.attributes else around.owner
        count[0] += 1
        if len(open_elements) >= DEEPEST or count[0] > MOST_ELEMENTS:
            raise element.error(f"more than {DEEPEST} levels or {MOST_ELEMENTS} elements")
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        place = parser.CurrentByteIndex  # of the end tag; behind an element that has none
        element = open_elements.pop()
        # the tag that follows an element without end tag may be the end of the one around it
        closed = data[place - 2 : place] == b"/>" and not element.children and not element.text
        element.stop = place if closed else data.index(b">", place) + 1

    def characters(piece: str) -> None:
        open_elements[-1].text += piece

    def doctype(*_: object) -> None:
        raise RobotError(f"{file}:{parser.CurrentLineNumber}: DOCTYPE is not read", hint="remove the DOCTYPE line")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = characters
    parser.StartDoctypeDeclHandler = doctype
    try:
        # bytes, and the encoding forced: a declared encoding such as UTF-16 is not what the text was read as
        parser.Parse(data, True)
    except expat.ExpatError as fault:
        reason = expat.ErrorString(fault.code)
        raise RobotError(f"{file}:{fault.lineno}: not well-formed XML ({reason})") from None
    return roots[0]
