"""The notebooks of the documentation run, and what they show is what their cells give."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def cells(path: Path) -> list[dict[str, Any]]:
    loaded: list[dict[str, Any]] = json.loads(path.read_text("utf-8"))["cells"]
    return loaded


def words(cell: dict[str, Any]) -> list[str]:
    """Return what a cell shows, word by word: numbers differ in their last digits between machines."""
    shown = "".join("".join(part) for output in cell.get("outputs", ()) for part in output.get("data", {}).values())
    return re.sub(r"[-\s]+", " ", NUMBER.sub("#", re.sub(r"<[^>]*>", " ", shown))).split()


@pytest.fixture(scope="module")
def executed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("notebooks")
    done = subprocess.run(
        [sys.executable, "-m", "tests.system.reproduce.notebook", "--to", str(folder)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_show_what_their_cells_give(executed: Path, path: Path) -> None:
    again = cells(executed / path.name)
    shown = [words(cell) for cell in cells(path) if cell["cell_type"] == "code"]
    assert sum(map(len, shown)) > 100, "run python -m tests.system.reproduce.notebook"
    assert [words(cell) for cell in again if cell["cell_type"] == "code"] == shown


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_import_public_names_only(path: Path) -> None:
    code = "\n".join("".join(cell["source"]) for cell in cells(path) if cell["cell_type"] == "code")
    assert "from elid_cli import" in code
    assert "elid_cli." not in code


def test_documents_import_public_names_only() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    blocks = [b for page in pages for b in re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)]
    assert len(blocks) >= 3
    assert [
        line for block in blocks for line in block.splitlines() if re.match(r"\s*(from|import) elid_cli\.", line)
    ] == []
