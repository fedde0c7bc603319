"""Logs reduced to triangles: identified from these, alone or merged, they say what the logs themselves say."""

from __future__ import annotations

import json
import subprocess
import zipfile
from concurrent.futures import Future
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import LogError, UsageError
from elid_cli.estimation.identify import identify
from elid_cli.estimation.result import Identification
from elid_cli.estimation.streaming.files import read_triangles, write_triangles
from elid_cli.estimation.streaming.fleet import Job, _collected, reduce_jobs
from elid_cli.estimation.streaming.merge import identify_reduced
from elid_cli.estimation.streaming.reduce import reduce_log
from elid_cli.estimation.streaming.stored import is_triangle_file
from elid_cli.logs import read_recording, write_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.text import text_of
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests import forked

LOGS = Path(__file__).parents[3] / "sample_logs"


def cut(recording: Recording, start: int, stop: int) -> Recording:
    part = slice(start, stop)
    kept = replace(recording, t=recording.t[part] - recording.t[start], q=recording.q[part],
                   theta=recording.theta[part], tau=recording.tau[part])  # fmt: skip
    optional = {name: None for name in ("dq", "dtheta", "tau_link", "temperature")}
    return replace(kept, segments=(Segment(0, stop - start),), **optional)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with one log of the PUMA 560 cut in two of unequal length, a.h5 and b.h5."""
    folder = tmp_path_factory.mktemp("fleet")
    recording = read_recording([LOGS / "puma560.h5"], read_robot("puma560"))
    middle = int(0.4 * recording.samples)
    write_recording(cut(recording, 0, middle), folder / "a.h5")
    write_recording(cut(recording, middle, recording.samples), folder / "b.h5")
    return folder


def elid(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return forked.run(arguments, cwd=cwd)


def jobs(place: Path, *logs: str) -> list[Job]:
    robot = read_robot("puma560")
    return [Job(str(place / log), text_of(robot), robot.name, conditioning=asdict(SignalOptions())) for log in logs]


def apart(a: Identification, b: Identification) -> tuple[float, float]:
    """Return the largest differences of estimates (relative) and of standard errors (relative)."""
    size = np.maximum(np.abs(a.estimate), a.std_error)
    return float(np.nanmax(np.abs(a.estimate - b.estimate) / size)), float(
        np.nanmax(np.abs(a.std_error / b.std_error - 1))
    )


@pytest.mark.parametrize(("log", "name"), [("puma560.h5", "puma560"), ("planar2.csv", "planar2"),
                                           ("planar2_stribeck.h5", "planar2")])  # fmt: skip
def test_one_log_says_the_same_through_its_triangles(log: str, name: str, tmp_path: Path) -> None:
    robot = read_robot(name)
    recording = read_recording([LOGS / log], robot)
    signals = prepare(recording, robot)
    direct = identify(robot, signals)
    write_triangles([reduce_log(robot, signals, recording, {})], tmp_path / "log.npz")
    reduced, _ = identify_reduced(robot, read_triangles(tmp_path / "log.npz"))
    estimate, error = apart(direct, reduced)
    assert estimate < 1e-9
    assert error < 1e-6
    assert reduced.verdict == direct.verdict
    assert reduced.reasons == direct.reasons
    assert reduced.this_log == direct.this_log
    for joint, found in direct.error.items():
        assert reduced.error[joint].rms == pytest.approx(found.rms, rel=1e-9)
    for key, value in direct.settings.items():
        expected = value if isinstance(value, str | bool) else pytest.approx(value, rel=1e-9)
        assert reduced.settings[key] == expected, key


def test_a_long_log_keeps_its_columns_in_single_precision_and_its_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = read_robot("puma560")
    recording = read_recording([LOGS / "puma560.h5"], robot)
    signals = prepare(recording, robot, SignalOptions())
    monkeypatch.setattr("elid_cli.estimation.streaming.reduce.SINGLE", 0)
    reduced, _ = identify_reduced(robot, [reduce_log(robot, signals, recording, {})])
    estimate, error = apart(identify(robot, signals), reduced)
    assert estimate < 1e-9
    assert error < 0.03


def test_logs_files_and_mixtures_give_the_same_bytes(place: Path) -> None:
    for log in "ab":
        done = elid("reduce", f"{log}.h5", "--robot", "puma560", "-o", f"{log}.npz", cwd=place)
        assert (done.returncode, done.stderr) == (0, "")
    done = elid("reduce", "a.h5", "b.h5", "--robot", "puma560", "-o", "both.npz", "--jobs", "2", "--json", cwd=place)
    assert json.loads(done.stdout)["log"]["files"] == ["a.h5", "b.h5"]
    answers = {
        elid("identify", *logs, "--robot", "puma560", "--json", cwd=place).stdout
        for logs in (
            ["a.h5", "b.h5"],
            ["a.npz", "b.npz"],
            ["a.h5", "b.npz"],
            ["both.npz"],
            ["a.h5", "b.h5", "--jobs", "2"],
        )
    }
    assert len(answers) == 1
    data = json.loads(answers.pop())
    assert [log["file"] for log in data["error_by_log"]] == ["a.h5", "b.h5"]
    classes = {
        elid("classify", *logs, "--robot", "puma560", "--json", cwd=place).stdout
        for logs in (["a.h5", "b.h5"], ["a.npz", "b.h5"])
    }
    assert len(classes) == 1


def test_merged_logs_agree_with_the_logs_read_as_one(place: Path) -> None:
    robot = read_robot("puma560")
    halves = reduce_jobs(jobs(place, "a.h5", "b.h5"))
    together = identify(robot, prepare(read_recording([place / "a.h5", place / "b.h5"], robot), robot, SignalOptions()))
    merged, logs = identify_reduced(robot, halves)
    assert len(logs) == 2
    assert not [note for note in merged.notes if "disagree" in note]
    both = np.isfinite(together.estimate) & np.isfinite(merged.estimate)
    assert both.sum() >= 50
    # each log chooses its own knots, so that the values differ by a small part of their standard errors
    assert np.median(np.abs(together.estimate - merged.estimate)[both] / together.std_error[both]) < 0.2
    assert np.median(np.abs(merged.std_error[both] / together.std_error[both] - 1)) < 0.15
    assert np.abs(merged.std_error[both] / together.std_error[both] - 1).max() < 0.6


def test_the_same_log_four_times_halves_the_standard_errors(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for what encoder noise pulls the stiffnesses by, which more logs do not make smaller."""
    robot = read_robot("puma560")
    log = reduce_jobs(jobs(place, "b.h5"))[0]
    whole = [identify_reduced(robot, [log] * count)[0].std_error for count in (1, 4)]
    monkeypatch.setattr(
        "elid_cli.estimation.assembly.with_pull",
        lambda model, triangles, solution, covariance, noise: covariance,
    )
    alone = [identify_reduced(robot, [log] * count)[0].std_error for count in (1, 4)]
    known = np.isfinite(whole).all(axis=0) & np.isfinite(alone).all(axis=0)
    pulls = [np.sqrt(a[known] ** 2 - b[known] ** 2) for a, b in zip(whole, alone, strict=True)]
    moved = pulls[0] > 0.1 * whole[0][known]
    assert moved.any()
    assert np.median(pulls[1][moved] / pulls[0][moved]) == pytest.approx(1.0, rel=0.15)
    once, _ = identify_reduced(robot, [log])
    four, _ = identify_reduced(robot, [log] * 4)
    known = np.isfinite(once.estimate) & np.isfinite(four.estimate)
    assert np.median((np.abs(four.estimate - once.estimate) / once.std_error)[known]) < 0.2
    # those of one short log are wider still by what its 60 parameters take out of it and by how few pieces it has
    assert 1.9 < np.median(once.std_error[known] / four.std_error[known]) < 2.6


