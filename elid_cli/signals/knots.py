"""Smooth motion from measured positions: how far apart the knots of its splines are.

Every channel is fitted by quintic splines whose knot spacing the data choose (corrected Akaike criterion), per
joint, so that motor and link channels of a joint are treated alike and their difference, the deflection, is not
distorted. Measured velocities join the fit where they agree with the positions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.memory import let_go
from elid_cli.robot.robot import Robot
from elid_cli.signals.excerpts import PART, WIDEST, WIDEST_KNOTS, excerpts
from elid_cli.signals.measured_rates import Rate, rate_of, white_noise
from elid_cli.signals.motion import Motion, SplineMotion, SplineSegment
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.spline_fit import fit_spline

KNOTS = (0.008, WIDEST_KNOTS)
"""Range of knot spacings tried, s."""
_PER_DECADE = 8


@dataclass(frozen=True)
class Smooth:
    """Smooth motion, with what was learnt on the way."""

    motion: Motion
    noise: tuple[Array, Array]
    knots: Array
    rates: tuple[tuple[int, Array], ...] = ()
    notes: tuple[str, ...] = ()


def channels_of(recording: Recording, robot: Robot) -> tuple[Array, Array]:
    """Return link and motor positions, (N, n); a rigid joint has one position, its motor's where both exist."""
    link, motor = recording.q, recording.theta
    shared = [k for k, joint in enumerate(robot.joints) if not joint.elastic or not _any_known(link[:, k])]
    moved = [bool(np.isfinite(column).any()) for column in motor.T] if shared else []
    if len(shared) == robot.n and all(moved):
        return motor, motor
    if shared:
        link, motor = link.copy(), motor.copy()
    for k in shared:
        link[:, k] = motor[:, k] = (motor if moved[k] else link)[:, k]
    return link, motor


def _any_known(column: Array) -> bool:
    """Whether a channel holds a number; most hold one at once, and a long log need not be passed over for it."""
    return bool(np.isfinite(column[:1]).any() or np.isfinite(column).any())


def _spacings(dt: float, options: SignalOptions, finest: float) -> list[int]:
    if options.knots is not None:
        return [max(1, round(options.knots / dt))]
    wanted = np.geomspace(finest, KNOTS[1], round(_PER_DECADE * np.log10(KNOTS[1] / finest))) / dt
    return sorted({max(2, round(float(w))) for w in wanted})


def splined(
    recording: Recording,
    link: Array,
    motor: Array,
    segments: tuple[Segment, ...],
    options: SignalOptions,
    accelerations: tuple[Array, Array] | None,
) -> Smooth:
    """Return links' and motors' positions (N, n) as splines, measured velocities and accelerations among them."""
    n, dt = link.shape[1], recording.dt
    strides = _choose((link, motor), segments, dt, n, options, ())
    rates, notes = _rates(recording, accelerations, (link, motor), segments, strides, options)
    if rates:
        strides = _choose((link, motor), segments, dt, n, options, rates)
    alike = _alike((link, motor)) and not rates
    squares, counts = np.zeros((2, n)), np.zeros((2, n))
    pieces: list[SplineSegment] = []
    for segment in segments:
        part = slice(segment.start, segment.stop)
        for number, (side, values) in enumerate((("link", link), ("motor", motor))[: 1 if alike else 2]):
            for stride in sorted(set(strides.tolist())):
                joints = np.flatnonzero(strides == stride)
                further = [
                    (r.derivative, r.values[number * n + joints, part], r.ratio[number * n + joints]) for r in rates
                ]
                fit = fit_spline(values[part].T, stride, dt, further, joints)
                let_go(values)
                for name, row in ((side, number),) if not alike else (("link", 0), ("motor", 1)):
                    pieces.append(SplineSegment(segment, "link" if name == "link" else "motor", joints, fit.spline))
                    squares[row, joints] += fit.rms**2 * len(segment)
                    counts[row, joints] += len(segment)
    noise = np.sqrt(squares / counts)
    used = tuple((r.derivative, r.ratio) for r in rates)
    return Smooth(
        SplineMotion(recording.t, n, pieces), (noise[0], noise[1]), np.asarray(strides * dt, dtype=float), used, notes
    )


def _choose(
    channels: tuple[Array, Array],
    segments: tuple[Segment, ...],
    dt: float,
    n: int,
    options: SignalOptions,
    rates: Sequence[Rate],
) -> NDArray[np.intp]:
    """Return the knot stride per joint: the finer of what its link and its motor channel prefer.

    Of a long log, stretches spread over it decide.
    """
    candidates = _spacings(dt, options, finest=2 * dt if rates else KNOTS[0])
    if len(candidates) == 1:
        return np.full(n, candidates[0], dtype=np.intp)
    sides = 1 if _alike(channels) and not rates else 2
    groups = [
        (length, np.concatenate([channel[span].T for span in spans for channel in channels[:sides]]), spans)
        for length, spans in _of_equal_length(excerpts(segments, dt), together=not rates)
    ]
    noise = [np.array([white_noise(channel) for channel in part]) if rates else np.zeros(0) for _, part, _ in groups]

    def score(stride: int, asked: NDArray[np.bool_]) -> Array:
        """Return Akaike's criterion of the channels `asked` for, (sides * n,); the others' is 0."""
        total = np.zeros(sides * n)
        for (length, part, spans), scatter in zip(groups, noise, strict=True):
            if length <= (WIDEST - 1) * stride:
                total[:] = np.inf
            elif rates:
                total += _fused_score(part, [(r, r.values[:, spans[0]]) for r in rates], scatter, stride, dt)
            else:
                chosen = part if asked.all() else part[np.tile(asked, len(spans))]
                total[asked] += fit_spline(chosen, stride, dt).aicc.reshape(len(spans), -1).sum(axis=0)
        return total

    best = _least(score, candidates, sides * n)
    finest = np.minimum(best[:n], best[-n:])
    return np.array([candidates[k] for k in finest], dtype=np.intp)


