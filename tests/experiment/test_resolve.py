"""`elid excite --resolve`: the planned motion is within limits, and its log decides what it promises."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elid_cli.errors import DataError, UsageError
from elid_cli.estimation.regression.effect_columns import extra_of
from elid_cli.experiment.reference import random_reference
from elid_cli.experiment.resolve import Question, Resolution, ResolveOptions, question_of, read_question, resolve
from elid_cli.experiment.resolve.decision import Distance
from elid_cli.experiment.resolve.played import Bench
from elid_cli.experiment.resolve.separation import Separation, varied
from elid_cli.report.answers.resolution import resolution_report
from elid_cli.robot.robot import Limits, Robot
from tests.system.reproduce.inverse_logs import Made
from tests.system.reproduce.resolve import LONG, arm_of, log, looked, outcome, played, poor_motions

TRUTH, RIVAL = "transmission_damping", "link_viscous"
NOISE = 0.005
LIMITS = Limits((-1.0, 1.4), 1.8, 7.0, 40.0)


@pytest.fixture(scope="module")
def made() -> Made:
    arm = arm_of(0)
    joints = tuple(replace(joint, limits=LIMITS) for joint in arm.truth.joints)
    return replace(arm, truth=replace(arm.truth, joints=joints))


@pytest.fixture(scope="module")
def saved(made: Made) -> dict[str, Any]:
    """Return the JSON object of a diagnosis of a poor log, which ties the two."""
    for number, motion in enumerate(poor_motions(made, 0, 0)):
        found = looked(made, log(made, TRUTH, 0, motion, NOISE, number), (TRUTH, RIVAL))
        if found.effects and found.also_possible:
            text = json.dumps(found.to_dict(), default=lambda value: value.tolist())
            return {"schema": "elid/1", "command": "diagnose", **json.loads(text)}
    raise AssertionError("no tie")


@pytest.fixture(scope="module")
def question(saved: dict[str, Any], made: Made) -> Question:
    return question_of(saved, made.truth)


@pytest.fixture(scope="module")
def plan(question: Question) -> Resolution:
    return resolve(question, ResolveOptions(duration=LONG, starts=5, steps=12))


def written(folder: Path, content: object) -> Path:
    path = folder / "diagnosis.json"
    path.write_text(json.dumps(content), "utf-8")
    return path


def test_a_rival_has_the_errors_of_its_parameters_and_how_far_it_is_behind(saved: Mapping[str, Any]) -> None:
    rival = saved["also_possible"][0]
    assert rival["std_error"].keys() == rival["parameters"].keys()
    assert 0 < rival["std_error"]["friction"] < abs(rival["parameters"]["friction"])
    assert abs(rival["behind"]) < 30


def test_the_question_holds_both_effects_of_the_tie(question: Question) -> None:
    (group,) = question.groups
    assert {h.effect for h in group.hypotheses} == {TRUTH, RIVAL}
    assert question.present == ()
    assert len(question.base) > 8


def test_the_motion_stays_within_limits_from_rest_to_rest(plan: Resolution, made: Made) -> None:
    _, q, dq, ddq = plan.trajectory.sampled(200.0)
    assert LIMITS.position is not None
    assert q.min() >= LIMITS.position[0]
    assert q.max() <= LIMITS.position[1]
    assert np.abs(dq).max() <= 1.001 * (LIMITS.velocity or 0)
    assert np.abs(ddq).max() <= 1.001 * (LIMITS.acceleration or 0)
    torque = Bench(plan.question).torques((q, dq, ddq))
    assert np.abs(torque).max() <= 1.01 * (LIMITS.torque or 0)
    assert np.abs(dq[[0, -1]]).max() < 1e-9
    assert np.abs(ddq[[0, -1]]).max() < 1e-7


def test_what_it_promises_a_diagnosis_of_its_log_decides(plan: Resolution, made: Made) -> None:
    (pair,) = plan.pairs
    assert pair.verdict == "promised"
    assert pair.planned > 1.2 * pair.random
    assert pair.probability >= pair.chance
    found = looked(made, log(made, TRUTH, 0, played(plan.trajectory), NOISE, 77), (TRUTH, RIVAL))
    assert outcome(found, TRUTH, RIVAL) == "right"


def test_the_same_seed_plans_the_same_motion(question: Question) -> None:
    few = ResolveOptions(duration=4.0, starts=3, steps=3, seed=5)
    one, other = (resolve(question, few) for _ in range(2))
    assert one.pairs == other.pairs
    for a, b in zip(one.trajectory.splines, other.trajectory.splines, strict=True):
        assert np.array_equal(a.points, b.points)


def test_an_effect_explains_its_own_log_and_its_rival_only_part_of_it(question: Question, made: Made) -> None:
    separation = Separation(Bench(question))
    truth = next(h for h in question.groups[0].hypotheses if h.effect == TRUTH)
    states = random_reference(made.truth, 6.0, 3).sampled(separation.bench.rate)[1:]
    view = separation.view(states, truth)
    rival = next(h for h in question.groups[0].hypotheses if h.effect == RIVAL)
    own, other = (view.left(effect) for effect in (view.own, separation.shapes(view, rival)[0]))
    assert own @ own < 1e-9 * (other @ other)
    assert other @ other < view.seen @ view.seen


@pytest.mark.parametrize(("effect", "name"), [("torque_offset", "offset"), ("asymmetric_coulomb", "difference")])
def test_what_an_offset_imitates_counts_for_nothing(question: Question, made: Made, effect: str, name: str) -> None:
    """Every diagnosis fits an offset of each torque channel; friction that differs by direction is one but at rest."""
    truth = replace(question.groups[0].hypotheses[0], effect=effect, parameters={name: 0.3}, std_error={})
    separation = Separation(Bench(question))
    view = separation.view(random_reference(made.truth, 8.0, 1).sampled(separation.bench.rate)[1:], truth)
    assert np.sqrt(separation.distance(view, truth, truth, [view.own]).seen.sum()) < 0.5
    own = extra_of(view.own, view.played.scene, view.played.signals)
    assert np.linalg.norm(view.wall.whitened(own.rows, own.width) @ np.full(own.width, 0.3)) > 20


def test_a_motion_twice_as_long_separates_twice_as_far(question: Question) -> None:
    counted = np.array([100.0, 100.0])
    near = Distance(np.array([900.0, 0.0]), np.array([20.0, 1.0]), np.zeros(2), counted, 0.5, 0.1, twins=False)
    assert near.times(4.0).sigma == pytest.approx(2.0 * near.sigma)
    assert near.times(4.0).probability > near.probability
    assert replace(near, twins=True).probability < near.probability
    assert replace(near, taken=0.01).probability < 0.01 < near.probability


def test_gains_of_two_joints_are_told_apart_by_no_motion(saved: dict[str, Any], made: Made) -> None:
    joints = made.truth.joint_names
    named = {**saved["effects"][0], "effect": "torque_gain", "joint": joints[0], "parameters": {"gain": 0.06},
             "std_error": {"gain": 0.004}}  # fmt: skip
    rival = {**saved["also_possible"][0], "effect": "torque_gain", "joint": joints[1], "instead_of": "torque_gain",
             "parameters": {"gain": 1 / 1.06 - 1}, "std_error": {"gain": 0.004}}  # fmt: skip
    asked = question_of({**saved, "effects": [named], "also_possible": [rival], "unexplained": []}, made.truth)
    found = resolve(asked, ResolveOptions(duration=5.0, starts=4, steps=4))
    (pair,) = found.pairs
    assert pair.twins
    assert pair.verdict == "no motion"
    assert pair.planned < 1.0
    assert any("torque gain of one of the joints, measured by itself" in remedy.words for remedy in pair.otherwise)
    # a motion that decides nothing is not proposed
    for decides in (False, True):
        plan = replace(found, pairs=(replace(pair, twins=False, planned=4.0),)) if decides else found
        sections = {
            section.key: section for section in resolution_report(plan, "r.yaml", "d.json", "n.csv", 250).sections
        }
        assert ("next" in sections) == decides
        (written,) = (value for name, value in sections["facts"].items if name == "written")
        assert ("decides none of it" in str(written)) != decides


def test_parameters_are_varied_within_their_bounds(question: Question) -> None:
    hypothesis = replace(question.groups[0].hypotheses[0], std_error={})
    name, value = next(iter(hypothesis.parameters.items()))
    assert varied(hypothesis, 1.0).parameters[name] == pytest.approx(1.3 * value)
    assert varied(hypothesis, -9.0).parameters[name] == pytest.approx(0.4 * value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"command": "identify"}, "not a diagnosis"),
        ({"judged_by": "motion"}, r"log of commands(?s:.*)--lookup"),
        ({"row_noise": None}, "not a diagnosis"),
        ({"joints": ["a", "b"]}, "joints a, b"),
        ({"base_parameters": [{"name": "m9", "estimate": 1.0}]}, "base parameters are not those"),
        ({"effects": [{"effect": "no_such", "joint": None, "parameters": {}}]}, "not a diagnosis"),
    ],
)
def test_what_does_not_fit_is_refused(
    saved: dict[str, Any], made: Made, tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        read_question(written(tmp_path, {**saved, **change}), made.truth)


def test_a_diagnosis_without_noise_of_its_rows_is_refused(saved: dict[str, Any], made: Made, tmp_path: Path) -> None:
    old = {key: value for key, value in saved.items() if key != "row_noise"}
    with pytest.raises(UsageError, match="older elid"):
        read_question(written(tmp_path, old), made.truth)


def test_a_diagnosis_that_leaves_nothing_open_is_told(saved: dict[str, Any], made: Made, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="leaves nothing open"):
        read_question(written(tmp_path, {**saved, "also_possible": [], "unexplained": []}), made.truth)


def test_a_rival_without_values_is_no_absence_of_rivals(saved: dict[str, Any], made: Made, tmp_path: Path) -> None:
    vague = [{**item, "parameters": {}} for item in saved["also_possible"]]
    with pytest.raises(DataError, match=f"{TRUTH} .* from {RIVAL}|{RIVAL} .* from {TRUTH}"):
        read_question(written(tmp_path, {**saved, "also_possible": vague, "unexplained": []}), made.truth)


def test_a_rival_at_another_joint_is_a_question_of_the_effect_that_it_stands_for(
    saved: dict[str, Any], made: Made
) -> None:
    named, rival = saved["effects"][0], saved["also_possible"][0]
    others = [name for name in made.truth.joint_names if name != named["joint"]]
    far = {**rival, "joint": others[0], "instead_at": named["joint"]}
    asked = question_of({**saved, "also_possible": [far], "unexplained": []}, made.truth)
    (group,) = asked.groups
    assert [(h.effect, h.joint) for h in group.hypotheses] == [
        (named["effect"], named["joint"]),
        (rival["effect"], others[0]),
    ]
    with pytest.raises(DataError, match="leaves nothing open"):  # of an effect that was not found there
        question_of({**saved, "also_possible": [{**far, "instead_at": others[0]}], "unexplained": []}, made.truth)


def test_words_that_are_no_json_are_refused(planar: Robot, tmp_path: Path) -> None:
    path = tmp_path / "words.json"
    path.write_text("words", "utf-8")
    with pytest.raises(UsageError, match="not JSON"):
        read_question(path, planar)
