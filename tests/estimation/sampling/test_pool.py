"""Several results make one distribution, with the spread between recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.errors import UsageError
from elid_cli.estimation.sampling.pool import pooled
from elid_cli.estimation.sampling.saved import SavedDistribution, distribution_of
from elid_cli.estimation.sampling.sets import sample
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec

NAMES = ("Ja1", "cy1", "fs1 + Izz1")
TERMS = ({"Ja1": 1.0}, {"cy1": 1.0}, {"fs1": 1.0, "Izz1": 2.0})
WITHIN = np.array([[1.0, 0.3, 0.0], [0.3, 2.0, 0.1], [0.0, 0.1, 0.5]])


def result(estimate: np.ndarray, covariance: np.ndarray = WITHIN, names: tuple[str, ...] = NAMES) -> SavedDistribution:
    known = np.isfinite(estimate)
    covariance = np.where(np.outer(known, known), covariance, np.nan)
    units, reference = ("kg·m²", "kg·m", "N·m"), np.array([7.0, np.nan, 9.0])
    return SavedDistribution(
        "r.json", "arm", ("joint1",), names, units, TERMS, estimate, reference, covariance, np.zeros(3, dtype=bool)
    )


def test_one_result_is_its_own_distribution() -> None:
    found = pooled([result(np.array([3.0, -1.0, 2.0]))])
    assert (found.covariance == WITHIN).all()
    assert found.mean.tolist() == [3.0, -1.0, 2.0]
    assert np.isnan(found.between).all()
    assert found.positive.tolist() == [True, False, True]


def test_refused_ones_are_held_at_the_reference_or_unknown() -> None:
    found = pooled([result(np.array([np.nan, np.nan, 2.0]))])
    assert found.origin == ("held", "unknown", "drawn")
    assert found.mean[0] == 7.0
    assert found.covariance[:2].tolist() == [[0.0] * 3] * 2


def test_offsets_of_drives_are_said_not_to_be_drawn() -> None:
    one = result(np.array([3.0, 1.0, 2.0]))
    assert sample([one], 2).notes == ()
    (words,) = sample([replace(one, channels=("torque_offset hip", "torque_offset knee")), one], 2).notes
    assert "and not to the robot: torque_offset of 2 joints" in words


def test_a_loop_that_the_motion_leaves_open_is_said_not_to_be_drawn() -> None:
    one = result(np.array([3.0, 1.0, 2.0]))
    (words,) = sample([replace(one, loop=0.0021), one], 2).notes
    assert "holds its torque for up to 2.1 ms" in words
    entry = {"name": "fv1", "unit": "N·m·s/rad", "terms": {"fv1": 1.0}, "estimate": 1.0, "reference": None}
    told = {"base_parameters": [entry], "covariance": [[0.1]], "joints": ["one"]}
    assert distribution_of(told, "r.json").loop == 0.0
    assert distribution_of({**told, "settings": {"trajectory": {"unseen_loop": 0.004}}}, "r.json").loop == 0.004


def test_a_robot_that_lacks_what_a_diagnosis_found_is_refused() -> None:
    robot = read_robot("planar2")
    file = dict(zip(map(str, robot.parameter_names()), robot.reference().tolist(), strict=True))["fv1"]
    data = {
        "command": "diagnose", "robot": robot.name, "joints": list(robot.joint_names), "covariance": [[1e-4]],
        "effects": [{"effect": "stribeck", "joint": "joint2"}, {"effect": "payload", "joint": None}],
        "base_parameters": [{"name": "fv1", "terms": {"fv1": 1.0}, "estimate": 0.3, "reference": file}],
    }  # fmt: skip
    found = distribution_of(data, "d.json")
    assert found.lacking == (("stribeck", "joint2"), ("payload", None))
    assert len(sample([found], 2).values) == 2  # alone it is a table
    with pytest.raises(UsageError, match=r"lacks what d\.json found: stribeck of joint2, payload"):
        sample([found], 2, robot)
    # one that identify writes has other friction, and a load may be in its bodies: still it lacks the effect
    parts = [replace(j, parameters={**j.parameters, "fv": 0.3}) for j in robot.joints]
    other = replace(robot, joints=tuple(parts))
    with pytest.raises(UsageError, match=r"lacks what d\.json found: stribeck of joint2\n"):
        sample([found], 2, other)
    friction = EffectSpec("stribeck", "joint2", {"amplitude": 0.1, "velocity": 0.1, "exponent": 2.0})
    assert len(sample([found], 2, replace(other, effects=(friction,))).values) == 2


def test_one_that_some_results_refuse_is_of_the_others() -> None:
    found = pooled([result(np.array([3.0, 1.0, 2.0])), result(np.array([np.nan, 1.0, 2.0]))])
    assert found.origin == ("drawn",) * 3
    assert found.mean[0] == 3.0
    assert found.covariance[0, 0] == pytest.approx(1.0)
    assert found.covariance[1, 1] == pytest.approx(1.0)  # half of 2


@pytest.mark.parametrize("logs", [4, 12])
def test_further_recordings_are_held_as_often_as_stated(logs: int) -> None:
    """Recordings whose truth wanders by `spread` around a mean: 95 % bands hold another one's truth."""
    generator = np.random.default_rng(0)
    root, spread, held = np.linalg.cholesky(WITHIN), np.array([6.0, 0.0, 4.0]), []
    for _ in range(600):
        truths = spread * generator.standard_normal((logs + 1, 3))
        found = pooled([result(truth + root @ generator.standard_normal(3)) for truth in truths[1:]])
        held.append(np.abs(truths[0] - found.mean) < 1.96 * np.sqrt(np.diag(found.covariance)))
    share = np.mean(held, axis=0)
    assert (share[[0, 2]] > 0.92).all()
    assert (share[[0, 2]] < 0.98).all()
    assert share[1] > 0.95  # no spread, and the moments' estimate of it is never below 0


def test_the_covariance_is_one_and_correlations_between_recordings_are_found() -> None:
    generator = np.random.default_rng(1)
    shared = 5.0 * generator.standard_normal(40)[:, None] * np.array([1.0, 1.0, 0.0])
    found = pooled([result(row + 1e-3 * generator.standard_normal(3), 1e-6 * WITHIN) for row in shared])
    assert np.linalg.eigvalsh(found.covariance)[0] > 0
    assert found.between[:2] == pytest.approx(5.0, rel=0.4)
    assert found.covariance[0, 1] / np.sqrt(found.covariance[0, 0] * found.covariance[1, 1]) > 0.9


def test_results_of_other_robots_are_refused() -> None:
    with pytest.raises(UsageError, match="its base parameters are not those of"):
        pooled([result(np.zeros(3)), result(np.zeros(3), names=("Ja1", "cy1", "fs2"))])
