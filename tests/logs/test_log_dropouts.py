"""Samples that the motion cannot reach: found where they are, and nowhere in logs without them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import LogError
from elid_cli.logs.repair.align import align
from elid_cli.logs.repair.dropouts import impossible
from elid_cli.logs.repair.reachable import Sampled
from tests.logs.faults import table
from tests.logs.made_logs import read, recording

ROOT = Path(__file__).parents[2]
MEASURED = ROOT.parent / "shared" / "data"
LOGS = sorted((ROOT / "sample_logs").glob("*.*")) + sorted(MEASURED.glob("*.*"))


def motion(samples: int = 4000, dt: float = 1e-3, *, noise: float = 1e-5) -> np.ndarray:
    t = dt * np.arange(samples)
    wave = np.column_stack([np.sin(2 * t) + 0.3 * np.sin(11 * t), 1.5 + 0.7 * np.cos(3 * t)])
    return wave + noise * np.random.default_rng(1).standard_normal(wave.shape)


@pytest.mark.parametrize("every", [50, 1000])
@pytest.mark.parametrize("length", [1, 3])
@pytest.mark.parametrize("value", [0.0, 0.9, None])
def test_short_dropouts_within_the_range_are_found(every: int, length: int, value: float | None) -> None:
    values = motion()
    rows = np.flatnonzero(np.arange(3988) % every < length) + 5
    values[rows, 1] = values[rows, 1] * -1 if value is None else value
    found = impossible(values, 1e-3)
    assert set(found) == {1}
    far = rows[np.abs(values[rows, 1] - motion()[rows, 1]) > 0.02]
    assert set(far) <= set(found[1].rows) <= set(rows)
    assert not found[1].jumps


@pytest.mark.parametrize("length", [2, 4, 6, 30, 90])
@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-4])
def test_readings_that_lie_about_are_found(length: int, noise: float) -> None:
    rng, sound = np.random.default_rng(length), motion(noise=noise)
    for start in rng.integers(100, 3800, 20):
        values, run = sound.copy(), np.arange(start, start + length)
        values[run, 1] = rng.uniform(0.8, 2.2, length)
        found = impossible(values, 1e-3)
        far = run[np.abs(values[run, 1] - sound[run, 1]) > 0.05]
        assert set(found) == {1}
        assert set(far) <= set(found[1].rows) <= set(range(start - 2, start + length + 2))
        assert not found[1].jumps


@pytest.mark.parametrize("path", [p for p in LOGS if p.suffix in (".h5", ".mcap", ".csv", ".gz")], ids=lambda p: p.name)
def test_nothing_is_found_in_logs_without_dropouts(path: Path) -> None:
    from elid_cli.logs.contract import Pick
    from elid_cli.logs.source import open_source
    from elid_cli.logs.writing import recognise

    source = open_source(path)
    (raw,) = recognise(source).open(source)
    channels = [c for c in raw.channels if c.width and not c.field.endswith("sec")]
    picks = [Pick(c.source, c.field, c.labels or tuple(range(c.width))) for c in channels]
    for channel, stream in zip(channels, raw.load(picks), strict=True):
        jumpy = any(word in channel.address for word in ("tau", "effort", "_des", "ref"))
        assert not impossible(np.ascontiguousarray(stream.values), 1e-3, jumpy=jumpy), channel.address


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_zeros_everywhere_are_found(share: float) -> None:
    values = motion()
    rows = np.flatnonzero(np.random.default_rng(3).random(4000) < share)
    values[rows, 1] = 0.0
    assert len(impossible(values, 1e-3)[1].rows) > 0.9 * len(rows)


def test_rows_that_come_twice_or_late_are_no_dropouts() -> None:
    values = motion(noise=0.0)
    for row in range(100, 3900, 97):
        values[row] = values[row - 1]
    assert not impossible(values, 1e-3)


@pytest.mark.parametrize("kind", ["backlash", "impact", "quantised", "noise", "held"])
def test_what_joints_do_is_possible(kind: str) -> None:
    rng = np.random.default_rng(2)
    values = motion()
    if kind == "backlash":
        values += 0.01 * np.sign(np.gradient(values, axis=0))
    elif kind == "impact":
        values = np.abs(values - 0.4)
    elif kind == "quantised":
        values = np.round(values * 500) / 500
    elif kind == "noise":
        values += 0.01 * rng.standard_t(4, values.shape)
    else:
        values = values[np.arange(len(values)) // 4 * 4]
    found = impossible(values, 1e-3)
    assert sum(len(what.rows) for what in found.values()) <= (2 if kind == "noise" else 0)
    assert not any(what.jumps for what in found.values())


def test_a_torque_may_jump_but_not_drop_out() -> None:
    tau = 30 * motion(noise=1e-3) + np.where(motion() > 0.5, 40.0, -40.0)
    tau[::333] += 15.0
    assert not impossible(tau, 1e-3, jumpy=True)
    tau[500::400] = 0.0
    assert np.array_equal(impossible(tau, 1e-3, jumpy=True)[0].rows, np.arange(500, 4000, 400))


def test_a_position_that_jumps_and_stays() -> None:
    t = 1e-3 * np.arange(4000)
    q, tau = motion(), np.sin(np.column_stack([t, t]))
    jumped = q.copy()
    jumped[2000:, 0] += 0.4
    streams = {"q": q, "theta": jumped, "tau": tau}
    with pytest.raises(LogError, match=r"theta of a jumps by 0\.4 at t = 2 s and stays there"):
        align([Sampled(s, (0, 1), v, t) for s, v in streams.items()], ("a", "b"), "log")
    streams["q"] = jumped
    done = align([Sampled(s, (0, 1), v, t) for s, v in streams.items()], ("a", "b"), "log")
    assert done.segments == ((0, 2000), (2000, 4000))
    assert "the position of a jumps and stays, 1 time: split there" in done.repairs


@pytest.mark.parametrize(("wrong", "words"), [(0.0, "off the motion left out"), (1e5, "1 broken sample left out")])
@pytest.mark.parametrize("holes", [(), (900, 1200)])
def test_a_sample_that_was_left_out_is_not_counted_as_no_number_too(
    tmp_path: Path, wrong: float, words: str, holes: tuple[int, ...]
) -> None:
    log = table(recording())
    rows = np.arange(log.rows.shape[0])
    log = log.with_column("q.shoulder", lambda q: np.where(rows == 700, wrong, q + 3.0))
    log = log.with_column("q.shoulder", lambda q: np.where(np.isin(rows, holes), np.nan, q))
    got = read(log.save(tmp_path / "log.csv"))
    assert sum(words in said for said in got.repairs) == 1
    counted = ["q of shoulder: 2 of 4000 values are not numbers, left out"] if holes else []
    assert [said for said in got.repairs if "number" in said] == counted
