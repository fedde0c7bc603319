"""Which repairs mean that a log is damaged, so that `--strict` refuses it."""

from __future__ import annotations

from collections.abc import Sequence

from elid_cli.errors import LogError

NAMED = 8
"""Faults that a refusal names; one kind in all signals of all joints would fill the screen."""


class Damage(str):
    """A repair of a fault: samples that are missing, wrong, twice or out of order.

    Others only bring sound signals of other rates, or with stamps that jitter, onto one time base.
    """

    __slots__ = ()


def refuse(name: str, faults: Sequence[str]) -> None:
    """Refuse a log with some faults, naming them (LogError)."""
    if not faults:
        return
    more = f"; and {len(faults) - NAMED} more" if len(faults) > NAMED else ""
    others = f" (further faults: {'; '.join(faults[1:NAMED])}{more})" if len(faults) > 1 else ""
    raise LogError(
        f"{name}: {faults[0]}",
        detail=f"refused because --strict was asked for{others}",
        hint="without --strict elid uses what is whole",
    )
