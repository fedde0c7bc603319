"""What diagnose adds on measured robots, judged on records that no fit saw.

    python -m tests.system.measured.records DATA [WORD …]

DATA is the folder of measured logs, WORDs choose robots. Each robot is identified and diagnosed on one record, and both
robots that are written predict the torque of another: a second log, or the other half of the log. Printed are the
effects that are named, and per joint the error of the diagnosed robot over that of the identified one. Ends with 1
where a joint is predicted more than 3 % worse.
"""

from __future__ import annotations

import gzip
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

WORSE = 1.03
"""Ratio of the errors beyond which what was found made a joint worse."""
ROBOTS = {"emps": "emps", "kr300_A": "kr300", "panda_a": "panda.yaml", "quanser_2dsfl": "quanser_2dsfl"}
"""First word of a log's file name -> its robot: one that ships with elid, or a file beside the log."""
OTHER = {"emps": "emps_pulses.csv"}
"""Logs of which a second record is at hand."""


def elid(*arguments: str) -> dict[str, object]:
    """Return what a command prints with ``--json``."""
    done = subprocess.run(
        [sys.executable, "-m", "elid_cli", *arguments, "--json"], check=True, capture_output=True, text=True
    )
    found: dict[str, object] = json.loads(done.stdout)
    return found


def halves(log: Path, folder: Path) -> list[Path]:
    """Write the two halves of a CSV into a folder."""
    with gzip.open(log, "rt") if log.suffix == ".gz" else log.open() as stream:
        head, *rows = stream.read().splitlines()
    parts = [folder / f"{number}.csv" for number in ("first", "second")]
    for part, own in zip(parts, (rows[: len(rows) // 2], rows[len(rows) // 2 :]), strict=True):
        part.write_text("\n".join([head, *own, ""]))
    return parts


def compared(fitted: Path, judged: Path, robot: str, folder: Path) -> Iterator[tuple[str, float]]:
    """Yield every joint with the error of the diagnosed robot over that of the identified one."""
    files = {verb: str(folder / f"{verb}.yaml") for verb in ("identify", "diagnose")}
    for file in files.values():
        Path(file).unlink(missing_ok=True)
    told = {verb: elid(verb, str(fitted), "--robot", robot, "--write-robot", file) for verb, file in files.items()}
    named = [f"{e['effect']} of {e['joint']}" for e in told["diagnose"]["effects"]]  # type: ignore[attr-defined]
    print("  named:", ", ".join(named) or "nothing")
    errors = {verb: elid("validate", str(judged), "--robot", file)["error"] for verb, file in files.items()}
    for joint, own in errors["identify"].items():  # type: ignore[attr-defined]
        yield joint, errors["diagnose"][joint]["rms"] / own["rms"]  # type: ignore[index]


def main() -> int:
    """Print the table; return 1 where a joint is predicted worse."""
    data, words = Path(sys.argv[1]), sys.argv[2:]
    bad = False
    for name, robot in ROBOTS.items():
        (log,) = [p for p in sorted(data.glob(f"{name}.csv*"))]
        if words and not any(word in name for word in words):
            continue
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            records = [log, data / OTHER[name]] if name in OTHER else halves(log, folder)
            described = str(data / robot) if (data / robot).exists() else robot
            for fitted, judged in (records, records[::-1]):
                print(f"{name}: {fitted.name} → {judged.name}", flush=True)
                ratios = dict(compared(fitted, judged, described, folder))
                print("  diagnosed over identified:", "  ".join(f"{j} {r:.4f}" for j, r in ratios.items()), flush=True)
                bad = bad or max(ratios.values()) > WORSE
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
