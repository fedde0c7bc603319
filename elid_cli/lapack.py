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
    import scipy

    for suffix in machinery.EXTENSION_SUFFIXES:
        path = Path(scipy.__file__).parent / "linalg" / f"_flapack{suffix}"
        if path.exists():
            spec = util.spec_from_file_location("_flapack", path)
            if spec is not None and spec.loader is not None:
                module = util.module_from_spec(spec)
                spec.loader.exec_module(module)
                return module if hasattr(module, "dtpqrt") else None
    return None
