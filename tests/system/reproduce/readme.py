"""Run the console blocks of README and documentation, and put what they print under their commands.

    python -m tests.system.reproduce.readme                       # README.md and every page of docs
    python -m tests.system.reproduce.readme docs/tutorial.md      # these pages only

The blocks of one page run one after the other in a folder of their own, which holds the sample logs. A comment
``<!-- shown: 1-8 12 -->`` before a block says which lines of the output are shown; lines left out become one line with
an ellipsis. A command may fail only where the page shows an error already. The pictures in ``docs`` come from the
folder ``figures`` that a block of the tutorial plots into.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[3]
BLOCK = re.compile(r"(<!-- shown: ([0-9\- ]+) -->\n)?```console\n(\$ (?:[^\n]*\\\n)*[^\n]*\n).*?```", re.DOTALL)
PICTURES = {"docs/tutorial.md": ("effect1.png", "torque_joint2.png")}
"""Page -> figures of its diagnosis that documents show."""
STEP_LIMIT = 600
"""s, for one command."""


def main() -> None:
    """Rewrite the pages in place."""
    pages = [Path(name).resolve() for name in sys.argv[1:]] or documents()
    for page in pages:
        text = page.read_text("utf-8")
        if BLOCK.search(text):
            page.write_text(refreshed(text, PICTURES.get(page.relative_to(ROOT).as_posix(), ())), "utf-8")


def documents() -> list[Path]:
    """Return README.md and every page of the documentation."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def refreshed(text: str, pictures: tuple[str, ...] = ()) -> str:
    """Return a page's text with the present output of its commands; copy its figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "sample_logs", folder / "sample_logs")
        text = BLOCK.sub(lambda match: _refreshed(match, folder), text)
        for picture in pictures:
            shutil.copy(folder / "figures" / picture, ROOT / "docs" / picture)
    return text


def _refreshed(match: re.Match[str], folder: Path) -> str:
    comment, spans, command = match.group(1) or "", match.group(2), match.group(3)
    lines = _run(command.removeprefix("$ "), folder, may_fail="\nerror: " in match.group()).splitlines()
    return f"{comment}```console\n{command}" + "\n".join(_shown(lines, spans)) + "\n```"


def _shown(lines: list[str], spans: str | None) -> list[str]:
    if spans is None:
        return lines
    kept: list[str] = []
    last = 0
    for span in spans.split():
        first, _, end = span.partition("-")
        if int(first) > last + 1:
            kept.append("  …")
        last = int(end or first)
        kept += lines[int(first) - 1 : last]
    return [*kept, "  …"] if last < len(lines) else kept


def _run(command: str, folder: Path, *, may_fail: bool) -> str:
    define = f'elid() {{ "{sys.executable}" -m elid_cli "$@"; }}; '
    env = {**os.environ, "COLUMNS": "80", "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        ["bash", "-c", define + command], cwd=folder, env=env, capture_output=True, encoding="utf-8",
        timeout=STEP_LIMIT, check=False,
    )  # fmt: skip
    if done.returncode not in (0, 1) and not may_fail:
        sys.exit(f"{command}{done.stderr}")
    return done.stdout + (done.stderr if done.returncode else "")


if __name__ == "__main__":
    main()
