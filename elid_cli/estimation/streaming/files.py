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
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.budget import Budget
from elid_cli.checks import of_kind, several
from elid_cli.checks import path as file_name
from elid_cli.errors import LogError
from elid_cli.estimation.facts import SignalFacts
from elid_cli.estimation.judgement import ColumnNoise, Insufficient, Judgement, NotExcluded, RowNoise
from elid_cli.estimation.regression.triangles import Triangle
from elid_cli.estimation.stiffness.links import LinkSystem
from elid_cli.estimation.streaming.believed import check_reduced, need
from elid_cli.estimation.streaming.reduced_log import ReducedLog, Scores
from elid_cli.files import replacing
from elid_cli.model.effects import effect_classes
from elid_cli.model.regressor import EstimationRow
from elid_cli.signals.recording import Segment, without_samples

ROWS = ("sum", "motor", "load", "drive", "spring")


SCHEMA = "elid-triangles/2"
_FAULTS = (
    zipfile.BadZipFile, KeyError, ValueError, IndexError, TypeError, AttributeError, EOFError, zlib.error, struct.error,
    RuntimeError, OverflowError, MemoryError, SyntaxError, tokenize.TokenError,
)  # fmt: skip
_KNOWN = ("files", "sha256", "repairs", "notes", "warnings")


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
        The file cannot be written, or what are no reduced logs.
    """
    several(of_kind(ReducedLog, "reduced_logs(request) makes them"), "reduced logs")("write_triangles: logs", logs)
    file_name("write_triangles: path", path)
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
        numbers = {row: number for number, (row, _) in enumerate(log.layout)}
        columns = [c for c in (() if log.judgement is None else log.judgement.columns) if c.row in numbers]
        arrays[f"{k}/column_noise_rows"] = np.array([numbers[item.row] for item in columns], dtype=np.int64)
        arrays[f"{k}/column_noise"] = np.concatenate([*(_upper(item.gram) for item in columns), np.zeros(0)])
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
                    f"{name}: a reduced log of version {head.get('schema')!r}, this elid reads {SCHEMA!r}",
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
    bounds = None if said.not_excluded is None else [asdict(item) for item in said.not_excluded]
    return {**lists, "not_excluded": bounds, "biased": said.biased.tolist(), "notes": list(said.notes)}


def _heard(told: dict[str, Any] | None, joints: Sequence[str], columns: tuple[ColumnNoise, ...]) -> Judgement | None:
    if told is None:
        return None
    # a moment cannot be left out of what is reduced already
    noise = tuple(RowNoise(**{**item, "moment": None}) for item in told["noise"])
    lacking = tuple(Insufficient(**item) for item in told["insufficient"])
    places = [*((i.joint, i.rows, i.ratio) for i in noise), *((i.joint, i.rows, i.ratio) for i in lacking)]
    need(all(j in joints and r in ROWS and np.isfinite(x) for j, r, x in places), "it judges no row of it")
    need(all(0 <= i.floor < np.inf and 0 <= i.correlation < np.inf for i in noise), "its noise is no number")
    need(all(isinstance(i.follows, str) and np.isfinite(i.share) for i in lacking), "it follows nothing")
    asked = told.get("not_excluded")
    bounds = tuple(NotExcluded(**item) for item in asked or ())
    need(
        all(i.joint in (None, *joints) and 0 <= i.up_to < np.inf and 0 <= i.moves < np.inf for i in bounds),
        "its bounds",
    )
    need(all(isinstance(x, str) for i in bounds for x in (i.effect, i.parameter, i.unit)), "a bound of it is no text")
    bounds = tuple(item for item in bounds if item.effect in effect_classes())  # another elid may know more
    notes = tuple(told.get("notes", ()))
    need(all(isinstance(note, str) for note in notes), "a note of it is no text")
    biased = np.array(told["biased"], dtype=bool).reshape(-1)
    return Judgement(noise, lacking, biased, columns, notes, not_excluded=None if asked is None else bounds)


def _unpacked(head: dict[str, Any], arrays: Any, k: int) -> ReducedLog:
    layout, place = [], 0
    columns = arrays[f"{k}/columns"].astype(np.intp)
    for kind, joint, width in head["layout"]:
        layout.append((EstimationRow(kind, joint), columns[place : place + width]))
        place += width
    values = {field.name: arrays[f"{k}/{field.name}"] for field in fields(SignalFacts) if field.name != "computed"}
    # files of before know nothing of commands
    values["computed"] = arrays[f"{k}/computed"] if f"{k}/computed" in arrays else np.zeros_like(values["torque"])
    facts = SignalFacts(**{name: value if value.ndim else value.item() for name, value in values.items()})
    joints = tuple(head["joints"])
    segments = tuple(Segment(*row) for row in arrays[f"{k}/segments"].tolist())
    known: dict[str, Any] = {name: tuple(head[name]) for name in _KNOWN}
    known["smooth"] = head["options"].get("commands") == "smooth" or None
    recording = without_samples(
        joints, float(head["dt"]), int(head["samples"]), **known, segments=segments, sources=dict(head["sources"])
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
        _heard(head["judgement"], joints, _columns(arrays, k, layout)),
    )


def _columns(arrays: Any, k: int, layout: Sequence[tuple[EstimationRow, NDArray[np.intp]]]) -> tuple[ColumnNoise, ...]:
    """Return what noise is in the columns of a log; files of before do not know."""
    found, place = [], 0
    rows = f"{k}/column_noise_rows"
    for number in arrays[rows].tolist() if rows in arrays.files else ():
        row, index = layout[number]
        width = len(index) - 2  # without delay and offset of the channel
        part = arrays[f"{k}/column_noise"][place : place + width * (width + 1) // 2]
        place += len(part)
        gram = _symmetric(part, width)
        need(bool(np.isfinite(gram).all() and (np.diag(gram) >= 0).all()), "the noise in its columns is no number")
        found.append(ColumnNoise(row, index[:-2], gram))
    return tuple(found)


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
