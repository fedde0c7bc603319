"""Terms of the model, one file each: five base terms and the effects that a model may lack."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import cache

from elid_cli.terms.effect import Effect

_NOT_EFFECTS = {"base_term", "effect", "rigid_body", "rotor", "spring", "coulomb", "viscous"}


@cache
def effect_classes() -> dict[str, type[Effect]]:
    """Return the library of effects by name, found in this folder's files, in alphabetical order."""
    found: dict[str, type[Effect]] = {}
    for module in pkgutil.iter_modules(__path__):
        if module.name in _NOT_EFFECTS:
            continue
        contents = importlib.import_module(f"{__name__}.{module.name}")
        for _, item in inspect.getmembers(contents, inspect.isclass):
            if issubclass(item, Effect) and not inspect.isabstract(item) and item.__module__ == contents.__name__:
                found[item.name] = item
    return dict(sorted(found.items()))
