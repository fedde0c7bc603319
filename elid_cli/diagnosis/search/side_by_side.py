"""Independent parts of a search in processes of their own, which begin as copies of this one (fork).

What a part needs is not sent: the log, the model and its fit are there already. Where the system has no safe fork, all
parts run here. Each part's result is the same wherever it runs.
"""

from __future__ import annotations

import multiprocessing
import sys
import warnings
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import TypeVar

Result = TypeVar("Result")


def can_fork() -> bool:
    """Whether processes can begin as copies; macOS has fork, but its libraries do not survive it."""
    return "fork" in multiprocessing.get_all_start_methods() and sys.platform != "darwin"


def side_by_side(part: Callable[[int], Result], count: int, jobs: int) -> list[Result]:
    """Return the results of parts 0 to `count` - 1, in their order.

    Parameters
    ----------
    part
        Computes one part; its result must be picklable. What it changes elsewhere may be lost.
    count
        Number of parts.
    jobs
        Most processes at a time, this one included.
    """
    jobs = min(jobs, count)
    if jobs <= 1 or not can_fork():
        return [part(k) for k in range(count)]
    context = multiprocessing.get_context("fork")
    found: dict[int, Result] = {}
    helpers = []
    try:
        for first in range(1, jobs):
            receiving, sending = context.Pipe(duplex=False)
            process = context.Process(target=_share, args=(part, range(first, count, jobs), sending), daemon=True)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # other threads only draw the progress
                process.start()
            sending.close()
            helpers.append((process, receiving, range(first, count, jobs)))
        found |= {k: part(k) for k in range(0, count, jobs)}
        for _, receiving, share in helpers:
            try:
                found |= receiving.recv()
            except EOFError:  # it was ended from outside, or failed: what fails fails here too, with its message
                found |= {k: part(k) for k in share}
    finally:
        for process, receiving, _ in helpers:
            receiving.close()
            process.terminate()
            process.join()
    return [found[k] for k in range(count)]


def _share(part: Callable[[int], Result], numbers: Sequence[int], sending: Connection) -> None:
    try:
        sending.send({k: part(k) for k in numbers})
    except Exception:  # the closed pipe tells
        sending.close()
