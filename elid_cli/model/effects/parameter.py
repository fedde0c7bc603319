"""A parameter of an effect: its name, unit and bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect as files and reports name it."""

    name: str
    unit: str
    meaning: str
    low: float = -np.inf
    high: float = np.inf
    fixed: bool = False
    of_joint: bool = False
    """Of a shape: chosen from the grid and never refined (an exponent …); the number of another joint."""
    default: float | None = None
    """Value where a file gives none; None: it must give one."""

    def unit_at(self, *, slides: bool) -> str:
        """Return the unit at a joint that slides or turns, empty for a number; a phase is an angle at both."""
        unit = self.unit.removeprefix("1")
        if slides and self.name != "phase":
            unit = unit.replace("N·m·s/rad", "N·s/m").replace("N·m", "N").replace("rad", "m")
        return unit
