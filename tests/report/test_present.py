"""Results print themselves, and give the values that their command prints as JSON."""

from __future__ import annotations

import dataclasses
import html.parser
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import elid_cli
from elid_cli import (
    BaseParameters,
    Comparison,
    DiagnoseOptions,
    Diagnosis,
    EffectSpec,
    Excitation,
    ExciteOptions,
    Identification,
    MotionDiagnosis,
    ParameterSets,
    Recording,
    Regressor,
    ReplayOptions,
    Resolution,
    ResolveOptions,
    SensorOptions,
    SignalOptions,
    SimulationOptions,
    Trends,
    UsageError,
    compare,
    diagnose,
    excite,
    find_base,
    identify,
    inspect_log,
    make_physical,
    prepare,
    question_of,
    read_recording,
    read_result,
    read_robot,
    replay,
    resolve,
    sample,
    simulate,
    trend,
    validate,
    write_recording,
)
from elid_cli.logs import robot_as_logged
from elid_cli.tables import Shown
from tests import forked
from tests.diagnosis.by_motion import plant

ROBOT = read_robot("planar2")
KNOWN_TO_COMMANDS_ONLY = {"schema", "command", "version", "log"}


def elid(*arguments: str) -> dict[str, Any]:
    done = forked.run([*arguments, "--json"])
    assert done.returncode == 0, done.stderr
    values: dict[str, Any] = json.loads(done.stdout)
    return values


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a log of a robot with friction at its link that the robot file does not have."""
    made = replace(ROBOT, effects=(EffectSpec("link_viscous", "joint1", {"friction": 2.0}),))
    sensors = SensorOptions(position_noise=3e-6, torque_noise_relative=0.002)
    path = tmp_path_factory.mktemp("present") / "log.h5"
    write_recording(simulate(made, SimulationOptions(duration=6.0, rate=500.0, seed=1, sensors=sensors)), path)
    return str(path)


@pytest.fixture(scope="module")
def recording(log: str) -> Recording:
    return read_recording([log], ROBOT)


@pytest.fixture(scope="module")
def identification(recording: Recording) -> Identification:
    return identify(ROBOT, prepare(recording, ROBOT))


@pytest.fixture(scope="module")
def diagnosis(recording: Recording) -> Diagnosis:
    signals = prepare(recording, ROBOT, SignalOptions.for_diagnosis(recording.rate))
    return diagnose(ROBOT, signals, DiagnoseOptions(only=("link_viscous",)))


@pytest.fixture(scope="module")
def saved(log: str, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("saved")
    values = elid("identify", log, "--robot", "planar2")
    other = json.loads(json.dumps(values))
    other["base_parameters"][0]["estimate"] *= 2
    for name, result in (("a.json", values), ("b.json", other)):
        (folder / name).write_text(json.dumps(result), "utf-8")
    return [str(folder / "a.json"), str(folder / "b.json")]


@pytest.fixture(scope="module")
def months(saved: list[str], tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return three different results of one machine; the first is that of the log."""
    folder = tmp_path_factory.mktemp("months")
    found = [saved[0]]
    for k in (1, 2):
        values = json.loads(Path(saved[0]).read_text("utf-8"))
        for entry in values["base_parameters"]:
            if entry["estimate"] is not None:
                entry["estimate"] += (-0.5) ** k * entry["std_error"]
        found.append(str(folder / f"{k}.json"))
        Path(found[-1]).write_text(json.dumps(values), "utf-8")
    return found


@pytest.fixture(scope="module")
def comparison(saved: list[str]) -> Comparison:
    (found,) = compare([read_result(path) for path in saved])
    return found


@pytest.fixture(scope="module")
def excitation() -> Excitation:
    return excite(ROBOT, ExciteOptions(duration=4.0, starts=1, rounds=2))


