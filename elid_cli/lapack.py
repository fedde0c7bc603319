"""LAPACK as SciPy brings it, without the rest of `scipy.linalg`.

That package's import takes longer than the whole fit of a short log: it copies NumPy's namespace, and with it NumPy's
test and build tools. Its extension module needs none of that.
"""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module, machinery, util
from pathlib import Path
from typing import Any


@cache
def lapack() -> Any:
    """Return the module with LAPACK's functions (`scipy.linalg.lapack`)."""
    whole = "scipy.linalg.lapack"
    return sys.modules.get(whole) or _extension() or import_module(whole)


def _extension() -> Any:
    """Return SciPy's extension module alone, None where it lies elsewhere than in the releases known."""
    if sys.platform == "win32":
        import scipy  # noqa: F401  # finds the libraries that the extension needs; elsewhere it knows where they are
    package = util.find_spec("scipy")
    folder = Path(package.origin).parent if package is not None and package.origin else Path()
    for suffix in machinery.EXTENSION_SUFFIXES:
        path = folder / "linalg" / f"_flapack{suffix}"
        if path.exists():
            spec = util.spec_from_file_location("_flapack", path)
            if spec is not None and spec.loader is not None:
                module = util.module_from_spec(spec)
                spec.loader.exec_module(module)
                return module if hasattr(module, "dtpqrt") else None
    return None
