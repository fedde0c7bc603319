"""Arrays that grow in place while a log of unknown length is read."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Growing:
    """Rows appended to one array; growing re-uses the memory (realloc), so that nothing is ever held twice.

    With a sound `hint` of the final number of rows nothing is moved at all; memory is taken when it is written to.
    """

    def __init__(self, width: int | None, dtype: Any = np.float64, hint: int = 0) -> None:
        self._shape: tuple[int, ...] = () if width is None else (width,)
        self._array: NDArray[Any] = np.empty((hint, *self._shape), dtype)
        self.rows = 0

    def extend(self, count: int) -> NDArray[Any]:
        """Return a view of `count` new rows to be filled."""
        needed = self.rows + count
        if needed > self._array.shape[0]:
            rows = max(needed, 4096, int(self._array.shape[0] * 1.5))
            self._array.resize((rows, *self._shape), refcheck=False)
        start, self.rows = self.rows, needed
        return self._array[start:needed]

    def finish(self) -> NDArray[Any]:
        """Return all rows."""
        if self.rows < self._array.shape[0]:
            self._array.resize((self.rows, *self._shape), refcheck=False)
        return self._array
