"""Broken heads of every registered format: a recording or one error of elid's own, never an exception of the reader."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import ElidError
from elid_cli.logs import read_recording, write_recording
from elid_cli.logs.contract import LogFormat
from elid_cli.logs.inspect import inspect_log
from elid_cli.logs.source import open_source
from elid_cli.logs.writing import formats, recognise
from elid_cli.robot.files import read_robot
from elid_cli.signals.recording import Recording
from tests.system import field_logs
from tests.system.hostile.hostile import ROBOT, base

SAMPLES = 60
HEAD = 400
"""Bytes that count as the head of a file."""
TRIES = 40
WORDS = (b"5", b"-1", b"1e999", b"nan", b"null", b"[]", b"{}", b'""', b"", b"\xff\xfe", b"0" * 400)
"""What a word of a text is replaced by."""
OTHERS = ("packed", "foreign")
"""Formats that hold files of other formats, or none that is read."""

Maker = Callable[[Path, Recording], Path]


def archive(folder: Path, log: Recording) -> Path:
    np.savez(path := folder / "log.npz", t=log.t, q=log.q, theta=log.theta, tau=log.tau)
    return path


MAKERS: dict[str, Maker] = {
    "JSON lines": field_logs.json_lines,
    "MATLAB": field_logs.old_matlab,
    "NumPy": archive,
    "Parquet": field_logs.parquet,
    "ros2 topic echo": field_logs.topic_echo,
    "rosbag2": field_logs.rosbag_mcap,
    "rosbag2 SQLite": lambda folder, log: next(field_logs.rosbag_sqlite(folder, log).glob("*.db3")),
}
"""Formats that elid does not write -> how a test does."""
READ = [fmt for fmt in formats() if fmt.name not in OTHERS]


def good(fmt: LogFormat, folder: Path) -> Path:
    """Return a good file, or folder, of a format."""
    log = base(SAMPLES)
    log = replace(log, dq=np.gradient(log.q, log.dt, axis=0))
    if fmt.write is None:
        return MAKERS[fmt.name](folder, log)
    path = folder / f"log{fmt.suffixes[0]}"
    write_recording(log, path)
    return path


def broken(data: bytes, chance: random.Random) -> bytes:
    """Return a file whose head is changed in one place or two: bytes, words, what is there twice, what is cut."""
    head, rest = bytearray(data[:HEAD]), data[HEAD:]
    for _ in range(chance.randint(1, 2)):
        at = chance.randrange(max(len(head), 1))
        words = list(re.finditer(rb"[\w.\-]+", bytes(head)))
        word = chance.choice(words) if words else None
        kind = chance.randrange(6)
        if kind == 0:
            head[at : at + 1] = bytes([chance.randrange(256)])
        elif kind == 1:
            del head[at : at + chance.choice((1, 4, 40))]
        elif kind == 2:
            return bytes(head[:at])
        elif word is not None:  # a word by another one of the head, or by one that means something else
            other = chance.choice(words)[0] if kind == 3 else chance.choice(WORDS)
            head[word.start() : word.end()] = other
    return bytes(head) + rest


def test_every_format_is_written_here_or_by_elid() -> None:
    unwritten = {fmt.name for fmt in READ if fmt.write is None}
    assert unwritten <= MAKERS.keys(), "give MAKERS a writer of the new format, or the format a `write`"


@pytest.mark.parametrize("fmt", READ, ids=lambda fmt: fmt.name)
def test_a_broken_head_is_one_error_or_a_recording(tmp_path: Path, fmt: LogFormat) -> None:
    path, robot = good(fmt, tmp_path), read_robot(ROBOT)
    assert recognise(open_source(path)).name == fmt.name
    file = path / "metadata.yaml" if path.is_dir() else path
    data, refused = file.read_bytes(), 0
    for seed in range(TRIES):
        file.write_bytes(broken(data, random.Random(f"{fmt.name} {seed}")))
        for read in (lambda: read_recording([path], robot), lambda: inspect_log(path, robot)):
            try:
                read()
            except ElidError as error:
                refused += bool(error.message)
            except Exception as error:
                error.add_note(f"seed {seed} of {fmt.name}: raise LogError for what a damaged file holds")
                raise
    assert refused or path.is_dir()  # a bag is read without its metadata as well
