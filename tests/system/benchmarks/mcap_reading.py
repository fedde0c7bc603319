"""Time elid's bulk decoder against mcap_ros2's decoded reader on the same generated file, in CPU time.

    python -m tests.system.benchmarks.mcap_reading [messages, default 600000]

Prints CPU seconds, memory above the resulting arrays, and the floor: reading and decompressing the chunks alone.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

JOINTS = 6
READERS = ("floor", "elid", "mcap_ros2")


def generate(path: Path, messages: int) -> None:
    """Write a log of `messages` JointStates of six joints, half of them on each topic."""
    import numpy as np

    from elid_cli.logs import write_recording
    from elid_cli.signals.recording import Recording, Segment

    n = messages // 2
    t = np.arange(n) / 1000
    rng = np.random.default_rng(1)
    q = np.sin(t[:, None] * np.linspace(0.5, 1.5, JOINTS)) + 1e-6 * rng.standard_normal((n, JOINTS))
    dq = np.gradient(q, axis=0) * 1000
    tau = 10 * dq + rng.standard_normal((n, JOINTS))
    names = tuple(f"joint{i + 1}" for i in range(JOINTS))
    write_recording(Recording(names, 0.001, t, q, q, tau, dq=dq, dtheta=dq, segments=(Segment(0, n),)), path)


def read(how: str, path: Path) -> tuple[float, float]:
    """Return (CPU s, MB of arrays)."""
    size = 0.0
    if how == "elid":
        from elid_cli.logs.contract import Pick
        from elid_cli.logs.formats.mcap import CANONICAL, McapLog
        from elid_cli.logs.source import open_source

        names = tuple(f"joint{i + 1}" for i in range(JOINTS))
        begin = time.process_time()
        source = open_source(path)
        log = McapLog(source.name, [source])
        picks = [Pick(s["from"], s["field"], names) for k, s in CANONICAL.items() if k != "tau_link"]
        streams = log.load(picks)
        cpu = time.process_time() - begin
        clocks = {id(c): c for stream in streams for c in stream.clocks.values()}
        size = sum(s.values.nbytes for s in streams) + sum(c.nbytes for c in clocks.values())
    elif how == "mcap_ros2":
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory

        begin = time.process_time()
        with path.open("rb") as stream:
            count = sum(
                len(decoded.position)
                for _, _, _, decoded in make_reader(
                    stream, decoder_factories=[DecoderFactory()]
                ).iter_decoded_messages()
            )
        cpu = time.process_time() - begin
        assert count > 0
    else:
        from elid_cli.logs.mcap.container import Container, walk

        begin = time.process_time()
        with path.open("rb") as stream:
            for _ in walk(stream, path.stat().st_size, Container()):
                pass
        cpu = time.process_time() - begin
    return cpu, size / 1e6


def measure(how: str, path: Path) -> dict[str, float]:
    """Run one reader in a fresh process: CPU s, peak MB above the imports, MB of arrays."""
    out = subprocess.run(
        [sys.executable, __file__, "--one", how, str(path)], check=True, capture_output=True, text=True
    )
    return dict(json.loads(out.stdout))


def one(how: str, path: Path) -> None:
    """Child process: import first, then measure."""
    import lz4.frame  # noqa: F401
    import numpy as np  # noqa: F401
    import zstandard  # noqa: F401

    import elid_cli.logs.formats.mcap  # noqa: F401

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    cpu, arrays = read(how, path)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"cpu": cpu, "extra": peak - before, "arrays": arrays}))


def main() -> None:
    """Print the table."""
    if sys.argv[1:2] == ["--one"]:
        one(sys.argv[2], Path(sys.argv[3]))
        return
    messages = int(sys.argv[1]) if len(sys.argv) > 1 else 600_000
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        subprocess.run(
            [
                sys.executable,
                "-c",
                f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); "
                f"import mcap_reading; mcap_reading.generate(mcap_reading.Path({str(path)!r}), {messages})",
            ],
            check=True,
        )
        print(f"{messages} JointState messages of {JOINTS} joints, {path.stat().st_size / 1e6:.0f} MB zstd")
        rounds = 3
        results = {}
        for how in READERS:
            runs = [measure(how, path) for _ in range(1 if how == "mcap_ros2" else rounds)]
            results[how] = sorted(runs, key=lambda run: run["cpu"])[len(runs) // 2]
            run = results[how]
            above = run["extra"] - run["arrays"]
            print(f"  {how:10s} {run['cpu']:7.3f} s CPU   {run['extra']:6.0f} MB, {above:6.0f} MB above the arrays")
        print(f"  ratio      {results['mcap_ros2']['cpu'] / results['elid']['cpu']:.1f} times faster than mcap_ros2")


if __name__ == "__main__":
    main()
