"""Results as they are given to a trend: which are the same, and what they warn of."""

from __future__ import annotations

from collections.abc import Sequence

from elid_cli.errors import in_words
from elid_cli.estimation.comparison import SavedResult, same_estimates

NAMED = 4
"""Files of one warning that are named."""


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
    return [*same, *(f"{in_words(files, NAMED)}: {line}" for line, files in said.items())]


def logs_of(results: Sequence[SavedResult]) -> tuple[tuple[str, str], ...]:
    """Return name and SHA-256 of every log of some results, each once."""
    told = [pair for result in results for pair in zip(result.log_files, result.logs, strict=False)]
    return tuple(dict.fromkeys(told))
