"""Short runs of missing samples inside a stretch: bridged by interpolation, and counted."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli.logs.repair.grid import Grid
from elid_cli.logs.repair.interpolate import interpolate
from elid_cli.logs.repair.timeline import fill_limit
from elid_cli.mapped import writable

Array = NDArray[np.float64]


def fill(
    signals: dict[str, Array], grid: Grid, joints: Sequence[str], repairs: list[str], sound: Collection[int] = ()
) -> None:
    """Bridge short runs of missing samples inside a stretch; `sound` are the identities of arrays without any."""
    limit = fill_limit(grid.dt)
    bridged: dict[str, int] = {}
    for signal, values in list(signals.items()):
        if id(values) in sound or np.isfinite(values.sum()):
            continue
        values = signals[signal] = writable(values)
        if signal == "temperature":
            _hold(values)
            continue
        for j in range(len(joints)):
            count = sum(_bridge(values[start:stop, j], limit) for start, stop in grid.bounds())
            if count:
                bridged[f"{signal}.{joints[j]}"] = count
    if bridged:
        most = max(bridged, key=lambda key: bridged[key])
        signal_names = " ".join(dict.fromkeys(key.split(".")[0] for key in bridged))
        repairs.append(
            f"missing samples in runs of at most {limit} bridged by interpolation: "
            f"{bridged[most]} of {most}" + (f" (also in {signal_names})" if len(bridged) > 1 else "")
        )


def _bridge(column: Array, limit: int) -> int:
    """Interpolate NaN runs of at most `limit` samples that have neighbours on both sides; return how many samples."""
    missing = np.isnan(column)
    if not missing.any() or missing.all():
        return 0
    edges = np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    short = (stops - starts <= limit) & (starts > 0) & (stops < column.size)
    if not short.any():
        return 0
    index = np.arange(column.size, dtype=float)
    wanted = np.concatenate([np.arange(a, b) for a, b in zip(starts[short], stops[short], strict=True)])
    held = ~missing
    column[wanted] = interpolate(index[held], column[held][:, None], index[wanted], order=4)[:, 0]
    return int(wanted.size)


def _hold(values: Array) -> None:
    """Interpolate a slow signal linearly everywhere, held at its ends."""
    index = np.arange(values.shape[0])
    for j in range(values.shape[1]):
        held = np.isfinite(values[:, j])
        if held.any():
            values[:, j] = np.interp(index, index[held], values[held, j])
