"""Triangle files: npz written, read, checked.

Array ``elid`` holds the JSON: schema, and for every log the robot's fingerprint, the options, what is known of the log
and the layout of its arrays. The arrays of log k are named ``k/…``; triangles and symmetric matrices are stored packed,
without the half that is zero or repeats.
"""

from __future__ import annotations

import json
import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import asdict, fields, replace
from math import isfinite
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.budget import Budget
from elid_cli.errors import LogError
from elid_cli.estimation.facts import SignalFacts
from elid_cli.estimation.regression.triangles import Triangle
from elid_cli.estimation.result import Insufficient, Judgement, RowNoise
from elid_cli.estimation.streaming.links import LinkSystem
from elid_cli.estimation.streaming.reduced_log import ReducedLog, Scores
from elid_cli.files import replacing
from elid_cli.model.regressor import EstimationRow
from elid_cli.signals.recording import Recording, Segment

ROWS = ("sum", "motor", "load", "drive", "spring")
KINDS = ("link", "sum", "motor")
FASTEST, SLOWEST = 1e-6, 1.0
"""s; sample times that a log may have."""


def check_reduced(log: ReducedLog) -> None:
    """Raise ValueError, with what is wrong, for a reduced log that cannot be one."""
    recording, facts = log.recording, log.facts
    n, samples = len(recording.joints), recording.samples
    _need(isinstance(log.fingerprint, str) and isinstance(log.options, dict), "it names neither robot nor options")
    texts = (*recording.joints, *recording.files, *recording.sha256, *recording.repairs, *recording.notes)
    texts += (*recording.warnings, *recording.sources, *recording.sources.values())
    _need(all(isinstance(text, str) for text in texts), "its names are no texts")
    _need(n > 0 and len(set(recording.joints)) == n, "it names no joints, or one twice")
    _need(samples > 0, f"it counts {samples} samples")
    _need(FASTEST <= recording.dt <= SLOWEST, f"its sample time is {recording.dt:g} s")
    _need(bool(np.isclose(facts.dt, recording.dt)), f"its sample time is {recording.dt:g} s and {facts.dt:g} s")
    _need(0 < facts.rate <= 1.001 / facts.dt, f"its rate after decimation is {facts.rate:g} Hz")
    _need(facts.cutoff > 0, f"its cut-off is {facts.cutoff:g} Hz")
    _need(1 <= facts.instants <= samples, f"it counts {facts.instants} instants of {samples} samples")
    files = len(recording.files)
    _need(files > 0 and len(recording.sha256) == files, "it does not name its log")
    stop = 0
    for segment in recording.segments:
        _need(stop <= segment.start < segment.stop <= samples, "its stretches overlap or lie outside the log")
        _need(0 <= segment.source < files, "a stretch belongs to no file")
        stop = segment.stop
    _facts(log, n)
    _layout(log, n)
    for triangle in (*log.steady, *log.reversing):
        _check_triangle(triangle, facts.instants)
    width = sum(len(index) for _, index in log.layout)
    _need(bool(log.scores), "it holds no scores")
    for scores in log.scores:
        _finite("its scores", scores.gram, (width, width))
        _need(0 < scores.bandwidth < 2 * max(facts.instants, 8), f"its scores' bandwidth is {scores.bandwidth:g}")
        _need(all(0 <= k < 2 * n for k in scores.nuisances), "its scores are of nuisances that there are not")
    _need(len(log.links) == n, f"it holds links of {len(log.links)} joints, of {n}")
    for link in log.links:
        if link is None:
            continue
        _finite("a link's triangle", link.factor, (None, n + 4))
        _finite("a link's scores", link.gram, (n + 3, n + 3))
        _need(1 <= link.count <= facts.instants and link.bandwidth > 0, "a link's equations are counted wrongly")


def _facts(log: ReducedLog, n: int) -> None:
    facts = log.facts
    for name in ("knots", "min_velocity", "deflection_noise", "noise"):
        values = getattr(facts, name)
        shape = (3, n) if name == "noise" else (n,)
        _need(values.shape == shape and values.dtype.kind == "f", f"{name} has the shape {values.shape}, not {shape}")
        _need(not (values < 0).any() and not np.isinf(values).any(), f"{name} is negative or infinite")
    for name in ("still", "torque", "unlinked", "link_torque"):
        values = getattr(facts, name)
        _need(values.shape == (n,) and values.dtype == bool, f"{name} is not a mark for every joint")
    _need(isinstance(facts.velocity_used, bool), "velocity_used is not a mark")
    _need(facts.known.shape == (n,) and facts.known.dtype.kind in "iu", "known is not a number for every joint")
    sound = (facts.known >= 0) & (facts.known <= facts.instants)
    _need(bool(sound.all()), "torques are known at more instants than there are")
    _finite("its moved torques", facts.moved, (n,))
    _finite("its poses", facts.poses, (None, n))


