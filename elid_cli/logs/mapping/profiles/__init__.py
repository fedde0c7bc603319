"""Messages of known makers: which of their fields are which signals. One file per family, found by listing this folder.

A file defines ``SCHEMAS``, names as ``package/Name``, and ``mapping(schema, topic, robot)``, which returns a mapping in
the language of ``--map``, or several where a message may hold a signal in several places, the better one first.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from elid_cli.logs.contract import Channel
from elid_cli.robot.robot import Robot


@cache
def profiles() -> dict[str, Any]:
    """Return the module of every known schema."""
    modules = [importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__)]
    return {schema: module for module in modules for schema in module.SCHEMAS}


def known_messages(channels: Sequence[Channel], robot: Robot) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield (words that name it, mapping) of every topic whose message is known, in the order of the log."""
    topics = {channel.source: channel.kind for channel in reversed(channels) if channel.kind}
    for topic, kind in reversed(topics.items()):
        schema = kind.replace("/msg/", "/")
        if schema in profiles():
            found = profiles()[schema].mapping(schema, topic, robot)
            for mapping in found if isinstance(found, list) else [found]:
                yield f"{schema} on {topic}", mapping


def fields(topic: str, **places: str) -> dict[str, dict[str, str]]:
    """Return the mapping of signals to fields of one topic."""
    return {signal: {"from": topic, "field": field} for signal, field in places.items()}
