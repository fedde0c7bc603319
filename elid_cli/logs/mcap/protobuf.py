"""Protobuf messages to values by path, driven by the FileDescriptorSet that an MCAP schema carries."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from elid_cli.logs.mcap.flat_decode import DEEPEST, Flat

FIXED64, FIXED32 = {1: "<d", 6: "<Q", 16: "<q"}, {2: "<f", 7: "<I", 15: "<i"}
"""Field types of descriptor.proto with eight and four bytes -> their struct format."""
VARINTS, ZIGZAG = (3, 4, 5, 8, 13, 14), (17, 18)
STRING, MESSAGE = 9, 11
REPEATED = 3

Value = int | bytes


@dataclass(frozen=True)
class ProtoField:
    """One field of a message type."""

    name: str
    type: int
    repeated: bool
    message: str = ""
    """Full name of its type, where it is a message."""


Types = dict[str, dict[int, ProtoField]]
"""Full message name -> fields by number."""


def flattener(schema: str, descriptors: bytes) -> Callable[[bytes], Flat | None] | None:
    """Return the function that flattens messages of a type, or None where its descriptor is missing or damaged."""
    try:
        types = message_types(descriptors)
    except (ValueError, struct.error):
        return None
    if schema not in types:
        return None

    def flatten(data: bytes) -> Flat | None:
        flat: Flat = {}
        try:
            _message(data, schema, types, "", flat, 0)
        except (ValueError, struct.error):
            return None
        return flat

    return flatten


def message_types(descriptors: bytes) -> Types:
    """Return all message types of a FileDescriptorSet (ValueError where it is damaged)."""
    types: Types = {}
    for number, file in wire(descriptors):
        if number == 1 and isinstance(file, bytes):
            parts = list(wire(file))
            package = next((part.decode() for k, part in parts if k == 2 and isinstance(part, bytes)), "")
            for k, part in parts:
                if k == 4 and isinstance(part, bytes):
                    _declare(part, package, types, 0)
    return types


def _declare(descriptor: bytes, scope: str, types: Types, depth: int) -> None:
    parts = list(wire(descriptor))
    name = next((part.decode() for k, part in parts if k == 1 and isinstance(part, bytes)), "")
    full = f"{scope}.{name}" if scope else name
    fields = types.setdefault(full, {})
    for k, part in parts:
        if not isinstance(part, bytes):
            continue
        if k == 2:
            entry = dict(wire(part))
            number, label, kind = (entry.get(key, 0) for key in (3, 4, 5))
            text, message = entry.get(1, b""), entry.get(6, b"")
            if isinstance(number, int) and isinstance(kind, int) and isinstance(text, bytes):
                of = message.decode().lstrip(".") if isinstance(message, bytes) else ""
                fields[number] = ProtoField(text.decode(), kind, label == REPEATED, of)
        elif k == 3 and depth < DEEPEST:
            _declare(part, full, types, depth + 1)


def wire(data: bytes) -> Iterator[tuple[int, Value]]:
    """Yield (field number, value) of a message: integers for varints, bytes for everything else."""
    position = 0
    while position < len(data):
        key, position = _varint(data, position)
        number, kind = key >> 3, key & 7
        if kind == 0:
            value, position = _varint(data, position)
            yield number, value
            continue
        if kind == 2:
            length, position = _varint(data, position)
        elif kind in (1, 5):
            length = 8 if kind == 1 else 4
        else:
            raise ValueError(f"wire type {kind}")
        if length > len(data) - position:
            raise ValueError("message ends before its field does")
        yield number, data[position : position + length]
        position += length


def _varint(data: bytes, position: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        if position >= len(data) or shift > 63:
            raise ValueError("damaged varint")
        byte = data[position]
        position += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value, position


def _message(data: bytes, name: str, types: Types, prefix: str, flat: Flat, depth: int) -> None:
    fields = types.get(name, {})
    seen: set[str] = set()
    for number, value in wire(data):
        field = fields.get(number)
        if field is None or depth > DEEPEST:
            continue
        path = f"{prefix}{field.name}"
        if field.type == MESSAGE and isinstance(value, bytes):
            _message(value, field.message, types, f"{path}.", flat, depth + 1)
        elif field.type == STRING and isinstance(value, bytes):
            if path not in seen:
                flat.setdefault(f"{path}\x00", []).append(len(flat.get(path, [])))
            flat.setdefault(path, []).append(value.decode("utf-8", "replace"))
        else:
            flat.setdefault(path, []).extend(_numbers(field.type, value))
        seen.add(path)
    for field in fields.values():  # proto3 leaves out zeros
        path = f"{prefix}{field.name}"
        if path not in seen and not field.repeated and field.type not in (STRING, MESSAGE, 12):
            flat.setdefault(path, []).append(0.0)


def _numbers(kind: int, value: Value) -> list[float]:
    """Return the numbers of a field: one, or a packed run of them."""
    if isinstance(value, bytes):
        form = FIXED64.get(kind) or FIXED32.get(kind)
        if form is not None:
            count, rest = divmod(len(value), struct.calcsize(form))
            if rest:
                raise ValueError("packed field of broken length")
            return [float(number) for number in struct.unpack(f"<{count}{form[1]}", value)]
        if kind not in VARINTS + ZIGZAG:
            return []
        numbers: list[float] = []
        position = 0
        while position < len(value):
            number, position = _varint(value, position)
            numbers.append(_integer(kind, number))
        return numbers
    return [_integer(kind, value)]


def _integer(kind: int, value: int) -> float:
    if kind in ZIGZAG:
        return float((value >> 1) ^ -(value & 1))
    if kind in (3, 5) and value >= 1 << 63:
        return float(value - (1 << 64))
    return float(value)
