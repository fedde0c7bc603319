"""A weak spring on a link hides in first moments: what it moves is marked, and why is said."""

from __future__ import annotations

import json

import numpy as np
import pytest

from elid_cli.estimation.judgement import Judgement, without_chance
from elid_cli.estimation.result import Identification
from elid_cli.estimation.streaming.files import _heard, _told
from elid_cli.estimation.validation.following import WEIGHT
from elid_cli.estimation.validation.size_beside import TAKEN_UP
from elid_cli.report.answers.lacking import is_doubted, words_of
from tests.estimation.test_unsaid_causes import RATE, as_rigid, identified, made_rigid
from tests.system.reproduce.inverse_logs import Laws, Made, World, make

JOINT = 1
"""The joint with the spring: the second, which carries weight."""


def _with_spring(made: Made, part: float) -> Laws:
    """Return a spring of a part of the joint's torque per rad."""

    def torque(world: World) -> np.ndarray:
        spring = np.zeros_like(world.q)
        spring[:, JOINT] = part * made.sizes[JOINT].torque * (world.q[:, JOINT] + 1.0)
        return spring

    return Laws(link=[torque])


def _sprung(seed: int, *, elastic: bool) -> tuple[Identification, np.ndarray]:
    """Return an identification beside a spring, and by how many of their errors its parameters are off, (b,)."""
    made = make(seed, 3, rate=RATE, duration=12.0) if elastic else made_rigid(seed)
    found = identified(made, made.robot, _with_spring(made, 0.03), torque=0.01, seed=seed)
    true = found.base.values((made.truth if elastic else as_rigid(made.truth)).reference())
    pairs = zip(found.parameters, true, strict=True)
    return found, np.array([abs(p.estimate - value) / p.std_error for p, value in pairs])


@pytest.mark.parametrize(("seed", "elastic"), [(2, False), (2, True), (3, True)])
def test_what_a_weak_spring_moves_is_marked(seed: int, *, elastic: bool) -> None:
    """Values up to 22 of their errors off were known, the model sufficient."""
    found, far = _sprung(seed, elastic=elastic)
    marked = np.array([p.bias_possible for p in found.parameters])
    assert far.max() > 7.0
    assert far[~marked].max() < 3.0
    assert [(item.joint, item.follows) for item in found.insufficient] == [("j2", WEIGHT)]
    assert any(note.startswith("a link spring at j2 (stiffness ") for note in found.notes)
    assert "looks missing at j2, such as a weak spring's, which other values take up" in words_of(found)


def test_what_a_spring_moves_that_is_only_likely_is_marked_as_well() -> None:
    found, far = _sprung(4, elastic=True)
    marked = np.array([p.bias_possible for p in found.parameters])
    assert far.max() > 20.0
    assert far[~marked].max() < 3.0
    assert found.model == "sufficient"
    assert is_doubted(found)
    assert words_of(found).startswith("Nothing that this log shows for sure. A link spring at j2 (stiffness ")


@pytest.mark.parametrize("elastic", [False, True])
def test_arms_without_springs_are_not_doubted(*, elastic: bool) -> None:
    for seed in range(1, 6):
        made = make(seed, 3, rate=RATE, duration=12.0) if elastic else made_rigid(seed)
        found = identified(made, made.robot, Laws(), torque=0.01, seed=seed)
        assert found.model == "sufficient"
        assert not any(p.bias_possible for p in found.parameters)
        assert not any(TAKEN_UP in note for note in found.notes)


def test_what_it_moves_is_kept_with_a_reduced_log() -> None:
    found = Judgement((), (), np.zeros(0, dtype=bool), (), ("a note",))
    told = json.loads(json.dumps(_told(found)))
    heard = _heard(told, (), ())
    assert heard is not None
    assert heard.notes == ("a note",)


@pytest.mark.parametrize(("likely", "said"), [(1, False), (2, True)])
def test_what_one_of_several_logs_finds_likely_is_chance(likely: int, *, said: bool) -> None:
    unsure = Judgement((), (), np.ones(2, dtype=bool), (), ("a note",))
    silent = Judgement((), (), np.zeros(2, dtype=bool))
    told = without_chance([unsure] * likely + [silent] * (4 - likely))
    assert any(one.notes for one in told) == said
    assert any(one.biased.any() for one in told) == said
    assert without_chance([unsure]) == [unsure]
