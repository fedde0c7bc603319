"""Parts of a stretch, taken together by their lengths, are the parts one after the other."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.estimation.trajectory.block_sums import of_parts, parts_of


@pytest.mark.parametrize(("count", "parts"), [(97, 8), (96, 8), (5, 5)])
@pytest.mark.parametrize("joints", [1, 2])
def test_parts_are_those_between_the_edges(count: int, parts: int, joints: int) -> None:
    values = np.arange(count * joints * 3.0).reshape(count, joints, 3)
    edges, seen = np.linspace(0, count, parts + 1).astype(int), list[int]()
    for numbers, rows in parts_of(edges):
        found = of_parts(values, rows)
        for number, part in zip(numbers.tolist(), found, strict=True):
            np.testing.assert_array_equal(part, values[edges[number] : edges[number + 1]].reshape(-1, 3))
            seen.append(number)
    assert sorted(seen) == list(range(parts))
