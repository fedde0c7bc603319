"""Broken clocks: the samples that remain hold the clean log's numbers, and what was done is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from elid_cli.errors import LogError
from elid_cli.logs.contract import Stream
from elid_cli.logs.repair.clocks import in_seconds
from elid_cli.logs.repair.timeline import sample_time
from tests.logs.faults import Table, table
from tests.logs.made_logs import SIGNALS, read, recording, same, written
from tests.logs.mcap_made import Bag, joint_state

BASE = recording()
GOOD = table(BASE)
RNG = np.random.default_rng(5)


def said(got: object, *words: str) -> None:
    text = " | ".join(got.repairs + got.notes)  # type: ignore[attr-defined]
    for word in words:
        assert word in text, text


@pytest.mark.parametrize(
    ("name", "factor"), [("ns", 1e9), ("µs", 1e6), ("ms", 1e3), ("s", 1.0)], ids=["ns", "us", "ms", "s"]
)
def test_epochs_of_any_unit_are_told_apart(tmp_path: Path, name: str, factor: float) -> None:
    broken = GOOD.with_time(lambda t: (t + 1_700_000_000) * factor)
    got = read(broken.save(tmp_path / "log.csv"))
    same(got, BASE)
    assert got.samples == BASE.samples
    if name != "s":
        said(got, f"{name} since 1970")


def test_relative_time_in_another_unit_by_mapping(tmp_path: Path) -> None:
    broken = GOOD.with_time(lambda t: t * 1e6).renamed(t="stamp_us")
    same(read(broken.save(tmp_path / "log.csv"), mapping={"t": {"from": "stamp_us", "unit": "us"}}), BASE)


def test_quantised_and_single_precision_time_is_even(tmp_path: Path) -> None:
    for change in (lambda t: np.round(t + 0.0000003, 6), lambda t: (t + 100).astype(np.float32).astype(float)):
        got = read(GOOD.with_time(change).save(tmp_path / "log.csv"))
        same(got, BASE)
        assert got.dt == 0.001
        assert got.repairs == ()


def test_unordered_samples_are_sorted(tmp_path: Path) -> None:
    index = np.arange(BASE.samples)
    swapped = index.copy()
    for k in range(100, 3900, 37):
        swapped[[k, k + 1, k + 2]] = swapped[[k + 2, k, k + 1]]
    for order in (swapped, RNG.permutation(index), np.concatenate([index[2000:], index[:2000]]), index[::-1]):
        got = read(GOOD.take(order).save(tmp_path / "log.csv"))
        same(got, BASE)
        assert got.samples == BASE.samples
        assert len(got.segments) == 1
        said(got, "sorted")


def test_repeated_rows_are_left_out(tmp_path: Path) -> None:
    index = np.sort(np.concatenate([np.arange(BASE.samples), RNG.integers(0, 4000, 300)]))
    got = read(GOOD.take(index).save(tmp_path / "log.csv"))
    same(got, BASE)
    assert got.samples == BASE.samples
    said(got, "300 samples with a repeated stamp")


def test_every_row_twice_is_one_log(tmp_path: Path) -> None:
    got = read(GOOD.take(np.repeat(np.arange(BASE.samples), 2)).save(tmp_path / "log.csv"))
    same(got, BASE)
    assert got.samples == BASE.samples


def test_a_repeated_stamp_with_other_values_costs_one_sample(tmp_path: Path) -> None:
    def repeat(t: np.ndarray) -> np.ndarray:
        t = t.copy()
        t[500::500] = t[499:-1:500]
        return t

    got = read(GOOD.with_time(repeat).save(tmp_path / "log.csv"))
    same(got, BASE, 2e-4)
    assert len(got.segments) == 1
    said(got, "repeated stamp", "with other values")


def test_a_coarse_clock_is_spread_evenly(tmp_path: Path) -> None:
    got = read(GOOD.with_time(lambda t: np.floor(t * 100 + 1e-9) / 100).save(tmp_path / "log.csv"))
    assert got.samples == BASE.samples
    assert got.dt == pytest.approx(0.001, rel=1e-4)
    assert np.array_equal(got.q, BASE.q)
    said(got, "coarse")


def test_gaps_split_and_are_never_interpolated(tmp_path: Path) -> None:
    index = np.concatenate([np.arange(1000), np.arange(1520, 2500), np.arange(2600, 4000)])
    got = read(GOOD.take(index).save(tmp_path / "log.csv"))
    same(got, BASE)
    assert [len(s) for s in got.segments] == [1000, 980, 1400]
    said(got, "2 gaps", "0.521 s after t = 0.999 s")


def test_single_lost_samples_are_bridged(tmp_path: Path) -> None:
    keep = RNG.random(BASE.samples) > 0.02
    keep[[0, -1]] = True
    got = read(GOOD.take(np.flatnonzero(keep)).save(tmp_path / "log.csv"))
    same(got, BASE, 1e-4)
    assert got.samples == BASE.samples
    said(got, "bridged by interpolation")
    lost = BASE.t[~keep] - BASE.t[0]
    assert {signal for signal, _, _ in got.bridged} >= {"q", "theta", "tau"}
    assert all(np.allclose(when, lost, atol=1e-9) for _, _, when in got.bridged)


def test_scraps_between_gaps_are_left_out(tmp_path: Path) -> None:
    index = np.concatenate([np.arange(1000), np.arange(1500, 1510), np.arange(2000, 4000)])
    got = read(GOOD.take(index).save(tmp_path / "log.csv"))
    same(got, BASE)
    assert len(got.segments) == 2
    said(got, "fewer than 20 samples")


def test_a_clock_that_jumps_back_is_split(tmp_path: Path) -> None:
    for jump in (0.5, 1.0005, 30.0):
        broken = GOOD.with_time(lambda t, jump=jump: np.where(t < 2.0, t, t - jump) + 100)
        got = read(broken.save(tmp_path / "log.csv"))
        assert [len(s) for s in got.segments] == [2000, 2000]
        order = [1, 0] if jump == 30.0 else [0, 1]  # far enough back it is a log whose halves were swapped
        halves = [BASE.tau[:2000], BASE.tau[2000:]]
        assert np.array_equal(got.tau, np.concatenate([halves[k] for k in order]))
        assert (np.diff(got.t) > 0).all()


def test_a_clock_that_jumps_forward_is_a_gap(tmp_path: Path) -> None:
    got = read(GOOD.with_time(lambda t: np.where(t < 2.0, t, t + 3600)).save(tmp_path / "log.csv"))
    assert [len(s) for s in got.segments] == [2000, 2000]
    said(got, "1 gap", "3600 s")


def test_jitter_of_the_stamps_alone_is_taken_out(tmp_path: Path) -> None:
    noise = RNG.normal(0, 1.2e-4, BASE.samples)
    got = read(GOOD.with_time(lambda t: t + noise).save(tmp_path / "log.csv"))
    assert np.array_equal(got.q, BASE.q)
    said(got, "jitter", "evenly spaced")


def test_jitter_of_the_sampling_is_interpolated(tmp_path: Path) -> None:
    t = BASE.t + np.random.default_rng(1).uniform(-3e-4, 3e-4, BASE.samples)
    rows = np.column_stack([np.interp(t, BASE.t, GOOD.rows[:, k]) for k in range(1, len(GOOD.names))])
    got = read(Table(GOOD.names, np.column_stack([t, rows])).save(tmp_path / "log.csv"))
    shift = got.t + float(t[0])
    for j in range(3):
        # the base is known at any time: its own interpolation is exact to 1e-5
        assert np.abs(got.q[5:-5, j] - np.interp(shift, BASE.t, BASE.q[:, j])[5:-5]).max() < 1e-3
    said(got, "jitter", "interpolated")


@pytest.mark.parametrize("fault", ["constant", "nan", "missing"])
def test_time_that_never_advances_is_refused(tmp_path: Path, fault: str) -> None:
    broken = {
        "constant": GOOD.with_time(np.zeros_like),
        "nan": GOOD.with_time(lambda t: t * np.nan),
        "missing": GOOD.without("t"),
    }[fault]
    with pytest.raises(LogError) as caught:
        read(broken.save(tmp_path / "log.csv"))
    assert caught.value.exit_code == 3
    assert "time" in caught.value.message
    assert caught.value.hint


def test_a_log_without_time_is_read_at_a_given_rate(tmp_path: Path) -> None:
    got = read(GOOD.without("t").save(tmp_path / "log.csv"), rate=1000.0)
    same(got, BASE)
    said(got, "1000 Hz as given")


def test_some_samples_without_a_stamp_are_left_out(tmp_path: Path) -> None:
    def lose(t: np.ndarray) -> np.ndarray:
        t = t.copy()
        t[[100, 900, 2000]] = np.nan
        return t

    got = read(GOOD.with_time(lose).save(tmp_path / "log.csv"))
    same(got, BASE, 1e-5)
    said(got, "3 samples without a time")


@pytest.mark.parametrize("samples", [1, 3, 19])
def test_too_few_samples_are_refused(tmp_path: Path, samples: int) -> None:
    with pytest.raises(LogError, match="samples") as caught:
        read(GOOD.take(np.arange(samples)).save(tmp_path / "log.csv"))
    assert caught.value.exit_code == 3


def motion(t: np.ndarray) -> dict[str, np.ndarray]:
    """The good log's signals at any time."""
    speed = 2 * np.pi * np.array([0.5, 0.9, 1.3])
    phase = t[:, None] * speed + np.array([0.1, 1.0, 2.0])
    q = np.sin(phase) * np.array([1.0, 0.7, 0.5])
    tau = 20 * np.cos(phase * 1.5) + 5 * q + 1.0
    dq = np.cos(phase) * np.array([1.0, 0.7, 0.5]) * speed
    return {"q": q, "theta": q + (tau - 2 * dq) / 4000, "tau": tau}


