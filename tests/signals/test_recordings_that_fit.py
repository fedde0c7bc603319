"""Recordings that programs make: arrays become one as a file would, and what does not fit a robot is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from elid_cli import (
    ElidError,
    EstimateOptions,
    ExciteOptions,
    LogError,
    Recording,
    ReplayOptions,
    Robot,
    SignalOptions,
    UsageError,
    compare,
    diagnose,
    identify,
    identify_logs,
    prepare,
    read_recording,
    read_robot,
    recording_of,
    replay,
    sample,
    validate,
)
from elid_cli.estimation.request import LogRequest

LOG = "sample_logs/planar2.csv"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return read_robot("planar2")


@pytest.fixture(scope="module")
def log(robot: Robot) -> Recording:
    return read_recording([LOG], robot)


def arrays(log: Recording) -> dict[str, Any]:
    return {"t": log.t, "q": log.q, "theta": log.theta, "tau": log.tau}


def test_arrays_are_read_as_the_file_that_holds_them(robot: Robot, log: Recording) -> None:
    for signal, values in arrays(recording_of(robot, arrays(log))).items():
        np.testing.assert_array_equal(values, log.signal(signal))


def test_columns_in_another_order_are_named_and_further_ones_left_out(robot: Robot, log: Recording) -> None:
    turned = {name: values[:, [1, 1, 0]] for name, values in arrays(log).items() if name != "t"}
    found = recording_of(robot, turned, joints=["joint2", "gripper", "joint1"], rate=log.rate)
    np.testing.assert_array_equal(found.q, log.q)
    np.testing.assert_array_equal(found.tau, log.tau)


@pytest.mark.parametrize(
    ("signals", "said"),
    [
        ({"q": np.zeros((50, 1))}, r"q has the shape \(50, 1\)"),
        ({"position": np.zeros((50, 2))}, "no signal is called 'position'"),
        ({"t": np.arange(49.0), "q": np.zeros((50, 2))}, "different lengths"),
        ({"q": "fast"}, "q does not hold numbers"),
        ({"t": np.zeros((50, 2))}, "t has the shape"),
    ],
)
def test_arrays_that_are_no_log_are_refused(robot: Robot, signals: dict[str, Any], said: str) -> None:
    with pytest.raises(LogError, match=said):
        recording_of(robot, signals)


def test_a_recording_of_another_robot_or_shape_is_refused(robot: Robot, log: Recording) -> None:
    wrong = {
        "the joints are joint2, joint1": replace(log, joints=log.joints[::-1]),
        "q has the shape": replace(log, q=log.q[:-5]),
        "no segments": replace(log, segments=()),
        "dt says": replace(log, dt=2 * log.dt),
    }
    for said, recording in wrong.items():
        with pytest.raises(LogError, match=said):
            prepare(recording, robot)


@pytest.mark.parametrize("name", ["cutoff", "rate", "knots", "butterworth"])
@pytest.mark.parametrize("value", [-1.0, 0.0, float("nan")])
def test_filters_that_cannot_be_are_refused(name: str, value: float) -> None:
    with pytest.raises(UsageError, match=f"{name} .* is not above 0"):
        SignalOptions(**{name: value})


def test_motions_and_samples_that_cannot_be_are_refused() -> None:
    with pytest.raises(UsageError, match="min_velocity -1 is negative"):
        SignalOptions(min_velocity=-1.0)
    with pytest.raises(UsageError, match="duration -1"):
        ExciteOptions(duration=-1.0)
    with pytest.raises(ElidError, match="0 parameter sets are none"):
        sample([], 0)


def test_signals_of_another_robot_are_refused(robot: Robot, log: Recording) -> None:
    signals = prepare(log, robot)
    with pytest.raises(LogError, match="joint1, joint2"):
        identify(read_robot("puma560"), signals)


def test_misspelt_joints_of_arrays_are_named_with_the_nearest(robot: Robot, log: Recording) -> None:
    for joints in (["joint1", "jiont2"], ["jiont2", "jiont1"]):
        with pytest.raises(LogError, match="no joint 'jiont2'") as told:
            recording_of(robot, arrays(log), joints=joints)
        assert told.value.hint == "did you mean 'joint2'?"
    single = Robot("one", robot.joints[:1])  # its only column would be taken by place
    one = {name: values[:, :1] for name, values in arrays(log).items() if name != "t"}
    with pytest.raises(LogError, match="no joint 'pp'"):
        recording_of(single, one, joints=["pp"], rate=log.rate)


def test_arguments_of_another_kind_are_refused_with_what_makes_them(robot: Robot, log: Recording) -> None:
    anything: Any = "pend.xml"
    calls: dict[str, Any] = {
        r"robot: the text 'pend.xml' in place of a Robot\n.*read_robot\('pend.xml'\)": (
            lambda: read_recording([LOG], anything),
            lambda: recording_of(anything, {}),
            lambda: prepare(log, anything),
            lambda: identify(anything, prepare(log, robot)),
            lambda: replay(anything, log),
            lambda: diagnose(anything, prepare(log, robot)),
        ),
        r"signals: a value of type Recording in place of a Signals\n.*prepare\(recording": (
            lambda: identify(robot, cast(Any, log)),
            lambda: validate(robot, cast(Any, log)),
            lambda: diagnose(robot, cast(Any, log)),
        ),
        "recording: the text 'pend.xml' in place of a Recording": (
            lambda: prepare(anything, robot),
            lambda: replay(robot, anything),
        ),
    }
    for said, wrong in calls.items():
        for call in wrong:
            with pytest.raises(UsageError, match=said):
                call()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: ReplayOptions(engine=cast(Any, "foo")), r"engine: 'foo' says nothing here(.|\n)*known: elid, mujoco"),
        (lambda: ReplayOptions(commands=cast(Any, "hold")), "did you mean 'held'"),
        (lambda: SignalOptions(commands=cast(Any, "hold")), "did you mean 'held'"),
        (lambda: SignalOptions(smoothing=cast(Any, "splines")), "did you mean 'spline'"),
        (lambda: SignalOptions(cutoff=cast(Any, "abc")), "cutoff: 'abc' is no number"),
        (lambda: EstimateOptions(fit=cast(Any, "trajectories")), "did you mean 'trajectory'"),
        (lambda: EstimateOptions(estimator=cast(Any, "papre")), "did you mean 'paper'"),
        (lambda: read_recording([LOG], read_robot("planar2"), time_source="heder"), "did you mean 'header'"),
    ],
)
def test_words_that_say_nothing_are_refused_with_the_nearest(make: Any, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        make()


def test_what_several_results_say_prints_as_their_command(robot: Robot, log: Recording) -> None:
    found = identify(robot, prepare(log, robot))
    compared = compare([found, found, found])
    assert "what has changed?" in str(compared)
    assert len(compared.to_dict()["comparisons"]) == len(compared) == 2
    assert repr(compared) == "Comparisons(<2 x Comparison>)"
    merged = identify_logs(LogRequest([LOG], robot))
    assert str(merged) == str(merged.found)
    assert merged.to_dict() == merged.found.to_dict()
