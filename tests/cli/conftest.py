"""Real processes: what a shell sees of elid."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

QUIET = ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "ELID_ROBOT", "_ELID_COMPLETE", "PYTHONIOENCODING", "PYTHONWARNINGS")


def environment(**changes: str) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name not in QUIET}
    return {**kept, "TERM": "xterm-256color", "LC_ALL": "C.UTF-8", **changes}


class Elid:
    """Runs elid as its own process, on pipes."""

    command = (sys.executable, "-m", "elid_cli")

    def __call__(
        self, *arguments: str, cwd: Path | None = None, stdin: str = "", timeout: float = 120, **env: str
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*self.command, *arguments], input=stdin, capture_output=True, encoding="utf-8", errors="surrogateescape",
            env=environment(**env), cwd=cwd, timeout=timeout, check=False,
        )  # fmt: skip

    def python(self, code: str, *arguments: str, **env: str) -> subprocess.CompletedProcess[str]:
        """Run a few lines that end in calling elid's main."""
        return subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, encoding="utf-8", env=environment(**env),
            timeout=120, check=False,
        )  # fmt: skip

    def shell(self, line: str, cwd: Path | None = None, **env: str) -> subprocess.CompletedProcess[str]:
        """Run a line of bash in which ``elid`` is this elid."""
        define = f'elid() {{ "{sys.executable}" -m elid_cli "$@"; }}; '
        return subprocess.run(
            ["bash", "-c", define + line], capture_output=True, encoding="utf-8", env=environment(**env), cwd=cwd,
            timeout=120, check=False,
        )  # fmt: skip

    def terminal(self, *arguments: str, **env: str) -> tuple[int, str]:
        """Run on a pseudo-terminal of 80 columns; returns the exit code and everything that it showed."""
        master, slave = pty.openpty()
        process = subprocess.Popen(
            [*self.command, *arguments], stdin=subprocess.DEVNULL, stdout=slave, stderr=slave,
            env=environment(COLUMNS=env.pop("COLUMNS", "80"), **env),
        )  # fmt: skip
        os.close(slave)
        shown = b""
        while select.select([master], [], [], 120)[0]:
            try:
                part = os.read(master, 65536)
            except OSError:  # Linux: the other end is closed
                break
            if not part:
                break
            shown += part
        os.close(master)
        return process.wait(timeout=120), shown.decode("utf-8", "replace")


@pytest.fixture(scope="session")
def elid() -> Elid:
    return Elid()


Run = Callable[..., subprocess.CompletedProcess[str]]
