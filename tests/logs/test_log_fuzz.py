"""Any mutation of a good log, and any mapping, ends in a recording or in one clear error."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from elid_cli.errors import ElidError, UsageError
from elid_cli.logs.mapping.language import KEYS, SignalMap, parse_mapping
from elid_cli.logs.repair.align import align
from elid_cli.logs.repair.grid import interpolate
from elid_cli.logs.repair.reachable import Sampled
from tests.logs.made_logs import JOINTS, ROBOT, SIGNALS, recording

values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from([*JOINTS, "deg", "motor"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)
specs = st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=5), values, max_size=4)
mappings = st.dictionaries(st.sampled_from([*SIGNALS, "t", "dq"]) | st.text(max_size=5), specs | values, max_size=3)


@given(mappings)
@settings(max_examples=300, deadline=None)
def test_any_mapping_is_understood_or_refused(raw: dict) -> None:
    try:
        signals, _ = parse_mapping(raw, ROBOT, "map.yaml")
    except UsageError as error:
        refused = error
    else:
        assert all(isinstance(spec, SignalMap) and np.isfinite(spec.gain(ROBOT)).all() for spec in signals.values())
        return
    assert refused.message.startswith("map.yaml")


@given(
    seed=st.integers(0, 2**32 - 1),
    lost=st.floats(0, 0.5),
    repeated=st.floats(0, 0.2),
    jitter=st.floats(0, 0.4),
    holes=st.integers(0, 4),
    shuffled=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_repairs_never_invent_numbers(
    seed: int, lost: float, repeated: float, jitter: float, holes: int, shuffled: bool
) -> None:
    """Whatever is lost, repeated, jittered or mixed up: what comes out is even, and close to the motion."""
    rng = np.random.default_rng(seed)
    base = recording(1500)
    keep = rng.random(1500) >= lost
    for _ in range(holes):
        start = int(rng.integers(0, 1400))
        keep[start : start + int(rng.integers(1, 100))] = False
    rows = np.flatnonzero(keep)
    rows = np.sort(np.concatenate([rows, rng.choice(rows, int(repeated * rows.size))])) if rows.size else rows
    if shuffled:
        rng.shuffle(rows)
    shift = rng.uniform(-jitter, jitter, 1500) * 1e-3
    t = base.t + shift
    moved = np.column_stack([t, 1 - t, 2 * t])  # a motion that tells the time at which it was sampled
    streams = [Sampled(s, (0, 1, 2), moved[rows].copy(), t[rows]) for s in SIGNALS]
    try:
        got = align(streams, JOINTS, "log")
    except ElidError as error:
        refused = error
    else:
        assert (np.diff(got.t) > 0).all()
        for start, stop in got.segments:
            assert np.allclose(np.diff(got.t[start:stop]), got.dt, rtol=1e-6, atol=1e-12)
        told = got.signals["theta"]
        assert np.ptp(told[:, 0] - got.t) < 1.5e-3
        assert np.abs(told[:, 2] - 2 * told[:, 0]).max() < 1e-9
        return
    assert refused.exit_code == 3


@given(seed=st.integers(0, 2**32 - 1), order=st.sampled_from([2, 4, 6]))
@settings(max_examples=50, deadline=None)
def test_interpolation_is_exact_on_polynomials(seed: int, order: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, 30))
    coefficients = rng.standard_normal((order, 2)) / (10.0 ** np.arange(order))[:, None]
    at = rng.uniform(t[0], t[-1], 50)
    powers, wanted = (np.vander(x / 10, order, increasing=True) @ coefficients for x in (t, at))
    assert np.allclose(interpolate(t, powers, at, order=order), wanted, atol=1e-7)


def test_mutated_files_end_in_a_recording_or_an_error() -> None:
    from tests.system.fuzz import fuzz_logs

    ends = fuzz_logs.run(160, seed=7)
    assert sum(ends.values()) == 160
    assert any("recording" in end for end in ends)
    assert any("LogError" in end for end in ends)