def _layout(log: ReducedLog, n: int) -> None:
    columns = len(log.reference) + 2 * n
    _need(log.reference.ndim == 1 and not np.isinf(log.reference).any(), "its reference parameters are not numbers")
    _need(len({row for row, _ in log.layout}) == len(log.layout) > 0, "it has no row groups, or one twice")
    for row, index in log.layout:
        _need(row.kind in KINDS and 0 <= row.joint < n, f"it has a row group {row.kind} of joint {row.joint + 1}")
        sound = len(index) > 0 and len(set(index.tolist())) == len(index)
        _need(sound and bool(((index >= 0) & (index < columns)).all()), "its columns are numbered wrongly")


def _check_triangle(triangle: Triangle, instants: int) -> None:
    what = f"a triangle of {triangle.row.kind} row {triangle.row.joint + 1}"
    _finite(what, triangle.factor, (None, len(triangle.index) + 1))
    _need(1 <= triangle.count <= instants, f"{what} counts {triangle.count} equations of {instants} instants")
    _need(0 <= triangle.fold < instants and isfinite(triangle.power) and triangle.power >= 0, f"{what} has no power")
    # the last column is the torque, of which the triangle keeps the length
    length = float(np.square(triangle.factor[:, -1]).sum())
    _need(abs(length - triangle.power) <= 1e-6 * triangle.power + 1e-300, f"{what} is not that of its torque")


def _finite(what: str, values: NDArray[np.float64], shape: Sequence[int | None]) -> None:
    fits = values.ndim == len(shape) and all(w is None or w == own for w, own in zip(shape, values.shape, strict=True))
    _need(fits, f"{what} has the shape {values.shape}")
    _need(values.dtype.kind == "f" and bool(np.isfinite(values).all()), f"{what} holds what is no number")


def _need(sound: bool, otherwise: str) -> None:
    if not sound:
        raise ValueError(otherwise)


SCHEMA = "elid-triangles/2"
_MAGIC = b"PK\x03\x04"
_FAULTS = (
    zipfile.BadZipFile, KeyError, ValueError, IndexError, TypeError, AttributeError, EOFError, zlib.error, struct.error,
    RuntimeError, OverflowError, MemoryError, SyntaxError, tokenize.TokenError,
)  # fmt: skip
_KNOWN = ("files", "sha256", "repairs", "notes", "warnings")


def is_triangle_file(path: str | Path) -> bool:
    """Return whether a file is one that `write_triangles` wrote, or what is left of one, by its content.

    NumPy's archives of other arrays are logs. A pipe or device is never opened.
    """
    try:
        if not Path(path).is_file():
            return False
        with Path(path).open("rb") as stream:
            head = stream.read(80)
        if not head.startswith(_MAGIC):
            return False
        if b"elid.npy" in head:
            return True
        with zipfile.ZipFile(path) as archive:
            return "elid.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def write_triangles(logs: Sequence[ReducedLog], path: str | Path) -> None:
    """Write reduced logs, the file whole or not at all; the same logs give the same bytes.

    Parameters
    ----------
    logs
        What `reduced_logs` returns.
    path
        NumPy's npz.

    Raises
    ------
    UsageError
        The file cannot be written.
    """
    with replacing(path) as beside, beside.open("wb") as stream:
        np.savez(stream, **packed(logs))


