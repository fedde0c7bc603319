"""Full disks, closed pipes, Ctrl-C at any time, read-only folders: no partial output, the right status."""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from elid_cli.files import filling
from tests.cli.conftest import interruptible
from tests.system.hostile.hostile import ROBOT, elid, one_message
from tests.system.hostile.test_csv_files import saved, table

COMMAND = (sys.executable, "-m", "elid_cli")
# on a full disk Python leaves half a .pyc file behind, on which every later import of that module would fail
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
OLD = "name: the file that was there\n"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("ends"), table().text())


def arguments_alone(log: Path) -> list[str]:
    """Return a command that prints a result."""
    return [*COMMAND, "identify", str(log), "--robot", ROBOT, "--json"]


def arguments(log: Path, folder: Path) -> list[str]:
    """Return a command that writes three files."""
    files = ["--write-robot", "found.yaml", "--report", "report.html", "--report", "report.json"]
    named = [str(folder / one) if not one.startswith("--") else one for one in files]
    return ["identify", str(log), "--robot", ROBOT, "--json", *named]


def whole(folder: Path, *, old: bool) -> None:
    """Assert that every file in a folder is whole, or as it was."""
    for path in folder.iterdir():
        assert not path.name.startswith("."), f"{path.name} was left behind"
        text = path.read_text()
        if old and text == OLD:
            continue
        if path.suffix == ".json":
            json.loads(text)
        elif path.suffix == ".html":
            assert text.rstrip().endswith("</html>")
        else:
            done = elid("classify", "--robot", path)
            assert done.code == 0, done.err


