"""Rows that were sampled beside their stamps, as all joints show together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elid_cli.logs.reading import read_recording
from tests.diagnosis.by_motion.plant import moved, robot, written


def test_values_are_moved_to_the_times_of_their_stamps(tmp_path: Path) -> None:
    clean, jittered = (moved(4, 6.0, noise=2e-5, jitter=jitter) for jitter in (0.0, 1.2e-3))
    arm = robot(tmp_path)
    found = read_recording([written(tmp_path, "log.h5", jittered)], arm)
    assert any("sampled at other times than their stamps say" in repair for repair in found.repairs)
    before, after = (np.std(log.q - clean.q, axis=0) for log in (jittered, found))
    assert (after < 0.3 * before).all()


def test_rows_written_twice_are_found_out(tmp_path: Path) -> None:
    clean = moved(5, 6.0, noise=2e-5)
    stale = np.arange(len(clean.t)) - (np.random.default_rng(0).random(len(clean.t)) < 0.07)
    held = type(clean)(**{**vars(clean), "q": clean.q[stale], "theta": clean.q[stale], "dq": clean.dq[stale]})
    found = read_recording([written(tmp_path, "log.h5", held)], robot(tmp_path))
    assert (np.std(found.q - clean.q, axis=0) < 0.5 * np.std(held.q - clean.q, axis=0)).all()


def test_even_rows_stay_as_they_are(tmp_path: Path) -> None:
    for noise in (1e-6, 2e-4):
        clean = moved(6, 6.0, noise=noise)
        found = read_recording([written(tmp_path, "log.h5", clean)], robot(tmp_path))
        assert not any("other times" in repair for repair in found.repairs)
        np.testing.assert_array_equal(found.q, clean.q)
