"""Friction that follows the load of rigid joints whose rotors motion shows in sums only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis.diagnose import diagnose
from elid_cli.diagnosis.evidence.held_out import held_out_triangles
from elid_cli.diagnosis.refit import contributions, published
from elid_cli.diagnosis.result import Diagnosis
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.regression.standard_errors import ROTOR_KNOWN, told_rotors
from elid_cli.estimation.result import Identification
from elid_cli.model.effects import effect_that
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import Arm, Laws, Sensors, World, log, random_arm

SHARE = 0.08
BARE = EffectSpec("load_friction", "joint1", {})


def logged(seed: int, share: float = SHARE) -> tuple[Arm, Recording]:
    """Return a rigid arm, and its log with friction under load at its first joint."""
    arm = random_arm(np.random.default_rng(seed), 2, rigid=(0, 1))

    def torque(world: World) -> np.ndarray:
        total = np.zeros_like(world.q)
        total[:, 0] = share * np.abs(world.spring[:, 0]) * np.sign(world.dtheta[:, 0])
        return total

    return arm, log(arm, seed=seed, duration=10.0, sensors=Sensors(rate=500.0, torque=0.001), laws=Laws(motor=[torque]))


def without(robot: Robot, *kinds: str) -> Robot:
    """Return a robot whose file does not know parameters of some kinds."""
    kept = [{k: v for k, v in joint.parameters.items() if k not in kinds} for joint in robot.joints]
    return replace(robot, joints=tuple(replace(j, parameters=p) for j, p in zip(robot.joints, kept, strict=True)))


UNKNOWN = {"no values": ("m", "cx", "cy", "Izz", "Jm", "fs", "fv"), "bodies": ("Jm", "fs", "fv")}


def is_right(found: Identification, truth: Robot) -> None:
    """Check the parameters that do not depend on a reference, and that only noise is left."""
    wanted = found.base.values(np.nan_to_num(truth.reference()))
    for item, value in zip(found.parameters, wanted, strict=True):
        assert item.verdict != "refused"
        assert item.estimate == pytest.approx(value, abs=4 * item.std_error), item.name
    assert found.model == "sufficient"


@pytest.mark.parametrize("unknown", UNKNOWN.values(), ids=UNKNOWN)
def test_declared_friction_under_load_tells_the_rotor(unknown: tuple[str, ...]) -> None:
    """With the rotor divided from the bodies as it happened, four times the noise was left."""
    arm, recording = logged(3)
    truth = arm.described()
    robot = replace(without(truth, *unknown), effects=(BARE,))
    signals = prepare(recording, robot)
    found = identify(robot, signals, EstimateOptions(fit="torque"))
    is_right(found, truth)
    (effect,) = found.effects
    assert effect.parameters["coefficient"] == pytest.approx(SHARE, abs=4 * effect.std_error["coefficient"])
    assert effect.std_error["coefficient"] < 0.02 * SHARE
    inertia, error = found.rotors[0]
    assert inertia == pytest.approx(arm.rotor[0] * arm.gear[0] ** 2, abs=4 * error)
    assert error < 0.1 * inertia
    assert any("Jm1 is" in note for note in found.notes)
    written = identified_robot(found)
    assert written.joints[0].parameters["Jm"] * arm.gear[0] ** 2 == pytest.approx(inertia)
    again = identify(written, signals, EstimateOptions(fit="torque"))  # which starts at the rotor of the file
    assert again.model == "sufficient"
    assert again.rotors[0][0] == pytest.approx(inertia, rel=5e-3)
    assert again.effects[0].parameters["coefficient"] == pytest.approx(effect.parameters["coefficient"], rel=5e-3)


def test_a_rotor_that_next_to_no_friction_tells_is_not_told() -> None:
    arm, recording = logged(3, 1e-4)
    robot = replace(without(arm.described(), *UNKNOWN["no values"]), effects=(BARE,))
    found = identify(robot, prepare(recording, robot), EstimateOptions(fit="torque"))
    assert not found.rotors
    assert not any("Jm1 is" in note for note in found.notes)


def off_by(robot: Robot, part: float) -> Robot:
    """Return a robot whose file is off by a part of its rotors."""
    joints = (replace(j, parameters={**j.parameters, "Jm": (1 + part) * j.parameters["Jm"]}) for j in robot.joints)
    return replace(robot, joints=tuple(joints))


def is_told(found: Identification | Diagnosis, rotors: Mapping[int, tuple[float, float]], arm: Arm) -> None:
    """Check the one effect and the rotor, which the file had wrong, against what they are in the arm."""
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == (BARE.effect, BARE.joint)
    assert effect.parameters["coefficient"] == pytest.approx(SHARE, abs=3 * effect.std_error["coefficient"])
    assert effect.std_error["coefficient"] < 0.03 * SHARE
    inertia, error = rotors[0]
    assert inertia == pytest.approx(arm.rotor[0] * arm.gear[0] ** 2, abs=3 * error)


@pytest.mark.parametrize("part", [-0.3, 0.4])
def test_a_wrong_rotor_of_the_file_is_a_start(part: float) -> None:
    """Taken for known, it left the coefficient many standard errors off."""
    arm, recording = logged(3)
    robot = replace(off_by(arm.described(), part), effects=(BARE,))
    found = identify(robot, prepare(recording, robot), EstimateOptions(fit="torque"))
    is_right(found, arm.described())
    is_told(found, found.rotors, arm)
    assert any("Jm1 is" in note for note in found.notes)


def test_a_wrong_rotor_of_the_file_does_not_bend_what_is_found() -> None:
    arm, recording = logged(4)
    robot = off_by(arm.described(), 0.3)
    signals = prepare(recording, robot)
    found = diagnose(robot, signals)
    assert isinstance(found, Diagnosis)
    is_told(found, told_rotors(found.state_after.solved), arm)
    is_right(published(found, signals).after, arm.described())
    (told,), state = contributions(found), found.state_after
    (row,) = state.columns[0].rows
    # written with another rotor than it was fitted with, the robot predicted worse than its own fit
    assert told.with_it == pytest.approx(held_out_triangles(state).rms(state.solution.values, row), rel=0.05)


def test_friction_that_tells_no_rotor_leaves_that_of_the_file() -> None:
    arm, recording = logged(4, 1e-4)
    robot = replace(off_by(arm.described(), 0.3), effects=(BARE,))
    found = identify(robot, prepare(recording, robot), EstimateOptions(fit="torque"))
    is_right(found, arm.described())
    own = robot.joints[0].parameters["Jm"]
    inertia, error = found.rotors[0]
    assert inertia == pytest.approx(own * arm.gear[0] ** 2, rel=0.5)
    assert error > ROTOR_KNOWN * inertia
    assert not any("Jm1 is" in note for note in found.notes)
    # the friction was fitted with it: written with another, as bodies that are off would have it, it predicts worse
    assert identified_robot(found).joints[0].parameters["Jm"] * arm.gear[0] ** 2 == pytest.approx(inertia)


@pytest.mark.parametrize("unknown", UNKNOWN.values(), ids=UNKNOWN)
def test_it_is_found_and_the_parameters_are_right(unknown: tuple[str, ...]) -> None:
    arm, recording = logged(4)
    truth = arm.described()
    robot = without(truth, *unknown)
    found = diagnose(robot, prepare(recording, robot))
    assert isinstance(found, Diagnosis)
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("load_friction", "joint1")
    assert effect.parameters["coefficient"] == pytest.approx(SHARE, rel=0.05)


def test_a_declared_offset_is_not_estimated_twice() -> None:
    arm, recording = logged(3)
    offset = effect_that(nuisance="offset").name
    robot = replace(arm.described(), effects=(BARE, EffectSpec(offset, "joint2", {})))
    moved = replace(recording, tau=recording.tau + np.array([0.0, 0.5]))
    found = identify(robot, prepare(moved, robot), EstimateOptions(fit="torque"))
    assert [(n.effect, n.joint) for n in found.nuisances if n.effect == offset] in ([], [(offset, "joint1")])
    (value,) = found.effects[1].parameters.values()
    assert value == pytest.approx(0.5, abs=4 * next(iter(found.effects[1].std_error.values())))