def two_topics(path: Path, link: np.ndarray, motor: np.ndarray, delay: int = 0) -> Path:
    """Write a log whose two topics are sampled at their own instants."""
    from tests.logs.made_logs import JOINTS

    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic)
    epoch = 10**18
    entries = []
    for t, row in zip(link.tolist(), motion(link)["q"], strict=True):
        stamp = epoch + round(t * 1e9)
        entries.append((stamp, "/joint_states", joint_state(stamp, list(JOINTS), row)))
    values = motion(motor)
    for t, theta, tau in zip(motor.tolist(), values["theta"], values["tau"], strict=True):
        stamp = epoch + round(t * 1e9)
        entries.append((stamp, "/motor_states", joint_state(stamp, list(JOINTS), theta, effort=tau)))
    for stamp, topic, message in sorted(entries, key=lambda entry: entry[0]):
        bag.add(topic, stamp + delay, message)
    path.write_bytes(bag.bytes())
    return path


@pytest.mark.parametrize(
    ("rate", "offset"), [(1000, 0.00037), (500, 0.0), (400, 0.0003), (2000, 0.0001), (1000, 0.00001)]
)
def test_topics_at_other_rates_and_instants_share_one_time_base(tmp_path: Path, rate: int, offset: float) -> None:
    link = np.arange(0, 2, 1 / rate) + offset
    motor = np.arange(0, 2, 1e-3)
    got = read(two_topics(tmp_path / "log.mcap", link, motor))
    start = max(0.0, offset) if rate <= 1000 else 0.0
    # t = 0 is the first sample kept: a sample of the faster topic
    grid = (offset + np.arange(4000) / 2000) if rate == 2000 else motor
    first = grid[grid >= start - 1e-9][0]
    wanted = motion(got.t + first)
    for signal in SIGNALS:
        assert np.abs(getattr(got, signal) - wanted[signal]).max() < 2e-6
    assert got.rate == pytest.approx(max(rate, 1000))
    assert len(got.segments) == 1
    said(got, "interpolated")


