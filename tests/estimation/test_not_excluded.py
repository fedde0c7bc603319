"""Where nothing is missing it is said up to which size a fault would not show, and how far values would be off."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.estimation.judgement import Judgement, NotExcluded, joined_bounds
from elid_cli.estimation.result import Identification
from elid_cli.estimation.streaming.files import _heard, _told
from elid_cli.estimation.validation.following import WEIGHT
from elid_cli.report.answers.diagnosis_input import DiagnosisInput
from elid_cli.report.answers.identification_json import identification_payload
from elid_cli.report.answers.lacking import words_of
from elid_cli.report.answers.missing import missing_words
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.estimation.test_unsaid_causes import RATE, identified, made_rigid
from tests.system.reproduce.inverse_logs import Laws, Made, World, log_of, recorded


def _read(change: dict[str, float], joint: int) -> Laws:
    """Return an encoder's zero or a torque's factor that is off."""

    def read(_: World, signals: dict[str, np.ndarray]) -> None:
        for side in ("q", "theta"):
            signals[side][:, joint] += change.get("encoder_zero", 0.0)
        signals["tau"][:, joint] *= 1.0 + change.get("torque_gain", 0.0)

    return Laws(sensors=[read])


def _sprung(stiffness: float, joint: int, preload: float = 0.0) -> Laws:
    def torque(world: World) -> np.ndarray:
        spring = np.zeros_like(world.q)
        spring[:, joint] = stiffness * world.q[:, joint] + preload
        return spring

    return Laws(link=[torque])


def _with(made: Made, item: NotExcluded, times: float, seed: int) -> Identification:
    """Return the identification of the same log with a fault of some times the size that would not show."""
    joint, size = made.robot.joint_names.index(item.joint or ""), times * item.up_to
    laws = _sprung(size, joint) if item.effect == "link_spring" else _read({item.effect: size}, joint)
    return identified(made, made.robot, laws, torque=0.003, seed=seed)


def _told_of(found: Identification) -> bool:
    return bool(found.insufficient or found.notes)


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_values_are_off_by_what_is_said_and_twice_the_size_shows(seed: int) -> None:
    made = made_rigid(seed)
    clean = identified(made, made.robot, Laws(), torque=0.003, seed=seed)
    assert clean.model == "sufficient"
    asked = [i for i in clean.not_excluded if i.effect in ("encoder_zero", "torque_gain", "link_spring")]
    assert asked
    for item in asked:
        off = _with(made, item, 1.0, seed)
        pairs = zip(off.parameters, clean.parameters, strict=True)
        moved = max(abs(a.estimate - b.estimate) / b.std_error for a, b in pairs)
        assert moved == pytest.approx(item.moves, rel=0.3), item
        assert _told_of(_with(made, item, 2.5, seed)), item


def test_it_is_said_and_kept_in_json() -> None:
    made = made_rigid(4)
    found = identified(made, made.robot, Laws(), torque=0.003, seed=4)
    first = found.not_excluded[0]
    words = words_of(found)
    assert "Not excluded, as other values would take it up unseen: " in words
    assert words.endswith("standard errors.")
    assert f" at {first.joint}" in words
    assert found.not_excluded == tuple(sorted(found.not_excluded, key=lambda item: -item.moves))
    assert json.loads(json.dumps(_plain(found)))[0] == {
        "effect": first.effect, "joint": first.joint, "parameter": first.parameter, "up_to": first.up_to,
        "unit": first.unit, "moves": first.moves,
    }  # fmt: skip


def _plain(found: Identification) -> list[dict[str, object]]:
    return [vars(item) for item in identification_payload(found)["not_excluded"]]


def test_nothing_is_said_of_it_where_something_is_missing() -> None:
    made = made_rigid(2)
    found = identified(made, made.robot, _read({"encoder_zero": 0.02}, 1), torque=0.003, seed=2)
    assert found.model == "insufficient"
    assert not found.not_excluded
    assert "Not excluded" not in words_of(found)


def test_a_weak_spring_beside_an_offset_of_the_torque_is_told() -> None:
    """The offset took up the spring's angle of rest: the spring was not asked for, and values were far off."""
    made = made_rigid(3)
    size = made.sizes[1].torque
    clean = identified(made, made.robot, Laws(), torque=0.01, seed=3)
    found = identified(made, made.robot, _sprung(0.08 * size, 1, 0.2 * size), torque=0.01, seed=3)
    assert any((item.effect, item.joint) == ("torque_offset", "j2") for item in found.nuisances)
    pairs = zip(found.parameters, clean.parameters, strict=True)
    assert max(abs(a.estimate - b.estimate) / b.std_error for a, b in pairs) > 10.0
    assert ("j2", WEIGHT) in [(item.joint, item.follows) for item in found.insufficient]


