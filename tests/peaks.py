"""Peak memory, of a command and of a piece of a test, free of what the test's own process held before."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path

PROCESS = Path("/proc/self")
_BETWEEN = (
    "import json, resource, subprocess, sys\n"
    "done = subprocess.run([sys.executable, '-m', 'elid_cli', *sys.argv[1:]], capture_output=True, text=True)\n"
    "peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024\n"
    "print(json.dumps([done.returncode, done.stdout, done.stderr, peak]))"
)


def of_command(*arguments: object) -> tuple[int, str, str, float]:
    """Run elid: exit status, standard output, standard error, peak (MB).

    By a small process in between, as the system's figure of a child is at least its parent's memory at the fork.
    """
    command = [sys.executable, "-c", _BETWEEN, *map(str, arguments)]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    status, printed, complaint, peak = json.loads(out)
    return status, printed, complaint, peak


def begin() -> float:
    """Forget this process' peak: its memory (MB) now. Where the system cannot (all but Linux), its peak."""
    if PROCESS.exists():
        (PROCESS / "clear_refs").write_text("5")
    return since()


def since() -> float:
    """Peak memory (MB) of this process since `begin`."""
    if not PROCESS.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    status = (PROCESS / "status").read_text()
    return next(float(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) / 1024