@pytest.mark.parametrize("late", [-2, 1, 3])
def test_topics_of_equal_length_that_begin_some_samples_apart_are_not_taken_as_simultaneous(
    tmp_path: Path, late: int
) -> None:
    link, motor = 0.1 + np.arange(2000) / 1000, 0.1 + (np.arange(2000) + late) / 1000
    got = read(two_topics(tmp_path / "log.mcap", link, motor))
    wanted = motion(got.t + max(link[0], motor[0]))
    assert got.samples == 2000 - abs(late)
    for signal in SIGNALS:
        assert np.abs(getattr(got, signal) - wanted[signal]).max() < 1e-9


def test_a_gap_in_one_topic_is_a_gap_of_the_log(tmp_path: Path) -> None:
    motor = np.arange(0, 2, 1e-3)
    link = np.concatenate([motor[:700], motor[1100:]])
    got = read(two_topics(tmp_path / "log.mcap", link, motor))
    assert [len(s) for s in got.segments] == [700, 900]
    wanted = motion(got.t)
    for signal in SIGNALS:
        assert np.abs(getattr(got, signal) - wanted[signal]).max() < 1e-12
    said(got, "1 gap")


def test_topics_that_lose_single_messages_are_bridged(tmp_path: Path) -> None:
    motor = np.arange(0, 2, 1e-3)
    link = np.delete(motor, [100, 400, 401, 1500])
    got = read(two_topics(tmp_path / "log.mcap", link, motor))
    assert got.samples == 2000
    wanted = motion(got.t)
    assert np.abs(got.q - wanted["q"]).max() < 1e-8