def test_a_file_holds_plain_arrays_and_is_the_same_twice(place: Path, tmp_path: Path) -> None:
    logs = reduce_jobs(jobs(place, "a.h5"))
    for name in ("one.npz", "two.npz"):
        write_triangles(logs, tmp_path / name)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    assert is_triangle_file(tmp_path / "one.npz")
    assert not is_triangle_file(place / "a.h5")
    with np.load(tmp_path / "one.npz", allow_pickle=False) as arrays:
        assert all(arrays[name].dtype.kind in "iufbU" for name in arrays.files)
        assert json.loads(str(arrays["elid"][()]))["logs"][0]["fingerprint"] == logs[0].fingerprint
    assert (tmp_path / "one.npz").stat().st_size < 2e6
    assert (
        list(tmp_path.iterdir()) == [tmp_path / "one.npz", tmp_path / "two.npz"] or len(list(tmp_path.iterdir())) == 2
    )


def test_other_robots_options_and_estimators_are_refused_with_the_reason(place: Path) -> None:
    assert elid("reduce", "a.h5", "--robot", "puma560", "-o", "c.npz", "--cutoff", "8", cwd=place).returncode == 0
    assert elid("reduce", "b.h5", "--robot", "puma560", "-o", "d.npz", cwd=place).returncode == 0
    cases = {
        ("identify", "c.npz", "--robot", "planar2"): "another robot than planar2",
        ("identify", "c.npz", "d.npz", "--robot", "puma560"): "cutoff: 8.0 and chosen from the log",
        ("identify", "d.npz", "--robot", "puma560", "--cutoff", "5"): "another cutoff",
        ("identify", "d.npz", "--robot", "puma560", "--accurate"): "--accurate estimates the trajectory",
        ("identify", "d.npz", "--robot", "puma560", "--estimator", "paper"): "--estimator paper",
    }
    for arguments, reason in cases.items():
        done = elid(*arguments, cwd=place)
        assert done.returncode == 2, arguments
        assert reason in done.stderr
    done = elid("diagnose", "d.npz", "--robot", "puma560", cwd=place)
    assert (done.returncode, "elid identify" in done.stderr) == (3, True)


