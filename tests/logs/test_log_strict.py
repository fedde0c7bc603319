"""`--strict` refuses what is damaged, all of it in one message, and nothing that only needed another time base."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import LogError
from tests.logs.faults import Table, table
from tests.logs.made_logs import read, recording

BASE = recording()
GOOD = table(BASE)
RNG = np.random.default_rng(8)
INDEX = np.arange(BASE.samples)


def swapped(log: Table) -> Table:
    index = INDEX.copy()
    index[[100, 101]] = index[[101, 100]]
    return log.take(index)


def holed(log: Table) -> Table:
    return log.with_column("q.shoulder", lambda q: np.where(np.isin(INDEX, (500, 900)), np.nan, q))


def dropped(log: Table) -> Table:
    return log.with_column("theta.elbow", lambda q: np.where(INDEX == 700, 0.0, q + 3.0))


def bent(log: Table) -> Table:
    return log.with_column("q.shoulder", lambda q: np.where(INDEX == 600, 1e4, q))


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (swapped, "1 steps backwards in time"),
        (lambda log: log.take(np.sort(np.append(INDEX, 300))), "1 samples with a repeated stamp"),
        (holed, "q of shoulder: 2 of 4000 values are not numbers"),
        (bent, "1 broken sample left out"),
        (dropped, "off the motion left out"),
        (lambda log: log.take(np.delete(INDEX, slice(1000, 1600))), "1 gap"),
        (lambda log: log.take(np.delete(INDEX, 1000)), "missing samples"),
        (lambda log: log.with_time(lambda t: np.where(INDEX == 50, np.nan, t)), "1 samples without a time"),
        (lambda log: log.with_time(lambda t: np.where(INDEX < 2000, t, t - 1.5)), "the clock jumps back"),
    ],
)
def test_a_damaged_log_is_refused(tmp_path: Path, fault: Callable[[Table], Table], words: str) -> None:
    path = fault(GOOD).save(tmp_path / "log.csv")
    assert any(words in said for said in read(path).repairs)
    with pytest.raises(LogError) as refused:
        read(path, strict=True)
    assert words in str(refused.value)
    assert "--strict" in str(refused.value)


def test_one_message_lists_every_fault(tmp_path: Path) -> None:
    path = holed(swapped(GOOD)).save(tmp_path / "log.csv")
    with pytest.raises(LogError) as refused:
        read(path, strict=True)
    for words in ("steps backwards", "not numbers", "missing samples"):
        assert words in str(refused.value)


def other_rates(log: Table) -> Table:
    columns = [k for k, name in enumerate(log.names) if name.startswith("tau")]
    rows = log.rows.copy()
    rows[np.ix_(INDEX % 2 == 1, columns)] = np.nan
    return Table(log.names, rows)


@pytest.mark.parametrize(
    "log",
    [
        GOOD,
        other_rates(GOOD),
        GOOD.with_time(lambda t: t + RNG.uniform(-1e-4, 1e-4, t.size)),
        GOOD.with_time(lambda t: np.floor(t / 0.004 + 1e-9) * 0.004),
    ],
    ids=["whole", "rates", "jitter", "coarse clock"],
)
def test_what_only_needs_another_time_base_is_used(tmp_path: Path, log: Table) -> None:
    path = log.save(tmp_path / "log.csv")
    assert read(path, strict=True).repairs == read(path).repairs


def test_a_part_left_out_as_asked_is_no_damage(tmp_path: Path) -> None:
    path = GOOD.save(tmp_path / "log.csv")
    got = read(path, strict=True, mapping={"leave_out": [[1.0, 1.5]]})
    assert any("1 gap" in said for said in got.repairs)