def _least(score: Callable[[int, NDArray[np.bool_]], Array], candidates: Sequence[int], count: int) -> NDArray[np.intp]:
    """Return the place of each channel's best candidate, (count,): of every second one, then of the best's neighbours.

    The criterion falls while a spline sheds what noise alone decides, and rises once it sheds the motion.
    """
    scores = np.full((len(candidates), count), np.inf)
    everyone = np.ones(count, dtype=bool)
    for row in range(0, len(candidates), 2):
        scores[row] = score(candidates[row], everyone)
    first = np.argmin(scores, axis=0)
    for row in range(1, len(candidates), 2):
        asked = np.abs(first - row) == 1
        if asked.any():
            scores[row, asked] = score(candidates[row], asked)[asked]
    return np.asarray(np.argmin(scores, axis=0))


def _of_equal_length(segments: Sequence[Segment], *, together: bool) -> Iterator[tuple[int, list[slice]]]:
    """Yield lengths and the stretches of each, which one call may fit `together`, or one stretch at a time."""
    groups: dict[int, list[slice]] = {}
    for number, segment in enumerate(segments):
        groups.setdefault(len(segment) if together else -number, []).append(slice(segment.start, segment.stop))
    for spans in groups.values():
        yield spans[0].stop - spans[0].start, spans


def _alike(channels: tuple[Array, Array]) -> bool:
    """Whether links and motors are the same signals, as of a robot with rigid transmissions."""
    link, motor = channels
    return link is motor or (
        bool(np.array_equal(link[:PART], motor[:PART], equal_nan=True))
        and bool(np.array_equal(link, motor, equal_nan=True))
    )


def _fused_score(part: Array, rates: Sequence[tuple[Rate, Array]], noise: Array, stride: int, dt: float) -> Array:
    """Return Akaike's criterion of splines seen through positions and rates of known noise, (channels,)."""
    fit = fit_spline(part, stride, dt, [(r.derivative, values, r.ratio) for r, values in rates])
    squares = fit.squares.copy()
    for rate, values in rates:
        squares += rate.ratio**2 * np.nansum((values - fit.spline.evaluate(rate.derivative)) ** 2, axis=1)
    return np.asarray(squares / np.maximum(noise, 1e-300) ** 2 + 2.0 * fit.freedom)


def _rates(
    recording: Recording,
    accelerations: tuple[Array, Array] | None,
    channels: tuple[Array, Array],
    segments: tuple[Segment, ...],
    strides: NDArray[np.intp],
    options: SignalOptions,
) -> tuple[list[Rate], tuple[str, ...]]:
    """Return measured derivatives that agree with the positions, and a sentence for each that does not."""
    if not options.measured_velocity:
        return [], ()
    measured = [(1, recording.dq, recording.dtheta), (2, *(accelerations or (None, None)))]
    if all(values is None for _, *sides in measured for values in sides):
        return [], ()
    both = np.concatenate(channels, axis=1).T
    absent = np.full((both.shape[1], len(strides)), np.nan)
    rates, notes = [], []
    for derivative, link, motor in measured:
        if link is None and motor is None:
            continue
        values = np.concatenate([absent if v is None else v for v in (link, motor)], axis=1).T
        prefix = "d" * derivative
        names = [f"{prefix}{side} of {joint}" for side in ("q", "theta") for joint in recording.joints]
        rate, said = rate_of(derivative, values, both, names, segments, np.tile(strides, 2), recording.dt)
        notes += said
        if (rate.ratio > 0).any():
            rates.append(rate)
    return rates, tuple(notes)


def filtered(
    t: Array, link: Array, motor: Array, segments: tuple[Segment, ...], dt: float, options: SignalOptions
) -> Smooth:
    """Return links' and motors' positions (N, n) after a zero-phase Butterworth filter, with central differences."""
    from scipy.signal import butter, sosfiltfilt

    sections = butter(options.order, min(options.butterworth, 0.45 / dt), fs=1.0 / dt, output="sos")
    samples, n = link.shape
    out = np.full((2, 3, samples, n), np.nan)
    noise = np.full((2, n), np.nan)
    for side, channel in enumerate((link, motor)):
        for segment in segments:
            part = slice(segment.start, segment.stop)
            raw = channel[part]
            smooth = sosfiltfilt(sections, np.where(np.isfinite(raw), raw, 0.0), axis=0)
            out[side, 0, part] = smooth
            out[side, 1, part] = np.gradient(smooth, dt, axis=0)
            out[side, 2, part] = np.gradient(out[side, 1, part], dt, axis=0)
            noise[side] = np.sqrt(np.nanmean((raw - smooth) ** 2, axis=0))
    motion = Motion(t, out[0, 0], out[0, 1], out[0, 2], out[1, 0], out[1, 1], out[1, 2])
    return Smooth(motion, (noise[0], noise[1]), np.full(n, np.nan))