def test_options_of_the_files_stand_for_themselves(place: Path) -> None:
    assert elid("reduce", "a.h5", "--robot", "puma560", "-o", "e.npz", "--cutoff", "8", cwd=place).returncode == 0
    data = json.loads(elid("identify", "e.npz", "--robot", "puma560", "--json", cwd=place).stdout)
    assert data["settings"]["cutoff"] == 8.0


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.999])
def test_a_cut_file_is_refused(place: Path, tmp_path: Path, share: float) -> None:
    whole = tmp_path / "whole.npz"
    write_triangles(reduce_jobs(jobs(place, "a.h5")), whole)
    (tmp_path / "cut.npz").write_bytes(whole.read_bytes()[: int(share * whole.stat().st_size)])
    done = elid("identify", "cut.npz", "--robot", "puma560", cwd=tmp_path)
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) <= 3
    assert "cut.npz: damaged" in done.stderr
    assert "elid reduce LOG --robot ROBOT -o cut.npz" in done.stderr


def test_a_file_of_before_is_read_as_one_of_measured_torques(place: Path, tmp_path: Path) -> None:
    whole = tmp_path / "whole.npz"
    write_triangles(reduce_jobs(jobs(place, "a.h5")), whole)
    with np.load(whole) as stored:
        arrays = {name: stored[name] for name in stored.files if name != "0/computed"}
        assert len(arrays) == len(stored.files) - 1
    np.savez(tmp_path / "before.npz", **arrays)
    (now,), (before,) = read_triangles(whole), read_triangles(tmp_path / "before.npz")
    assert before.facts.computed.tolist() == now.facts.computed.tolist() == [False] * 6


def test_a_file_with_other_shapes_or_another_schema_is_damaged(place: Path, tmp_path: Path) -> None:
    whole = tmp_path / "whole.npz"
    write_triangles(reduce_jobs(jobs(place, "a.h5")), whole)
    with np.load(whole) as arrays:
        stored = {name: arrays[name] for name in arrays.files}
    for name, values in {
        "0/steady_factors": stored["0/steady_factors"][:-7],
        "0/columns": stored["0/columns"][:-1],
        "0/scores0": stored["0/scores0"][1:],
        "elid": np.array("{}"),
        "0/steady_power": np.array([None], dtype=object),
    }.items():
        np.savez(tmp_path / "other.npz", **{**stored, name: values})
        with pytest.raises(LogError, match=r"damaged|of version"):
            read_triangles(tmp_path / "other.npz")
    with zipfile.ZipFile(tmp_path / "bare.npz", "w") as archive:
        archive.writestr("elid.npy", b"nothing")
    with pytest.raises(LogError, match="damaged"):
        read_triangles(tmp_path / "bare.npz")


