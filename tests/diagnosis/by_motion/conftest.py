"""What tests of the diagnosis by motion share."""

from __future__ import annotations

from typing import Any

import pytest

from elid_cli import diagnosis


@pytest.fixture
def diagnosed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands after the first one tell what that one found: for tests of what different ones say of one log."""
    found: list[Any] = []
    search = diagnosis.diagnose

    def once(*args: Any) -> Any:
        if not found:
            found.append(search(*args))
        return found[0]

    monkeypatch.setattr(diagnosis, "diagnose", once)