def packed(logs: Sequence[ReducedLog]) -> dict[str, Any]:
    """Return reduced logs as named plain arrays."""
    arrays: dict[str, Any] = {}
    heads = []
    for k, log in enumerate(logs):
        heads.append(_head(log))
        for field in fields(SignalFacts):
            arrays[f"{k}/{field.name}"] = np.asarray(getattr(log.facts, field.name))
        arrays[f"{k}/segments"] = np.array([[s.start, s.stop, s.source] for s in log.recording.segments])
        arrays[f"{k}/columns"] = np.concatenate([index for _, index in log.layout])
        for name, triangles in (("steady", log.steady), ("reversing", log.reversing)):
            rows = {row: number for number, (row, _) in enumerate(log.layout)}
            shapes = [[rows[t.row], t.fold, t.count, *t.factor.shape, _packs(t.factor)] for t in triangles]
            arrays[f"{k}/{name}"] = np.array(shapes, dtype=np.int64).reshape(len(triangles), 6)
            arrays[f"{k}/{name}_power"] = np.array([t.power for t in triangles])
            flat = [_upper(t.factor) if _packs(t.factor) else t.factor.ravel() for t in triangles]
            arrays[f"{k}/{name}_factors"] = np.concatenate([*flat, np.zeros(0)])
        for number, scores in enumerate(log.scores):
            arrays[f"{k}/scores{number}"] = _upper(scores.gram)
        arrays[f"{k}/reference"] = log.reference
        for joint, link in enumerate(log.links):
            if link is not None:
                arrays[f"{k}/link{joint}"] = link.factor
                arrays[f"{k}/link{joint}_scores"] = link.gram
                arrays[f"{k}/link{joint}_count"] = np.array([link.count, link.bandwidth])
    text = json.dumps({"schema": SCHEMA, "logs": heads}, allow_nan=False)
    return {"elid": np.array(text), **arrays}


def read_triangles(path: str | Path) -> list[ReducedLog]:
    """Read reduced logs.

    Raises
    ------
    LogError
        The file is damaged, cut, or of a version that this elid does not know.
    """
    try:
        with Path(path).open("rb") as stream:
            return [replace(log, origin=str(path)) for log in read_stream(stream, str(path))]
    except OSError as error:
        raise LogError(f"{path}: cannot be read", detail=(error.strerror or str(error)).lower()) from error


def read_stream(stream: IO[bytes], name: str) -> list[ReducedLog]:
    """Read reduced logs from an open file; `name` stands for it in errors."""
    try:
        with zipfile.ZipFile(stream) as archive:
            _believe(archive, name, stream.seek(0, 2))
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as arrays:
            if "elid" not in arrays.files:
                raise LogError(
                    f"{name}: a NumPy archive that elid reduce did not write",
                    detail=f"it holds {', '.join(arrays.files[:6])}",
                    hint="elid reduce LOG --robot ROBOT -o FILE.npz",
                )
            head = json.loads(str(arrays["elid"][()]))
            if head.get("schema") != SCHEMA:
                raise LogError(
                    f"{name}: triangles of the kind {head.get('schema')!r}, this elid reads {SCHEMA!r}",
                    hint="run elid reduce again with this elid",
                )
            found = []
            for k, described in enumerate(head["logs"]):
                found.append(_unpacked(described, arrays, k))
                check_reduced(found[-1])
            if not found:
                raise ValueError("it holds no log")
            return found
    except _FAULTS as error:
        why = "it is cut: its end is missing" if "not a zip file" in str(error) else str(error).split("\n")[0][:120]
        raise LogError(
            f"{name}: damaged, or not written by elid reduce",
            detail=why or type(error).__name__,
            hint=f"make it again: elid reduce LOG --robot ROBOT -o {name}",
        ) from error


def _believe(archive: zipfile.ZipFile, name: str, size: int) -> None:
    """Ask for the memory of an archive's arrays, by their own headers, before it is taken (LogError, ValueError)."""
    budget = Budget(name, size)
    for info in archive.infolist():
        budget.step()
        budget.take(info.file_size)
        with archive.open(info) as member:
            version = np.lib.format.read_magic(member)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, dtype = read(member)
        if math.prod(shape) * dtype.itemsize > info.file_size or len(shape) > 2:
            raise ValueError(f"{info.filename} declares {shape} values and holds {info.file_size} bytes")


def _head(log: ReducedLog) -> dict[str, Any]:
    recording = log.recording
    return {
        "fingerprint": log.fingerprint,
        "options": dict(log.options),
        "joints": list(recording.joints),
        "dt": recording.dt,
        "samples": recording.samples,
        **{name: list(getattr(recording, name)) for name in _KNOWN},
        "sources": dict(recording.sources),
        "layout": [[row.kind, row.joint, len(index)] for row, index in log.layout],
        "judgement": _told(log.judgement),
        "scores": [{"bandwidth": s.bandwidth, "nuisances": list(s.nuisances)} for s in log.scores],
    }


def _told(said: Judgement | None) -> dict[str, Any] | None:
    """Return a judgement as JSON values."""
    if said is None:
        return None
    lists = {name: [asdict(item) for item in getattr(said, name)] for name in ("noise", "insufficient")}
    return {**lists, "biased": said.biased.tolist()}


