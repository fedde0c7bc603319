"""Whether reduced logs that were read can be ones."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.regression.triangles import Triangle
from elid_cli.estimation.streaming.reduced_log import ReducedLog

KINDS = ("link", "sum", "motor")
FASTEST, SLOWEST = 1e-6, 1.0
"""s; sample times that a log may have."""


def check_reduced(log: ReducedLog) -> None:
    """Raise ValueError, with what is wrong, for a reduced log that cannot be one."""
    recording, facts = log.recording, log.facts
    n, samples = len(recording.joints), recording.samples
    need(isinstance(log.fingerprint, str) and isinstance(log.options, dict), "it names neither robot nor options")
    texts = (*recording.joints, *recording.files, *recording.sha256, *recording.repairs, *recording.notes)
    texts += (*recording.warnings, *recording.sources, *recording.sources.values())
    need(all(isinstance(text, str) for text in texts), "its names are not text")
    need(n > 0 and len(set(recording.joints)) == n, "it names no joints, or one twice")
    need(samples > 0, f"it counts {samples} samples")
    need(FASTEST <= recording.dt <= SLOWEST, f"its sample time is {recording.dt:g} s")
    need(bool(np.isclose(facts.dt, recording.dt)), f"its sample time is {recording.dt:g} s and {facts.dt:g} s")
    need(0 < facts.rate <= 1.001 / facts.dt, f"its rate after decimation is {facts.rate:g} Hz")
    need(facts.cutoff > 0, f"its cut-off is {facts.cutoff:g} Hz")
    need(1 <= facts.instants <= samples, f"it counts {facts.instants} instants of {samples} samples")
    files = len(recording.files)
    need(files > 0 and len(recording.sha256) == files, "it does not name its log")
    stop = 0
    for segment in recording.segments:
        need(stop <= segment.start < segment.stop <= samples, "its stretches overlap or lie outside the log")
        need(0 <= segment.source < files, "a segment belongs to no file")
        stop = segment.stop
    _facts(log, n)
    _layout(log, n)
    for triangle in (*log.steady, *log.reversing):
        _check_triangle(triangle, facts.instants)
    width = sum(len(index) for _, index in log.layout)
    need(bool(log.scores), "it holds no scores")
    for scores in log.scores:
        _finite("its scores", scores.gram, (width, width))
        need(0 < scores.bandwidth < 2 * max(facts.instants, 8), f"its scores' bandwidth is {scores.bandwidth:g}")
        need(all(0 <= k < 2 * n for k in scores.nuisances), "its scores are of nuisances that there are not")
    need(len(log.links) == n, f"it holds links of {len(log.links)} joints, of {n}")
    for link in log.links:
        if link is None:
            continue
        _finite("a link's triangle", link.factor, (None, n + 4))
        _finite("a link's scores", link.gram, (n + 3, n + 3))
        need(1 <= link.count <= facts.instants and link.bandwidth > 0, "a link's equations are counted wrongly")


def _facts(log: ReducedLog, n: int) -> None:
    facts = log.facts
    for name in ("knots", "min_velocity", "deflection_noise", "noise"):
        values = getattr(facts, name)
        shape = (3, n) if name == "noise" else (n,)
        need(values.shape == shape and values.dtype.kind == "f", f"{name} has the shape {values.shape}, not {shape}")
        need(not (values < 0).any() and not np.isinf(values).any(), f"{name} is negative or infinite")
    for name in ("still", "torque", "unlinked", "link_torque", "computed"):
        values = getattr(facts, name)
        need(values.shape == (n,) and values.dtype == bool, f"{name} is not a flag for every joint")
    need(isinstance(facts.velocity_used, bool), "velocity_used is not a flag")
    need(facts.known.shape == (n,) and facts.known.dtype.kind in "iu", "known is not a number for every joint")
    sound = (facts.known >= 0) & (facts.known <= facts.instants)
    need(bool(sound.all()), "torques are known at more instants than there are")
    _finite("its moved torques", facts.moved, (n,))
    _finite("its poses", facts.poses, (None, n))


def _layout(log: ReducedLog, n: int) -> None:
    columns = len(log.reference) + 2 * n
    need(log.reference.ndim == 1 and not np.isinf(log.reference).any(), "its reference parameters are not numbers")
    need(len({row for row, _ in log.layout}) == len(log.layout) > 0, "it has no row groups, or one twice")
    for row, index in log.layout:
        need(row.kind in KINDS and 0 <= row.joint < n, f"it has a row group {row.kind} of joint {row.joint + 1}")
        sound = len(index) > 0 and len(set(index.tolist())) == len(index)
        need(sound and bool(((index >= 0) & (index < columns)).all()), "its columns are numbered wrongly")


def _check_triangle(triangle: Triangle, instants: int) -> None:
    what = f"a triangle of {triangle.row.kind} row {triangle.row.joint + 1}"
    _finite(what, triangle.factor, (None, len(triangle.index) + 1))
    need(1 <= triangle.count <= instants, f"{what} counts {triangle.count} equations of {instants} instants")
    need(0 <= triangle.fold < instants and isfinite(triangle.power) and triangle.power >= 0, f"{what} has no power")
    # the last column is the torque, of which the triangle keeps the length
    length = float(np.square(triangle.factor[:, -1]).sum())
    need(abs(length - triangle.power) <= 1e-6 * triangle.power + 1e-300, f"{what} is not that of its torque")


def _finite(what: str, values: NDArray[np.float64], shape: Sequence[int | None]) -> None:
    fits = values.ndim == len(shape) and all(w is None or w == own for w, own in zip(shape, values.shape, strict=True))
    need(fits, f"{what} has the shape {values.shape}")
    need(values.dtype.kind == "f" and bool(np.isfinite(values).all()), f"{what} holds what is no number")


def need(sound: bool, otherwise: str) -> None:
    """Raise ValueError, with what is wrong, unless something holds."""
    if not sound:
        raise ValueError(otherwise)