def test_header_stamps_that_run_backwards_give_way(tmp_path: Path) -> None:
    from tests.logs.made_logs import JOINTS

    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic)
    for row, t in enumerate(np.rint(BASE.t[:500] * 1e9).astype(int).tolist()):
        stamp = 10**18 - t
        bag.add("/joint_states", 10**18 + t, joint_state(stamp, list(JOINTS), BASE.q[row]))
        bag.add("/motor_states", 10**18 + t, joint_state(stamp, list(JOINTS), BASE.theta[row], effort=BASE.tau[row]))
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    got = read(path)
    same(got, BASE)
    assert got.repairs == ("header stamps run backwards: time is the log time",)


def test_header_stamps_that_only_come_out_of_order_are_sorted(tmp_path: Path) -> None:
    """Messages are stored as they arrive; the header holds when they were measured."""
    from tests.logs.made_logs import JOINTS

    messages = []
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        stamp, late = 10**18 + t, np.rint(RNG.exponential(2e6, 2)).astype(int).tolist()
        link = joint_state(stamp, list(JOINTS), BASE.q[row])
        motor = joint_state(stamp, list(JOINTS), BASE.theta[row], effort=BASE.tau[row])
        messages += [(stamp + late[0], "/joint_states", link), (stamp + late[1], "/motor_states", motor)]
    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic)
    for logged, topic, data in sorted(messages):
        bag.add(topic, logged, data)
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    got = read(path)
    same(got, BASE)
    assert got.samples == BASE.samples
    said(got, "steps backwards in time: samples sorted")


@pytest.mark.parametrize("wrong", [lambda t: t % 10_000_000, lambda t: RNG.permutation(t)], ids=["wraps", "random"])
def test_header_stamps_that_do_not_go_with_the_log_time_give_way(
    wrong: Callable[[NDArray[np.int64]], NDArray[np.int64]],
) -> None:
    moments = 1_000_000 * np.arange(4000) + 1
    repairs: list[str] = []
    clocks = {"header stamp": 10**18 + wrong(moments), "log time": 10**18 + moments}
    (t,) = in_seconds([Stream(np.ones((4000, 1)), clocks)], notes=[], repairs=repairs)
    assert np.abs(t - 1e-3 * np.arange(4000)).max() < 1e-9
    assert repairs == ["header stamps run backwards: time is the log time"]


def test_one_message_alone_without_a_stamp_is_no_clock() -> None:
    """Found by the fuzzer: all but one message of a topic were lost, and its stamp was zero."""
    alone = {"header stamp": np.array([0], dtype=np.int64), "log time": np.array([10**18], dtype=np.int64)}
    assert in_seconds([Stream(np.zeros((1, 1)), alone)], notes=[])[0].tolist() == [0.0]


