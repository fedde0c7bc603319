"""`elid sample`: sets as tables, ranges and robot files."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from elid_cli.robot.files import read_robot
from tests.cli.conftest import Elid

SAMPLES = Path(__file__).parents[2] / "sample_logs"


@pytest.fixture(scope="module")
def folder(elid: Elid, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a saved result, one of old without covariance, and broken ones."""
    place = tmp_path_factory.mktemp("sample")
    done = elid("identify", str(SAMPLES / "planar2.h5"), "--robot", "planar2", "--json", cwd=place)
    result = json.loads(done.stdout)
    saved = {
        "result.json": result,
        "old.json": {key: value for key, value in result.items() if key != "covariance"},
        "short.json": result | {"covariance": result["covariance"][:-1]},
        "negative.json": result | {"covariance": (-np.array(result["covariance"])).tolist()},
        "words.json": result | {"covariance": [["much"] * len(result["covariance"])] * len(result["covariance"])},
        "refused.json": result | {"base_parameters": [{**e, "estimate": None} for e in result["base_parameters"]]},
        "other.json": result | {"joints": ["a", "b"]},
    }
    for name, content in saved.items():
        (place / name).write_text(json.dumps(content), "utf-8")
    return place


def result_of(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "result.json").read_text("utf-8"))
    return found


def test_the_result_has_the_covariance_of_its_standard_errors(folder: Path) -> None:
    result = result_of(folder)
    covariance = np.array(result["covariance"], dtype=float)
    assert np.sqrt(np.diag(covariance)) == pytest.approx([e["std_error"] for e in result["base_parameters"]])
    assert covariance == pytest.approx(covariance.T)


