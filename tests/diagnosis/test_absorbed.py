"""Effects that base parameters absorb: named by their size, where the residual holds next to nothing of them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.fit.state import fit, refreshed
from elid_cli.diagnosis.search.absorbed import _amplitudes, _chance, _scales_all, _without_outgrown
from elid_cli.diagnosis.search.steps import Found, Step
from elid_cli.model.effects import effect_classes
from elid_cli.report.answers.diagnosis_input import DiagnosisInput
from elid_cli.report.answers.diagnosis_tables import effect_sections
from elid_cli.report.answers.missing import missing_words
from elid_cli.report.tree import Table
from elid_cli.robot.files import read_robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.inverse_logs import Laws, Made, World, laws_of, log_of, make, recorded

RATE, JOINT = 200.0, 1
"""Hz, and the joint at which an effect acts: the second, which carries weight."""


def rigid(seed: int) -> Made:
    """Return an arm of three rigid joints with its motion."""
    made = make(seed, 3, rate=RATE, duration=15.0)
    stiff = [replace(j, parameters={**j.parameters, "K": 1e4 * j.parameters["K"]}) for j in made.truth.joints]
    bare = [replace(joint, transmission="rigid") for joint in made.robot.joints]
    return replace(made, truth=replace(made.truth, joints=tuple(stiff)), robot=replace(made.robot, joints=tuple(bare)))


def diagnosed(made: Made, laws: Laws, torque: float = 0.01) -> Diagnosis:
    log = recorded(made, log_of(made, laws), db=0.0, counts=2.0**16, torque=torque, colour=0.0, seed=1)
    found = diagnose(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)))
    assert isinstance(found, Diagnosis)
    return found


def with_spring(made: Made) -> Laws:
    """Return a spring of a few per cent of the joint's torque per rad."""

    def torque(world: World) -> np.ndarray:
        spring = np.zeros_like(world.q)
        spring[:, JOINT] = 0.03 * made.sizes[JOINT].torque * (world.q[:, JOINT] + 1.0)
        return spring

    return Laws(link=[torque])


def with_gain() -> Laws:
    def read(_: World, signals: dict[str, np.ndarray]) -> None:
        signals["tau"][:, JOINT] *= 1.05

    return Laws(sensors=[read])


def with_zero() -> Laws:
    def read(_: World, signals: dict[str, np.ndarray]) -> None:
        for channel in ("q", "theta"):
            signals[channel][:, JOINT] += 0.05

    return Laws(sensors=[read])


def deviations(made: Made, found: Diagnosis) -> tuple[float, float]:
    """Return by how many standard errors the worst base parameter is off before and after."""
    joints = (
        replace(j, transmission="rigid", parameters={k: v for k, v in j.parameters.items() if k != "K"})
        for j in made.truth.joints
    )
    true = found.state_before.log.base.values(replace(made.truth, joints=tuple(joints)).reference())
    worst = [
        max(abs(item.estimate - value) / item.std_error for item, value in zip(model.parameters, true, strict=True))
        for model in (found.identified_before, found.identified_after)
    ]
    return worst[0], worst[1]


@pytest.mark.parametrize("effect", ["link_spring", "torque_gain"])
def test_what_base_parameters_absorb_is_named_and_they_come_right(effect: str) -> None:
    """It was "Nothing", with values up to eighty of their standard errors off."""
    made = rigid(1)
    found = diagnosed(made, with_spring(made) if effect == "link_spring" else with_gain())
    assert [(e.effect, e.joint, e.absorbed) for e in found.effects] == [(effect, "j2", True)]
    before, after = deviations(made, found)
    assert before > 12
    assert after < 4
    name, true = ("gain", 0.05) if effect == "torque_gain" else ("stiffness", 0.03 * made.sizes[JOINT].torque)
    assert abs(found.effects[0].parameters[name] - true) < 4 * found.effects[0].std_error[name]


def test_what_is_little_is_told_with_what_it_does() -> None:
    found = diagnosed(rigid(1), with_gain())
    models = found.identified_before, found.identified_after
    words = missing_words(DiagnosisInput(found, *models, found.contributions, found.recording, "arm.yaml"))
    assert "Base parameters can take up nearly all of it" in words
    assert "of its standard errors off" in words


def test_rivals_are_listed_and_standard_errors_reach_to_them() -> None:
    """Under more noise the gain of one joint and the inverse one of the next do as well."""
    made = rigid(2)
    found = diagnosed(made, with_gain(), torque=0.02)
    assert [(e.effect, e.joint) for e in found.effects] == [("torque_gain", "j2")]
    assert [(r.effect, r.joint) for r in found.also_possible] == [("torque_gain", "j3")]
    assert found.also_possible[0].change is not None
    assert deviations(made, found)[1] < 4


@pytest.mark.parametrize("seed", range(4))
def test_a_log_without_them_has_none(seed: int) -> None:
    assert diagnosed(rigid(seed), Laws()).effects == ()