ABSURD = {
    "dt": lambda head, arrays: head.update(dt=-1.0),
    "dt of the facts": lambda head, arrays: arrays.update({"0/dt": np.array(0.5)}),
    "rate": lambda head, arrays: arrays.update({"0/rate": np.array(np.nan)}),
    "instants": lambda head, arrays: arrays.update({"0/instants": np.array(10**12)}),
    "no instants": lambda head, arrays: arrays.update({"0/instants": np.array(-5)}),
    "samples": lambda head, arrays: head.update(samples=0),
    "cutoff": lambda head, arrays: arrays.update({"0/cutoff": np.array(-10.0)}),
    "knots": lambda head, arrays: arrays.update({"0/knots": np.array([0.1])}),
    "noise": lambda head, arrays: arrays.update({"0/noise": -np.ones((3, 6))}),
    "marks": lambda head, arrays: arrays.update({"0/unlinked": np.zeros(5, dtype=bool)}),
    "counts": lambda head, arrays: arrays["0/steady"].__setitem__((0, 2), -3),
    "power": lambda head, arrays: arrays["0/steady_power"].__setitem__(0, 1e9),
    "columns": lambda head, arrays: arrays["0/columns"].__setitem__(0, 4000),
    "joint of a row": lambda head, arrays: head["layout"][0].__setitem__(1, 17),
    "scores": lambda head, arrays: arrays["0/scores0"].__setitem__(5, np.inf),
    "bandwidth": lambda head, arrays: head["scores"][0].update(bandwidth=-1.0),
    "segments": lambda head, arrays: arrays.update({"0/segments": np.array([[50, 10, 0]])}),
    "joints": lambda head, arrays: head.update(joints=["a", "b"]),
    "no log named": lambda head, arrays: head.update(files=[]),
    "options": lambda head, arrays: head.update(options=[1]),
    "reference": lambda head, arrays: arrays.update({"0/reference": np.ones(7)}),
}


@pytest.mark.parametrize("what", ABSURD)
def test_what_no_log_can_be_is_refused_in_one_message(place: Path, tmp_path: Path, what: str) -> None:
    whole = tmp_path / "whole.npz"
    if not (place / "sound.npz").exists():
        write_triangles(reduce_jobs(jobs(place, "a.h5")), place / "sound.npz")
    whole.write_bytes((place / "sound.npz").read_bytes())
    with np.load(whole) as stored:
        arrays = {name: stored[name] for name in stored.files}
    head = json.loads(str(arrays["elid"][()]))
    ABSURD[what](head["logs"][0], arrays)
    np.savez(tmp_path / "odd.npz", **{**arrays, "elid": np.array(json.dumps(head))})
    robot = read_robot("puma560")
    with pytest.raises(LogError, match=r"odd\.npz.*damaged"):
        identify_reduced(robot, read_triangles(tmp_path / "odd.npz"))


def test_errors_name_the_triangle_file_and_the_log_in_it(place: Path) -> None:
    for name, cutoff in (("f.npz", "8"), ("g.npz", "9")):
        done = elid("reduce", "a.h5", "--robot", "puma560", "-o", name, "--cutoff", cutoff, cwd=place)
        assert done.returncode == 0
    done = elid("identify", "f.npz", "g.npz", "--robot", "puma560", cwd=place)
    assert "g.npz (a.h5): reduced under other options than f.npz (a.h5)" in done.stderr
    done = elid("identify", "f.npz", "--robot", "planar2", cwd=place)
    assert "f.npz (a.h5): reduced for another robot" in done.stderr
    done = elid("identify", "f.npz", "--robot", "puma560", "--cutoff", "5", cwd=place)
    assert "f.npz (a.h5): reduced with another cutoff" in done.stderr


def test_an_archive_of_numpy_that_elid_did_not_write_is_a_log(tmp_path: Path) -> None:
    np.savez(tmp_path / "mine.npz", q=np.ones(3), tau=np.ones(3))
    done = elid("identify", "mine.npz", "--robot", "puma560", cwd=tmp_path)
    assert done.returncode == 3
    assert "mine.npz: no position for joint1" in done.stderr
    assert "the log holds /q, /tau" in done.stderr


def test_a_lost_worker_loses_nothing(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lost: Future[bytes] = Future()
    lost.set_exception(RuntimeError("the process died"))
    assert list(_collected([lost])) == [None]
    monkeypatch.setattr(
        "elid_cli.estimation.streaming.fleet._on_processes", lambda given, workers: _collected([lost] * len(given))
    )
    found = reduce_jobs(jobs(place, "a.h5", "b.h5"), workers=2)
    assert [Path(log.recording.files[0]).name for log in found] == ["a.h5", "b.h5"]


def test_a_bad_log_in_a_worker_is_told_as_it_is_here(place: Path) -> None:
    (place / "bad.h5").write_bytes(b"\x89HDF\r\n\x1a\n nothing")
    here = elid("identify", "a.h5", "bad.h5", "--robot", "puma560", cwd=place)
    there = elid("identify", "a.h5", "bad.h5", "--robot", "puma560", "--jobs", "2", cwd=place)
    assert (there.returncode, there.stderr) == (here.returncode, here.stderr)
    assert here.returncode == 3


def test_a_scheduler_that_is_not_there_is_refused(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("elid_cli.estimation.streaming.fleet.CONNECT", 0.5)
    with pytest.raises(UsageError, match="no Dask scheduler"):
        reduce_jobs(jobs(place, "a.h5"), scheduler="tcp://127.0.0.1:9")
