"""Torque gains: the inverse gain of the other joint of two, and columns that come from the fit itself."""

from __future__ import annotations

import pytest

from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, diagnose
from elid_cli.diagnosis.evidence.held_out import held_out_triangles
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.files import read_robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, Made, laws_of, log_of, make, recorded

RATE = 500.0
GAIN = -0.08


def diagnosed(
    made: Made,
    laws: Laws,
    *,
    given: bool,
    only: tuple[str, ...] = ("torque_gain",),
    torque: float = 0.003,
    seed: int = 1,
) -> Diagnosis:
    """Return the diagnosis of a log of an arm whose file gives its parameters or not."""
    log = recorded(made, log_of(made, laws), db=90.0, counts=0.0, torque=torque, colour=0.0, seed=seed)
    robot = made.truth if given else made.robot
    return diagnose(robot, prepare(log, robot, SignalOptions.for_diagnosis(RATE)), DiagnoseOptions(only=only))


@pytest.mark.parametrize("joint", [0, 1])
def test_the_gain_of_one_joint_of_two_is_the_inverse_gain_of_the_other(joint: int) -> None:
    """A file without values leaves open whose gain it is: both are named. Its values tell which comes first."""
    made = make(1, rate=RATE, bodies_of=read_robot("planar2"))
    laws = laws_of("torque_gain", made, joint)
    for given in (False, True):
        found = diagnosed(made, laws, given=given)
        assert len(found.effects) == len(found.also_possible) == 1
        named = {e.joint: e.parameters["gain"] for e in (*found.effects, *found.also_possible)}
        assert set(named) == {"joint1", "joint2"}
        assert named[f"joint{joint + 1}"] == pytest.approx(GAIN, abs=3e-3)
        assert named[f"joint{2 - joint}"] == pytest.approx(1 / (1 + GAIN) - 1, abs=3e-3)
        if given:
            assert found.effects[0].joint == f"joint{joint + 1}"


def test_what_is_left_is_that_of_the_robot_that_is_written() -> None:
    """The column of a gain is the torque that the fit itself predicts: it and the fit must agree to the last."""
    made = make(41, 2, rate=RATE)
    found = diagnosed(made, laws_of("torque_gain", made, 0), given=False)
    assert found.state_after is not None
    inside = held_out_triangles(found.state_after)
    for k, name in enumerate(made.robot.joint_names):
        own = inside.rms(found.state_after.solution.values, EstimationRow("sum", k))
        assert found.after[name].rms == pytest.approx(own, rel=0.01)


def test_a_gain_does_not_stand_in_for_what_drags_at_another_joint() -> None:
    """A cable that drags at the second joint was followed by a gain of 0.45 of the first, whose rows held noise."""
    made = make(42, 2, rate=RATE)
    found = diagnosed(made, laws_of("dragging_cable", made, 1), given=False, only=(), torque=0.0, seed=42)
    assert {e.joint for e in found.effects} <= {"j2"}
    assert {u.joint for u in found.unexplained} == {"j2"}


def test_a_gain_beside_a_tilted_base_leaves_what_is_written() -> None:
    """Levelling ended with columns of a fit without effects: a good joint came out ten times worse."""
    made = make(55, rate=RATE, duration=10.0, bodies_of=read_robot("planar2"))
    both = laws_of("torque_gain", made, 1)
    both.gravity = laws_of("gravity_direction", made, 0).gravity
    found = diagnosed(made, both, given=False, only=("torque_gain", "gravity_direction"), seed=55)
    assert {e.effect for e in found.effects} == {"torque_gain", "gravity_direction"}
    assert found.unexplained == ()
    for name in made.robot.joint_names:
        assert found.after[name].rms < 1.2 * (found.after[name].floor or 0.0)
