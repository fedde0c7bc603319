"""The list of faults in this folder's docstring names tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

from tests.system import hostile

ROOT = Path(__file__).parents[3]


def test_every_fault_has_tests_that_exist() -> None:
    told = hostile.__doc__ or ""
    assert re.findall(r"(?m)^ ?(\d+)\.|, (6)\. ", told) == [("", "6") if k == 6 else (str(k), "") for k in range(1, 23)]
    named = re.findall(r"([\w/]+\.py)::(\w+)", told)
    assert len(named) > 40
    for file, name in named:
        path = ROOT / "tests" / file if "/" in file else Path(__file__).with_name(file)
        assert f"\ndef {name}(" in path.read_text("utf-8"), (file, name)
