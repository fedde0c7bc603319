"""Effects that a model may lack: what an effect knows (`effect`), and the library, one file each.

No other file knows the name of an effect: `effect_that` finds one by what it says of itself.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import cache

from elid_cli.model.effects import library
from elid_cli.model.effects.effect import Effect, Nuisance


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


@cache
def effect_that(**says: object) -> type[Effect]:
    """Return the one effect whose attributes are these: ``effect_that(nuisance="delay")``.

    Raises
    ------
    ValueError
        None is, or a new file of the library is another one.
    """
    found = [kind for kind in effect_classes().values() if all(getattr(kind, k) == v for k, v in says.items())]
    if len(found) != 1:
        raise ValueError(f"{says}: one effect is needed, not {len(found)}: {[kind.name for kind in found]}")
    return found[0]


def nuisance_of(name: str) -> Nuisance | None:
    """Return which fault of a torque channel or sensor an effect is; None for another one, or for no effect."""
    kind = effect_classes().get(name)
    return None if kind is None else kind.nuisance


def twins_of(kind: type[Effect]) -> tuple[str, ...]:
    """Return the twins that an effect names, and those that name it."""
    others = (name for name, other in effect_classes().items() if kind.name in other.twins)
    return tuple(dict.fromkeys((*kind.twins, *others)))