def test_beside_what_nothing_explains_none_is_named() -> None:
    """Where more than noise is left, standard errors say nothing of it."""
    made = rigid(1)
    drags = laws_of("dragging_cable", made, 2)
    drags.sensors += with_gain().sensors
    found = diagnosed(made, drags)
    assert found.unexplained
    assert not any(effect.absorbed for effect in found.effects)


def test_a_tilt_counts_with_what_the_model_is_turned_by() -> None:
    """Its column finds nothing once gravity is turned in the model."""
    made = make(55, rate=500.0, duration=10.0, bodies_of=read_robot("planar2"))
    tilted = laws_of("gravity_direction", made, 0)
    log = recorded(made, log_of(made, tilted), db=90.0, counts=0.0, torque=0.003, colour=0.0, seed=55)
    signals = prepare(log, made.robot, SignalOptions.for_diagnosis(500.0))
    parted = divided(made.robot, signals)
    kind = effect_classes()["gravity_direction"]
    state = refreshed(fit(parted, [kind(0)]))
    assert np.any(state.log.pose.tilt)
    assert _chance(state, 0) < 1e-9
    assert np.abs(state.coefficients(0)).max() < 0.01 * np.abs(_amplitudes(state, 0)).max()


def test_a_gain_that_shows_at_another_joint_is_told_with_its_own_joint_and_the_other_equation() -> None:
    """The table showed 0.17 before and after, and 0 %, of a gain that brought another joint down to noise."""
    found = diagnosed(rigid(1), with_gain())
    shown = (replace(found.contributions[0], joint="j1"),)
    models = found.identified_before, found.identified_after
    table, *_ = effect_sections(DiagnosisInput(found, *models, shown, found.recording, "arm.yaml"))
    assert isinstance(table, Table)
    assert table.rows[0][1:3] == ("j2", "whole joint of j1")


@pytest.mark.parametrize(("there", "kept"), [(False, ["torque_gain"]), (True, ["link_spring", "torque_gain"])])
def test_what_made_up_for_it_goes_with_it(*, there: bool, kept: list[str]) -> None:
    """A spring that a search had found stayed, -0.0004 ± 0.0026 N·m/rad, once an encoder's zero explained it."""
    made, spring, gain = rigid(1), effect_classes()["link_spring"], effect_classes()["torque_gain"]
    laws = with_gain()
    laws.link += with_spring(made).link if there else []
    log = recorded(made, log_of(made, laws), db=0.0, counts=2.0**16, torque=0.01, colour=0.0, seed=1)
    parted = divided(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)))
    effects = (spring(JOINT if there else 2), gain(JOINT))
    state = refreshed(fit(parted, effects))
    steps = tuple(cast("Step", SimpleNamespace(candidate=SimpleNamespace(effect=effect))) for effect in effects)
    left = _without_outgrown(Found(state, state, steps, (), 0))
    assert [effect.name for effect in left.after.effects] == kept
    assert [step.candidate.effect.name for step in left.steps] == kept


@pytest.mark.parametrize(("joints", "rigid_ones"), [(2, False), (3, False), (3, True)])
def test_the_last_joint_without_a_gain_is_given_none(*, joints: int, rigid_ones: bool) -> None:
    """Gains of all joints scale every parameter: two were told of an arm of two joints, the second 0 and surely so."""
    made = rigid(3) if rigid_ones else make(3, joints, rate=RATE)
    log = recorded(made, log_of(made, Laws()), db=0.0, counts=2.0**16, torque=0.01, colour=0.0, seed=1)
    gain, spring = effect_classes()["torque_gain"], effect_classes()["link_spring"]
    parted = divided(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)))
    one, most = fit(parted, [gain(0)]), fit(parted, [gain(k) for k in range(joints - 1)])
    assert not _scales_all(fit(parted, []), gain(0))
    assert _scales_all(one, gain(1)) == (joints == 2)
    assert _scales_all(most, gain(joints - 1))
    assert not _scales_all(most, spring(joints - 1))


def test_parameters_beside_a_found_effect_are_as_unsure_held_as_unknown() -> None:
    """They were as sure beside a spring known to a fifth, held at its size, as beside one that is known exactly."""
    made = rigid(5)

    def torque(world: World) -> np.ndarray:
        spring = np.zeros_like(world.q)
        spring[:, JOINT] = 0.2 * made.sizes[JOINT].torque * (world.q[:, JOINT] + 1.0)
        return spring

    found = diagnosed(made, Laws(link=[torque]), torque=0.06)
    assert [(e.effect, e.joint, e.absorbed) for e in found.effects] == [("link_spring", "j2", True)]
    held = replace(found, effects=tuple(replace(effect, absorbed=False) for effect in found.effects))
    unknown, known = (one.identified_after.parameters for one in (found, held))
    ratios = [one.std_error / other.std_error for one, other in zip(known, unknown, strict=True)]
    assert np.nanmin(ratios) > 0.7, ratios
    assert deviations(made, held)[1] < 4
