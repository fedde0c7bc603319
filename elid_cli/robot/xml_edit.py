"""Changes of an XML text that leave everything else as it stands: names, comments, spaces, order of attributes."""

from __future__ import annotations

import re
from collections.abc import Mapping

from elid_cli.robot.urdf.xml import Element, parse_xml
from elid_cli.robot.xml_text import escaped, quoted


class XmlEdit:
    """A document and the changes to be made; elements are those of `root`."""

    def __init__(self, text: str, file: str) -> None:
        self.root = parse_xml(text, file)
        self._data = text.encode("utf-8", "surrogatepass")
        self._changes: list[tuple[int, int, str]] = []
        self._attributes: dict[int, tuple[Element, dict[str, str]]] = {}

    def set_attributes(self, element: Element, values: Mapping[str, str]) -> None:
        """Give attributes of an element new values; those it does not have are added at its end."""
        self._attributes.setdefault(element.start, (element, {}))[1].update(values)

    def replace(self, element: Element, text: str) -> None:
        """Put a text in place of an element."""
        self._changes.append((element.start, element.stop, text))

    def add_first(self, element: Element, text: str) -> None:
        """Put a text inside an element, before its other children, on a line of its own."""
        end = self._tag_end(element)
        line = f"\n{self._indent(element)}  {text}"
        if self._data[end - 2 : end] == b"/>":
            self._changes.append((end - 2, end, f">{line}\n{self._indent(element)}</{element.tag}>"))
        else:
            self._changes.append((end, end, line))

    def comment(self, lines: str) -> None:
        """Put a comment first inside the root."""
        self.add_first(self.root, f"<!-- {escaped(lines).replace('--', '- -')} -->")

    def text(self) -> str:
        """Return the changed document."""
        changes = list(self._changes)
        for element, values in self._attributes.values():
            changes += self._of_attributes(element, values)
        data = self._data
        # from the end, so that earlier places stay; of several at one place, what replaces, then the last insertion
        for start, stop, new in sorted(reversed(changes), key=lambda change: (-change[0], change[0] == change[1])):
            data = data[:start] + new.encode() + data[stop:]
        return data.decode("utf-8", "surrogatepass")

    def _of_attributes(self, element: Element, values: Mapping[str, str]) -> list[tuple[int, int, str]]:
        end = self._tag_end(element)
        tag = self._data[element.start : end]
        changes, added = [], ""
        for name, value in values.items():
            found = re.search(rb"\s" + re.escape(name.encode()) + rb"\s*=\s*(\"[^\"]*\"|'[^']*')", tag)
            if found:
                changes.append((element.start + found.start(1), element.start + found.end(1), quoted(value)))
            else:
                added += f" {name}={quoted(value)}"
        if added:
            place = end - 2 if tag.endswith(b"/>") else end - 1
            while self._data[place - 1 : place].isspace():
                place -= 1
            changes.append((place, place, added))
        return changes

    def _tag_end(self, element: Element) -> int:
        """Return where an element's start tag ends, quoted ``>`` passed over."""
        found = re.compile(rb"<(?:[^>\"']|\"[^\"]*\"|'[^']*')*>").match(self._data, element.start)
        assert found is not None
        return found.end()

    def _indent(self, element: Element) -> str:
        line = self._data[: element.start].rpartition(b"\n")[2]
        return line.decode("utf-8", "replace") if line.isspace() else ""
