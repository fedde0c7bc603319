"""Commands load what they use: what costs start-up time is not imported by verbs that need none of it."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

LOGS = Path(__file__).parents[2] / "sample_logs"
CSV, HDF5, MCAP = (str(LOGS / f"planar2.{suffix}") for suffix in ("csv", "h5", "mcap"))

SCRIPT = """
import contextlib, io, sys
from elid_cli.cli import main
with contextlib.redirect_stdout(io.StringIO()):
    code = main(sys.argv[1:])
print(code, *sorted(sys.modules))
"""
HEAVY = (
    "h5py",
    "mcap",
    "lz4",
    "matplotlib",
    "pandas",
    "rich",
    "distributed",
    "dask",
    "clarabel",
    "multiprocessing.pool",
)
SCIPY = ["signal", "optimize", "stats", "interpolate", "spatial", "ndimage", "special", "fft"]
if tuple(map(int, version("scipy").split(".")[:2])) >= (1, 17):
    SCIPY += ["sparse"]  # scipy.linalg of older versions imports it
NOT_SCIPY = tuple(f"scipy.{name}" for name in SCIPY)


def loaded(*arguments: str) -> set[str]:
    done = subprocess.run([sys.executable, "-c", SCRIPT, *arguments], capture_output=True, text=True, check=True)
    code, *modules = done.stdout.split()
    assert code == "0", done.stderr
    return set(modules)


@pytest.mark.parametrize(
    ("arguments", "absent"),
    [
        (("--help",), ("numpy", "scipy", "yaml", *HEAVY)),
        (("--version",), ("numpy", "scipy", "yaml", *HEAVY)),
        (("reduce", "--help"), ("numpy", "scipy", "yaml", *HEAVY)),
        (("effects", "--json"), ("scipy", *HEAVY)),
        (("info", CSV, "--json"), ("scipy", *HEAVY)),
        (("classify", "--robot", "puma560", "--json"), ("scipy", *HEAVY)),
        (("identify", CSV, "--robot", "planar2", "--json"), (*NOT_SCIPY, "zstandard", *HEAVY)),
        (("identify", HDF5, "--robot", "planar2", "--json"), (*NOT_SCIPY, "zstandard", *set(HEAVY) - {"h5py"})),
        (("identify", MCAP, "--robot", "planar2", "--json"), (*NOT_SCIPY, *set(HEAVY) - {"mcap", "lz4"})),
        (("validate", CSV, "--robot", "planar2", "--json"), (*NOT_SCIPY, *HEAVY)),
    ],
    ids=lambda value: " ".join(Path(v).name for v in value if isinstance(v, str))[:40],
)
def test_a_verb_loads_only_what_it_uses(arguments: tuple[str, ...], absent: tuple[str, ...]) -> None:
    assert not loaded(*arguments) & set(absent)


def test_triangles_are_reduced_and_identified_without_readers_of_other_logs(tmp_path: Path) -> None:
    file = str(tmp_path / "log.npz")
    assert not loaded("reduce", CSV, "--robot", "planar2", "-o", file, "--json") & {*NOT_SCIPY, *HEAVY}
    assert not loaded("identify", file, "--robot", "planar2", "--json") & {*NOT_SCIPY, *HEAVY}


FIRST_SIGN = """
import os, sys
class Terminal:
    def write(self, text):
        if text.strip():
            print(*sorted(sys.modules), flush=True)
            os._exit(0)
    def flush(self):
        pass
    def isatty(self):
        return True
sys.stderr = Terminal()
from elid_cli.cli import main
main(sys.argv[1:])
"""


@pytest.mark.parametrize("verb", ["identify", "diagnose", "validate"])
def test_a_first_sign_of_life_comes_before_what_takes_long_to_load(verb: str) -> None:
    command = [sys.executable, "-c", FIRST_SIGN, verb, MCAP, "--robot", "planar2"]
    modules = set(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())
    assert "elid_cli.cli" in modules
    assert not modules & ({"scipy", "numba", *HEAVY} - {"rich"})  # Rich draws the sign
