"""Files that are read are never written over, and files that are written keep their links, devices and modes."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import numpy as np
import pytest

from elid_cli.files import replacing
from elid_cli.logs import write_recording
from elid_cli.robot.files import read_robot, write_robot
from tests.system.hostile.hostile import ROBOT, base, elid, one_message


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_recording(base(), "log.csv")
    Path("log.txt").write_bytes(Path("log.csv").read_bytes())
    Path("link.md").symlink_to("log.txt")
    Path("hard.csv").hardlink_to("log.csv")
    Path("map.txt").write_text("q: {from: 'q.{joint}'}\n")
    for name in ("a.json", "b.json"):
        Path(name).write_text(elid("identify", "log.csv", "--robot", ROBOT, "--json").out)
    write_robot(read_robot(ROBOT), "arm.yaml")
    Path("bag").mkdir()
    Path("bag/metadata.md").write_text("x")
    return tmp_path


LINES = [
    "identify log.txt --report log.txt --robot planar2",
    "identify log.txt --report link.md --robot planar2",
    "diagnose log.csv --report ./log.txt --check log.txt --robot planar2",
    "excite --robot planar2 --after log.csv -o log.csv",
    "excite --robot planar2 --after log.csv -o hard.csv",
    "simulate --robot planar2 --reference log.csv -o log.csv",
    "simulate --robot planar2 --reference log.csv -o out.csv --truth log.csv",
    "simulate --robot planar2 -o out.csv --truth ./out.csv",
    "compare a.json b.json --report a.json",
    "identify log.csv --robot planar2 --map map.txt --report map.txt",
    "identify log.csv --robot arm.yaml --write-robot arm.yaml",
    "identify log.csv --robot planar2 --report x.md --report ./x.md",
    "identify log.csv --robot planar2 --report x.yaml --write-robot x.yaml",
    "reduce log.csv --robot planar2 -o log.csv",
    "identify bag --robot planar2 --report bag/metadata.md",
]


@pytest.mark.parametrize("line", LINES)
def test_an_input_is_never_written_over(place: Path, line: str) -> None:
    before = {p: p.read_bytes() for p in place.iterdir() if p.is_file()}
    done = elid(*line.split())
    assert done.code == 2, done
    assert done.out == ""
    one_message(done, "file" if "bag" not in line else "folder")
    assert {p: p.read_bytes() for p in place.iterdir() if p.is_file()} == before


def test_outputs_of_their_own_and_devices_are_written(place: Path) -> None:
    done = elid("identify", "log.csv", "--robot", ROBOT, "--report", "x.md", "--report", "x.txt", "--report", "x.json")
    assert (done.code, done.err) == (0, "")
    done = elid("simulate", "--robot", ROBOT, "--duration", "1", "-o", "new.csv", "--truth", "new.h5")
    assert done.code == 0, done.err


@pytest.mark.parametrize("name", ["", "  "])
def test_an_empty_name_is_no_log(place: Path, name: str) -> None:
    write_recording(base(), "one.mcap")
    for line in (["identify", name, "--robot", ROBOT], ["info", name], ["compare", name, "a.json"]):
        done = elid(*line)
        assert done.code == 2, done
        one_message(done, "empty name")


def test_one_writer_keeps_links_modes_and_devices(tmp_path: Path) -> None:
    real, link = tmp_path / "real.csv", tmp_path / "link.csv"
    real.write_text("old")
    real.chmod(0o600)
    link.symlink_to(real)
    null = tmp_path / "null.csv"
    null.symlink_to("/dev/null")
    for target in (link, null):
        write_recording(base(), target)
    assert link.is_symlink()
    assert null.is_symlink()
    assert stat.S_IMODE(real.stat().st_mode) == 0o600
    assert real.read_text().startswith("t,")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


def test_a_file_beside_is_never_more_readable_than_the_one_it_replaces(tmp_path: Path) -> None:
    target, trap = tmp_path / "a.txt", tmp_path / f".a.{os.getpid()}.part.txt"
    target.write_text("old")
    target.chmod(0o600)
    trap.symlink_to(tmp_path / "elsewhere")
    with replacing(target) as beside:
        assert beside == trap
        assert stat.S_IMODE(beside.stat().st_mode) == 0o600
        beside.write_text("new")
    assert not (tmp_path / "elsewhere").exists()
    assert target.read_text() == "new"


def test_a_pipe_receives_the_log(tmp_path: Path) -> None:
    import threading

    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_recording(base(), pipe)
    reader.join(10)
    assert np.loadtxt(got[0].decode().splitlines()[1:], delimiter=",").shape[0] == base().samples
    assert pipe.is_fifo()


def test_a_pipe_is_written_once(tmp_path: Path) -> None:
    """Its hash is of what was written: reading it again would wait for a writer for ever."""
    import hashlib
    import json
    import subprocess
    import sys

    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    line = [sys.executable, "-m", "elid_cli", "simulate", "--robot", "planar2", "--duration", "1", "-o", pipe, "--json"]
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        done = subprocess.run(line, capture_output=True, check=True, timeout=60)
        got = reader.communicate(timeout=10)[0]
    assert json.loads(done.stdout)["log"]["sha256"] == [hashlib.sha256(got).hexdigest()]