def _heard(told: dict[str, Any] | None, joints: Sequence[str]) -> Judgement | None:
    if told is None:
        return None
    noise = tuple(RowNoise(**item) for item in told["noise"])
    lacking = tuple(Insufficient(**item) for item in told["insufficient"])
    places = [*((i.joint, i.rows, i.ratio) for i in noise), *((i.joint, i.rows, i.ratio) for i in lacking)]
    _need(all(j in joints and r in ROWS and np.isfinite(x) for j, r, x in places), "it judges no row of it")
    _need(all(0 <= i.floor < np.inf and 0 <= i.correlation < np.inf for i in noise), "its noise is no number")
    _need(all(isinstance(i.follows, str) and np.isfinite(i.share) for i in lacking), "it follows nothing")
    return Judgement(noise, lacking, np.array(told["biased"], dtype=bool).reshape(-1))


def _unpacked(head: dict[str, Any], arrays: Any, k: int) -> ReducedLog:
    layout, place = [], 0
    columns = arrays[f"{k}/columns"].astype(np.intp)
    for kind, joint, width in head["layout"]:
        layout.append((EstimationRow(kind, joint), columns[place : place + width]))
        place += width
    values = {field.name: arrays[f"{k}/{field.name}"] for field in fields(SignalFacts)}
    facts = SignalFacts(**{name: value if value.ndim else value.item() for name, value in values.items()})
    samples, joints = int(head["samples"]), tuple(head["joints"])
    empty = np.broadcast_to(np.nan, (samples, len(joints)))
    recording = Recording(
        joints=joints,
        dt=float(head["dt"]),
        t=np.broadcast_to(np.nan, (samples,)),
        q=empty,
        theta=empty,
        tau=empty,
        segments=tuple(Segment(*row) for row in arrays[f"{k}/segments"].tolist()),
        sources=dict(head["sources"]),
        files=tuple(head["files"]),
        sha256=tuple(head["sha256"]),
        repairs=tuple(head["repairs"]),
        notes=tuple(head["notes"]),
        warnings=tuple(head["warnings"]),
    )
    scores = tuple(
        Scores(_symmetric(arrays[f"{k}/scores{number}"], place), told["bandwidth"], tuple(told["nuisances"]))
        for number, told in enumerate(head["scores"])
    )
    steady, reversing = (_triangles(arrays, f"{k}/{name}", layout) for name in ("steady", "reversing"))
    return ReducedLog(
        head["fingerprint"],
        head["options"],
        recording,
        facts,
        tuple(layout),
        steady,
        reversing,
        scores,
        tuple(_link(arrays, f"{k}/link{joint}") for joint in range(len(joints))),
        arrays[f"{k}/reference"],
        _heard(head["judgement"], joints),
    )


def _link(arrays: Any, name: str) -> LinkSystem | None:
    if name not in arrays.files:
        return None
    count, bandwidth = arrays[f"{name}_count"].tolist()
    return LinkSystem(arrays[name], int(count), arrays[f"{name}_scores"], bandwidth)


def _triangles(
    arrays: Any, name: str, layout: Sequence[tuple[EstimationRow, NDArray[np.intp]]]
) -> tuple[Triangle, ...]:
    factors, powers = arrays[f"{name}_factors"], arrays[f"{name}_power"]
    if not np.isfinite(factors).all():
        raise ValueError("triangles hold values that are not numbers")
    found, place, shapes = [], 0, arrays[name].tolist()
    for (number, fold, count, rows, width, half), power in zip(shapes, powers.tolist(), strict=True):
        row, index = layout[number]
        if width != len(index) + 1:
            raise ValueError(f"a triangle of {row.kind} row {row.joint + 1} has {width} columns")
        size = width * (width + 1) // 2 if half else rows * width
        part = factors[place : place + size]
        place += size
        factor = _triangle(part, width) if half else part.reshape(rows, width)
        found.append(Triangle(row, fold, index, factor, count, power))
    if place != len(factors):
        raise ValueError(f"triangles hold {len(factors)} values, not {place}")
    return tuple(found)


def _packs(factor: Array) -> bool:
    """Whether a factor is a square triangle; of few instants it may be anything."""
    return factor.shape[0] == factor.shape[1] and not np.tril(factor, -1).any()


def _upper(matrix: Array) -> Array:
    """Return the upper half of a square matrix, row by row."""
    return np.asarray(matrix[np.triu_indices(len(matrix))])


def _triangle(values: Array, width: int) -> Array:
    result = np.zeros((width, width))
    result[np.triu_indices(width)] = values
    return result


def _symmetric(values: Array, width: int) -> Array:
    half = _triangle(values, width)
    return half + np.triu(half, 1).T
