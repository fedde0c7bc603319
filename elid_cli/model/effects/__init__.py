"""Effects that a model may lack: what an effect knows (`effect`), and the library, one file each."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import cache

from elid_cli.model.effects import library
from elid_cli.model.effects.effect import Effect


@cache
def effect_classes() -> dict[str, type[Effect]]:
    """Return the library of effects by name, found in the files of `library`, in alphabetical order."""
    found: dict[str, type[Effect]] = {}
    for module in pkgutil.iter_modules(library.__path__):
        contents = importlib.import_module(f"{library.__name__}.{module.name}")
        for _, item in inspect.getmembers(contents, inspect.isclass):
            if issubclass(item, Effect) and not inspect.isabstract(item) and item.__module__ == contents.__name__:
                found[item.name] = item
    return dict(sorted(found.items()))
