"""What --map gives, as one mapping: files, and single lines."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from elid_cli.checks import names
from elid_cli.errors import UsageError, did_you_mean
from elid_cli.files import read_text
from elid_cli.logs.mapping.language import SIGNALS


def read_map_options(options: Sequence[str]) -> dict[str, Any]:
    """Return one raw mapping from the values of ``--map``: YAML files, ``signal=place``, or lines as in a file.

    Raises
    ------
    UsageError
        If a file cannot be read or is not a mapping.
    """
    names("read_map_options: options", options)
    merged: dict[str, Any] = {}
    for option in options:
        signal, equals, place = option.partition("=")
        line = _line_of(option)
        found: Mapping[str, Any]
        if line is not None:
            found = line
        elif equals and (signal in SIGNALS or signal == "t" or not Path(option).exists()):
            if signal not in (*SIGNALS, "t"):
                raise UsageError(f"--map: unknown signal {signal!r}", hint=did_you_mean(signal, ("t", *SIGNALS)))
            found = {signal: {"from": place}}
        else:
            found = _read_map_file(option)
        # a key that is replaced would keep its old place
        merged = {key: entry for key, entry in merged.items() if key not in found} | dict(found)
    return merged


def _line_of(option: str) -> dict[str, Any] | None:
    """Return the mapping that a value of ``--map`` spells out, as in a file: ``tau: {from: …}``, ``tau={from: …}``.

    None where it does not; ``{joint}_torque`` is a pattern of columns.
    """
    from elid_cli.robot.yaml import parse_yaml

    spelt = re.sub(r"^(\w+)=(?=\{\s*(from|field)\s*:)", r"\1: ", option)
    named = re.match(r"(\w+):\s", spelt)
    if not re.match(r"\w+:\s*[\[{]", spelt) and not (named and named[1] in (*SIGNALS, "t")):
        return None
    try:
        raw = parse_yaml(spelt, "--map", UsageError).plain()
    except UsageError as error:
        error.hint = error.hint or "quote patterns: --map 'tau: {from: \"tau.{joint}\"}'"
        raise
    if not isinstance(raw, Mapping):
        return None
    return {signal: {"from": place} if isinstance(place, str) else place for signal, place in raw.items()}


def _read_map_file(name: str) -> dict[str, Any]:
    from elid_cli.robot.yaml import parse_yaml

    try:
        text = read_text(Path(name), UsageError, suffixes=(".yaml", ".yml"))
    except UsageError as error:
        error.hint = error.hint or "--map map.yaml, or --map tau=/arm/motors.current"
        raise
    try:
        raw = parse_yaml(text, name, UsageError).plain(placed=True)
    except UsageError as error:
        error.hint = error.hint or 'quote patterns: "q.{joint}"'
        raise
    if isinstance(raw, Mapping) and set(raw) == {"log"}:
        raw = raw["log"]
    if not isinstance(raw, Mapping):
        raise UsageError(f"{name}: holds no mapping", hint="q: {from: /arm/joint_states, field: position}")
    return dict(raw)
