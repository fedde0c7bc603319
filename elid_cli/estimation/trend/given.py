"""Results as they are given to a trend: which are the same, and what they warn of."""

from __future__ import annotations

import re
from collections.abc import Sequence

from elid_cli.errors import in_words
from elid_cli.estimation.comparison import SavedResult, same_estimates

NAMED = 4
"""Files of one warning that are named."""
NUMBER = re.compile(r"(?<![\w.:-])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w:]|\.\d)")
"""A number in a sentence; none that is part of a name, such as ``joint 2:``."""


def distinct(results: Sequence[SavedResult]) -> tuple[list[int], list[str]]:
    """Return the numbers of the results that are no repetition of an earlier one, and a sentence on each repetition.

    The same estimates with the same errors to the last digit are the same result, whatever its file is called.
    """
    kept: list[int] = []
    again: dict[int, list[str]] = {}
    for k, result in enumerate(results):
        first = next((j for j in kept if same_estimates(results[j], result)), None)
        if first is None:
            kept.append(k)
        else:
            again.setdefault(first, []).append(result.file)
    said = []
    for first, files in again.items():
        file = results[first].file
        others = list(dict.fromkeys(name for name in files if name != file))
        times = 1 + files.count(file)
        what = [f"given {times} times"] if times > 1 else []
        what += [f"the same result as {in_words(others, NAMED)}"] if others else []
        said.append(f"{file} is {' and '.join(what)}: counted once")
    return kept, said


def warnings_of(results: Sequence[SavedResult]) -> list[str]:
    """Return what results warn of, each with its files, and which of them are of the same log."""
    logs: dict[tuple[str, ...], list[str]] = {}
    said: dict[str, list[str]] = {}
    for result in results:
        if result.logs:
            logs.setdefault(result.logs, []).append(result.file)
        for line in dict.fromkeys(result.warnings):
            said.setdefault(line, []).append(result.file)
    same = [f"{in_words(files, NAMED)} are of the same log, but count as different recordings"
            for files in logs.values() if len(files) > 1]  # fmt: skip
    return [*same, *(f"{in_words(files, NAMED)}: {line}" for line, files in _together(results, said))]


def logs_of(results: Sequence[SavedResult]) -> tuple[tuple[str, str], ...]:
    """Return name and SHA-256 of every log of some results, each once."""
    told = [pair for result in results for pair in zip(result.log_files, result.logs, strict=False)]
    return tuple(dict.fromkeys(told))


def _together(results: Sequence[SavedResult], said: dict[str, list[str]]) -> list[tuple[str, list[str]]]:
    """Return sentences with their files, those as one that differ in one number alone: with its range."""
    alike: dict[str, list[str]] = {}
    for line in said:
        alike.setdefault(NUMBER.sub("#", line), []).append(line)
    found = []
    for lines in alike.values():
        places = [list(NUMBER.finditer(line)) for line in lines]
        differing = [k for k, here in enumerate(zip(*places, strict=False)) if len({one.group() for one in here}) > 1]
        if len(differing) != 1:
            found += [(line, said[line]) for line in lines]
            continue
        numbers = sorted((here[differing[0]].group() for here in places), key=float)
        at, first = places[0][differing[0]], lines[0]
        line = f"{first[: at.start()]}{numbers[0]} to {numbers[-1]}{first[at.end() :]}"
        held = {file for line in lines for file in said[line]}
        found.append((line, [result.file for result in results if result.file in held]))
    return found