@pytest.mark.parametrize("start", [20, 1000, 1_764_000_000], ids=["just on", "uptime", "epoch"])
@pytest.mark.parametrize("apart", [0, 7_000_000, 1_764_000_000 * 10**9], ids=["one clock", "late", "another clock"])
def test_a_zero_header_stamp_takes_its_place_by_the_log_time(start: int, apart: int) -> None:
    """The numbers of the other stamps stay exact, and drift between the clocks is followed."""
    stamps = start * 10**9 + 2_000_000 * np.arange(4000) + np.arange(4000) % 7
    logged = stamps + apart + 1000 * np.arange(4000)
    broken = stamps.copy()
    broken[[0, 80, 81, 2000, 3999]] = 0
    notes: list[str] = []
    (t,) = in_seconds([Stream(np.ones((4000, 1)), {"header stamp": broken, "log time": logged})], notes=notes)
    wanted = (stamps - stamps[0]) * 1e-9
    assert np.abs((t - t[1]) - (wanted - wanted[1])).max() < 3e-6
    inner = broken != 0
    assert np.abs((t - t[1] - wanted + wanted[1])[inner]).max() < 1e-12 * max(1, start * 1e-3)
    assert notes == ["5 header stamps are zero: taken by the log time"]


def test_a_zero_stamp_amid_a_clock_that_starts_at_zero_takes_its_place_too() -> None:
    stamps = 2_000_000 * np.arange(4000)
    broken = stamps.copy()
    broken[80] = 0
    (t,) = in_seconds([Stream(np.ones((4000, 1)), {"header stamp": broken, "log time": stamps + 10**18})], notes=[])
    assert np.abs(t - stamps * 1e-9).max() < 1e-9


@pytest.mark.parametrize("fault", ["never advances", "zero as well"])
def test_a_zero_header_stamp_without_a_log_time_is_no_time(fault: str) -> None:
    stamps = 1000 * 10**9 + 2_000_000 * np.arange(4000)
    broken, logged = stamps.copy(), stamps + 10**18
    broken[80] = 0
    logged[... if fault == "never advances" else 80] = 0
    notes: list[str] = []
    (t,) = in_seconds([Stream(np.ones((4000, 1)), {"header stamp": broken, "log time": logged})], notes=notes)
    assert np.flatnonzero(np.isnan(t)).tolist() == [80]
    assert not any("taken by the log time" in note for note in notes)
    assert np.nanmax(np.abs(t - 2e-3 * np.arange(4000))) < 1e-9


def test_messages_without_a_stamp_in_a_log_of_uptime_are_read(tmp_path: Path) -> None:
    from tests.logs.made_logs import JOINTS

    bag = Bag()
    for topic in ("/joint_states", "/motor_states"):
        bag.topic(topic)
    for row, t in enumerate(np.rint(BASE.t[:500] * 1e9).astype(int).tolist()):
        stamp = 1000 * 10**9 + t
        shown = 0 if row == 80 else stamp
        bag.add("/joint_states", stamp, joint_state(shown, list(JOINTS), BASE.q[row]))
        bag.add("/motor_states", stamp, joint_state(stamp, list(JOINTS), BASE.theta[row], effort=BASE.tau[row]))
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    got = read(path)
    assert got.samples == 500
    same(got, BASE)
    assert "1 header stamp is zero: taken by the log time" in got.repairs


def test_two_episodes_of_hdf5_are_segments(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        for k, (start, stop) in enumerate([(0, 1500), (2000, 4000)]):
            group = file.create_group(f"data/demo_{k}")
            group["t"] = BASE.t[start:stop]
            for signal in SIGNALS:
                group[signal] = getattr(BASE, signal)[start:stop]
    got = read(path)
    assert [len(s) for s in got.segments] == [1500, 2000]
    assert np.array_equal(got.tau, np.concatenate([BASE.tau[:1500], BASE.tau[2000:]]))
    assert written(tmp_path, "x.csv").exists()


@pytest.mark.parametrize("jitter", [0.4e-3, 0.7e-3, 1.2e-3])
def test_stamps_that_jitter_by_a_quarter_of_a_step_tell_the_rate(jitter: float) -> None:
    """Steps that are rounded one by one miscount: 200.26 Hz at 0.7 ms."""
    stamps = np.arange(4000) / 200 + jitter * np.random.default_rng(5).standard_normal(4000)
    assert sample_time(np.sort(stamps)) == pytest.approx(1 / 200, rel=1e-6)


def test_a_lost_sample_is_no_longer_step_of_all() -> None:
    stamps = np.arange(4000) / 200 + 0.2e-3 * np.random.default_rng(5).standard_normal(4000)
    for lost in (10, 2000, 3990):
        assert sample_time(np.delete(stamps, slice(lost, lost + 3))) == pytest.approx(1 / 200, rel=1e-6)
