"""Long logs pass through in blocks: the answer is that of the whole, and memory does not grow with the regressor."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import LogError
from elid_cli.estimation.identify import identify
from elid_cli.estimation.regression.long_run import KernelSum, Persistence
from elid_cli.estimation.regression.observation import observe
from elid_cli.estimation.regression.triangles import factor_of
from elid_cli.estimation.streaming.merge import identify_reduced
from elid_cli.estimation.streaming.reduce import reduce_log
from elid_cli.logs import read_recording
from elid_cli.memory import let_go
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.signals.excerpts import excerpts
from elid_cli.signals.lowpass import low_pass
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import prepare
from elid_cli.signals.spline_fit import _RIDGE, fit_spline
from elid_cli.signals.splines import DEGREE, basis
from tests import peaks
from tests.system.benchmarks import made

ROOT = Path(__file__).parents[3]
LOGS = ROOT / "sample_logs"


@pytest.fixture(scope="module")
def log():  # type: ignore[no-untyped-def]
    robot = read_robot("puma560")
    recording = read_recording([LOGS / "puma560.h5"], robot)
    return robot, recording, prepare(recording, robot, SignalOptions())


@pytest.mark.parametrize("chunk", [900, 2500])
def test_blocks_of_any_length_give_the_equations_of_the_whole(log, chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    robot, recording, signals = log
    model = Regressor(robot)
    monkeypatch.setattr("elid_cli.estimation.regression.filtered_rows.CHUNK", 10**9)
    whole = observe(model, signals)
    direct = identify(robot, signals)
    monkeypatch.setattr(
        "elid_cli.estimation.regression.filtered_rows._outputs_per_chunk",
        lambda signals, every: chunk // signals.filter.step,
    )
    blocks = observe(model, signals)
    for a, b in zip(whole.groups, blocks.groups, strict=True):
        size = np.abs(a.columns).max(axis=1, keepdims=True) + 1e-300
        assert np.abs((a.columns - b.columns) / size).max() < 1e-9
        assert np.array_equal(a.use, b.use)
    assert np.abs(whole.tau - blocks.tau).max() < 1e-9 * np.abs(whole.tau).max()
    assert np.abs(whole.tau_rate - blocks.tau_rate).max() < 1e-9 * np.abs(whole.tau_rate).max()
    reduced, _ = identify_reduced(robot, [reduce_log(robot, signals, recording, {})])
    size = np.maximum(np.abs(direct.estimate), direct.std_error)
    assert np.nanmax(np.abs(direct.estimate - reduced.estimate) / size) < 1e-9


def test_motion_in_slices_is_the_motion(log) -> None:  # type: ignore[no-untyped-def]
    motion = log[2].motion
    for start, stop in ((0, 1), (0, 777), (1234, 4321), (motion.samples - 5, motion.samples), (10, 10)):
        part = motion[start:stop]
        for name in ("t", "q", "dq", "ddq", "theta", "dtheta", "ddtheta"):
            whole = getattr(motion, name)[start:stop]
            assert np.array_equal(getattr(part, name), whole) or np.abs(getattr(part, name) - whole).max() < 1e-12 * (
                1 + np.abs(whole).max()
            )


@pytest.mark.parametrize("samples", [500, 501, 33_000, 70_001])
@pytest.mark.parametrize("stride", [2, 7, 100])
def test_splines_fitted_in_stretches_solve_the_normal_equations(samples: int, stride: int) -> None:
    generator = np.random.default_rng(samples)
    t = np.arange(samples) * 1e-3
    values = np.sin(np.outer([1.0, 2.0], t)) + 1e-3 * generator.standard_normal((2, samples))
    fit = fit_spline(values, stride, 1e-3)
    rest = values - fit.spline.evaluate()
    assert fit.squares == pytest.approx(np.sum(rest**2, axis=1), rel=1e-9)
    # the residual of least squares is orthogonal to every spline, but for the ridge on third differences
    other = fit_spline(generator.standard_normal((2, samples)), stride, 1e-3).spline
    bends = np.diff(fit.spline.coefficients, 3) * np.diff(other.coefficients, 3)
    place = np.minimum(np.arange(samples) // stride, fit.spline.coefficients.shape[1] - DEGREE - 1)
    seen = np.zeros(fit.spline.coefficients.shape[1])
    np.add.at(seen, place[:, None] + np.arange(DEGREE + 1), basis(np.arange(samples) / stride - place, 0) ** 2)
    product = np.sum(rest * other.evaluate(), axis=1)
    assert np.abs(product - _RIDGE * seen.max() * bends.sum(axis=1)).max() < 1e-11 * np.sqrt(
        np.sum(rest**2) * np.sum(other.evaluate() ** 2)
    )
    holes = values.copy()
    holes[0, samples // 3 : samples // 3 + 20] = np.nan
    apart = fit_spline(holes, stride, 1e-3)
    assert apart.counted.tolist() == [samples - 20, samples]
    assert np.abs(apart.spline.evaluate()[1] - fit.spline.evaluate()[1]).max() < 1e-9


@pytest.mark.parametrize(("cutoff", "step"), [(10.0, 20), (3.0, 1), (40.0, 5), (10.0, 7)])
def test_the_filter_is_the_sum_it_says_and_holes_stay_where_they_are(cutoff: float, step: int) -> None:
    rows = np.random.default_rng(0).standard_normal((3, 1500))
    rows[1, 700] = np.nan
    filter_ = low_pass(cutoff, 1e-3, step)
    found = filter_.apply(rows, 5)
    for k, centre in enumerate(filter_.outputs(1500, 5)):
        window = rows[:, centre - filter_.half : centre + filter_.half + 1]
        assert np.allclose(found[:, k], window @ filter_.taps, atol=1e-12, equal_nan=True)


def test_scores_summed_in_blocks_are_the_parzen_sum() -> None:
    generator = np.random.default_rng(0)
    scores = generator.standard_normal((4, 6000))
    for k in range(1, 6000):
        scores[:, k] += 0.8 * scores[:, k - 1]
    memory = Persistence(4)
    for start in range(0, 6000, 700):
        memory.feed(scores[:, start : start + 700])
    whole = Persistence(4)
    whole.feed(scores)
    assert memory.bandwidth == pytest.approx(whole.bandwidth, rel=1e-12)
    total = KernelSum(4, memory.bandwidth)
    for start, stop, stretch in ((0, 500, 0), (500, 2500, 0), (2500, 6000, 1)):
        total.feed(scores[:, start:stop], stretch)
    expected = scores @ scores.T
    same = np.arange(6000) < 2500
    for lag in range(1, int(memory.bandwidth) + 1):
        x = lag / (memory.bandwidth + 1)
        kernel = 1 - 6 * x**2 + 6 * x**3 if x <= 0.5 else 2 * (1 - x) ** 3
        cross = (scores[:, lag:] * (same[lag:] == same[:-lag])) @ scores[:, :-lag].T
        expected += kernel * (cross + cross.T)
    assert total.total() == pytest.approx(expected, rel=5e-3, abs=5e-3 * np.abs(expected).max())


def test_triangles_hold_all_of_tall_systems() -> None:
    for shape in ((5000, 60), (61, 60), (3000, 4)):
        system = np.random.default_rng(0).standard_normal(shape) * np.logspace(-9, 5, shape[1])
        factor = factor_of(system)
        scale = np.linalg.norm(system, axis=0)
        assert np.abs((factor.T @ factor - system.T @ system) / np.outer(scale, scale)).max() < 1e-13
        assert not np.tril(factor, -1).any()


def test_excerpts_lie_in_the_log_and_are_spread_over_it() -> None:
    assert excerpts([Segment(0, 5000)], 1e-3) == (Segment(0, 5000),)
    segments = [Segment(0, 400_000), Segment(400_000, 400_100), Segment(400_100, 2_000_000)]
    found = excerpts(segments, 1e-3)
    assert len(found) == 8
    assert all(any(s.start <= e.start and e.stop <= s.stop for s in segments) for e in found)
    assert found[0].start < 250_000
    assert found[-1].stop > 1_750_000


def test_a_log_taken_from_its_file_is_the_log_and_leaves_the_file_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = read_robot("puma560")
    path = LOGS / "puma560.h5"
    before = path.read_bytes()
    plain = read_recording([path], robot)
    monkeypatch.setattr("elid_cli.memory.LEAST", 0)
    mapped = read_recording([path], robot)
    assert not mapped.tau.flags.writeable
    let_go(mapped.q, mapped.theta, mapped.tau)
    for name in ("t", "q", "theta", "tau"):
        assert np.array_equal(getattr(mapped, name), getattr(plain, name))
    assert path.read_bytes() == before


def test_a_mapped_log_is_repaired_as_one_that_was_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import h5py

    path = tmp_path / "faulty.h5"
    path.write_bytes((LOGS / "puma560.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        file["q"][100:103, 2] = np.nan
        file["theta"][2000:2600] = np.nan
        file["tau"][:, 4] = 0.0
        file["q"][:, 5] = np.nan
    robot = read_robot("puma560")
    plain = read_recording([path], robot)
    monkeypatch.setattr("elid_cli.memory.LEAST", 0)
    mapped = read_recording([path], robot)
    assert mapped.repairs == plain.repairs
    assert mapped.warnings == plain.warnings
    for name in ("t", "q", "theta", "tau"):
        assert np.array_equal(getattr(mapped, name), getattr(plain, name), equal_nan=True)


def test_a_file_shorter_than_its_dataset_is_not_mapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("elid_cli.memory.LEAST", 0)
    cut = tmp_path / "cut.h5"
    cut.write_bytes((LOGS / "puma560.h5").read_bytes()[:700_000])
    with pytest.raises(LogError):
        read_recording([cut], read_robot("puma560"))


@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is in other units elsewhere")
def test_memory_of_a_long_log_is_far_from_its_regressor(tmp_path: Path) -> None:
    minutes = 4
    made.write_hdf5(made.puma(), tmp_path / "long.h5", 60 * minutes)
    arguments = ["reduce", tmp_path / "long.h5", "--robot", "puma560", "-o", tmp_path / "long.npz", "--json"]
    status, *_, peak = peaks.of_command(*arguments)
    regressor = 60_000 * minutes * 248 * 8 / 1e6
    assert status == 0
    assert peak < 260 < regressor
    data = json.loads(
        subprocess.run(
            [sys.executable, "-m", "elid_cli", "identify", str(tmp_path / "long.npz"), "--robot", "puma560", "--json"],
            capture_output=True, text=True, check=True,
        ).stdout
    )  # fmt: skip
    assert data["log"]["samples"] == 60_000 * minutes
    assert all(error["relative"] < 0.05 for error in data["error"].values())
