"""Trends: what is named on machines that wear, jump or stay as they are."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.errors import UsageError
from elid_cli.estimation.comparison import Estimate, SavedResult, result_of
from elid_cli.estimation.trend.conditions import explanations
from elid_cli.estimation.trend.series import series_of
from elid_cli.estimation.trend.trends import trend
from elid_cli.report.figures import picture
from elid_cli.report.figures.build import trend_figures
from tests.system.reproduce.trend_fleets import STILL, WEAR, changed, fleet, robot, viscous

ROOT = Path(__file__).parents[3]


def test_wear_is_found_and_quiet_machines_are_left_alone() -> None:
    found = [fleet(seed, 60, WEAR, 20).trends[0].word for seed in range(20)]
    assert sum(word in ("trend", "step") for word in found) >= 18
    quiet = [bool(changed(fleet(1000 + seed, 30, 0.0, 20))) for seed in range(40)]
    assert sum(quiet) <= 2


def test_joints_that_differ_alike_are_named_and_a_session_of_its_own_is_no_trend() -> None:
    """No joint alone stands out in five recordings; twelve of them do. Sessions that differ make no line."""
    few, many = (
        [viscous(robot(seed)) for seed in range(20)],
        [viscous(robot(seed, recordings=12)) for seed in range(20)],
    )
    assert sum(item.word != "steady" for item in few) >= 19
    assert sum(item.word == "trend" for item in many) >= 19
    slope = -0.2 / 11 / 0.9  # of parts of the mean, which is 0.9 of the first
    assert sum(item.interval[0] < slope < item.interval[1] for item in many) >= 17
    sessions = [robot(500 + seed, STILL, 12, session=0.05) for seed in range(40)]
    assert sum(viscous(item).word == "together" for item in sessions) >= 36
    assert sum(bool(changed(item)) for item in sessions) <= 2
    quiet = [robot(700 + seed, STILL, 12) for seed in range(40)]
    assert sum(viscous(item).word != "steady" or bool(changed(item)) for item in quiet) <= 2


def test_the_wear_of_one_joint_is_none_of_all() -> None:
    """One joint of four whose friction grows moves the mean over joints as clearly as it does itself."""
    rng = np.random.default_rng(5)
    values = np.array([6.0, 2.5, 0.9, 2.0]) * (1.0 + 0.02 * rng.standard_normal((10, 4)))
    values[:, 1] *= 1.0 + 0.04 * np.arange(10.0)
    found = trend(machine({f"fs{k + 1}": column for k, column in enumerate(values.T)}, 0.001))
    (family,) = found.families
    assert family.word == "steady"
    assert [item.series.name for item in found.trends if item.word == "trend"] == ["fs2"]


def test_friction_goes_with_temperature_where_it_was_logged() -> None:
    """Temperatures of their own are told from time; those that rise with time are not."""
    found = [viscous(robot(seed, STILL, 12, warmth=0.01)).explained for seed in range(20)]
    assert sum(bool(e) and e[0].by == "temperature" and e[1].ruled_out for e in found) >= 17
    rng = np.random.default_rng(8)
    values = 1.0 - 0.05 * np.arange(5.0) + 0.01 * rng.standard_normal(5)
    warm = 20.0 + 3.0 * np.arange(5.0) + 0.3 * rng.standard_normal(5)
    both = explanations(values, {"time": np.arange(5.0), "temperature": warm})
    assert [e.ruled_out for e in both] == [False, False]
    assert explanations(rng.standard_normal(4), {"time": np.arange(4.0)}) == ()


@pytest.mark.parametrize("joints", [2, 3])
def test_three_joints_suffice_to_try_the_temperature_and_of_two_it_is_said_that_it_was_not(joints: int) -> None:
    rng = np.random.default_rng(3)
    warm = 25.0 + 5.0 * rng.standard_normal(12)
    scatter = 1.0 + 0.005 * rng.standard_normal((joints, 12)) - 0.012 * (warm - 25.0)
    columns = {f"fv{k + 1}": value * row for k, (value, row) in enumerate(zip((4.0, 5.0, 3.0), scatter, strict=False))}
    results = machine(columns, 0.01)
    found = trend([replace(result, temperature=float(t)) for result, t in zip(results, warm, strict=True)])
    said = str(found)
    assert ("temperature was not tried" in " ".join(said.split())) == (joints < 3)
    assert [family.explained[0].by for family in found.families] == ["temperature"] * (joints > 2)


def test_three_joints_that_scatter_by_themselves_are_steady() -> None:
    rng, named = np.random.default_rng(4), 0
    for _ in range(60):
        values = np.array([6.0, 2.5, 0.9]) * (1.0 + np.array([0.05, 0.01, 0.02]) * rng.standard_normal((12, 3)))
        (family,) = trend(machine({f"fv{k + 1}": column for k, column in enumerate(values.T)}, 0.02)).families
        named += family.word != "steady"
    assert named <= 2


def test_the_lead_of_one_explanation_is_by_chance_as_often_as_said() -> None:
    """Of two conditions of which neither is of more worth, one is ruled out in 5 % at most."""
    rng = np.random.default_rng(9)
    ruled = 0
    for _ in range(400):
        one, other = rng.standard_normal((2, 12))
        found = explanations(one + other + 0.5 * rng.standard_normal(12), {"time": one, "temperature": other})
        ruled += any(e.ruled_out for e in found)
    assert ruled <= 32


def test_temperature_and_armatures_are_read_from_results() -> None:
    """A trajectory fit's armatures that are part of a sum of base parameters have places of their own."""
    result = result_of(
        {"robot": "dog", "joints": ["hip", "knee"], "log": {"temperature": {"hip": 30.0, "knee": 34.0}},
         "base_parameters": [{"name": "Ja2", "unit": "kg·m²", "estimate": 0.02, "std_error": 0.001}],
         "settings": {"trajectory": {"joint_parameters": {
             "hip": {"Ja": {"estimate": 0.01, "std_error": 0.002}},
             "knee": {"Ja": {"estimate": 0.02, "std_error": 0.001}}}}}},
        "a.json",
    )  # fmt: skip
    assert result.temperature == 32.0
    assert result.beside == {"Ja1": Estimate(0.01, 0.002, "kg·m²")}


