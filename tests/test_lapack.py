"""LAPACK is SciPy's own, and identifying does not import the package around it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from elid_cli import lapack as door
from elid_cli.lapack import lapack


def test_functions_are_those_of_scipy() -> None:
    from scipy.linalg.lapack import dgeqp3

    matrix = np.random.default_rng(0).standard_normal((20, 5))
    for mine, theirs in zip(lapack().dgeqp3(matrix), dgeqp3(matrix), strict=True):
        assert np.array_equal(mine, theirs)


def test_another_scipy_is_asked_as_a_package(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr(door, "_extension", lambda: None)
    lapack.cache_clear()
    try:
        assert hasattr(lapack(), "dtpqrt")
    finally:
        lapack.cache_clear()


@pytest.mark.parametrize("robot", ["planar2", "puma560"])
def test_identify_does_not_import_scipys_packages(robot: str) -> None:
    """Not where torques are late, either: the log of puma560."""
    code = (
        "import sys; from elid_cli.cli import main; "
        f"main(['identify', 'sample_logs/{robot}.h5', '--robot', '{robot}', '--json']); "
        "print({'scipy.linalg', 'scipy.interpolate', 'scipy.special'} & {*sys.modules}, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "set()"
