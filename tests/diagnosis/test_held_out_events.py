"""What happens within a held-out stretch alone: a change is timed there, anything else is at least not called noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.diagnosis.residuals import MATTERS, RowState
from elid_cli.diagnosis.result import Unexplained
from elid_cli.diagnosis.unexplained import HELD_OUT, UNSEEN, unseen
from elid_cli.estimation.identify import JointError
from elid_cli.model.regressor import Kind
from elid_cli.report.answers.diagnosis import event_words
from elid_cli.report.answers.diagnosis_tables import _left
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, Made, World, laws_of, log_of, make, recorded

ARM, GRIPPER, RATE = 317, 305, 500.0
"""Seeds of two arms; what the search alone says of a payload of the second is up to a second wrong."""
WITHIN, BETWEEN = 8.1, 6.0
"""Instants within the second held-out stretch, from 7.5 to 8.7 s, and before it."""


@pytest.fixture(scope="module")
def made() -> Made:
    return make(ARM, 2, rate=RATE, duration=15.0)


def diagnosed(made: Made, laws: Laws, *only: str, seed: int = ARM) -> Diagnosis:
    log = recorded(made, log_of(made, laws), db=90.0, counts=0.0, torque=0.0, colour=0.0, seed=seed)
    return diagnose(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)), DiagnoseOptions(only=only))


def touch(made: Made, joint: int, instant: float) -> Laws:
    """Return a contact of a few tenths of a second at one link."""

    def torque(world: World) -> np.ndarray:
        push = np.zeros_like(world.q)
        push[:, joint] = 0.25 * made.sizes[joint].torque * np.exp(-(((world.t - instant) / 0.15) ** 2))
        return push

    return Laws(link=[torque])


@pytest.mark.parametrize("joint", [0, 1])
def test_a_contact_within_a_held_out_stretch_is_found_with_others_held_out(made: Made, joint: int) -> None:
    found = diagnosed(made, touch(made, joint, WITHIN), "contact", "stribeck")
    assert all(not first - 0.1 < WITHIN < last + 0.1 for first, last in found.held_out)
    assert [(effect.effect, effect.joint) for effect in found.effects] == [("contact", f"j{joint + 1}")]
    assert found.effects[0].parameters["time"] == pytest.approx(WITHIN, abs=0.02)
    assert found.effects[0].gain > 0.9
    assert found.written_robot.effects == ()
    assert (
        event_words(found.events[0])
        == f"The contact of j{joint + 1} at 8.1 s is of this log, not of the robot: left out."
    )


@pytest.mark.parametrize("joint", [0, 1])
def test_a_contact_that_the_search_cannot_see_is_not_called_noise(made: Made, joint: int) -> None:
    found = diagnosed(made, touch(made, joint, WITHIN), "stribeck")
    first, last = found.held_out[1]
    assert first < WITHIN - 0.5
    assert last > WITHIN + 0.5
    assert found.effects == ()
    assert all(row.ratio < 1.5 for row in found.rows_after)  # where the search looks there is nothing
    (item,) = found.unexplained
    assert (item.joint, item.variable) == (f"j{joint + 1}", HELD_OUT)
    assert item.ratio > UNSEEN
    assert not found.sufficient
    assert "on the held-out stretches, where the search does not look" in _left(found, item)


def test_nothing_there_is_sufficient_there_too(made: Made) -> None:
    found = diagnosed(made, Laws(), "contact", "stribeck")
    assert (found.effects, found.unexplained) == ((), ())
    assert found.sufficient


def test_a_contact_that_the_search_sees_is_no_matter_of_held_out_stretches(made: Made) -> None:
    found = diagnosed(made, touch(made, 1, BETWEEN), "contact")
    assert [(e.effect, e.joint) for e in found.effects] == [("contact", "j2")]
    assert HELD_OUT not in {item.variable for item in found.unexplained}


@pytest.mark.parametrize("start", [7.65, 8.5])
def test_a_payload_gripped_within_a_held_out_stretch_is_timed_there(start: float) -> None:
    made = make(GRIPPER, 2, rate=RATE, duration=15.0)
    usual = laws_of("payload", made, 1).payload
    assert usual is not None
    found = diagnosed(made, Laws(payload=(start, usual[1])), "payload", seed=GRIPPER)
    first, last = found.held_out[1]
    assert first < start < last
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("payload", None)
    assert effect.parameters["start"] == pytest.approx(start, abs=0.05)
    assert effect.gain > 0.9
    payload = found.state_after.effects[0]
    assert payload.shape[0] == effect.parameters["start"]  # what is written is what was fitted


def test_the_time_that_gripping_takes_is_not_called_unexplained() -> None:
    """A load is taken up within 60 ms here and at once in the model: right in the middle of a held-out stretch."""
    made = make(42, 2, rate=RATE, duration=15.0)
    found = diagnosed(made, laws_of("payload", made, 1), "payload", seed=42)
    assert [e.effect for e in found.effects] == ["payload"]
    assert found.effects[0].parameters["start"] == pytest.approx(8.25, abs=0.05)
    assert found.after["j2"].rms > UNSEEN * (found.after["j2"].floor or 0.0)  # what is reported holds those moments
    assert found.unexplained == ()


def errors(**changes: float | None) -> dict[str, JointError]:
    """Return the held-out error of one joint, at its floor but for the changes."""
    plain = JointError(0.1, 0.01, 0.1, 0.01, torque_rms=10.0, floor=0.1, spring_floor=0.1)
    return {"j1": replace(plain, **changes)}  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "rows"),
    [
        ({}, []),
        ({"rms": 0.95 * UNSEEN * 0.1}, []),
        ({"rms": 1.05 * UNSEEN * 0.1}, ["sum"]),
        ({"spring_rms": 1.05 * UNSEEN * 0.1}, ["motor"]),
        ({"rms": 0.4, "spring_rms": 0.4}, ["sum", "motor"]),
        ({"rms": 0.4, "floor": None}, []),  # no floor, no judgement
        ({"rms": 0.4, "spring_rms": None, "spring_floor": None}, ["sum"]),  # a rigid joint
        ({"rms": 0.4, "torque_rms": 0.9 * 0.4 / MATTERS}, ["sum"]),
        ({"rms": 0.4, "torque_rms": 1.1 * 0.4 / MATTERS}, []),  # smoothing's own errors
    ],
)
def test_held_out_rows_count_from_three_floors_that_matter(changes: dict[str, float | None], rows: list[str]) -> None:
    items = unseen(errors(**changes), (), ())
    assert [(item.joint, item.rows, item.variable) for item in items] == [("j1", row, HELD_OUT) for row in rows]
    assert all(item.ratio == pytest.approx(item.rms / 0.1) for item in items)


@pytest.mark.parametrize(
    ("joint", "row", "left"),
    [("j1", "sum", []), ("j1", "motor", ["sum"]), ("j2", "sum", ["sum", "motor"])],
)
def test_what_is_told_already_is_not_told_again(joint: str, row: Kind, left: list[str]) -> None:
    """Whether the row's structure is told, or it is high where the search looks."""
    high = errors(rms=0.4, spring_rms=0.4)
    told = Unexplained(joint, row, "q", 0.5, 0.4, 4.0, ())
    state = RowState(joint, row, rms=0.4, share=0.04, ratio=4.0)
    assert state.high
    assert [item.rows for item in unseen(high, (), (told,))] == left
    assert [item.rows for item in unseen(high, (state,), ())] == left
