"""Real processes: what a shell sees of elid."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests import forked

QUIET = ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "ELID_ROBOT", "_ELID_COMPLETE", "PYTHONIOENCODING", "PYTHONWARNINGS")


def environment(**changes: str) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name not in QUIET}
    return {**kept, "TERM": "xterm-256color", "LC_ALL": "C.UTF-8", **changes}


def interruptible() -> None:
    """Let Control-C act in a child even where this process was started in the background, which ignores it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Elid:
    """Runs elid as its own process; but where Python itself is looked at, forked (`tests.forked`)."""

    command = (sys.executable, "-m", "elid_cli")

    def __call__(
        self, *arguments: str, cwd: Path | None = None, stdin: str = "", timeout: float = 120, **env: str
    ) -> subprocess.CompletedProcess[str]:
        return forked.run(arguments, cwd=cwd, env=environment(**env), stdin=stdin, timeout=timeout)

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


ROBOT = """\
name: spindle
gravity: [0, 0, -9.81]
dh: standard
joints:
  - {name: "/joint[1]", a: 0, alpha: 0, d: 0, theta: 0, gear_ratio: 1, transmission: rigid,
     parameters: {m: 2, Izz: 0.5, Jm: 0.1, fs: 0.4, fv: 0.3}}
"""
JOINT = "/joint[1]"


def spindle_log(duration: float = 12.0, rate: float = 200.0, *, noise: float = 0.01, inertia: float = 0.6) -> str:
    """Return a CSV log of a spindle with J = 0.6 kg·m², Coulomb 0.4 N·m and viscous friction 0.3 N·m·s/rad."""
    generator = np.random.default_rng(0)
    t = np.arange(round(duration * rate)) / rate
    q, dq, ddq = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for amplitude, hertz, phase in [(0.8, 0.3, 0.0), (0.3, 0.7, 1.0), (0.1, 1.3, 2.0)]:
        w = 2 * np.pi * hertz
        q += amplitude * np.sin(w * t + phase)
        dq += amplitude * w * np.cos(w * t + phase)
        ddq -= amplitude * w**2 * np.sin(w * t + phase)
    tau = inertia * ddq + 0.4 * np.sign(dq) + 0.3 * dq + noise * generator.standard_normal(t.size)
    rows = (f"{a:.6f},{b:.9f},{b:.9f},{c:.6f}" for a, b, c in zip(t, q, tau, strict=True))
    return "\n".join([f"t,q.{JOINT},theta.{JOINT},tau.{JOINT}", *rows]) + "\n"


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a robot file and a log in it; tests must not write to it."""
    folder = tmp_path_factory.mktemp("Läufe 1")
    (folder / "spindle.yaml").write_text(ROBOT, "utf-8")
    (folder / "run 07.csv").write_text(spindle_log())
    return folder
