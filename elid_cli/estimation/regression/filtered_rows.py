"""Filtered, decimated rows of a log, block by block: the regressor at the log's rate is never held.

What the torque is explained by is a smooth function of smooth motion, and need not be computed at every sample: splines
with a knot every 100 samples change nothing between one sample and the next that the filter would let through. So the
model's columns are computed at every few samples only, as many to each knot as keep the filtered columns the same to
about 1e-9 (`thinning`), and filtered by what the parallel filter makes of rows so thinned (`LowPass.thinned`). What is
not smooth, the torque and the direction of motion, passes the filter at the log's own rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.memory import let_go
from elid_cli.model.regressor import SENSOR_KINDS, Regressor, RegressorPlan, direction_inputs, inputs_of
from elid_cli.signals.lowpass import REACH
from elid_cli.signals.motion import Motion, SplineMotion
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import Signals

CHUNK = 8160
"""Instants whose columns are held at a time before the filter, a block of the traced program."""
PER_KNOT = 12
"""Least number of instants per knot interval at which columns are computed."""


@dataclass(frozen=True)
class FilteredBlock:
    """Filtered rows of instants `first` to `last` of a log, all of one segment (`segment`)."""

    first: int
    last: int
    segment: int
    rows: Array
    """Outputs of the plan's program, each once, (distinct outputs, last - first)."""
    place: NDArray[np.intp]
    """Which of `rows` each output is, (outputs,)."""
    tau: Array
    tau_rate: Array
    reversal: Array
    """Share of each instant's filter window in which a motor reverses or sticks, (n, last - first)."""
    channels: Array
    """Filtered deflections (theta - q), their rates, link velocities and accelerations, (4 n, last - first)."""
    tau_link: Array
    """Filtered readings of the joint torque sensors, (n, last - first); (0, last - first) where the plan has none."""

    @property
    def columns(self) -> Array:
        """All outputs of the plan's program, (outputs, last - first)."""
        return np.asarray(self.rows[self.place])


def thinning(signals: Signals) -> int:
    """Return at every how many samples columns are computed before the filter decimates them: a divisor of its step."""
    moving = signals.knots[~signals.still]
    if not isinstance(signals.motion, SplineMotion) or not len(moving) or len(signals.filter.taps) == 1:
        return 1
    # where a log begins and ends, the interpolation needs samples beyond the filter's
    most = min(float(np.min(moving)) / signals.dt / PER_KNOT, signals.margin / (REACH + 1))
    step = signals.filter.step
    return max(every for every in range(1, step + 1) if step % every == 0 and every <= max(most, 1.0))


def observed_blocks(model: Regressor, signals: Signals, plan: RegressorPlan) -> Iterator[FilteredBlock]:
    """Compute, filter and decimate the rows of a log block by block, in the order of its instants."""
    every = thinning(signals)
    program, place = plan.program.distinct  # what stands in several rows is filtered once
    signs = program.copied(direction_inputs(model.robot.n))
    if signs is None:  # directions of motion are more than columns of their own
        every = 1
    done, width, filter_ = 0, program.outputs, signals.filter
    smooth = filter_.thinned(every) if every > 1 else filter_
    window = filter_.window
    slope = filter_.differentiated(signals.dt)
    readings = signals.tau_link if any(item.row.kind in SENSOR_KINDS for item in plan.rows) else None
    nothing = np.zeros((0, len(signals.tau)))
    each = _outputs_per_chunk(signals, every)
    # memory that is touched for the first time is slower than the arithmetic: one array serves all blocks
    room = np.empty((width + 4 * model.robot.n, (each - 1) * smooth.step + 2 * smooth.half + 1))
    inputs = np.empty((program.inputs, room.shape[1]))
    for number, segment in enumerate(signals.segments):
        count = len(filter_.outputs(len(segment), signals.margin))
        for first in range(0, count, each):
            last = min(first + each, count)
            centres = [segment.start + filter_.half + signals.margin + k * filter_.step for k in (first, last - 1)]
            part = slice(centres[0] - filter_.half, centres[1] + filter_.half + 1)
            reach = smooth.half * every
            motion = signals.motion[centres[0] - reach : centres[1] + reach + 1 : every]
            rows = room[:, : motion.samples]
            program.run(inputs_of(motion, program, inputs[:, : motion.samples]), rows[:width])
            _channels(motion, rows[width:])
            filtered = smooth.apply(rows)
            speeds = signals.motion.speeds(part) if every > 1 else motion.dtheta.T
            if every > 1 and signs:
                directions = filter_.apply(np.sign(speeds))
                for output, joint in signs:
                    filtered[output] = directions[joint]
            torque = _wider(signals.tau, segment, part)
            yield FilteredBlock(
                done + first,
                done + last,
                number,
                filtered[:width],
                place,
                filter_.apply(torque, 1),
                slope.apply(
                    torque if signals.command_torque is None else _wider(signals.command_torque, segment, part)
                ),
                window.apply((np.abs(speeds) < signals.min_velocity[:, None]).astype(float)),
                filtered[width:],
                filter_.apply(nothing[:, part] if readings is None else np.ascontiguousarray(readings[part].T)),
            )
            let_go(signals.tau)
        done += count


def _channels(motion: Motion, out: Array) -> None:
    """Write deflections, their rates, link velocities and accelerations, (4 n, samples)."""
    n = motion.q.shape[1]
    np.subtract(motion.theta.T, motion.q.T, out=out[:n])
    np.subtract(motion.dtheta.T, motion.dq.T, out=out[n : 2 * n])
    out[2 * n : 3 * n] = motion.dq.T
    out[3 * n :] = motion.ddq.T


def _wider(values: Array, segment: Segment, part: slice) -> Array:
    """Return a part of a segment with one sample more at either end, (n, samples + 2).

    Where the segment ends they are on the straight line, so that central differences become one-sided there.
    """
    out = np.empty((values.shape[1], part.stop - part.start + 2))
    begin, end = max(part.start - 1, segment.start), min(part.stop + 1, segment.stop)
    out[:, begin - part.start + 1 : end - part.start + 1] = values[begin:end].T
    if begin == part.start:
        out[:, 0] = 2.0 * out[:, 1] - out[:, 2]
    if end == part.stop:
        out[:, -1] = 2.0 * out[:, -2] - out[:, -3]
    return out


def _outputs_per_chunk(signals: Signals, every: int) -> int:
    """Return how many outputs a chunk has: at least so many that the filter's overlap stays a small part of it."""
    window = 2 * signals.filter.half // every + 1
    most = max(1, (max(CHUNK, 8 * window) - window) * every // signals.filter.step + 1)
    return max(1, min(most, max((len(s) for s in signals.segments), default=0) // signals.filter.step + 1))
