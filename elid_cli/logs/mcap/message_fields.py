"""What a decoded message offers to a mapping: dotted paths, and which joint each number belongs to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from elid_cli.logs.mcap.cdr import NAME_FIELDS

INTERFACES = "interface_names"


@dataclass(frozen=True)
class FieldColumns:
    """The numbers of one field: `indices` among those of `path`, and their labels where the message names them."""

    path: str
    indices: tuple[int, ...]
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class MessageShape:
    """Counts of numbers by path, and strings by path with the starts of their sequences."""

    widths: Mapping[str, int]
    strings: Mapping[str, Sequence[str]]
    starts: Mapping[str, Sequence[int]]

    def fields(self) -> Iterator[tuple[str, FieldColumns]]:
        """Yield every field that a mapping may name."""
        for path, width in self.widths.items():
            if width:
                yield path, FieldColumns(path, tuple(range(width)), self._labels(path, width))
        for interface in dict.fromkeys(self._interfaces()):
            found = self._interface(interface)
            if found is not None:
                yield interface, found

    def columns(self, field: str) -> FieldColumns | None:
        """Return the numbers of one field, or None where this message has none."""
        width = self.widths.get(field, 0)
        if width:
            return FieldColumns(field, tuple(range(width)), self._labels(field, width))
        return self._interface(field.removeprefix("interface_values."))

    def _labels(self, path: str, width: int) -> tuple[str, ...]:
        """Return the names beside a sequence of numbers, where there are as many."""
        prefix = path.rpartition(".")[0]
        while True:
            for name in NAME_FIELDS:
                names = self.strings.get(f"{prefix}.{name}" if prefix else name, ())
                if len(names) == width:
                    return tuple(names)
            if not prefix:
                return ()
            prefix = prefix.rpartition(".")[0]

    def _interfaces(self) -> Sequence[str]:
        path = next((path for path in self.strings if path.rpartition(".")[2] == INTERFACES), "")
        return self.strings.get(path, ())

    def _interface(self, interface: str) -> FieldColumns | None:
        """Return one interface of every joint of a DynamicJointState, whose values are named joint by joint."""
        path = next((path for path in self.strings if path.rpartition(".")[2] == INTERFACES), None)
        joints = self.strings.get("joint_names", ())
        if path is None or len(self.starts.get(path, ())) != len(joints):
            return None
        values = f"{path.rpartition('.')[0]}.values"
        names = self.strings[path]
        if self.widths.get(values, 0) != len(names):
            return None
        bounds = [*self.starts[path], len(names)]
        found = [
            (index, joint)
            for joint, start, stop in zip(joints, bounds, bounds[1:], strict=False)
            for index in range(start, stop)
            if names[index] == interface
        ]
        if not found:
            return None
        return FieldColumns(values, tuple(index for index, _ in found), tuple(joint for _, joint in found))
