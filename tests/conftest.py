"""The order of the tests: folders of long files come first, so that no worker is left alone with one at the end."""

from __future__ import annotations

from pathlib import Path

import pytest

LONG = ("diagnosis", "takeaway", "measured", "joint_torque", "estimate", "simulation")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Move the tests of the long folders to the front; all others keep their order."""
    here = Path(__file__).parent

    def rank(item: pytest.Item) -> int:
        folder = item.path.relative_to(here).parts[0]
        return LONG.index(folder) if folder in LONG else len(LONG)

    items.sort(key=rank)
