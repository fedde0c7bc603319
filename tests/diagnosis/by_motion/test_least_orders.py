"""Orders of effects that repeat with the angle: in a fit of motion none falls below what the angle covered shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.trajectory.unknowns import Unknowns
from elid_cli.logs.reading import read_recording
from elid_cli.model.effects import effect_classes
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

JOINT, SPAN = 1, 1.57
"""The joint whose friction varies, and what its angle covers, rad."""
KIND = effect_classes()["position_friction"]


def test_an_order_below_the_least_is_held_there(tmp_path: Path) -> None:
    (least,) = KIND.least(SPAN)
    unknowns = Unknowns(plant.robot(tmp_path), (KIND(JOINT, (2 * least,)),), spans=(0.1, SPAN, 0.1))
    z = np.ones(unknowns.count)
    at, _ = unknowns.shapes_of(0)
    z[at] = 0.5 * least
    assert unknowns.possible(z)[at] == pytest.approx(least)
    assert unknowns.least_of(0, unknowns.possible(z)) == ("order",)
    z[at] = 1.5 * least
    assert unknowns.possible(z)[at] == pytest.approx(1.5 * least)
    assert unknowns.least_of(0, z) == ()


def test_an_order_that_begins_below_the_least_falls_no_further(tmp_path: Path) -> None:
    (least,) = KIND.least(SPAN)
    unknowns = Unknowns(plant.robot(tmp_path), (KIND(JOINT, (0.98 * least,)),), spans=(0.1, SPAN, 0.1))
    z = np.full(unknowns.count, 1e-3)
    at, _ = unknowns.shapes_of(0)
    z[at] = 0.5 * least
    assert unknowns.possible(z)[at] == pytest.approx(0.98 * least)
    assert unknowns.least_of(0, unknowns.possible(z)) == ("order",)
    assert replace(unknowns, spans=()).possible(z) == pytest.approx(z)  # nothing is known of the angle


def test_a_ripple_of_less_than_a_period_is_held_nowhere(tmp_path: Path) -> None:
    """It is a bend that other effects explain as well: at its bound it was named beside a load that there was not."""
    kind = effect_classes()["torque_ripple"]
    unknowns = Unknowns(plant.robot(tmp_path), (kind(JOINT, (8.0,)),), spans=(0.1, SPAN, 0.1))
    z = np.full(unknowns.count, 1e-2)
    assert unknowns.possible(z) == pytest.approx(z)


@pytest.mark.parametrize(("part", "amplitude", "lower"), [(0.2, 0.4, True), (0.5, 0.15, False)])
def test_friction_that_varies_over_less_than_a_period_is_named_with_an_order_that_may_be_lower(
    tmp_path: Path, part: float, amplitude: float, lower: bool
) -> None:
    order = part * 2 * np.pi / SPAN
    grip = lambda x, v, load: np.eye(3)[JOINT] * amplitude * np.sin(order * x)  # noqa: E731
    log = plant.written(tmp_path, "log.h5", plant.moved(3, 6.0, grip=grip))
    robot = plant.robot(tmp_path)
    found = diagnose_motion(robot, prepare(read_recording([log], robot), robot), only=(KIND.name,))
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == (KIND.name, "two")
    assert ("may be lower" in effect.summary) is lower
    span = found.fit_after.unknowns.spans[JOINT]
    if lower:
        assert effect.parameters["order"] == pytest.approx(KIND.least(span)[0])
        assert not effect.std_error  # its values go together, as no log tells
    else:
        assert abs(effect.parameters["order"] - order) < 3 * effect.std_error["order"]
    # the bend is as good as the friction's
    assert found.position["two"].after < 0.05 * found.position["two"].before
