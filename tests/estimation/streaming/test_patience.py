"""A cluster without workers is given up, and an address that is none is refused before anything is imported."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from elid_cli.errors import UsageError
from elid_cli.estimation.streaming import fleet
from tests.system.hostile.hostile import SAMPLE, elid, one_message


class Cluster:
    """A client of a scheduler whose workers die."""

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def scheduler_info(self) -> dict[str, Any]:
        found = {"workers": dict.fromkeys(range(self.workers))}
        self.workers = max(self.workers - 1, 0)
        return found


class Never:
    """A job that nobody does."""

    def result(self, timeout: float) -> bytes:
        raise TimeoutError


class Done:
    def __init__(self, answer: bytes | Exception) -> None:
        self.answer = answer

    def result(self, timeout: float) -> bytes:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.mark.parametrize("workers", [0, 3])
def test_no_worker_is_no_progress(monkeypatch: pytest.MonkeyPatch, workers: int) -> None:
    monkeypatch.setattr(fleet, "PATIENCE", 0.0)
    answers = fleet._awaited(Cluster(workers), [Done(b"1"), Done(RuntimeError()), Never()], "tcp://x:1")
    assert next(answers) == b"1"
    assert next(answers) is None
    with pytest.raises(UsageError, match=r"tcp://x:1 has had no worker for 0 s") as caught:
        next(answers)
    assert caught.value.detail == "2 of 3 logs were reduced"


@pytest.mark.parametrize("address", ["nonsense://x", "file:///etc/passwd", "inproc://x", "://"])
def test_an_address_that_is_none(address: str) -> None:
    loaded = "distributed" in sys.modules
    done = elid("reduce", SAMPLE, "--robot", "planar2", "-o", "/tmp/never.npz", "--scheduler", address)
    assert done.code == 2
    one_message(done, "no Dask scheduler", "tcp://")
    assert ("distributed" in sys.modules) == loaded
