"""Types that stand in many signatures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers in double precision; the docstring beside it says the shape and the unit."""
Progress = Callable[[str, float], None]
"""Told what is being done, and which share of it is done (0 to 1)."""
