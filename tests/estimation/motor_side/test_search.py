"""A fit of fine sensors that does not leave the end of one of rougher sensors does not know more than that one."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.estimation.motor_side.search import _unless_stuck


@dataclass(frozen=True)
class Found:
    """What a search found, as far as it is looked at."""

    best: SimpleNamespace
    stuck: Array | None = None


@dataclass(frozen=True)
class End:
    """An end of a fit of three joints, the last one rigid, with errors of 1 %."""

    compliance: Array = field(default_factory=lambda: np.array([1e-3, 2e-3, 0.0]))
    errors: Array = field(default_factory=lambda: np.array([9.0, 1e-5, 2e-5, 0.0]))
    problem: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(
            unknowns={"c": slice(1, 4)}, link=SimpleNamespace(elastic=np.array([True, True, False]))
        )
    )


@pytest.mark.parametrize(("moves", "stuck"), [((1e-4, -2e-3), True), ((1e-4, -5e-3), False), ((0.02, 0.0), False)])
def test_a_fit_that_stays_at_the_end_of_rougher_sensors_has_its_errors(moves: tuple[float, float], stuck: bool) -> None:
    rougher = End()
    fine = Found(SimpleNamespace(compliance=rougher.compliance * (1 + np.array([*moves, 0.0]))))
    told = _unless_stuck(fine, rougher)  # type: ignore[arg-type]
    assert (told.stuck is not None) == stuck
    if stuck:
        assert told.stuck == pytest.approx([0.01, 0.01, 0.0])


def test_a_log_that_is_not_searched_as_a_rougher_one_keeps_its_errors() -> None:
    fine = Found(SimpleNamespace(compliance=np.ones(3)))
    assert _unless_stuck(fine, None) is fine  # type: ignore[arg-type, comparison-overlap]
