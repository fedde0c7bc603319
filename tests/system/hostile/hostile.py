"""What every test of a hostile file asks: exit code, words, numbers that are right or absent, and nothing else."""

from __future__ import annotations

import contextlib
import io
import json
import re
import signal
import warnings
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli.cli import main
from elid_cli.logs import read_recording
from elid_cli.robot.files import read_robot
from elid_cli.signals.recording import Recording, Segment

SAMPLE = Path(__file__).parents[3] / "sample_logs" / "planar2.h5"
ROBOT = "planar2"
JOINTS = ("joint1", "joint2")
SIGNALS = ("q", "theta", "tau")
EVERY = 4
"""The sample log's 1 kHz are thinned by this, so that a command takes a third of a second."""
SIZES = {"kg": 6.0, "kg·m": 1.0, "kg·m²": 12.0, "N·m": 0.3, "N·m·s/rad": 0.14, "N·m/rad": 1800.0}
"""What a parameter near zero is compared with, by unit: the smallest one of the robot."""


@dataclass(frozen=True)
class Done:
    """One command that has ended."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        """The one object on stdout."""
        found = json.loads(self.out)
        assert isinstance(found, dict)
        return found

    @property
    def estimates(self) -> dict[str, tuple[float | None, str]]:
        """Estimate and unit by base parameter."""
        return {entry["name"]: (entry["estimate"], entry["unit"]) for entry in self.json["base_parameters"]}


def elid(*arguments: object) -> Done:
    """Run one command line as a shell would, in this process."""
    out, err = io.StringIO(), io.StringIO()
    handler = signal.getsignal(signal.SIGINT)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main([str(argument) for argument in arguments])
    finally:
        signal.signal(signal.SIGINT, handler)
    done = Done(code, out.getvalue(), err.getvalue())
    assert "Traceback" not in done.err, done.err
    assert code != 70, done.err
    return done


@cache
def base(samples: int | None = None) -> Recording:
    """Return the good log, 12 s of the two-joint arm at 250 Hz, or its first samples."""
    whole = read_recording([SAMPLE], read_robot(ROBOT))
    rows = slice(None, None if samples is None else samples * EVERY, EVERY)
    signals = {signal: np.ascontiguousarray(getattr(whole, signal)[rows]) for signal in SIGNALS}
    t = np.ascontiguousarray(whole.t[rows])
    return Recording(JOINTS, whole.dt * EVERY, t, **signals, segments=(Segment(0, t.size),))


@cache
def clean(samples: int | None = None) -> dict[str, tuple[float | None, str]]:
    """Return what `elid identify` finds in the good log, or in its first samples."""
    import tempfile

    from elid_cli.logs import write_recording

    with tempfile.TemporaryDirectory() as folder:
        write_recording(base(samples), Path(folder) / "clean.h5")
        done = elid("identify", Path(folder) / "clean.h5", "--robot", ROBOT, "--json")
    assert done.code == 0, done.err
    assert samples or done.err == ""
    return done.estimates


def refused(log: object, *words: str, code: int = 3, robot: object = ROBOT, more: tuple[object, ...] = ()) -> Done:
    """Assert that identify and diagnose refuse a log in one message that holds `words`, and print nothing else."""
    for verb in ("identify", "diagnose"):
        for form in ((), ("--json",)):
            done = elid(verb, log, "--robot", robot, *more, *form)
            assert done.code == code, (verb, done)
            assert done.out == ""
            one_message(done, *words)
    return done


def one_message(done: Done, *words: str) -> None:
    """Assert that stderr ends in one error of at most three lines that holds `words`."""
    lines = [line for line in done.err.splitlines() if not line.startswith(("repaired: ", "warning: "))]
    assert lines, done
    assert lines[0].startswith("error: "), done.err
    assert len(lines) <= 3, done.err
    assert done.err.count("error: ") == 1, done.err
    for word in words:
        assert word in done.err, (word, done.err)


def used(
    log: object, *words: str, tolerance: float = 0.01, robot: object = ROBOT, more: tuple[object, ...] = ()
) -> Done:
    """Assert that a log is used: `words` are said, on stderr and in the JSON, and the numbers are the good log's."""
    done = elid("identify", log, "--robot", robot, *more, "--json")
    assert done.code == 0, done.err
    said = json.dumps(done.json["log"], ensure_ascii=False)
    for word in words:
        assert word in said, (word, said)
    agrees(done, tolerance)
    return done


def agrees(done: Done, tolerance: float = 0.01) -> None:
    """Assert that every number is the good log's, or absent."""
    wanted = clean()
    for name, (value, unit) in done.estimates.items():
        if value is None or name not in wanted:
            continue
        right = wanted[name][0]
        assert right is not None
        assert abs(value - right) <= tolerance * max(abs(right), SIZES[unit]), (name, value, right)


def sizes_only(text: str) -> str:
    """Return a message without its numbers, to compare forms."""
    return re.sub(r"[-+]?\d[\d.e+-]*", "#", text)
