"""There is one fit: estimates and standard errors are the same whichever way the same data come to it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.fit.state import fit as fit_of_a_search
from elid_cli.diagnosis.refit import identified
from elid_cli.estimation.assembly import judged
from elid_cli.estimation.default_fit import fit_data
from elid_cli.estimation.identify import identify, identify_logs
from elid_cli.estimation.request import LogRequest
from elid_cli.estimation.result import EstimateOptions, Identification
from elid_cli.estimation.streaming.files import read_triangles
from elid_cli.estimation.streaming.merge import identify_reduced
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.logs import read_recording, write_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests import forked

ROOT = Path(__file__).parents[2]
LOGS = ROOT / "sample_logs"
PLANAR = read_robot("planar2")
ROUNDING = 1e-6
"""Of a standard error: sums are taken in another order."""
NOISE = 1e-4
"""The same of errors themselves where encoders' noise, whose pull they hold, is estimated of each log by itself."""


def elid(*words: str | Path, cwd: Path) -> str:
    done = forked.run([str(word) for word in words], cwd=cwd)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    return done.stdout


def columns_of(found: Identification) -> tuple[np.ndarray, np.ndarray]:
    return found.estimate, found.std_error


def printed(text: str) -> tuple[np.ndarray, np.ndarray]:
    rows = json.loads(text)["base_parameters"]
    estimate, error = ([np.nan if r[key] is None else r[key] for r in rows] for key in ("estimate", "std_error"))
    return np.array(estimate), np.array(error)


def assert_same(
    one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray], errors: float = ROUNDING
) -> None:
    assert np.array_equal(np.isnan(one[0]), np.isnan(other[0]))
    assert np.nanmax(np.abs(one[0] - other[0]) / one[1]) < ROUNDING
    assert np.nanmax(np.abs(other[1] / one[1] - 1)) < errors


def logged(robot: Robot, path: Path, seed: int) -> Path:
    sensors = SensorOptions(position_noise=1e-5, torque_noise=0.05)
    write_recording(simulate(robot, SimulationOptions(duration=10.0, seed=seed, sensors=sensors)), path)
    return path


@pytest.mark.parametrize(
    ("log", "name"), [("planar2.csv", "planar2"), ("planar2_stribeck.h5", "planar2"), ("puma560.h5", "puma560")]
)
def test_python_command_line_and_reduced_logs_say_the_same_of_one_log(log: str, name: str, tmp_path: Path) -> None:
    robot = read_robot(name)
    direct = identify(robot, prepare(read_recording([LOGS / log], robot), robot))
    assert_same(columns_of(direct), columns_of(identify_logs(LogRequest([str(LOGS / log)], robot)).found))
    assert_same(columns_of(direct), printed(elid("identify", LOGS / log, "--robot", name, "--json", cwd=tmp_path)))
    elid("reduce", LOGS / log, "--robot", name, "-o", "log.npz", cwd=tmp_path)
    stored, _ = identify_reduced(robot, read_triangles(tmp_path / "log.npz"))
    assert_same(columns_of(direct), columns_of(stored))
    assert stored.verdict == direct.verdict
    assert_same(columns_of(stored), printed(elid("identify", "log.npz", "--robot", name, "--json", cwd=tmp_path)))


@pytest.fixture(scope="module")
def two_logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    place = tmp_path_factory.mktemp("two")
    return logged(PLANAR, place / "a.h5", 1), logged(PLANAR, place / "b.h5", 2)


def test_two_logs_say_the_same_read_together_reduced_or_merged(two_logs: tuple[Path, Path], tmp_path: Path) -> None:
    # read together, logs share one choice of knots; with it given, one estimate of their noise is left to differ
    chosen = SignalOptions(cutoff=10.0, knots=0.02)
    joined = read_recording(two_logs, PLANAR)
    together = identify(PLANAR, prepare(joined, PLANAR, chosen))
    found = identify_logs(LogRequest([str(log) for log in two_logs], PLANAR, chosen))
    assert_same(columns_of(together), columns_of(found.found), NOISE)
    for log in two_logs:
        words = (log, "--robot", "planar2", "--cutoff", "10", "--knots", "0.02")
        elid("reduce", *words, "-o", f"{log.stem}.npz", cwd=tmp_path)
    merged = elid("identify", "a.npz", "b.npz", "--robot", "planar2", "--json", cwd=tmp_path)
    assert_same(columns_of(found.found), printed(merged))
    assert_same(columns_of(together), printed(merged), NOISE)