@pytest.fixture(scope="module")
def resolution(diagnosis: Diagnosis) -> Resolution:
    """Return a motion planned to tell what was found from another that comes as near."""
    saved = json.loads(json.dumps(diagnosis.to_dict(), default=lambda value: value.tolist()))
    rival = {"effect": "encoder_skew", "joint": "joint1", "parameters": {"skew": 1e-4}, "std_error": {"skew": 1e-5}}
    saved["also_possible"] = [{**saved["effects"][0], **rival, "instead_of": "link_viscous", "behind": 0.0}]
    return resolve(question_of({"command": "diagnose", **saved}, ROBOT), ResolveOptions(duration=4.0))


@pytest.fixture(scope="module")
def base() -> BaseParameters:
    return find_base(Regressor(ROBOT))


@pytest.fixture(scope="module")
def motion_diagnosis(tmp_path_factory: pytest.TempPathFactory) -> MotionDiagnosis:
    folder = tmp_path_factory.mktemp("commands")
    path = plant.written(folder, "log.h5", plant.moved(4, 6.0))
    arm = robot_as_logged(plant.robot(folder), [path], None, {})
    signals = prepare(read_recording([path], arm), arm)
    found = diagnose(arm, signals, DiagnoseOptions(only=("link_spring",)))
    assert isinstance(found, MotionDiagnosis)  # a log of commands, of known bodies
    return found


@pytest.fixture(scope="module")
def results(
    log: str,
    recording: Recording,
    identification: Identification,
    diagnosis: Diagnosis,
    comparison: Comparison,
    excitation: Excitation,
    base: BaseParameters,
    motion_diagnosis: MotionDiagnosis,
    resolution: Resolution,
    months: list[str],
) -> dict[str, Shown]:
    """Return one result of every kind that shows itself."""
    found: list[Shown] = [
        recording, identification, diagnosis, comparison, excitation, base, inspect_log(log),
        make_physical(identification), validate(ROBOT, prepare(recording, ROBOT)), motion_diagnosis,
        replay(ROBOT, recording, ReplayOptions(horizon=0.2)), sample([identification], 50, seed=3),
        trend([identification, *months[1:]]), resolution, compare([identification] * 3), prepare(recording, ROBOT),
        ROBOT,
    ]  # fmt: skip
    return {type(result).__name__: result for result in found}


KINDS = [name for name in elid_cli.__all__ if isinstance(k := getattr(elid_cli, name), type) and issubclass(k, Shown)]
WORDS = {
    "BaseParameters": ["28 standard, 14 base", "m2 - 4*Izz2"],
    "Comparison": ["result 2 against result 1", "m1 - 4*Izz1"],
    "Comparisons": ["what has changed?", "result 3"],
    "Diagnosis": ["missing from the model", "link_viscous  joint1", "before", "after"],
    "Excitation": ["use of the limits", "expected ± sd"],
    "Identification": ["14 base", "K1", "joint2"],
    "LogInfo": ["HDF5", "log.h5", "theta"],
    "MotionDiagnosis": ["rms error of the simulated position", "three"],
    "ParameterSets": ["range of the sets", "2.5 %", "K1"],
    "PhysicalParameters": ["a robot that could be built", "decided by"],
    "Recording": ["at 500 Hz, 2 joints", "log.h5"],
    "Replay": ["simulated minus measured position", "joint2"],
    "Resolution": ["encoder_skew", "link_viscous"],
    "Robot": ["planar2", "0 -9.81 0 m/s²", "elastic", "14 of 14"],
    "Signals": ["at 500 Hz, 2 joints", "zero-phase low-pass 10 Hz", "noise of each channel", "joint2"],
    "Trends": ["planar2 · 3 recordings", "slope: per", "fv1"],
    "Validation": ["torque rms", "joint1", "N·m"],
}


class Checker(html.parser.HTMLParser):
    """Collects the text of a page and refuses tags that do not close in order."""

    VOID = ("br", "img")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.said = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag not in ("script", "style", "html", "body"), "a notebook's page is not ours"
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.said += f" {data}"


def test_every_result_that_shows_itself_is_tried(results: dict[str, Shown]) -> None:
    assert set(KINDS) == set(results) == set(WORDS)


