"""Run the README's console blocks, one after the other, and put what they print under their commands.

    python -m tests.reproduce.readme

A comment ``<!-- shown: 1-8 12 -->`` before a block says which lines of the output are shown; lines left out become
one line with an ellipsis. The table of effects comes from ``elid effects --json`` in the same way, and the pictures in
``docs`` from the folder ``figures`` that a block plots into.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
BLOCK = re.compile(r"(<!-- shown: ([0-9\- ]+) -->\n)?```console\n(\$ (?:[^\n]*\\\n)*[^\n]*\n).*?```", re.DOTALL)
EFFECTS = re.compile(r"(<!-- elid effects -->\n).*?(?=\n<!-- end -->)", re.DOTALL)
PICTURES = ("effect1.png", "torque_joint2.png")
"""Figures of the walk's diagnosis that the README shows."""
STEP_LIMIT = 600
"""s, for one command."""


def main() -> None:
    """Rewrite the README in place."""
    text = README.read_text("utf-8")
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "sample_logs", Path(folder) / "sample_logs")
        text = BLOCK.sub(lambda match: _refreshed(match, Path(folder)), text)
        table = effects_table(json.loads(_run("elid effects --json", Path(folder))))
        for picture in PICTURES:
            shutil.copy(Path(folder) / "figures" / picture, ROOT / "docs" / picture)
    text = EFFECTS.sub(lambda match: match.group(1) + table, text)
    README.write_text(text, "utf-8")


def effects_table(answer: dict[str, list[dict[str, str]]]) -> str:
    """Return the Markdown table of the effects that elid knows."""
    rows = [f"| `{effect['effect']}` | {effect['summary']} |" for effect in answer["effects"]]
    return "\n".join(["| effect | what it is |", "|---|---|", *rows])


def _refreshed(match: re.Match[str], folder: Path) -> str:
    comment, spans, command = match.group(1) or "", match.group(2), match.group(3)
    lines = _run(command.removeprefix("$ "), folder).splitlines()
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


def _run(command: str, folder: Path) -> str:
    define = f'elid() {{ "{sys.executable}" -m elid_cli "$@"; }}; '
    env = {**os.environ, "COLUMNS": "80", "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        ["bash", "-c", define + command], cwd=folder, env=env, capture_output=True, encoding="utf-8",
        timeout=STEP_LIMIT, check=False,
    )  # fmt: skip
    if done.returncode not in (0, 1):
        sys.exit(f"{command}{done.stderr}")
    return done.stdout + (done.stderr if done.returncode else "")


if __name__ == "__main__":
    main()
