"""Stretches of a long log that say what it is like, and the parts in which a log is passed over."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elid_cli.signals.recording import Segment

WIDEST_KNOTS = 0.4
"""Widest knot spacing of splines that is tried, s."""
WIDEST = 13
"""Length that a stretch needs to be judged by, in the widest knot spacings."""
EXCERPTS, JUDGED = 8, 48_000
"""Number of stretches of a long log, and their samples together, by which knots and noise are chosen."""
PART = 65536
"""Samples taken at a time where all are passed over."""


def excerpts(
    segments: Sequence[Segment], dt: float, samples: int = JUDGED, shortest: float = WIDEST * WIDEST_KNOTS
) -> tuple[Segment, ...]:
    """Return stretches spread over a long log that say what it is like; of a log that is not long, all of it.

    Parameters
    ----------
    segments
        Gap-free parts of the log.
    dt
        Time from sample to sample, s.
    samples
        Samples that the stretches hold together, about; a log up to twice as long is taken whole.
    shortest
        Length of a stretch, s, at least.
    """
    total = sum(len(s) for s in segments)
    each = max(samples // EXCERPTS, round(shortest / dt))
    if total <= 2 * each * EXCERPTS:
        return tuple(segments)
    found: list[Segment] = []
    begin = 0
    for segment in segments:
        wanted = (np.arange(EXCERPTS) + 0.5) / EXCERPTS * total - begin
        for centre in wanted[(wanted >= 0) & (wanted < len(segment))]:
            start = segment.start + int(np.clip(centre - each // 2, 0, max(len(segment) - each, 0)))
            found.append(Segment(start, min(start + each, segment.stop), segment.source))
        begin += len(segment)
    return tuple(found)


def in_parts(segments: Sequence[Segment]) -> Iterator[slice]:
    """Yield slices of `PART` samples at most that cover the segments."""
    for segment in segments:
        for start in range(segment.start, segment.stop, PART):
            yield slice(start, min(start + PART, segment.stop))