@pytest.mark.parametrize("kind", WORDS)
def test_results_print_as_tables(results: dict[str, Shown], kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    said = str(results[kind])
    assert [word for word in WORDS[kind] if word not in said] == []
    assert max(map(len, said.splitlines())) <= 80 or kind in (
        "LogInfo",
        "Comparison",
        "Recording",
        "Signals",
    )  # paths are whole
    assert "Next: " not in said
    assert "--all" not in said
    page = Checker()
    page.feed(results[kind]._repr_html_())
    assert page.open == []
    spoken = " ".join(page.said.split()).lower()
    assert [word for word in WORDS[kind] if " ".join(word.split()).lower() not in spoken] == []


@pytest.mark.parametrize("kind", sorted(WORDS.keys() - {"Robot"}))  # whose repr is all of it: robots are compared so
def test_a_repr_is_short_and_says_how_large_things_are(results: dict[str, Shown], kind: str) -> None:
    said = repr(results[kind])
    assert said.startswith(f"{kind}(")
    assert "array(" not in said
    assert "\n" not in said
    assert len(said) < 1000


def test_long_tables_say_what_shows_the_rest() -> None:
    many = identification_of_many()
    assert "to_frame()" in str(many)
    assert len(many.to_frame()) == many.base.count


def identification_of_many() -> Identification:
    """Return an identification of an arm with more base parameters than a table shows."""
    puma = read_robot("puma560")
    log = Path(__file__).parents[2] / "sample_logs" / "puma560.h5"
    return identify(puma, prepare(read_recording([log], puma), puma))


def test_values_are_those_of_json(
    log: str, identification: Identification, diagnosis: Diagnosis, recording: Recording, base: BaseParameters
) -> None:
    printed = elid("identify", log, "--robot", "planar2")
    assert {k: v for k, v in printed.items() if k not in KNOWN_TO_COMMANDS_ONLY} == identification.to_dict()
    assert printed["log"] == recording.to_dict()
    printed = elid("diagnose", log, "--robot", "planar2", "--only", "link_viscous")
    assert printed["effects"][0]["effect"] == "link_viscous"
    assert {k: v for k, v in printed.items() if k not in KNOWN_TO_COMMANDS_ONLY - {"log"}} == diagnosis.to_dict()
    printed = elid("classify", "--robot", "planar2")
    assert {k: printed[k] for k in base.to_dict()} == base.to_dict()
    assert {"counts", "classification", "base_parameters"} <= base.to_dict().keys()


def test_values_of_the_other_commands_are_those_of_json(
    log: str, recording: Recording, saved: list[str], comparison: Comparison, results: dict[str, Shown]
) -> None:
    printed = elid("validate", log, "--robot", "planar2")
    signals = prepare(recording, ROBOT, SignalOptions.for_diagnosis(recording.rate))
    values = validate(ROBOT, signals).to_dict()
    assert {k: printed[k] for k in values} == values
    printed = elid("compare", *saved)
    assert {k: v for k, v in printed.items() if k not in KNOWN_TO_COMMANDS_ONLY} == comparison.to_dict()
    assert elid("info", log)["logs"] == [results["LogInfo"].to_dict()]
    printed = elid("identify", log, "--robot", "planar2", "--physical")
    assert printed["physical"] == results["PhysicalParameters"].to_dict()


def test_frames_hold_the_main_table(results: dict[str, Shown], identification: Identification) -> None:
    pytest.importorskip("pandas")
    frame = identification.to_frame()
    np.testing.assert_array_equal(frame["estimate"], identification.estimate)
    np.testing.assert_array_equal(frame["std_error"], identification.std_error)
    assert list(frame["name"]) == list(identification.base.names)
    samples = results["Recording"]
    assert isinstance(samples, Recording)
    frame = samples.to_frame()
    assert list(frame)[:3] == ["t", "q.joint1", "q.joint2"]
    np.testing.assert_array_equal(frame["tau.joint2"], samples.tau[:, 1])
    frame = results["Diagnosis"].to_frame()
    assert frame["effect"].tolist() == ["link_viscous"]
    assert frame["value"][0] == pytest.approx(2.0, rel=0.05)
    prepared = results["Signals"].to_frame()
    assert {"t", "ddq.joint1", "dtheta.joint2"} <= set(prepared)
    np.testing.assert_array_equal(prepared["tau.joint2"], samples.tau[:, 1])
    rows = {"Validation": 2, "Excitation": 14, "BaseParameters": 14, "PhysicalParameters": 28}
    assert {kind: len(results[kind].to_frame()) for kind in rows} == rows
    compared = results["Comparison"]
    assert isinstance(compared, Comparison)
    frame = compared.to_frame()  # what was found beside the base parameters too; NaN where one result has no estimate
    assert len(frame) == 14 + len(compared.beside) > 14
    assert f"of {frame['deviations'].notna().sum()} parameters moved" in " ".join(str(compared).split())


def test_without_pandas_a_frame_is_refused_with_what_to_install(
    base: BaseParameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UsageError, match="pandas is not installed") as refused:
        base.to_frame()
    assert "elid[frames]" in refused.value.hint


def test_dataclasses_with_arrays_do_not_print_them() -> None:
    classes = [k for name in elid_cli.__all__ if dataclasses.is_dataclass(k := getattr(elid_cli, name))]
    with_arrays = {k for k in classes if any("Array" in str(f.type) for f in dataclasses.fields(k))}
    assert with_arrays
    assert {k.__name__ for k in with_arrays if "Brief" not in {c.__name__ for c in k.__mro__}} == set()


def test_sets_and_trends_of_results_are_those_of_the_files_saved(
    saved: list[str], months: list[str], identification: Identification, results: dict[str, Shown]
) -> None:
    first = saved[0]
    drawn = results["ParameterSets"]
    assert isinstance(drawn, ParameterSets)
    assert np.array_equal(sample([first], 50, seed=3).values, drawn.values)
    assert list(drawn.to_frame().columns) == list(drawn.names)
    assert np.array_equal(drawn.to_frame().to_numpy(), drawn.values)
    printed = elid("sample", first, "-n", "50", "--seed", "3")
    assert printed["parameters"] == drawn.to_dict()["parameters"]
    assert printed["samples"] == drawn.to_dict()["samples"]
    over = trend([months[1], identification, read_result(months[2])])
    assert isinstance(over, Trends)
    assert over.files == (months[1], "result 2", months[2])
    assert trend([*months, identification]).files == tuple(months)
    printed = elid("trend", *months)
    assert printed["parameters"] == trend(months).to_dict()["parameters"]
    assert len(over.to_frame()) == len(printed["parameters"])
    (same,) = compare([first, identification])
    assert same.moved(0.0) == ()


def test_a_diagnosis_chooses_what_judges(recording: Recording) -> None:
    signals = prepare(recording, ROBOT, SignalOptions.for_diagnosis(recording.rate))
    with pytest.raises(UsageError, match="the motion cannot judge this log"):
        diagnose(ROBOT, signals, DiagnoseOptions(by="motion"))


def test_a_printed_validation_judges_by_the_sensors_noise(recording: Recording) -> None:
    off = replace(ROBOT, joints=tuple(replace(j, parameters={**j.parameters, "fs": 5.0}) for j in ROBOT.joints))
    told = str(validate(off, prepare(recording, off)))
    assert "what is missing?" in told
    assert "× noise" in told
    assert "good  " not in told


def test_what_reading_a_log_warned_of_is_in_its_result(recording: Recording) -> None:
    warned = replace(recording, warnings=("the clock stood still",))
    found = identify(ROBOT, prepare(warned, ROBOT))
    assert found.log_warnings == ("the clock stood still",)
    assert "the clock stood still" in str(found)
    assert "the clock stood still" in found.to_dict()["warnings"]