def test_two_halves_merged_say_what_the_whole_says(two_logs: tuple[Path, Path]) -> None:
    """But for their edges, which the filter cannot use, and for the knots, noise and weights that each half shows."""
    whole = read_recording(two_logs[:1], PLANAR)
    middle = whole.samples // 2
    first, last = whole.segments[0].start, whole.segments[-1].stop
    segments = [replace(whole.segments[0], start=a, stop=b, source=k) for k, (a, b) in
                enumerate(((first, middle), (middle, last)))]  # fmt: skip
    halved = replace(whole, segments=tuple(segments), files=(*whole.files, "second half"), sha256=whole.sha256 * 2)
    chosen = SignalOptions(cutoff=10.0, knots=0.02)
    one = identify(PLANAR, prepare(whole, PLANAR, chosen))
    two = identify(PLANAR, prepare(halved, PLANAR, chosen))
    assert np.max(np.abs(one.estimate - two.estimate) / one.std_error) < 1.0
    assert np.median(np.abs(two.std_error / one.std_error - 1)) < 0.15


def test_logs_that_agree_are_not_said_to_disagree(two_logs: tuple[Path, Path]) -> None:
    found = identify_logs(LogRequest([str(log) for log in two_logs], PLANAR)).found
    assert not any("disagree" in note for note in found.notes)


def test_logs_that_disagree_say_so_and_widen_their_errors(two_logs: tuple[Path, Path], tmp_path: Path) -> None:
    joints = tuple(replace(j, parameters={**j.parameters, "fv": 1.5 * j.parameters["fv"]}) for j in PLANAR.joints)
    other = logged(replace(PLANAR, joints=joints), tmp_path / "worn.h5", 3)
    found = identify_logs(LogRequest([str(two_logs[0]), str(other)], PLANAR)).found
    (said,) = [note for note in found.notes if "disagree" in note]
    assert "most in fv" in said
    first, second = (found.parameters[found.base.names.index(f"fv{joint}")] for joint in (1, 2))
    truth = PLANAR.joints[0].parameters["fv"]
    assert truth < first.estimate < 1.5 * truth
    assert first.std_error > 0.2 * 0.5 * truth  # of the difference: each log's own error is a thousandth of it
    # two logs say little of how far logs differ: of what makes less of the torque nothing is left to say
    assert second.verdict == "refused"
    assert second.reason.endswith("it differs from log to log")
    assert first.bias_possible
    assert second.bias_possible


def test_the_recording_that_stands_out_is_named(two_logs: tuple[Path, Path], tmp_path: Path) -> None:
    joints = tuple(replace(j, parameters={**j.parameters, "fv": 1.5 * j.parameters["fv"]}) for j in PLANAR.joints)
    worn = logged(replace(PLANAR, joints=joints), tmp_path / "worn.h5", 3)
    found = identify_logs(LogRequest([str(two_logs[0]), str(worn), str(two_logs[1])], PLANAR)).found
    (said,) = [note for note in found.notes if "disagree" in note]
    assert "worn.h5 stands out" in said
    truth = PLANAR.joints[0].parameters["fv"]
    k = found.base.names.index("fv1")
    assert abs(found.estimate[k] - truth) < 1.96 * found.std_error[k]  # of the machine that the two others are of


def test_a_search_starts_from_the_same_fit(two_logs: tuple[Path, Path]) -> None:
    """On the stretches that it sees, at its cut-off, reversals left out and no offsets: its stated differences."""
    recording = read_recording(two_logs[:1], PLANAR)
    log = divided(PLANAR, prepare(recording, PLANAR, SignalOptions.for_diagnosis(recording.rate)))
    state = fit_of_a_search(log, ())
    options = EstimateOptions(mask=True, offsets=False)
    _, _, found = judged(fit_data(log.base, log.data, options), options)
    before = identified(state, found.error)
    assert_same(columns_of(found), columns_of(before))
    assert before.verdict == found.verdict
