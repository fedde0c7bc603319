"""The good log in further containers, saved results, and ways to break both."""

from __future__ import annotations

import contextlib
import io
import json
import math
import sqlite3
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli.cli import main
from elid_cli.logs import write_recording
from elid_cli.logs.mcap.write import joint_state_schema
from elid_cli.signals.recording import Recording
from tests.logs.mcap_made import encoder, joint_state
from tests.system.field_logs import KIND, stamps
from tests.system.fuzz.fuzz_logs import HALVES, WORDS, mutated
from tests.system.hostile.hostile import ROBOT, SAMPLE, base, elid

Case = tuple[str, bytes]
PLACES = ["--rate", "250"] + [
    part for k, name in enumerate(("q", "theta", "tau"))
    for part in ("--map", f"{name}={{from: /array, joints: [{2 * k + 1}, {2 * k + 2}]}}")
]  # fmt: skip
"""Where the signals are in an array without names."""
EDGE = 400
"""Bytes at either end of a file in which containers hold their sizes."""
UNUSABLE = ("1" + "0" * 400, "1e999", "-1e999", "NaN", '"x"', "[1]", "true", "-" + "9" * 350, "{}", "1e305")


def columns_of(log: Recording) -> dict[str, np.ndarray]:
    signals = {name: getattr(log, name) for name in ("q", "theta", "tau")}
    return {"t": log.t} | {f"{s}.{j}": signals[s][:, k] for s in signals for k, j in enumerate(log.joints)}


def sqlite_bag(folder: Path, log: Recording) -> Path:
    """Write joint and motor states as `ros2 bag record` does into SQLite."""
    encode = encoder(KIND, joint_state_schema().decode())
    with sqlite3.connect(path := folder / "a.db3") as bag:
        bag.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        for topic, name in enumerate(("/joint_states", "/motor_states"), 1):
            bag.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr')", (topic, name, KIND))
        joints, rows = list(log.joints), []
        assert log.theta is not None
        for k, stamp in enumerate(stamps(log)):
            rows.append((1, stamp, encode(joint_state(stamp, joints, log.q[k]))))
            rows.append((2, stamp, encode(joint_state(stamp, joints, log.theta[k], effort=log.tau[k]))))
        bag.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", rows)
    bag.close()
    return path


def parquet_table(folder: Path, log: Recording) -> Path:
    import pandas as pd

    pd.DataFrame(columns_of(log)).to_parquet(path := folder / "a.parquet")
    return path


def archive(folder: Path, log: Recording) -> Path:
    write_recording(log, folder / "log.csv")
    with zipfile.ZipFile(path := folder / "a.zip", "w", zipfile.ZIP_DEFLATED) as out:
        out.write(folder / "log.csv", "log.csv")
    return path


def one_array(folder: Path, log: Recording) -> Path:
    np.save(path := folder / "a.npy", np.column_stack(list(columns_of(log).values())))
    return path


def lying(suffix: str, data: bytes) -> Callable[[np.random.Generator], Case]:
    """Return a maker of files whose ends, where sizes and counts stand, hold other words."""

    def made(rng: np.random.Generator) -> Case:
        out = bytearray(data)
        for _ in range(int(rng.integers(1, 4))):
            near = int(rng.integers(0, min(EDGE, len(out))))
            at = near if rng.random() < 0.5 else len(out) - 8 - near
            if rng.random() < 0.5:
                out[at : at + 8] = WORDS[rng.integers(len(WORDS))].to_bytes(8, "little")
            else:
                out[at : at + 4] = HALVES[rng.integers(len(HALVES))].to_bytes(4, "little")
        return f"a.{suffix}", bytes(out)

    return made


def crowded(rng: np.random.Generator) -> Case:
    """Return the start of the good log among many columns, or columns of long names; its name is its samples."""
    import pandas as pd

    many = bool(rng.random() < 0.5)
    count, length = (int(rng.integers(500, 3000)), 8) if many else (4, int(rng.integers(1000, 60_000)))
    rows = 300 if many else 3000
    held = {name: values[:rows] for name, values in columns_of(base()).items()}
    held |= {f"{k:08d}".ljust(length, "x"): np.zeros(held["t"].size) for k in range(count)}
    suffix = str(rng.choice(["csv", "parquet", "npz", "jsonl"]))
    out = io.BytesIO()
    if suffix == "npz":
        np.savez(out, **held)  # type: ignore[arg-type]
    elif suffix == "parquet":
        pd.DataFrame(held).to_parquet(out)
    elif suffix == "csv":
        pd.DataFrame(held).to_csv(out, index=False)
    else:
        pd.DataFrame(held).iloc[:60].to_json(out, orient="records", lines=True)
    return f"{60 if suffix == 'jsonl' else rows}.{suffix}", out.getvalue()


@cache
def saved() -> str:
    """Return what `identify --json` prints of the sample log."""
    return elid("identify", SAMPLE, "--robot", ROBOT, "--json").out


def result_bytes(rng: np.random.Generator) -> Case:
    return "a.json", mutated(saved().encode(), rng)


def result_cut(rng: np.random.Generator) -> Case:
    return "a.json", saved().encode()[: int(rng.integers(0, len(saved())))]


def result_numbers(rng: np.random.Generator) -> Case:
    """Return a saved result in which a number of a base parameter cannot be used."""
    data = json.loads(saved())
    entry = data["base_parameters"][int(rng.integers(len(data["base_parameters"])))]
    entry[str(rng.choice(["estimate", "std_error"]))] = "HERE"
    return "a.json", json.dumps(data).replace('"HERE"', str(rng.choice(UNUSABLE)), 1).encode()


def result_outcome(path: Path) -> str:
    """Give a result to compare, trend and sample, and say how they ended together."""
    sound = path.with_name("sound.json")
    sound.write_text(saved(), "utf-8")
    lines = (["compare", sound, path], ["trend", sound, sound, sound, path], ["sample", path, "-n", "3"])
    ends = {_ended([*map(str, line), "--json"], path) for line in lines}
    return next(kind for kind in ("silent", "error", "right") if kind in ends)


def _ended(line: list[str], path: Path) -> str:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(line)
    said = err.getvalue()
    assert not any(mark in said + out.getvalue() for mark in "\x1b\x07\x9b\u202e"), "a control reached the terminal"
    if code:
        assert code in (2, 3, 4), (code, said)
        assert sum(part.startswith("error: ") for part in said.splitlines()) == 1, said
        assert len(said) < 4000, len(said)
        return "error"
    return "right" if _usable(json.loads(path.read_bytes())) else "silent"


def _usable(data: dict[str, Any]) -> bool:
    """Return whether estimates and their errors are null or numbers that arithmetic has."""
    given = [entry.get(key) for entry in data["base_parameters"] for key in ("estimate", "std_error")]
    return all(v is None or _finite(v) for v in given)


def _finite(value: Any) -> bool:
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(float(value))
    except OverflowError:
        return False
