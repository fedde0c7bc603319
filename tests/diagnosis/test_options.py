"""Options of a diagnosis in Python."""

from __future__ import annotations

import pytest

from elid_cli.diagnosis.diagnose import DiagnoseOptions
from elid_cli.errors import UsageError


def test_words_that_say_nothing_are_refused_with_the_nearest() -> None:
    with pytest.raises(UsageError, match="movement"):
        DiagnoseOptions(by="movement")  # type: ignore[arg-type]
    with pytest.raises(UsageError) as told:
        DiagnoseOptions(only=("stribek",))
    assert "stribeck" in f"{told.value} {told.value.hint}"
    assert DiagnoseOptions(only=("stribeck",), by="motion").only == ("stribeck",)
