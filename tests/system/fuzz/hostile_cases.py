"""Hostile files by class, each read in a process of its own under a limit of memory; a table of how they ended.

    python -m tests.system.fuzz.hostile_cases [cases per class, default 140] [class …]

`tried`; `error`: one clean error; `right`: read, and the estimates are those of the good log; `flagged`: read, and the
damage said; `silent`: read, other numbers, and nothing said (there must be none); then peak memory, longest time.
"""

from __future__ import annotations

import collections
import contextlib
import io
import json
import multiprocessing
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli.cli import main
from elid_cli.logs import write_recording
from elid_cli.signals.recording import Recording
from tests.system.field_logs import json_lines, old_matlab
from tests.system.fuzz import hostile_files as files
from tests.system.fuzz.fuzz_logs import mutated
from tests.system.hostile.bags import joint_states
from tests.system.hostile.hostile import ROBOT, SIZES, base, clean

Case = tuple[str, bytes]
Made = Callable[[np.random.Generator], Case]


def plain_arrays(folder: Path, log: Recording) -> Path:
    np.savez(path := folder / "a.npz", t=log.t, q=log.q, theta=log.theta, tau=log.tau)
    return path


OTHERS = {
    "jsonl": json_lines, "mat": old_matlab, "npz": plain_arrays, "db3": files.sqlite_bag,
    "parquet": files.parquet_table, "zip": files.archive, "npy": files.one_array,
}  # fmt: skip
SLOWEST, MOST = 10.0, 2 << 30
"""s and bytes that one case may take."""


def good(suffix: str) -> bytes:
    """Return the good log in a format."""
    if suffix == "mcap":
        return joint_states()
    with tempfile.TemporaryDirectory() as folder:
        if suffix in OTHERS:
            return OTHERS[suffix](Path(folder), base()).read_bytes()
        path = Path(folder) / f"a.{suffix}"
        write_recording(base(), path)
        return path.read_bytes()


