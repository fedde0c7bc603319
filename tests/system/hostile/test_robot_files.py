"""Robot files and mappings that are bombs, cycles, tags, folders, pipes, or of another robot."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import peaks
from tests.system.hostile.hostile import elid, one_message, refused, used
from tests.system.hostile.test_csv_files import saved, table

SHIPPED = (Path(__file__).parents[3] / "robots" / "planar2.yaml").read_text()
LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12)
)
MERGES = "a0: &a0 {x: 1}\n" + "".join(f"a{k}: &a{k}\n  <<: [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))
FAULTS: dict[str, tuple[str, str]] = {
    "billion laughs": (LAUGHS + SHIPPED, "through aliases"),
    "billion merges": (MERGES + SHIPPED, "through aliases"),
    "many aliases": ("a: &a 1\nb: [" + "*a," * 2000 + "]\n", "aliases"),
    "cyclic anchor": ("name: &a [*a]\n", "contains itself"),
    "cyclic merge": ("joints: &a\n  <<: *a\n", "contains itself"),
    "python tag": ("name: !!python/object/apply:os.system ['touch pwned']\n", "tag"),
    "own tag": ("name: !robot x\n", "tag"),
    "megabyte string": ("name: " + "x" * 2_000_000, "at most"),
    "deep nesting": ("name: " + "[" * 5000, "nested deeper"),
    "binary": ("name: \x00\x01", "special characters"),
    "two documents": ("---\nname: a\n---\nname: b\n", "document"),
    "unknown key": (SHIPPED.replace("gear_ratio: 0.1", "gear_ration: 0.1", 1), "'gear_ratio'"),
    "missing key": (SHIPPED.replace("    alpha: 0\n", "", 1), "missing key 'alpha'"),
    "not finite": (SHIPPED.replace("d: 0", "d: .inf", 1), "joint1: d"),
    "huge exponent": (SHIPPED.replace("d: 0", "d: 9**9**9**9", 1), "joint1: d"),
    "code for a number": (SHIPPED.replace("d: 0", "d: __import__('os').getpid()", 1), "joint1: d"),
    "no joints": ("name: a\ngravity: [0, 0, -9.81]\ndh: standard\njoints: []\n", "joint"),
    "empty": ("", "empty"),
}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return saved(tmp_path, table().text())


@pytest.mark.parametrize("name", FAULTS)
def test_descriptions_that_do_harm_are_refused_at_once(tmp_path: Path, log: Path, name: str) -> None:
    text, word = FAULTS[name]
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    before, begin = peaks.begin(), time.perf_counter()
    refused(log, "robot.yaml", word, code=2, robot=path)
    assert time.perf_counter() - begin < 20
    assert peaks.since() - before < 300
    assert not Path("pwned").exists()


@pytest.mark.parametrize(
    "name", ["billion laughs", "billion merges", "cyclic anchor", "python tag", "deep nesting", "megabyte string"]
)
def test_mappings_that_do_harm_are_refused_at_once(tmp_path: Path, log: Path, name: str) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(FAULTS[name][0])
    refused(log, "map", code=2, more=("--map", path))


def folder(path: Path) -> None:
    path.mkdir()


def unreadable(path: Path) -> None:
    path.write_text(SHIPPED)
    path.chmod(0)
    if os.access(path, os.R_OK):
        pytest.skip("this user reads everything")


def dangling(path: Path) -> None:
    path.symlink_to("nowhere")


def endless(path: Path) -> None:
    path.symlink_to(path.name)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


@pytest.mark.parametrize("make", [folder, os.mkfifo, unreadable, dangling, endless, device])
@pytest.mark.parametrize("what", ["robot", "map", "log"])
def test_paths_that_are_no_files(tmp_path: Path, log: Path, what: str, make: Callable[[Path], None]) -> None:
    path = tmp_path / f"odd.{'csv' if what == 'log' else 'yaml'}"
    make(path)
    if what == "robot":
        refused(log, "odd.yaml", code=2, robot=path)
    elif what == "map":
        refused(log, "odd.yaml", code=2, more=("--map", path))
    else:
        refused(path, "odd.csv")


def test_a_robot_with_other_joints_lists_those_of_the_log(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "other.yaml"
    path.write_text(SHIPPED.replace("name: joint1", "name: shoulder").replace("name: joint2", "name: elbow"))
    refused(log, "no position for shoulder", "theta.joint1", robot=path)
    path.write_text(SHIPPED.replace("name: joint2", "name: joint_2"))
    refused(log, "no position for joint_2", "names joint1 joint2", robot=path)
    refused(log, "joint3", robot="puma560")
    done = elid("identify", log, "--robot", "planar3")
    assert done.code == 2
    one_message(done, "planar3", "did you mean 'planar2'?")


def test_anchors_and_aliases_that_are_fine_are_read(tmp_path: Path, log: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(SHIPPED.replace("alpha: 0", "alpha: &zero 0", 1).replace("alpha: 0\n", "alpha: *zero\n"))
    used(log, robot=path, tolerance=1e-9)
