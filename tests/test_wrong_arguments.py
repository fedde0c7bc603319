"""Wrong arguments of the Python API: one error of elid's own names the argument, and no impossible value passes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import elid_cli
from elid_cli import (
    DiagnoseOptions,
    EstimateOptions,
    ExciteOptions,
    Joint,
    LogError,
    LogRequest,
    Recording,
    ReplayOptions,
    ResolveOptions,
    Robot,
    RobotError,
    SensorOptions,
    SignalOptions,
    Signals,
    SimulationOptions,
    UsageError,
    prepare,
    read_recording,
    read_robot,
    recording_of,
)
from elid_cli.experiment.reference import ReferenceOptions
from elid_cli.experiment.simulation.control import ControlOptions

NAN, INF = float("nan"), float("inf")
LOG = "sample_logs/planar2.csv"


class Given(NamedTuple):
    """What right arguments are."""

    robot: Robot
    recording: Recording
    signals: Signals


@pytest.fixture(scope="module")
def given() -> Given:
    robot = read_robot("planar2")
    recording = read_recording([LOG], robot)
    return Given(robot, recording, prepare(recording, robot))


def of(cls: Any, *arguments: Any, **options: Any) -> Callable[[], Any]:
    return lambda: cls(*arguments, **options)


def joint(**options: Any) -> Callable[[], Any]:
    return of(Joint, "shoulder", **options)


def robot(*joints: Any, **options: Any) -> Callable[[], Any]:
    return of(Robot, "arm", joints or (Joint("a"),), **options)


ROBOTS = {
    "type: 'Revolute' .*\n.*did you mean 'revolute'": joint(type="Revolute"),
    "type: 'ball' .*\n.*known: revolute, prismatic": joint(type="ball"),
    "transmission: 'Rigid' .*\n.*did you mean 'rigid'": joint(transmission="Rigid"),
    "torque_at: 'Link' .*\n.*did you mean 'link'": joint(torque_at="Link"),
    "no parameter is called 'mass'\n.*known: m, cx": joint(parameters={"mass": 1.0}),
    "no parameter is called 'ixx'\n.*did you mean 'Ixx'": joint(parameters={"m": 1.0, "ixx": 0.1}),
    "parameters: m: '1' is no number": joint(parameters={"m": "1"}),
    "parameters: fv: nan is not finite\n.*leave it out": joint(parameters={"fv": NAN}),
    "parameters: .*list in place of a mapping": joint(parameters=[1.0]),
    "joint 'shoulder': a: nan is not finite": joint(a=NAN),
    "theta: '0' is no number": joint(theta="0"),
    "gear_ratio 0": joint(gear_ratio=0),
    "gear_ratio: inf is not finite": joint(gear_ratio=INF),
    "motor_axis: of length 2": joint(motor_axis=(0, 0, 2)),
    "motor_axis: None is no vector": joint(motor_axis=None, gear_ratio=50),
    "axis: of length 0": joint(axis=(0, 0, 0)),
    r"xyz: \(0, 1\) is no vector": joint(xyz=(0, 1)),
    "name: 3 is no text": of(Joint, 3),
    "dh: 'Modified' .*\n.*did you mean 'modified'": robot(dh="Modified"),
    "gravity: -9.81 is no vector": robot(gravity=-9.81),
    r"gravity: \(0, -9.81\) is no vector": robot(gravity=(0, -9.81)),
    "gravity: nan is not finite": robot(gravity=(0, 0, NAN)),
    "a second joint 'a'": robot(Joint("a"), Joint("b"), Joint("a")),
    "parent of b: 'c' is no joint above": robot(Joint("a"), Joint("b", parent="c"), Joint("c")),
    "joints: no tuple of Joint": robot("a"),
    "it has no joints": lambda: elid_cli.find_base(elid_cli.Regressor(Robot("arm", ()))),
    "read_robot: .*int": of(read_robot, 5),
    "read_robot: .*bytes": of(read_robot, b"planar2"),
}


@pytest.mark.parametrize("said", ROBOTS)
def test_robots_that_a_program_builds_are_checked_as_those_of_files(said: str) -> None:
    with pytest.raises(RobotError, match=said):
        ROBOTS[said]()


def test_robots_that_can_be_are_left_as_they_are() -> None:
    branched = Robot("arm", (Joint("a", a=1e308, d=1e308), Joint("b", parent="base"), Joint("c", parent="a")))
    assert branched.parents == (-1, -1, 0)
    assert Joint("a", type="prismatic", gear_ratio=-50, parameters={"Jm": np.float64(1e-4), "m": 1}).gear_ratio == -50


OPTIONS: list[tuple[Any, dict[str, tuple[Any, ...]]]] = [
    (
        EstimateOptions,
        {
            "folds": (100000, -3, 0, 1, 2.5, "6", NAN, True),
            "hold": (-1, NAN, INF, "1"),
            "mask": (3, "no"),
            "delays": ("no", 1),
            "accurate": ("yes", None),
            "declared_late": ("b", (-1,), 3, ("a",)),
            "fit": (None, "Torque"),
            "guards": (0,),
        },
    ),
    (
        SignalOptions,
        {
            "cutoff": ("10", NAN, 0, -1),
            "knots": (INF,),
            "order": (2.5, 0),
            "slow_motion": ("no",),
            "smoothing": (None,),
            "min_velocity": (NAN, INF, "0"),
        },
    ),
    (DiagnoseOptions, {"jobs": ("2", 0), "only": ("stribeck", ("stribek",), (3,)), "lookup": (1,), "by": (None,)}),
    (
        SimulationOptions,
        {
            "duration": ("3", 0, NAN),
            "rate": (-1,),
            "seed": (-1, 1.5),
            "reference": ("tr.csv", None),
            "control": ({}, None),
            "sensors": ({}, None),
            "friction_width": (-1, 0, NAN),
            "accuracy": (0, -1, NAN),
        },
    ),
    (
        SensorOptions,
        {
            "torque_noise": (NAN, -1, "1"),
            "position_noise": (-1,),
            "torque_correlation": (-1, INF),
            "noise_db": (NAN, "80"),
            "counts": (0, -1),
            "gyro": ("joint1", 3),
            "velocities": ("no",),
        },
    ),
    (ControlOptions, {"kp": (3, ("a",), (-1.0,), "12"), "feedforward": (None, "Model")}),
    (ReferenceOptions, {"amplitude": (0, NAN), "speed": (-1,)}),
    (
        ExciteOptions,
        {
            "duration": ("10", INF),
            "starts": (2.5, 0),
            "seed": (-1, 1.5),
            "aims": ("K1",),
            "measured": ((1.0, 2.0), "no"),
        },
    ),
    (ResolveOptions, {"duration": (-1,), "starts": (0,), "seed": (-1,)}),
    (ReplayOptions, {"horizon": (NAN, -1, "1"), "engine": (None,), "mjcf": (3,)}),
]
VALUES = [(cls, name, value) for cls, fields in OPTIONS for name, values in fields.items() for value in values]


@pytest.mark.parametrize(("cls", "name", "value"), VALUES, ids=lambda item: getattr(item, "__name__", repr(item)))
def test_options_that_cannot_be_are_refused_where_they_are_given(cls: Any, name: str, value: Any) -> None:
    with pytest.raises(UsageError, match=f"^{cls.__name__}: {name}") as told:
        cls(**{name: value})
    assert told.value.hint


def test_options_that_can_be_pass_in_any_type_of_numbers() -> None:
    assert EstimateOptions(folds=np.int64(4), mask=np.True_, hold=np.float32(0.5)).folds == 4  # type: ignore[arg-type]
    assert SignalOptions(cutoff=INF, rate=None).cutoff == INF
    assert SensorOptions(noise_db=INF, gyro=["joint1"], torque_correlation=5).gyro == ["joint1"]  # type: ignore[arg-type]
    assert ExciteOptions(measured=((NAN, 0.1), (0.0, INF)), aims=("K1",)).starts == 8


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"robot": "planar2"}, r"robot: the text 'planar2' in place of a Robot\n.*read_robot\('planar2'\)"),
        ({"logs": "x.csv"}, r"logs: the text 'x.csv' in place of several logs\n.*\['x.csv'\]"),
        ({"logs": [3]}, "logs: .*int"),
        ({"jobs": "2"}, "jobs: '2'"),
        ({"signals": {}}, "signals: .*dict in place of a SignalOptions"),
        ({"mapping": "q=a"}, "mapping: the text"),
        ({"time": "heder"}, "time: 'heder' .*\n.*did you mean 'header'"),
    ],
)
def test_requests_that_cannot_be_are_refused(given: Given, options: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=f"LogRequest: {said}"):
        LogRequest(**{"logs": [LOG], "robot": given.robot, **options})


def arrays(recording: Recording, **others: Any) -> dict[str, Any]:
    return {"t": recording.t, "q": recording.q, "theta": recording.theta, "tau": recording.tau, **others}


def timeless(given: Given, rate: Any) -> Recording:
    return recording_of(given.robot, {k: v for k, v in arrays(given.recording).items() if k != "t"}, rate=rate)


api: Any = elid_cli
CALLS: dict[str, Callable[[Given], Any]] = {
    "prepare: options: .*dict in place of a SignalOptions": lambda g: api.prepare(g.recording, g.robot, {"cutoff": 10}),
    "identify: options: the text 'accurate' in place of an Est": lambda g: api.identify(g.robot, g.signals, "accurate"),
    "no joint 9": lambda g: api.identify(g.robot, g.signals, EstimateOptions(declared_late=(9,))),
    "diagnose: options: the text 'stribeck'": lambda g: api.diagnose(g.robot, g.signals, "stribeck"),
    "replay: options: .*float": lambda g: api.replay(g.robot, g.recording, 0.5),
    "simulate: options: .*dict": lambda g: api.simulate(g.robot, {"duration": 3}),
    "excite: options: .*int": lambda g: api.excite(g.robot, 3),
    "question: the text": lambda g: api.resolve("x"),
    "chosen: .* in place of bool": lambda g: api.validate(g.robot, g.signals, np.ones(5, dtype=bool)),
    "chosen: int64": lambda g: api.validate(g.robot, g.signals, [1, 2]),
    "accelerations: .* and": lambda g: api.prepare(g.recording, g.robot, None, (g.recording.q, g.recording.q[:5])),
    "accelerations: .*2,": lambda g: api.prepare(g.recording, g.robot, None, g.recording.q),
    "accelerations: .*int": lambda g: api.prepare(g.recording, g.robot, None, 3),
    "cutoff 1e-09: one period": lambda g: api.prepare(g.recording, g.robot, SignalOptions(cutoff=1e-9)),
    "rate 4.94.*: one period": lambda g: api.prepare(g.recording, g.robot, SignalOptions(rate=5e-324)),
    "for_diagnosis: rate: '500'": lambda g: SignalOptions.for_diagnosis("500"),  # type: ignore[arg-type]
    "for_diagnosis: rate nan": lambda g: SignalOptions.for_diagnosis(NAN),
    "recording_of: rate: '500'": lambda g: timeless(g, "500"),
    "recording_of: rate 0 ": lambda g: timeless(g, 0),
    "recording_of: rate -5 ": lambda g: timeless(g, -5),
    "recording_of: signals: .*list": lambda g: api.recording_of(g.robot, [g.recording.t, g.recording.q]),
    "recording_of: joints: the text": lambda g: api.recording_of(g.robot, arrays(g.recording), joints="joint1"),
    "read_recording: paths: .*int": lambda g: api.read_recording(5, g.robot),
    "read_recording: rate -1": lambda g: api.read_recording([LOG], g.robot, rate=-1),
    "result 1: .*int": lambda g: api.compare([3, 4]),
    "result 1: .*dict": lambda g: api.compare([{}, {}]),
    "compare: results: the text 'ab.json'": lambda g: api.compare("ab.json"),
    "sample: results: .*int": lambda g: api.sample(5, 3),
    "sample: no result": lambda g: api.sample([], 3),
    "sample: count: '3'": lambda g: api.sample([5], "3"),
    "sample: count: 2.5": lambda g: api.sample([5], 2.5),
    "sample: count: nan": lambda g: api.sample([5], NAN),
    "sample: seed: 'x'": lambda g: api.sample([5], 3, seed="x"),
    "sample: seed: -1": lambda g: api.sample([5], 3, seed=-1),
    "robot: the text 'planar2' in": lambda g: api.sample([5], 3, "planar2"),
    "trend: results: .*int": lambda g: api.trend(5),
    "result: .*int": lambda g: api.read_result(3),
    "recording: the text 'x'": lambda g: api.write_recording("x", "a.csv"),
    "write_recording: path: .*int": lambda g: api.write_recording(g.recording, 5),
    "robot: the text 'puma560'": lambda g: api.Regressor("puma560"),
    "robot: the text 'emps'": lambda g: api.simulate("emps"),
    "robot: the text 'kr300'": lambda g: api.excite("kr300"),
    "model: .*Robot in place of a Regressor": lambda g: api.find_base(g.robot),
    "found: .*Robot in place of an Identification": lambda g: api.make_physical(g.robot),
    "found: .*Signals in place of an Identification": lambda g: api.identified_robot(g.signals),
    "write_triangles: logs: .*int in place of a ReducedLog": lambda g: api.write_triangles([3], "a.npz"),
    "saved: the text": lambda g: api.question_of("x", g.robot),
    "robot: the text 'q'": lambda g: api.read_question("x", "q"),
    "request: the text 'x.csv' in place of a LogRequest": lambda g: api.identify_logs("x.csv"),
    "request: the text 'y.csv'": lambda g: api.reduced_logs("y.csv"),
    "remarks: the text 'one remark'": lambda g: api.write_robot(g.robot, "r.yaml", "one remark"),
    "write_robot: path": lambda g: api.write_robot(g.robot, 5),
    "options: the text 'q=a'": lambda g: api.read_map_options("q=a"),
    "a log is a path": lambda g: api.inspect_log(5),
    "robot: the text 'z'": lambda g: api.inspect_log(LOG, "z"),
    "signals: the text 'x'": lambda g: api.diagnose_motion(g.robot, "x"),
    "joints: the text 'ab'": lambda g: api.write_trajectory("a.csv", "ab", *[g.recording.q] * 4),
    "q is not of shape": lambda g: api.write_trajectory("a.csv", ("a",), g.recording.t, *[g.recording.q] * 3),
    "Recording: t: .*list in place": lambda g: api.Recording(("a",), 0.01, [0.0], [[1.0]], [[1.0]], [[1.0]]),
}


@pytest.mark.parametrize("said", CALLS)
def test_functions_refuse_arguments_of_another_kind(
    given: Given, said: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if not any(name in said for name in ("read_recording", "'z'")):
        monkeypatch.chdir(tmp_path)  # what is not refused would be written
    with pytest.raises(UsageError, match=said):
        CALLS[said](given)
    assert not list(tmp_path.iterdir())


def test_arrays_of_a_recording_that_do_not_fit_together_are_refused(given: Given, tmp_path: Path) -> None:
    wrong = replace(given.recording, q=given.recording.q[:-5])
    for call in (lambda: api.replay(given.robot, wrong), lambda: api.write_recording(wrong, tmp_path / "a.csv")):
        with pytest.raises(LogError, match="q has the shape"):
            call()
    with pytest.raises(LogError, match=r"q does not hold numbers\n.*complex"):
        recording_of(given.robot, arrays(given.recording, q=given.recording.q + 1j))


def test_masked_samples_are_missing_samples(given: Given) -> None:
    mask = np.zeros(given.recording.q.shape, dtype=bool)
    mask[[7, 70, 700], 1] = True  # their values are right, so that nothing but the mask can be what is noticed
    found = recording_of(given.robot, arrays(given.recording, q=np.ma.array(given.recording.q, mask=mask)))
    assert any("3 of 12000" in said for said in found.repairs)
    np.testing.assert_allclose(found.q, given.recording.q, atol=1e-3)


def test_columns_of_a_data_frame_are_taken_by_the_joints_names(given: Given) -> None:
    pandas = pytest.importorskip("pandas")
    q, names = given.recording.q, ["joint1", "joint2"]
    turned = pandas.DataFrame(q, columns=names)[names[::-1]]
    np.testing.assert_array_equal(recording_of(given.robot, arrays(given.recording, q=turned)).q, q)
    other = pandas.DataFrame(q, columns=["x", "joint1"])  # not the joints' names: by place
    np.testing.assert_array_equal(recording_of(given.robot, arrays(given.recording, q=other)).q, q)
    nullable = pandas.DataFrame(q, columns=names).astype("Float64")
    nullable.iloc[3, 0] = pandas.NA
    found = recording_of(given.robot, arrays(given.recording, q=nullable))
    assert any("q of joint1: 1 of" in said for said in found.repairs)