def columns(rng: np.random.Generator, change: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Case:
    """Return the good log as CSV with one column of one joint changed."""
    log = base()
    signals = {name: getattr(log, name).copy() for name in ("q", "theta", "tau")}
    name, joint = str(rng.choice(["q", "theta"])), int(rng.integers(2))
    signals[name][:, joint] = change(signals[name][:, joint], rng)
    head = ",".join(["t", *(f"{s}.{j}" for s in signals for j in log.joints)])
    out = io.StringIO()
    np.savetxt(out, np.column_stack([log.t, *signals.values()]), delimiter=",", header=head, comments="")
    return "a.csv", out.getvalue().encode()


def dropouts(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    every, length = int(rng.integers(60, 800)), int(rng.integers(1, 4))
    lost = (np.arange(values.size) + int(rng.integers(5, 60))) % every < length
    return np.where(lost, rng.choice([0.0, float(values.mean()), -1.0]), values)


def jump(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    start = int(rng.integers(300, values.size - 300))
    return values + np.where(np.arange(values.size) >= start, rng.choice([-1, 1]) * rng.uniform(0.5, 2.0), 0.0)


def spikes(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    places = rng.choice(values.size - 40, int(rng.integers(1, 8)), replace=False) + 20
    return np.where(np.isin(np.arange(values.size), places), rng.choice([1e6, -300.0, 1e30, np.inf, np.nan]), values)


def damaged(suffix: str) -> Made:
    data = good(suffix)
    return lambda rng: (f"a.{suffix}", mutated(data, rng))


def cut(suffix: str) -> Made:
    data = good(suffix)
    return lambda rng: (f"a.{suffix}", data[: int(rng.integers(0, len(data)))])


def named(rng: np.random.Generator) -> Case:
    """Return the good log with names that would move a terminal or run in a page."""
    evil = "".join(rng.choice(list("\x1b]0;x\x07<script>\x9b31m\u202e$`|\t"), int(rng.integers(1, 30))))
    suffix, text = columns(rng, lambda v, _: v)
    return suffix, text.replace(b"tau.joint2", f'"{evil}"'.encode(), 1)


def bomb(rng: np.random.Generator) -> Case:
    """Return a few bytes that ask for gigabytes."""
    import gzip

    from tests.system.hostile.test_budgets import with_chunk

    size = int(rng.integers(1, 64)) << 20
    kind = int(rng.integers(4))
    if kind == 0:
        return "a.csv.gz", gzip.compress(bytes([int(rng.choice(list(b"0,;\n1")))]) * size)
    if kind == 1:
        import lz4.frame

        return "a.mcap", with_chunk("lz4", int(rng.choice([100, size, 1 << 40])), lz4.frame.compress(bytes(size)))
    if kind == 2:
        import zstandard

        return "a.mcap", with_chunk("zstd", int(rng.choice([100, size, 1 << 40])), zstandard.compress(bytes(size)))
    return "a.csv", b"t,q\n" + bytes([int(rng.choice(list(b"0,;1")))]) * size


def described(rng: np.random.Generator) -> Case:
    """Return a robot file with one number that is none, or one byte changed."""
    import elid_cli

    package = Path(elid_cli.__file__).parent
    text = next(p for p in (package / "robots", package.parent / "robots") if p.is_dir()) / "planar2.yaml"
    lines = text.read_text("utf-8").split("\n")
    if rng.random() < 0.5:
        return "a.yaml", mutated("\n".join(lines).encode(), rng)
    place = int(rng.choice([k for k, line in enumerate(lines) if ": " in line]))
    key = lines[place].partition(": ")[0]
    lines[place] = f"{key}: {rng.choice(['1e300', '-1e300', '.nan', '1e-300', '[1, 2', '&a *a', '!!python/x 1'])}"
    return "a.yaml", "\n".join(lines).encode()


CLASSES: dict[str, Callable[[], Made]] = {
    "MCAP, bytes changed": lambda: damaged("mcap"),
    "MCAP, cut": lambda: cut("mcap"),
    "HDF5, bytes changed": lambda: damaged("h5"),
    "HDF5, cut": lambda: cut("h5"),
    "CSV, bytes changed": lambda: damaged("csv"),
    "JSON lines, bytes changed": lambda: damaged("jsonl"),
    "MATLAB 5, bytes changed": lambda: damaged("mat"),
    "NumPy, bytes changed": lambda: damaged("npz"),
    "gzip, bytes changed": lambda: damaged("csv.gz"),
    "SQLite bag, bytes changed": lambda: damaged("db3"),
    "SQLite bag, cut": lambda: cut("db3"),
    "SQLite bag, sizes": lambda: files.lying("db3", good("db3")),
    "Parquet, bytes changed": lambda: damaged("parquet"),
    "Parquet, cut": lambda: cut("parquet"),
    "Parquet, sizes": lambda: files.lying("parquet", good("parquet")),
    "zip, bytes changed": lambda: damaged("zip"),
    "zip, cut": lambda: cut("zip"),
    "zip, sizes": lambda: files.lying("zip", good("zip")),
    "npy, bytes changed": lambda: damaged("npy"),
    "npz, cut": lambda: cut("npz"),
    "npz, sizes": lambda: files.lying("npz", good("npz")),
    "MATLAB 5, cut": lambda: cut("mat"),
    "MATLAB 5, sizes": lambda: files.lying("mat", good("mat")),
    "JSON lines, cut": lambda: cut("jsonl"),
    "many columns, long names": lambda: files.crowded,
    "saved results, bytes changed": lambda: files.result_bytes,
    "saved results, cut": lambda: files.result_cut,
    "saved results, numbers": lambda: files.result_numbers,
    "dropouts within the range": lambda: lambda rng: columns(rng, dropouts),
    "positions that jump": lambda: lambda rng: columns(rng, jump),
    "broken samples": lambda: lambda rng: columns(rng, spikes),
    "names with controls": lambda: named,
    "bombs": lambda: bomb,
    "robot files": lambda: described,
}


def outcome(path: Path) -> str:
    """Run one case as a command does, and say how it ended."""
    if path.suffix == ".json":
        return files.result_outcome(path)
    out, err = io.StringIO(), io.StringIO()
    robot = str(path) if path.suffix == ".yaml" else ROBOT
    line = ["classify"] if path.suffix == ".yaml" else ["identify", str(path)]
    line += files.PLACES if path.suffix == ".npy" else []
    with warnings.catch_warnings(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([*line, "--robot", robot, "--json"])
    said = err.getvalue()
    assert not any(mark in said + out.getvalue() for mark in "\x1b\x07\x9b\u202e"), "a control reached the terminal"
    if code:
        assert code in (2, 3, 4), (code, said)
        assert sum(line.startswith("error: ") for line in said.splitlines()) == 1, said  # a codec's may be quoted in it
        return "error"
    if path.suffix == ".yaml":
        return "right"
    told = json.loads(out.getvalue())
    if told["log"]["repairs"] or told["log"]["warnings"]:
        return "flagged"
    return "right" if _agrees(told, clean(int(path.stem) if path.stem.isdigit() else None)) else "silent"


def _agrees(told: dict[str, Any], wanted: dict[str, tuple[float | None, str]]) -> bool:
    for entry in told["base_parameters"]:
        value, right = entry["estimate"], wanted.get(entry["name"], (None, ""))[0]
        if value is not None and right is not None and entry["verdict"] == "supported":
            slack = 0.02 * max(abs(right), SIZES[entry["unit"]]) + 4 * (entry["std_error"] or 0.0)
            if abs(value - right) > slack:
                return False
    return True


def _worker(name: str, count: int, seed: int, pipe: Any) -> None:
    rng = np.random.default_rng(seed)
    make = CLASSES[name]()
    clean()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            suffix, data = make(rng)
            path = Path(folder) / suffix
            path.write_bytes(data)
            begin = time.process_time()
            try:
                ended = outcome(path)
            except BaseException as problem:
                (Path.cwd() / f"crash-{name.replace(' ', '-')}-{number}-{suffix}").write_bytes(data)
                ended = f"CRASH {type(problem).__name__}: {str(problem)[:120]}"
            pipe.send((ended, time.process_time() - begin))
    pipe.send((None, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024))


def tried(name: str, count: int, seed: int = 0) -> Iterator[tuple[str | None, float]]:
    """Yield how each case of a class ended and its time in s; last None and the peak memory of all, in bytes."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    worker = multiprocessing.get_context("spawn").Process(target=_worker, args=(name, count, seed, theirs))
    worker.start()
    theirs.close()
    try:
        while True:
            try:
                ended, figure = ours.recv()
            except EOFError:
                yield "CRASH of the process", 0.0
                return
            yield ended, figure
            if ended is None:
                return
    finally:
        worker.join()


def table(count: int, classes: Sequence[str] = tuple(CLASSES)) -> bool:
    """Print the table; return whether every case ended as it must."""
    print(f"{'class':28}{'tried':>7}{'error':>7}{'right':>7}{'flagged':>9}{'silent':>8}{'peak MB':>9}{'longest s':>11}")
    sound, total = True, collections.Counter[str]()
    for name in classes:
        ends: collections.Counter[str] = collections.Counter()
        longest = peak = 0.0
        for ended, figure in tried(name, count):
            if ended is None:
                peak = figure
                continue
            ends[ended] += 1
            longest = max(longest, figure)
        number = sum(ends.values())
        cells = [ends[kind] for kind in ("error", "right", "flagged", "silent")]
        print(f"{name:28}{number:7}{cells[0]:7}{cells[1]:7}{cells[2]:9}{cells[3]:8}{peak / 2**20:9.0f}{longest:11.2f}")
        for ended in ends:
            if ended.startswith("CRASH"):
                print(f"  {ends[ended]} × {ended}")
        total.update(ends)
        bad = ends["silent"] + sum(n for ended, n in ends.items() if ended.startswith("CRASH"))
        sound = sound and not bad and peak <= MOST and longest <= SLOWEST
        sys.stdout.flush()
    print(
        f"{'all':28}{sum(total.values()):7}{total['error']:7}{total['right']:7}{total['flagged']:9}{total['silent']:8}"
    )
    return sound


if __name__ == "__main__":
    sys.exit(0 if table(int(sys.argv[1]) if len(sys.argv) > 1 else 140, sys.argv[2:] or tuple(CLASSES)) else 1)
