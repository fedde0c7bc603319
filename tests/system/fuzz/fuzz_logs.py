"""Mutate good logs and read them: every input ends in a recording or in one ElidError, quickly and in little memory.

    python -m tests.system.fuzz.fuzz_logs [inputs, default 2000] [seed]

Prints how many inputs were tried and how each kind ended. An input that ends otherwise is kept as `crash-*`.
"""

from __future__ import annotations

import collections
import resource
import sys
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType

from elid_cli.errors import ElidError
from elid_cli.logs import read_recording, write_recording
from elid_cli.logs.inspect import inspect_log
from elid_cli.signals.recording import Recording
from tests.logs.made_logs import ROBOT, recording
from tests.logs.mcap_made import canonical
from tests.system.field_logs import json_lines, old_matlab

WORDS = (0, 1, 2**31, 2**40, 2**60, 2**64 - 1)
HALVES = (0, 1, 255, 2**16, 2**31, 2**32 - 1)
SLOWEST = 10.0
"""s for one input."""


def seeds(folder: Path) -> dict[str, bytes]:
    """Return the good files."""
    base = recording(60)
    made = {}
    for name in ("a.csv", "a.csv.gz", "a.h5"):
        write_recording(base, folder / name)
        made[name] = (folder / name).read_bytes()
    for name, options in {
        "zstd": {"chunk_size": 1500},
        "none": {"chunk_size": 1500, "compression": CompressionType.NONE, "enable_crcs": False},
        "lz4": {"chunk_size": 1500, "compression": CompressionType.LZ4},
        "loose": {"use_chunking": False, "enable_crcs": False},
        "json": {"encoding": "json", "compression": CompressionType.NONE, "enable_crcs": False},
    }.items():
        made[f"{name}.mcap"] = canonical(folder / "x.mcap", base, **options).read_bytes()
    for name, write in {"a.jsonl": json_lines, "a.mat": old_matlab, "a.npy": plain_array}.items():
        made[name] = write(folder, base).read_bytes()
    return made


def plain_array(folder: Path, log: Recording) -> Path:
    np.save(path := folder / "a.npy", np.hstack([log.t[:, None], log.q, log.theta, log.tau]))
    return path


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Return a file with a few bytes, words or stretches changed, cut, doubled or swapped."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(0, max(len(out), 1)))
        length = int(rng.choice([1, 2, 4, 8, 30, 200]))
        kind = rng.integers(0, 8)
        if kind == 0:
            out[at : at + length] = rng.integers(0, 256, length, dtype=np.uint8).tobytes()
        elif kind == 1:
            del out[at : at + length]
        elif kind == 2:
            out[at:at] = out[at : at + length]
        elif kind == 3:
            out[at : at + 8] = WORDS[rng.integers(len(WORDS))].to_bytes(8, "little")
        elif kind == 4:
            out[at : at + 4] = HALVES[rng.integers(len(HALVES))].to_bytes(4, "little")
        elif kind == 5:
            del out[at:]
        elif kind == 6:
            other = int(rng.integers(0, max(len(out), 1)))
            out[at : at + length], out[other : other + length] = out[other : other + length], out[at : at + length]
        else:
            out[at : at + 1] = bytes([out[at] ^ (1 << int(rng.integers(0, 8)))]) if at < len(out) else b""
    return bytes(out)


def outcome(path: Path) -> str:
    """Read one file as both commands do; return how it ended."""
    ended = "recording"
    try:
        got = read_recording([path], ROBOT)
        _sound(got)
    except ElidError as error:
        ended = type(error).__name__
        if not error.message:
            raise AssertionError("an error without a message") from error
    try:
        inspect_log(path, ROBOT)
    except ElidError:
        ended += ", not inspected"
    return ended


def _sound(got: Recording) -> None:
    """Check what every recording promises."""
    assert got.samples >= 20
    for signal in (got.q, got.theta, got.tau):
        assert signal.shape == (got.samples, 3)
        finite = np.isfinite(signal)
        assert (finite.all(axis=0) | ~finite.any(axis=0)).all(), "a column is neither whole nor absent"
    for segment in got.segments:
        steps = np.diff(got.t[segment.start : segment.stop])
        assert np.allclose(steps, got.dt, rtol=1e-6, atol=1e-9), "a segment is not even"


def run(count: int, seed: int, keep: Path | None = None) -> collections.Counter[str]:
    """Try `count` inputs; raise at the first that ends neither in a recording nor in an ElidError."""
    rng = np.random.default_rng(seed)
    ends: collections.Counter[str] = collections.Counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = seeds(folder)
        kinds = list(made)
        for k in range(count):
            kind = kinds[k % len(kinds)]
            data = mutated(made[kind], rng)
            path = folder / "input"
            path.write_bytes(data)
            begin = time.perf_counter()
            try:
                ends[f"{kind}: {outcome(path)}"] += 1
            except BaseException:
                if keep is not None:
                    (keep / f"crash-{seed}-{k}-{kind}").write_bytes(data)
                    traceback.print_exc()
                    ends[f"{kind}: CRASH"] += 1
                    continue
                raise
            assert time.perf_counter() - begin < SLOWEST, f"input {k} of seed {seed} took too long"
    return ends


if __name__ == "__main__":
    inputs = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    found = run(inputs, int(sys.argv[2]) if len(sys.argv) > 2 else 0, Path.cwd())
    for ended, number in sorted(found.items()):
        print(f"{number:8d}  {ended}")
    print(f"{inputs} inputs, {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB at most")