def test_saved_results_hold_mean_temperatures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(tmp_path / "warm.csv")
    assert main(["simulate", "--robot", "planar2", "--temperature", "--duration", "6", "-o", log]) == 0
    capsys.readouterr()
    assert main(["identify", log, "--robot", "planar2", "--json"]) == 0
    saved = json.loads(capsys.readouterr().out)
    rows = np.genfromtxt(log, delimiter=",", names=True)
    warm = {name: float(rows[name].mean()) for name in rows.dtype.names or () if "temp" in name}
    assert list(saved["log"]["temperature"].values()) == pytest.approx(list(warm.values()))
    assert result_of(saved, "warm.json").temperature == pytest.approx(float(np.mean(list(warm.values()))))


def test_steps_and_odd_recordings_are_those_of_each_place_in_turn() -> None:
    """Against plain loops over the places, on values with a large mean."""
    rng = np.random.default_rng(10)
    for _ in range(20):
        values, errors = 1e3 + rng.standard_normal(17), rng.uniform(0.2, 1.5, 17)
        found = series_of("K1", "N·m/rad", np.arange(17.0), values, errors).step
        assert found is not None
        told = []
        for first in range(3, 15):
            one, other = values[:first], values[first:]
            within = (np.var(one) * len(one) + np.var(other) * len(other)) / 15
            size = other.mean() - one.mean()
            told.append(abs(size) / np.sqrt(max(within, np.mean(errors**2)) * (1 / len(one) + 1 / len(other))))
        assert found.after == int(np.argmax(told)) + 2
        assert found.size == pytest.approx(
            values[found.after + 1 :].mean() - values[: found.after + 1].mean(), rel=1e-9
        )


def test_a_slope_and_its_interval_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(4)
    x = np.arange(30.0)
    hits = 0
    for _ in range(200):
        y = 5.0 + 0.02 * x + 0.1 * rng.standard_normal(30)
        s = series_of("K1", "N·m/rad", x, y, np.full(30, 0.03))
        assert s.slope == pytest.approx(np.polyfit(x, y, 1)[0], rel=1e-6)  # equal weights
        hits += s.interval[0] < 0.02 < s.interval[1]
    assert 180 <= hits <= 199


def test_spread_between_recordings_is_told_from_errors_within() -> None:
    rng = np.random.default_rng(5)
    errors = np.full(400, 0.1)
    values = 3.0 + np.hypot(0.1, 0.3) * rng.standard_normal(400)
    s = series_of("fv1", "N·m", np.arange(400.0), values, errors)
    assert s.between == pytest.approx(0.3, rel=0.1)
    assert s.within == pytest.approx(0.1)


def machine(columns: dict[str, np.ndarray], error: float) -> list[SavedResult]:
    count = len(next(iter(columns.values())))
    return [
        SavedResult(f"{k}.json", "arm", {n: Estimate(float(v[k]), error, "N·m") for n, v in columns.items()}, {})
        for k in range(count)
    ]


