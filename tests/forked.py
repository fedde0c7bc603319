"""elid as a process of its own without the wait for Python and NumPy: forked from a server that has imported them.

Standard streams, working folder, environment and exit status are the process's own, as a shell would give them. How
elid starts has tests of its own, which start Python (`tests/cli/test_imports.py`, `tests/cli/test_frame.py`).
"""

from __future__ import annotations

import io
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

COMMAND = (sys.executable, "-m", "elid_cli")
IMPORTED = (
    "pytest", "h5py", "scipy.interpolate", "scipy.optimize", "elid_cli.cli.group", "elid_cli.cli.output",
    "elid_cli.cli.inputs", "elid_cli.cli.verbs.classify", "elid_cli.cli.verbs.diagnose", "elid_cli.cli.verbs.identify",
    "elid_cli.cli.verbs.simulate", "elid_cli.cli.verbs.validate", "elid_cli.logs", "elid_cli.diagnosis",
    "elid_cli.estimation.identify", "elid_cli.experiment.simulation", "elid_cli.report.answers.identification",
    "elid_cli.report.formats.terminal", "tests.forked",
)  # fmt: skip
"""What the server has imported: `pytest` as well, which multiprocessing would import anew in every process."""


def run(
    arguments: Sequence[str],
    *,
    cwd: Path | None = None,
    env: Mapping[str, str] | None = None,
    stdin: str = "",
    timeout: float = 300.0,
    limits: Mapping[int, int] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run elid, as `subprocess.run` with its output captured as UTF-8; what Python itself is told starts Python.

    `limits` are those of `resource.setrlimit`, for the process alone.
    """
    wanted = dict(os.environ if env is None else env)
    if any(wanted.get(name) != os.environ.get(name) for name in wanted if name.startswith("PYTHON")):
        return subprocess.run(
            [*COMMAND, *arguments], input=stdin, capture_output=True, encoding="utf-8", errors="surrogateescape",
            env=wanted, cwd=cwd, timeout=timeout, check=False,
        )  # fmt: skip
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(IMPORTED))
    with tempfile.TemporaryDirectory() as folder:
        streams = [Path(folder) / name for name in ("stdin", "stdout", "stderr")]
        streams[0].write_text(stdin, "utf-8", errors="surrogateescape")
        place = str(Path.cwd() if cwd is None else cwd)
        order = (list(arguments), place, wanted, list(map(str, streams)), dict(limits or {}))
        process = context.Process(target=_elid, args=order)
        process.start()
        process.join(timeout)
        if process.exitcode is None:
            process.kill()
            process.join()
            raise subprocess.TimeoutExpired([*COMMAND, *arguments], timeout)
        said = [path.read_text("utf-8", errors="surrogateescape") if path.exists() else "" for path in streams[1:]]
        return subprocess.CompletedProcess([*COMMAND, *arguments], process.exitcode, *said)


def _elid(
    arguments: list[str], place: str, environment: dict[str, str], streams: list[str], limits: dict[int, int]
) -> None:
    """Become elid: in the forked process."""
    for kind, most in limits.items():
        resource.setrlimit(kind, (most, most))
    os.chdir(place)
    os.environ.clear()
    os.environ.update(environment)
    for number, path in enumerate(streams):
        os.dup2(os.open(path, os.O_RDWR | os.O_CREAT), number)
    sys.argv = ["elid", *arguments]
    sys.stdin = io.TextIOWrapper(open(0, "rb", closefd=False), encoding="utf-8")  # noqa: SIM115
    sys.stdout = io.TextIOWrapper(open(1, "wb", closefd=False), encoding="utf-8")  # noqa: SIM115
    sys.stderr = io.TextIOWrapper(
        open(2, "wb", closefd=False), encoding="utf-8", errors="backslashreplace", line_buffering=True  # noqa: SIM115
    )  # fmt: skip
    from elid_cli.cli import main

    status = main(arguments)
    sys.stdout.flush()
    os._exit(status)
