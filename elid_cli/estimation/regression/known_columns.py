"""Effects' columns of one log that need not be computed again.

Most effects are computed from the motion and the logged torque alone, and their columns stay the same however often a
search fits the model anew. Which ones is not declared but watched: an entry holds as long as everything that the effect
read of the fit has kept its bytes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.effect_columns import extra_of
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene
from elid_cli.signals.signals import Signals

FITTED = frozenset({"tau", "load", "predicted", "parameters", "stiffness", "found", "alone", "late"})
"""What of a scene changes with the fit; where torque is not known, the logged one is filled with the predicted."""
ROOM = 64_000_000
"""Bytes that are kept; columns beyond are computed each time."""


@dataclass(frozen=True)
class _Entry:
    value: Any
    read: dict[str, bytes]
    """Digests of what it was computed from."""


Fresh = dict[Hashable, _Entry]
"""Entries that are new."""


class KnownColumns:
    """Filtered and decimated columns of effects in one log, kept between the scenes of several fits."""

    def __init__(self, signals: Signals) -> None:
        self._signals = signals
        self._entries: dict[Hashable, _Entry] = {}
        self._scene: Scene | None = None
        self._digests: dict[str, bytes] = {}
        self._bytes = 0
        self._fresh: Fresh = {}

    def of(self, effect: Effect, scene: Scene) -> ExtraColumns:
        """Return the columns of an effect in a scene of this log."""
        self._seen(scene)
        key = (effect.name, effect.joint, effect.shape)
        known = self.get(key)
        if known is None:
            watched = _Watched.of(scene, self)
            known = self.put(key, extra_of(effect, watched, self._signals), watched.read)
        return cast(ExtraColumns, known.value)

    @contextmanager
    def fresh(self) -> Iterator[Fresh]:
        """Yield what becomes known meanwhile, for another process to `learn`."""
        before, self._fresh = self._fresh, {}
        try:
            yield self._fresh
        finally:
            self._fresh = before

    def learn(self, fresh: Fresh) -> None:
        """Take over what another process found out about the same log."""
        for key, entry in fresh.items():
            self._keep(key, entry)

    def _seen(self, scene: Scene) -> None:
        if scene is not self._scene:
            self._scene, self._digests = scene, {}

    def _digest(self, name: str) -> bytes:
        if name not in self._digests:
            values = getattr(self._scene, name)
            content = _content(values) if name == "found" else np.ascontiguousarray(values, dtype=float).data
            self._digests[name] = hashlib.blake2b(content).digest()
        return self._digests[name]

    def get(self, key: Hashable) -> _Entry | None:
        """Return what is known under a key and still holds."""
        entry = self._entries.get(key)
        if entry is None or any(self._digest(name) != digest for name, digest in entry.read.items()):
            return None
        return entry

    def put(self, key: Hashable, value: Any, read: set[str]) -> _Entry:
        """Keep a result that was computed from some of what changes with the fit."""
        entry = _Entry(value, {name: self._digest(name) for name in read})
        self._keep(key, entry)
        return entry

    def _keep(self, key: Hashable, entry: _Entry) -> None:
        value = entry.value
        size = sum(rows.nbytes for rows in value.rows.values()) if isinstance(value, ExtraColumns) else 0
        if key in self._entries or self._bytes + size <= ROOM:
            self._bytes += 0 if key in self._entries else size  # the same effect has columns of the same size
            self._entries[key] = self._fresh[key] = entry


def _content(found: Sequence[tuple[Effect, Array]]) -> bytes:
    """Return what tells effects with their amplitudes from others."""
    return repr([(effect.name, effect.joint, effect.shape, linear.tolist()) for effect, linear in found]).encode()


class _Watched(Scene):
    """A scene that knows what of the fit has been read of it."""

    read: set[str]

    @classmethod
    def of(cls, scene: Scene, known: KnownColumns) -> _Watched:
        """Return a scene's double, of which nothing has been read."""
        watched = object.__new__(cls)
        read: set[str] = set()
        vars(watched).update(vars(scene), read=read, cache=_Shared(known, read))
        return watched

    def __getattribute__(self, name: str) -> Any:
        if name in FITTED:
            object.__getattribute__(self, "read").add(name)
        return object.__getattribute__(self, name)


class _Shared(dict[object, Array]):
    """What effects share (`Scene.cache`), by the same rule."""

    def __init__(self, known: KnownColumns, read: set[str]) -> None:
        super().__init__()
        self._known, self._read = known, read

    def __contains__(self, key: object) -> bool:
        return self._known.get(("shared", key)) is not None

    def __getitem__(self, key: object) -> Array:
        entry = self._known.get(("shared", key))
        if entry is None:
            raise KeyError(key)
        self._read |= entry.read.keys()
        return cast(Array, entry.value)

    def __setitem__(self, key: object, value: Array) -> None:
        self._known.put(("shared", key), value, self._read)