def test_a_step_a_disagreement_and_an_odd_recording_have_their_words() -> None:
    rng = np.random.default_rng(6)
    noise = 0.01 * rng.standard_normal((4, 24))
    apart = 0.08 * rng.standard_normal(24)
    odd = np.zeros(24)
    odd[7] = 0.2
    columns = {"jump": 1.0 + 0.1 * (np.arange(24) > 11) + noise[0], "apart": 1.0 + apart + noise[1],
               "still": 1.0 + noise[2], "odd": 1.0 + odd + noise[3]}  # fmt: skip
    every = trend(machine(columns, 0.01))
    found = {item.series.name: item for item in every.trends}
    assert {name: item.word for name, item in found.items()} == {
        "jump": "step", "apart": "disagrees", "still": "steady", "odd": "disagrees",
    }  # fmt: skip
    step = found["jump"].series.step
    assert step is not None
    assert (found["jump"].number(step.after), step.size) == (11, pytest.approx(0.1, abs=0.015))
    (far,) = every.stands_out
    assert (far.number, [d.name for d in far.parameters]) == (7, ["odd"])
    assert far.parameters[0].value - far.parameters[0].expected == pytest.approx(0.2, abs=0.03)


def test_the_command_reads_results_and_logs_and_has_a_gate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(ROOT / "sample_logs" / "planar2.h5")
    assert main(["identify", log, "--robot", "planar2", "--json"]) == 0
    saved = json.loads(capsys.readouterr().out)
    files = []
    for k in range(12):
        entries = [dict(entry) for entry in saved["base_parameters"]]
        for entry in entries:
            shift = 0.3 * k if entry["name"] == "K1" else np.random.default_rng(k).standard_normal()
            entry["estimate"] += shift * entry["std_error"] * (10 if entry["name"] == "K1" else 1)
        files.append(tmp_path / f"{k:02}.json")
        files[-1].write_text(json.dumps({**saved, "base_parameters": entries}))
    line = ["trend", *map(str, files), log, "--robot", "planar2"]
    assert main([*line[:-3], "--fail-on-trend"]) == 1
    told = capsys.readouterr()
    assert "K1" in told.err
    assert main([*line, "--json"]) == 0
    every = json.loads(capsys.readouterr().out)
    found = {item["name"]: item for item in every["parameters"]}
    assert found["K1"]["recordings"] == 12  # the log's stiffness is that of the first result, far from the line
    assert [far["file"] for far in every["stands_out"]] == [found["K1"]["stands_out"]] == [log]
    assert {"between_sessions", "within_session", "slope", "slope_interval"} <= set(found["K1"])


def test_what_cannot_be_answered_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UsageError, match="at least 3"):
        trend(machine({"K1": np.ones(2)}, 0.1))
    assert main(["trend", str(ROOT / "sample_logs" / "planar2.h5")]) == 2
    assert "needs --robot" in capsys.readouterr().err


def test_offsets_and_effects_are_followed_and_drawn_by_joint() -> None:
    rng = np.random.default_rng(2)
    offsets = [0.2 + 0.05 * k + 0.005 * rng.normal() for k in range(8)]
    twice = {"effect": "stribeck", "joint": "hip", "parameters": {"amplitude": 1.0, "velocity": 0.1},
             "std_error": {"amplitude": 0.1}}  # fmt: skip
    results = [
        result_of(
            {"robot": "arm", "joints": ["hip", "knee"], "effects": [twice, twice], "base_parameters": [
                {"name": "fv1", "unit": "N·m·s/rad", "estimate": 1.0 + 0.01 * rng.normal(), "std_error": 0.01},
                {"name": "m2 - 4*Izz1", "unit": "kg", "estimate": 2.0 + 0.01 * rng.normal(), "std_error": 0.01}],
             "nuisances": [{"effect": "torque_offset", "joint": "hip", "parameters": {"offset": offset},
                            "std_error": {"offset": 0.005}}]},
            f"{k}.json",
        )
        for k, offset in enumerate(offsets)
    ]  # fmt: skip
    found = trend(results)
    words = {item.series.name: item.word for item in found.trends}
    assert words == {"fv1": "steady", "m2 - 4*Izz1": "steady", "torque_offset of hip: offset": "trend"}
    assert [found.joint_of(item) for item in found.trends] == ["hip", "knee", "hip"]
    first, second = trend_figures(found)
    assert (first.key, second.key) == ("trend_hip", "trend_knee")
    assert [p["name"] for p in first.data["parameters"]] == ["torque_offset of hip: offset", "fv1"]  # moved first
    line = first.data["parameters"][0]["line"]
    assert line[-1] - line[0] == pytest.approx(0.35, rel=0.05)
    assert b"</svg>" in picture(first, "svg")