def test_an_offset_alone_is_no_spring() -> None:
    made = made_rigid(2)
    found = identified(made, made.robot, _sprung(0.0, 1, 0.2 * made.sizes[1].torque), torque=0.01, seed=2)
    assert found.model == "sufficient"
    assert not found.notes


def test_a_tilt_is_of_the_base_and_of_no_joint() -> None:
    made = made_rigid(4)
    found = identified(made, made.robot, Laws(), torque=0.003, seed=4)
    tilt = NotExcluded("gravity_direction", None, "roll", 0.002, "rad", 1e3)
    words = words_of(replace(found, not_excluded=(tilt,)))
    assert "unseen: gravity direction of 0.002 rad; values are then off by up to 1000 standard errors." in words


def _bound(joint: str, up_to: float, moves: float) -> NotExcluded:
    return NotExcluded("encoder_zero", joint, "offset", up_to, "rad", moves)


def test_several_logs_exclude_what_one_of_them_does() -> None:
    silent = Judgement((), ())
    one = Judgement((), (), not_excluded=(_bound("j1", 0.01, 20.0), _bound("j2", 0.02, 10.0)))
    other = Judgement((), (), not_excluded=(_bound("j2", 0.01, 9.0),))
    assert joined_bounds([one, other]) == (_bound("j2", 0.01, 9.0),)
    assert joined_bounds([one]) == one.not_excluded
    assert joined_bounds([one, silent]) == one.not_excluded  # it was not asked
    assert joined_bounds([one, Judgement((), (), not_excluded=())]) == ()


def test_it_is_kept_with_a_reduced_log() -> None:
    told = json.loads(
        json.dumps(_told(Judgement((), (), np.zeros(0, dtype=bool), not_excluded=(_bound("j1", 0.01, 9.0),))))
    )
    heard = _heard(told, ("j1",), ())
    assert heard is not None
    assert heard.not_excluded == (_bound("j1", 0.01, 9.0),)


def test_one_of_an_effect_that_is_not_known_is_left_out() -> None:
    other = NotExcluded("something_new", "j1", "size", 0.01, "rad", 9.0)
    told = json.loads(json.dumps(_told(Judgement((), (), np.zeros(0, dtype=bool), not_excluded=(other,)))))
    heard = _heard(told, ("j1",), ())
    assert heard is not None
    assert heard.not_excluded == ()
    del told["not_excluded"]  # as an older version wrote it
    heard = _heard(told, ("j1",), ())
    assert heard is not None
    assert heard.not_excluded is None


def test_a_diagnosis_that_finds_nothing_says_it_as_well() -> None:
    made = made_rigid(4)
    log = recorded(made, log_of(made, Laws()), db=0.0, counts=2.0**16, torque=0.003, colour=0.0, seed=4)
    found = diagnose(made.robot, prepare(log, made.robot, SignalOptions.for_diagnosis(RATE)))
    assert isinstance(found, Diagnosis)
    models = found.identified_before, found.identified_after
    assert models[1].not_excluded
    words = missing_words(DiagnosisInput(found, *models, found.contributions, found.recording, "arm.yaml"))
    assert words.startswith("Nothing: only the sensors' noise is left, and no effect improves the model. Not excluded")
