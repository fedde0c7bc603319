"""Coverage-guided fuzzing of what reads files: the MCAP decoder, the CSV reader, the robot reader, mappings.

    python -m tests.system.fuzz.guided mcap -max_total_time=300
    python -m tests.system.fuzz.guided csv crash-0123abcd          # one input again

Every input has to end in a result or in one `ElidError`; anything else is a crash, which libFuzzer (through Atheris)
keeps as `crash-…`. Ten seconds for one input, or 2 GB, are crashes as well. What follows the target are options of
libFuzzer, or folders with inputs to start from; without one, good files made here are the start.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris
import numpy as np  # imported before, so that it is not instrumented

with atheris.instrument_imports(include=["elid_cli"]):
    from elid_cli.errors import ElidError
    from elid_cli.logs import reading
    from elid_cli.logs.formats import csv as csv_log
    from elid_cli.logs.formats import csv_dialect, csv_text
    from elid_cli.logs.formats import mcap as mcap_log
    from elid_cli.logs.mapping.language import parse_mapping
    from elid_cli.logs.repair import align as repair
    from elid_cli.logs.repair import timeline
    from elid_cli.logs.source import Source
    from elid_cli.robot.files import robot_from_text
    from elid_cli.robot.text import text_of
    from elid_cli.robot.yaml import parse_yaml

INSTRUMENTED = (csv_log, csv_dialect, csv_text, mcap_log, repair, timeline)
LIMITS = ["-timeout=10", "-rss_limit_mb=2048", "-max_len=20000", "-print_final_stats=1"]
MAGIC = mcap_log.MAGIC


def _complete(error: ElidError) -> None:
    if not error.message:
        raise AssertionError("an error without a message")


def _recorded(source: Source) -> None:
    """Read a log as the commands do, from memory."""
    from tests.logs.made_logs import ROBOT

    reading.open_source = lambda path, progress=None: source
    try:
        got = reading.read_recording(["fuzz"], ROBOT)
    except ElidError as error:
        _complete(error)
        return
    assert got.samples >= 20
    for signal in (got.q, got.theta, got.tau):
        finite = np.isfinite(signal)
        assert (finite.all(axis=0) | ~finite.any(axis=0)).all(), "a column is neither whole nor absent"


def mcap(data: bytes) -> None:
    """Read an MCAP file; the magic is put in front so that no input is lost to it."""
    _recorded(Source("fuzz.mcap", data=data if data.startswith(MAGIC) else MAGIC + data))


def csv(data: bytes) -> None:
    """Read a CSV file."""
    if data.strip():
        _recorded(Source("-", data=data))


def robot(data: bytes) -> None:
    """Read a robot description, and write and read again what was understood."""
    try:
        found = robot_from_text(data.decode("utf-8", "replace"), "fuzz.yaml")
    except ElidError as error:
        _complete(error)
        return
    assert robot_from_text(text_of(found), "again.yaml") == found, "written and read again it is another robot"


def mapping(data: bytes) -> None:
    """Understand a mapping."""
    from tests.logs.made_logs import ROBOT

    try:
        parse_mapping(parse_yaml(data.decode("utf-8", "replace"), "map.yaml").plain(), ROBOT, "map.yaml")
    except ElidError as error:
        _complete(error)


TARGETS: dict[str, Callable[[bytes], None]] = {"mcap": mcap, "csv": csv, "robot": robot, "mapping": mapping}


def seeds(target: str, folder: Path) -> None:
    """Write good files to start from, small ones, so that many are tried."""
    from mcap.writer import CompressionType

    from elid_cli.logs import write_recording
    from tests.logs.made_logs import recording
    from tests.logs.mcap_made import canonical

    base = recording(30, rate=100.0)
    if target == "mcap":
        plain = {"compression": CompressionType.NONE, "enable_crcs": False}
        kinds = {
            "chunks": {"chunk_size": 2000, **plain},
            "loose": {"use_chunking": False, **plain},
            "json": {"encoding": "json", "chunk_size": 4000, **plain},
            "zstd": {"chunk_size": 2000},
        }
        for name, options in kinds.items():
            canonical(folder / name, base, **options)
    elif target == "csv":
        write_recording(base, folder / "log.csv")
        text = (folder / "log.csv").read_text()
        (folder / "semicolons").write_text(text.replace(",", ";").replace(".", ","))
        (folder / "spaces").write_text("# comment\n" + text.replace(",", " "))
        (folder / "units").write_text(text.replace("\n", "\ns,rad,rad,rad,rad,rad,rad,Nm,Nm,Nm\n", 1))
        (folder / "ragged").write_text(text.replace("\n0.0", "\n2026-11-21T10:00:00Z,,nan\n0.0", 3))
        (folder / "log.csv.gz").write_bytes(__import__("gzip").compress(text.encode(), mtime=0))
    elif target == "robot":
        for path in sorted((Path(__file__).parents[3] / "robots").glob("*.yaml")):
            (folder / path.name).write_bytes(path.read_bytes())
        urdf = "<robot name='a'><link name='b'/><link name='l'><inertial><mass value='1'/></inertial></link>"
        urdf += "<joint name='j' type='revolute'><parent link='b'/><child link='l'/><axis xyz='0 0 1'/></joint></robot>"
        (folder / "a.urdf").write_text(urdf)
    else:
        lines = (
            "t: {from: stamp, unit: ns}\nq: {from: /a, field: position, joints: {shoulder: s}, unit: deg, sign: -1}\n"
            'theta: {from: "m_{i}", unit: "counts:4096", side: motor, offset: [0, 1, 2]}\n'
            "tau: {from: /m, field: current, unit: A, scale: [1, 2, 3], side: motor}\n"
        )
        (folder / "map.yaml").write_text(lines)


def main() -> None:
    """Fuzz one target."""
    target, *options = sys.argv[1:] or ["mcap"]
    with tempfile.TemporaryDirectory() as name:
        given = [option for option in options if not option.startswith("-")]
        if not given:
            seeds(target, Path(name))
            options.append(name)
        atheris.Setup([sys.argv[0], *LIMITS, *options], TARGETS[target])
        atheris.Fuzz()


if __name__ == "__main__":
    main()