def test_sets_have_the_covariance_of_the_result(elid: Elid, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "sets.npz"
    done = elid("sample", "result.json", "-n", "20000", "-o", str(out), cwd=folder)
    assert done.returncode == 0, done.stderr
    result = result_of(folder)
    deviation = np.array([e["std_error"] for e in result["base_parameters"]])
    with np.load(out) as sets:
        assert sets["names"].tolist() == [e["name"] for e in result["base_parameters"]]
        assert set(sets["origin"].tolist()) == {"drawn"}
        drawn = np.cov(sets["values"].T) / np.outer(deviation, deviation)
    assert drawn == pytest.approx(np.array(result["covariance"]) / np.outer(deviation, deviation), abs=0.04)


def test_tables_of_all_kinds_hold_the_same_sets(elid: Elid, folder: Path, tmp_path: Path) -> None:
    names = [str(tmp_path / f"sets.{suffix}") for suffix in ("csv", "json", "npz")]
    printed = json.loads(elid("sample", "result.json", "-n", "5", "--seed", "7", "--json", cwd=folder).stdout)
    for name in names:
        done = elid("sample", "result.json", "-n", "5", "--seed", "7", "-o", name, "--json", cwd=folder)
        assert "samples" not in json.loads(done.stdout)
    with Path(names[0]).open(encoding="utf-8", newline="") as file:
        head, *rows = list(csv.reader(file))
    assert head == [entry["name"] for entry in printed["parameters"]]
    assert [[float(v) for v in row] for row in rows] == printed["samples"]
    assert json.loads(Path(names[1]).read_text("utf-8"))["samples"] == printed["samples"]
    assert np.load(names[2])["values"].tolist() == printed["samples"]
    other = json.loads(elid("sample", "result.json", "-n", "5", "--seed", "8", "--json", cwd=folder).stdout)
    assert other["samples"] != printed["samples"]


def test_ranges_hold_the_middle_of_the_sets(elid: Elid, folder: Path, tmp_path: Path) -> None:
    ranges = tmp_path / "ranges.yaml"
    done = elid("sample", "result.json", "-n", "400", "--ranges", str(ranges), "--json", cwd=folder)
    answer = json.loads(done.stdout)
    read = yaml.safe_load(ranges.read_text("utf-8"))["parameters"]
    values = np.array(answer["samples"])
    for k, entry in enumerate(answer["parameters"]):
        low, high = read[entry["name"]]["low"], read[entry["name"]]["high"]
        assert (low, high) == (entry["low"], entry["high"])
        assert np.mean((values[:, k] >= low) & (values[:, k] <= high)) == pytest.approx(0.95, abs=0.003)


def test_robot_files_have_the_sets_values(elid: Elid, folder: Path, tmp_path: Path) -> None:
    place = tmp_path / "robots"
    done = elid("sample", "result.json", "-n", "3", "--robot", "planar2", "-o", str(place), cwd=folder)
    assert done.returncode == 0, done.stderr
    files = sorted(place.glob("set_*.yaml"))
    assert [file.name for file in files] == ["set_1.yaml", "set_2.yaml", "set_3.yaml"]
    with (place / "sets.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    result = result_of(folder)
    for file, row in zip(files, rows, strict=True):
        robot = read_robot(file)
        values = dict(zip(map(str, robot.parameter_names()), robot.reference().tolist(), strict=True))
        assert values == {name: float(value) for name, value in row.items()}
        for entry in result["base_parameters"]:
            base = sum(factor * values[name] for name, factor in entry["terms"].items())
            assert abs(base - entry["estimate"]) < 6 * entry["std_error"]  # Izz1 …: every base parameter as drawn


def test_a_folder_with_sets_of_an_earlier_run_is_refused(elid: Elid, folder: Path, tmp_path: Path) -> None:
    """Fewer sets than before would leave the others between the new ones; nothing of the folder is touched."""
    place = tmp_path / "robots"
    place.mkdir()
    (place / "notes.txt").write_text("mine")
    line = ("sample", "result.json", "--robot", "planar2", "-o", str(place), "-n")
    assert elid(*line, "3", cwd=folder).returncode == 0
    before = {file.name: file.read_bytes() for file in place.iterdir()}
    assert before["notes.txt"] == b"mine"
    done = elid(*line, "2", "--seed", "5", cwd=folder)
    assert done.returncode == 2
    assert f"-o {place}: holds parameter sets already: set_1.yaml and 3 more" in done.stderr
    assert {file.name: file.read_bytes() for file in place.iterdir()} == before
    for name in before.keys() - {"notes.txt", "sets.csv"}:
        (place / name).unlink()
    assert "already: sets.csv" in elid(*line, "2", cwd=folder).stderr


MJCF = """<mujoco model="pendulum">
  <compiler angle="radian"/>
  <worldbody>
    <body name="arm" pos="0 0 1">
      <joint name="swing" type="hinge" axis="0 1 0" armature="0.05" damping="0.1" frictionloss="0.05"/>
      <inertial pos="0 0 -0.4" mass="2" fullinertia="0.1 0.1 0.02 0 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


def pendulum(folder: Path, **estimates: tuple[float, float]) -> list[str]:
    """Write a pendulum and a result on it, (estimate, standard error) by name; return both files' names."""
    robot = folder / "pendulum.xml"
    robot.write_text(MJCF, "utf-8")
    names = {"cx1": "cx1", "Iyy1 + Ja1": "Iyy1", "fs1": "fs1", "fv1": "fv1"}
    reference = dict(
        zip(map(str, (read := read_robot(robot)).parameter_names()), read.reference().tolist(), strict=True)
    )
    entries, variances = [], []
    for name in names:
        parts = name.split(" + ")
        true = sum(reference[p] for p in parts)
        value, error = estimates.get(parts[0], (true, 0.01 * abs(true) + 1e-4))
        entries.append({"name": name, "unit": "", "terms": dict.fromkeys(parts, 1.0), "estimate": value,
                        "std_error": error, "reference": true})  # fmt: skip
        variances.append(error**2)
    result = {"schema": "elid/1", "command": "identify", "robot": "pendulum", "joints": ["swing"],
              "base_parameters": entries, "covariance": np.diag(variances).tolist()}  # fmt: skip
    (folder / "pendulum.json").write_text(json.dumps(result), "utf-8")
    return ["pendulum.json", "pendulum.xml"]


def test_an_mjcf_is_patched_with_bodies_that_could_be_built(elid: Elid, tmp_path: Path) -> None:
    result, robot = pendulum(tmp_path)
    line = ["sample", result, "-n", "20", "--robot", robot, "-o", "robots", "--json"]
    done = elid(*line, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    origin = {entry["name"]: entry["origin"] for entry in answer["parameters"]}
    assert {origin[name] for name in ("cx1", "fs1", "fv1")} == {"drawn"}
    assert {origin[name] for name in ("Ja1", "Iyy1")} == {"split"}
    mujoco = pytest.importorskip("mujoco")
    armature = [mujoco.MjModel.from_xml_path(str(f)).dof_armature[0] for f in sorted(tmp_path.glob("robots/*.xml"))]
    assert len(armature) == 20
    assert np.std(armature) > 0


def test_bodies_that_nobody_could_build_are_the_robots_own(elid: Elid, tmp_path: Path) -> None:
    """A centre of mass a metre off no body of that inertia has: armature is what is left of the sum."""
    moment = 0.1 + 2 * 0.4**2
    result, robot = pendulum(tmp_path, cx1=(2.0, 0.3), Iyy1=(moment + 0.07, 0.002), fs1=(0.002, 0.004))
    done = elid("sample", result, "-n", "300", "--robot", robot, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    entries = {entry["name"]: entry for entry in answer["parameters"]}
    assert "held at those of pendulum" in " ".join(answer["notes"])
    assert {entries[name]["origin"] for name in ("m1", "cx1", "Iyy1")} == {"held"}
    assert entries["Iyy1"]["std"] == 0
    assert entries["Ja1"]["mean"] == pytest.approx(0.07, abs=0.02)
    assert entries["fs1"]["low"] > 0


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("old.json", "old.json: holds no covariance of its estimates"),
        ("short.json", "short.json: the covariance is not a matrix of 14 rows and columns"),
        ("negative.json", "negative.json: not a covariance"),
        ("words.json", "words.json: expected a number in the result"),
        ("refused.json", "refused.json: every base parameter is refused"),
        ("missing.json", "missing.json: no such file"),
        ("other.json --robot planar2", "planar2: its joints are not those of other.json"),
        ("result.json --robot puma560", "puma560: its joints are not those of result.json"),
        ("result.json -o folder", "-o folder: a folder is for robot files"),
        ("result.json -o sets.xlsx", "sets.xlsx: not a name for parameter sets"),
        ("result.json -o result.json", "the same file as result.json, which is read"),
        ("result.json --ranges nowhere/r.yaml", "no folder nowhere"),
        ("result.json -n 0", "--count: 0 is not in the range"),
    ],
)
def test_what_cannot_be_done_is_one_error(elid: Elid, folder: Path, line: str, words: str) -> None:
    done = elid("sample", *line.split(), cwd=folder)
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) <= 3
