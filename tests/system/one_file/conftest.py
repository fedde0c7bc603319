"""A copy of the package for each test, in which one file is dropped."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Copy:
    """A copied package in a folder, where commands run as well."""

    folder: Path

    def drop(self, name: str, into: str) -> None:
        """Copy a file from `dropped` into a folder of the package."""
        shutil.copy(Path(__file__).parent / "dropped" / name, self.folder / "elid_cli" / into)

    def python(self, *arguments: str) -> str:
        """Run Python on the copy; return stdout."""
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join((str(self.folder), str(ROOT))),
            "OPENBLAS_NUM_THREADS": "1",
        }
        run = subprocess.run([sys.executable, *arguments], cwd=self.folder, env=environment, capture_output=True,
                             text=True, timeout=300)  # fmt: skip
        assert run.returncode == 0, run.stderr or run.stdout
        return run.stdout

    def elid(self, *arguments: str) -> str:
        """Run one command; return stdout."""
        return self.python("-m", "elid_cli", *arguments)

    def tested(self, name: str, *files: str) -> str:
        """Run those tests of some files, relative to the root, whose names hold `name`; return what pytest says."""
        options = ("--import-mode=append", "-o", "pythonpath=", "-p", "no:cacheprovider", "-rA", "-k", name)
        return self.python("-m", "pytest", *options, *(str(ROOT / file) for file in files))


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    shutil.copytree(ROOT / "elid_cli", tmp_path / "elid_cli", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "elid_cli/robots").symlink_to(ROOT / "robots")  # where a wheel has them
    return Copy(tmp_path)
