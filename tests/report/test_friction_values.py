"""What is shown of the friction that a joint was found to have."""

from __future__ import annotations

import pytest

from elid_cli.diagnosis.friction_shapes import family
from elid_cli.report.answers.friction import _shown


@pytest.mark.parametrize("name", list(family().members))
def test_a_member_that_does_not_fade_has_no_velocity(name: str) -> None:
    member, example = family().members[name], family().example
    shown = _shown(example, member)
    assert ("velocity" in shown) is ("exponent" in shown) is bool(member.forms)
    assert "motor" in shown