@pytest.mark.parametrize("old", [False, True])
def test_control_c_at_any_time_leaves_whole_files(log: Path, tmp_path: Path, old: bool) -> None:
    generator = random.Random(5 + old)
    codes = []
    for k in range(4):
        folder = tmp_path / str(k)
        folder.mkdir()
        if old:
            for name in ("found.yaml", "report.html", "report.json"):
                (folder / name).write_text(OLD)
        with subprocess.Popen(
            [*COMMAND, *arguments(log, folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT,
            preexec_fn=interruptible,
        ) as process:  # fmt: skip
            time.sleep(0.25 + generator.random() * 1.5)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=60)
        codes.append(process.returncode)
        # before elid has begun, Python itself ends by the signal
        assert process.returncode in (0, 130, -signal.SIGINT), err
        if process.returncode == 130:
            assert b"Traceback" not in err
            assert b"error" not in err
        assert out == b"" or json.loads(out)["schema"] == "elid/1"
        whole(folder, old=old)
    assert set(codes) & {0, 130}


def limited(size: int) -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # as on a full disk: an error, not a signal
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.parametrize("size", [0, 3000])
def test_a_disk_that_is_full_leaves_what_was_there(log: Path, tmp_path: Path, size: int) -> None:
    for name in ("found.yaml", "report.html", "report.json"):
        (tmp_path / name).write_text(OLD)
    done = subprocess.run(
        [*COMMAND, *arguments(log, tmp_path)], capture_output=True, env=ENVIRONMENT, timeout=120, check=False,
        preexec_fn=lambda: limited(size),
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert b"cannot be written" in done.stderr
    assert b"file too large" in done.stderr
    assert b"Traceback" not in done.stderr
    assert done.stderr.count(b"error:") == 1
    whole(tmp_path, old=True)


@pytest.mark.parametrize("there", [False, True])
def test_a_folder_of_sets_is_filled_or_left_as_it_was(log: Path, tmp_path: Path, there: bool) -> None:
    result, sets = tmp_path / "result.json", tmp_path / "sets"
    result.write_bytes(subprocess.run(arguments_alone(log), capture_output=True, env=ENVIRONMENT, check=True).stdout)
    if there:
        sets.mkdir()
        (sets / "mine.txt").write_text(OLD)
    command = [*COMMAND, "sample", str(result), "--robot", ROBOT, "-n", "100", "-o", str(sets)]
    done = subprocess.run(  # a robot file has 2 kB, the table of 100 sets ten times as much
        command, capture_output=True, env=ENVIRONMENT, check=False, preexec_fn=lambda: limited(10_000)
    )
    assert done.returncode == 2, done.stderr
    assert b"sets.csv: cannot be written" in done.stderr
    assert [item.name for item in sets.iterdir()] == ["mine.txt"] if there else not sets.exists()
    done = subprocess.run(command, capture_output=True, env=ENVIRONMENT, check=False)
    assert done.returncode == 0, done.stderr
    assert len(list(sets.iterdir())) == 101 + there


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("form", ["--json", "--markdown", "--all"])
def test_standard_output_on_a_full_disk(log: Path, form: str) -> None:
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [*COMMAND, "identify", str(log), "--robot", ROBOT, form],
            stdout=full, stderr=subprocess.PIPE, env=ENVIRONMENT, timeout=120, check=False,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == b"error: standard output: no space left on device\n"


@pytest.mark.parametrize("verb", ["identify", "info"])
def test_a_closed_pipe_is_quiet(log: Path, tmp_path: Path, verb: str) -> None:
    robot = f"--robot {ROBOT} --write-robot {tmp_path}/found.yaml" if verb == "identify" else ""
    line = f"{sys.executable} -m elid_cli {verb} {log} {robot} --json | head -c 20; echo ${{PIPESTATUS[0]}} >&2"
    done = subprocess.run(["bash", "-c", line], capture_output=True, env=ENVIRONMENT, timeout=120, check=False)
    assert len(done.stdout) == 20
    assert done.stderr.strip() in (b"0", b"141")
    whole(tmp_path, old=False)
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [*COMMAND, verb, str(log), *robot.split()], stdout=write, stderr=subprocess.PIPE, env=ENVIRONMENT, timeout=120,
        check=False,
    )  # fmt: skip
    os.close(write)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.parametrize("option", ["--write-robot", "--report"])
@pytest.mark.parametrize("where", ["no such folder", "a folder", "read-only"])
def test_what_cannot_be_written_is_one_message(log: Path, tmp_path: Path, option: str, where: str) -> None:
    suffix = "yaml" if option == "--write-robot" else "md"
    place = {"no such folder": tmp_path / "none" / f"x.{suffix}", "a folder": tmp_path / f"folder.{suffix}",
             "read-only": tmp_path / "locked" / f"x.{suffix}"}[where]  # fmt: skip
    if where == "a folder":
        place.mkdir()
    if where == "read-only":
        place = Path(f"/proc/elid.{suffix}")  # nobody writes there, root neither
    done = elid("identify", log, "--robot", ROBOT, option, place)
    assert done.code == 2, done
    one_message(done, place.name)
    assert done.out == "" or where == "read-only"
    assert not list(tmp_path.rglob("*.part*"))


def test_two_runs_give_the_same_bytes(log: Path, tmp_path: Path) -> None:
    made = []
    for _ in range(2):
        for verb in ("identify", "diagnose"):
            file = tmp_path / f"{verb}.yaml"
            done = elid(verb, log, "--robot", ROBOT, "--json", "--write-robot", file)
            made.append((done.code, done.out, file.read_bytes()))
    assert made[:2] == made[2:]
    other = subprocess.run(
        [*COMMAND, "identify", str(log), "--robot", ROBOT, "--json"], capture_output=True, timeout=120, check=False,
        env={**ENVIRONMENT, "PYTHONHASHSEED": "1", "LC_ALL": "C"},
    )  # fmt: skip
    assert json.loads(other.stdout) == elid("identify", log, "--robot", ROBOT, "--json").json


def half_filled(folder: Path, others: dict[str, str]) -> None:
    """Begin to fill a folder, into which others write meanwhile, and be interrupted."""
    with filling(folder) as within:
        for name in ("new.csv", *(item.name for item in folder.iterdir())):
            within(name).write_text("half")
        for name, text in others.items():
            (folder / name).write_text(text)
        raise KeyboardInterrupt


@pytest.mark.parametrize("there", [False, True])
def test_a_folder_that_is_not_filled_to_the_end_loses_its_new_files_alone(tmp_path: Path, there: bool) -> None:
    folder = tmp_path / "sets"
    if there:
        folder.mkdir()
        (folder / "old.csv").write_text(OLD)
    with pytest.raises(KeyboardInterrupt):
        half_filled(folder, {"of another.csv": OLD} if there else {})
    assert folder.exists() == there
    assert not there or {item.name for item in folder.iterdir()} == {"old.csv", "of another.csv"}
