"""Where each signal of a robot is read from in a log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from elid_cli.logs.contract import Pick
from elid_cli.logs.mapping.language import SignalMap, SignalMaps, TimeMap


@dataclass(frozen=True)
class Placement:
    """One signal's place: the picks that bring it, and which joint each picked column is."""

    spec: SignalMap
    picks: tuple[Pick, ...]
    joints: tuple[tuple[int, ...], ...]
    """Joint indices (from 0) of the columns of each pick."""
    places: str
    """Where it comes from, as a user would write it."""
    either: bool = False
    """Of a `tau_link`: whether it is the effort of joint states, the motor's where no motor side is logged."""
    unnamed: bool = False
    """Whether values without names were taken in the robot's joint order."""
    left: bool = False
    """Whether that order is the one of the joints that are left, without those that are held."""
    told: bool = False
    """Whether a mapping says so, and not a canonical name or what is known of a message."""


@dataclass(frozen=True)
class Layer:
    """One mapping to try, with the words that name it."""

    where: str
    signals: SignalMaps
    time: TimeMap | None = None
    canonical: bool = False
    profile: bool = False
    """Whether it is what is known of a message (`profiles`)."""
    asked: bool = False
    """Whether the user gave it for this log."""


@dataclass(frozen=True)
class ReadPlan:
    """Where every signal of a log is read from, and what had to be decided for that."""

    placements: Mapping[str, Placement]
    time: TimeMap | None
    unfit: tuple[str, ...]
    """Mapped signals that the log does not hold, and what was done instead."""
    notes: tuple[str, ...]
    reasons: Mapping[str, str]
    """Signals that nothing fits -> why."""
    unusable: frozenset[str] = frozenset()
    """Those of them that the log holds, or that the user has mapped."""
    mapped: frozenset[str] = frozenset()
    """Signals that the user gave a place for this log."""
