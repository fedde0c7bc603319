"""Clocks. The numbers are the good log's, or there are none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.logs.mcap_made import Bag, joint_state
from tests.system.hostile.bags import EPOCH
from tests.system.hostile.hostile import JOINTS, base, refused, used
from tests.system.hostile.test_csv_files import saved, table

Change = Callable[[np.ndarray], np.ndarray]
RNG = np.random.default_rng(3)


@pytest.mark.parametrize(("factor", "unit"), [(1, "s"), (1e3, "ms"), (1e6, "µs"), (1e9, "ns")])
def test_epochs_are_told_apart(tmp_path: Path, factor: float, unit: str) -> None:
    text = table().with_time(lambda t: np.round((t + 1.7e9) * factor, 3 if unit == "s" else 0)).text()
    used(saved(tmp_path, text), *([f"time is {unit} since 1970"] if unit != "s" else []), tolerance=1e-3)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_relative_time_in_another_unit_is_refused_with_the_mapping(tmp_path: Path, factor: float, unit: str) -> None:
    log = saved(tmp_path, table().with_time(lambda t: t * factor).text())
    refused(log, "per sample", "too slow", f"t: {{from: t, unit: {unit}}}")
    path = tmp_path / "map.yaml"
    path.write_text(f"t: {{from: t, unit: {unit}}}\n")
    used(log, more=("--map", path), tolerance=1e-6)
    if unit != "ms":  # a unit that was tried is not proposed again
        path.write_text("t: {from: t, unit: ms}\n")
        done = refused(log, "too slow", f"t: {{from: t, unit: {unit}}}", more=("--map", path))
        assert "unit: ms" not in done.err


CHANGES: dict[str, tuple[Change, tuple[str, ...], float]] = {
    "float32": (lambda t: t.astype(np.float32).astype(float), (), 1e-6),
    "float32 after 1000 s": (lambda t: (t + 1000).astype(np.float32).astype(float), (), 1e-3),
    "quantised to µs": (lambda t: np.round(t, 6), (), 1e-6),
    "quantised to 10 ms": (lambda t: np.round(t, 2), ("clock is coarse",), 0.01),
    "jitter": (lambda t: t + RNG.uniform(-1e-3, 1e-3, t.size), ("stamps jitter",), 0.02),
    "jump back": (lambda t: np.where(t > 6, t - 4, t), ("jumps back by 3.996 s",), 0.01),
    "jump forward": (lambda t: np.where(t > 6, t + 1000, t), ("1 gap", "1000 s"), 0.01),
    "clock set while recording": (lambda t: np.where(t > 6, t + 1.7e9, t), ("1 gap",), 0.01),
    "starts again and again": (lambda t: t % 3, ("jumps back", "3 gaps"), 0.01),
    "negative": (lambda t: t - 1e5, (), 1e-6),
    "some without a stamp": (
        lambda t: np.where(np.arange(t.size) % 50 == 20, np.nan, t), ("without a time", "bridged"), 0.01,
    ),
    "one beyond belief": (lambda t: np.where(np.arange(t.size) == 99, 1e300, t), ("1 samples without a time",), 0.01),
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGES)
def test_clocks_that_can_be_mended(tmp_path: Path, name: str) -> None:
    change, words, tolerance = CHANGES[name]
    used(saved(tmp_path, table().with_time(change).text()), *words, tolerance=tolerance)


ORDERS: dict[str, tuple[Callable[[int], np.ndarray], tuple[str, ...], float]] = {
    "repeated": (lambda n: np.sort(np.concatenate([np.arange(n), RNG.choice(n, 300)])), ("repeated stamp",), 1e-6),
    "shuffled": (lambda n: RNG.permutation(n), ("samples sorted",), 1e-6),
    "backwards": (lambda n: np.arange(n)[::-1], ("samples sorted",), 1e-6),
    "gap": (lambda n: np.r_[0:1000, 1500:n], ("1 gap, split there: 2.004 s",), 0.01),
    "every fifth lost": (lambda n: np.flatnonzero(RNG.random(n) > 0.2), ("bridged",), 0.02),
}


@pytest.mark.parametrize("name", ORDERS)
def test_orders_that_can_be_mended(tmp_path: Path, name: str) -> None:
    order, words, tolerance = ORDERS[name]
    used(saved(tmp_path, table().take(order(base().samples)).text()), *words, tolerance=tolerance)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t * 0, ("time never advances",)),
        (lambda t: t * np.nan, ("its time holds no numbers",)),
        (lambda t: np.where(t < 11, 0, t), ("time stands still", "same stamp")),
        (lambda t: (t + 1.7e9).astype(np.float32).astype(float), ("time never advances",)),
        (lambda t: np.exp(t), ("per sample",)),
        (lambda t: np.where(np.arange(t.size) % 2 == 0, t, t + 1e18), ("per sample",)),
        (lambda t: np.where(t < 6, t * 0.01, (t - 6) * 10 + 0.06), ("too few",)),
    ],
    ids=["constant", "NaN", "mostly zero", "float32 since 1970", "ever slower", "two clocks mixed", "two rates"],
)
def test_clocks_that_cannot_be_mended_are_refused_at_once(
    tmp_path: Path, change: Change, words: tuple[str, ...]
) -> None:
    refused(saved(tmp_path, table().with_time(change).text()), *words)


def topics(
    stamp: Callable[[int], int], delay: int = 0, every: int = 1, shift: float = 0.0, logged: Callable[[int], int] = int
) -> bytes:
    """Return the good log with other header stamps; motor states at another rate and other instants."""
    log = base()
    bag = Bag()
    for name in ("/joint_states", "/motor_states"):
        bag.topic(name)
    moments = np.rint(log.t * 1e9).astype(int) + EPOCH
    for row, moment in enumerate(moments.tolist()):
        bag.add("/joint_states", logged(moment) + delay, joint_state(stamp(moment), list(JOINTS), log.q[row]))
    from elid_cli.logs.repair.grid import interpolate

    at = log.t[:-1:every] + shift * log.dt
    theta, tau = (interpolate(log.t, values, at) for values in (log.theta, log.tau))
    for row, moment in enumerate((np.rint(at * 1e9).astype(int) + EPOCH).tolist()):
        message = joint_state(stamp(moment), list(JOINTS), theta[row], effort=tau[row])
        bag.add("/motor_states", logged(moment) + delay, message)
    return bag.bytes()


def kept(folder: Path, data: bytes) -> Path:
    return saved(folder, data, "log.mcap")


def test_header_stamps_or_log_times(tmp_path: Path) -> None:
    late = kept(tmp_path, topics(int, delay=5_000_000))
    assert used(late, tolerance=1e-3).err == ""
    used(late, "time is the log time, as asked", more=("--time", "log"), tolerance=1e-3)
    used(kept(tmp_path, topics(lambda moment: 0)), "header stamps are zero: time is the log time", tolerance=1e-3)
    backwards = kept(tmp_path, topics(lambda moment: 2 * EPOCH - moment))
    used(backwards, "header stamps run backwards: time is the log time", tolerance=1e-3)
    constant = kept(tmp_path, topics(lambda moment: EPOCH))
    used(constant, "header stamps never advance: time is the log time", tolerance=1e-3)
    done = refused(constant, "time never advances", "--time log", more=("--time", "header"))
    assert "--time header" not in done.err


@pytest.mark.parametrize(("every", "shift"), [(1, 0.4), (2, 0.0), (2, 0.3), (5, 0.7)])
def test_two_topics_at_different_rates_and_instants(tmp_path: Path, every: int, shift: float) -> None:
    used(kept(tmp_path, topics(int, every=every, shift=shift)), "interpolated to the sample times of", tolerance=0.02)
