"""From a recording to what the regressor needs: smooth motion of every joint and a plan of filter and decimation.

Every channel is fitted by quintic splines whose knot spacing the data choose (corrected Akaike criterion), per
joint, so that motor and link channels of a joint are treated alike and their difference, the deflection, is not
distorted. Measured velocities join the fit where they agree with the positions. The torque is not smoothed: it is
filtered in parallel with the model's columns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import DataError, LogError
from elid_cli.fusion import Rate, rate_of, white_noise
from elid_cli.lowpass import LowPass, low_pass
from elid_cli.mapped import let_go
from elid_cli.motion import Motion
from elid_cli.recording import Recording, Segment
from elid_cli.robot import Robot
from elid_cli.smoothing import fit_spline
from elid_cli.spline_motion import STRETCH, Piece, SplineMotion
from elid_cli.torque_sensors import sensors_of

Array = NDArray[np.float64]

DEFAULT_CUTOFF = 10.0
"""Cut-off of the parallel filter, Hz, unless the data or the user choose another."""
EFFECT_CUTOFF = 20.0
"""The same where the robot file declares effects, whose shapes show in faster changes than inertia does."""
RATE_PER_CUTOFF = 5.0
"""Samples kept per second for every Hz of cut-off."""
KNOTS = (0.008, 0.4)
"""Range of knot spacings tried, s."""
_PER_DECADE = 8
HELD = 2e-3
"""rad; a joint that stays within this but for a jolt does not move …"""
JOLT = 0.1
"""… of at most this (rad), as when the brakes open."""
GLANCE = 5000
"""Samples of a stretch that tell it."""
STILL = 3.0
"""A joint whose range of motion is below this many standard deviations of its noise does not move."""
SLOW, SLOW_KEPT = (0.05, 0.05), (0.01, 0.005)
"""Largest speed that counts as reversing, rad/s (m/s), and its largest part of the top speed."""
MINIMUM_SAMPLES = 40
INSTANTS = 14
"""Independent instants, two per period of the cut-off, that a log needs: as many as a joint has parameters."""
_WIDEST = 13
"""Length that a stretch needs to be judged by, in the widest knot spacings."""
EXCERPTS, JUDGED = 8, 48_000
"""Number of stretches of a long log, and their samples together, by which knots and noise are chosen."""


@dataclass(frozen=True)
class SignalOptions:
    """How to make signals from a recording; None: chosen from the data."""

    cutoff: float | None = None
    """Cut-off of the parallel low-pass filter, Hz."""
    rate: float | None = None
    """Rate after decimation, Hz."""
    min_velocity: float | None = None
    """Speed below which a motor counts as reversing or stuck, rad/s (m/s)."""
    slow_motion: bool = False
    """Keep slow motion, in which friction shows most: what a diagnosis needs more than an estimate."""
    knots: float | None = None
    """Knot spacing of the splines, s."""
    measured_velocity: bool = True
    """Use measured velocities where they agree with the positions."""
    smoothing: Literal["spline", "butterworth"] = "spline"
    """`butterworth` is the classical way: zero-phase Butterworth filter and central differences."""
    butterworth: float = 20.0
    """Cut-off of the Butterworth filter on positions, Hz."""
    order: int = 4
    """Order of the Butterworth filter."""


@dataclass(frozen=True)
class Noise:
    """Estimated standard deviation of the noise of each channel, (n,); NaN where the channel is absent."""

    q: Array
    theta: Array
    tau: Array
    tau_link: Array = field(default_factory=lambda: np.zeros(0))
    """Empty where the log has no joint torque sensor that is used."""


@dataclass(frozen=True)
class Signals:
    """Smooth motion at the log's rate, raw torque, and the plan of filtering and decimation.

    All arrays are (N, n), joint side, SI.
    """

    joints: tuple[str, ...]
    dt: float
    motion: Motion
    tau: Array
    tau_link: Array | None
    temperature: Array | None
    segments: tuple[Segment, ...]
    noise: Noise
    knots: Array
    """Knot spacing chosen per joint, s, (n,)."""
    filter: LowPass
    margin: int
    """Samples dropped at each end of a segment beyond the filter's half-length."""
    min_velocity: Array
    """Speed below which a motor counts as reversing, (n,)."""
    still: NDArray[np.bool_]
    """Joints that do not move in this log, (n,)."""
    velocity_used: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    rates: tuple[tuple[int, Array], ...] = ()
    """Measured derivatives that joined the splines: which, and the standard deviation of the position's noise over that
    of its noise, links then motors (2n,); 0: not used."""
    notes: tuple[str, ...] = ()
    sensed: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Joints whose torque sensor is used, (n,); empty: none."""
    doubts: tuple[str, ...] = ()
    """Why the torque sensors of other joints are not used, a sentence each."""
    recording: Recording | None = None
    """What the signals were made from: estimators that model the raw samples start there."""
    cutoff_free: bool = False
    """Whether the user left the cut-off of the filter to the data."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def unlinked(self) -> NDArray[np.bool_]:
        """Joints of which the log holds no link position, (n,): their transmission counts as rigid."""
        if self.recording is None:
            return np.zeros(self.n, dtype=bool)
        q = self.recording.q
        return np.array([bool(np.isnan(q[:1, k]).all() and np.isnan(q[:, k]).all()) for k in range(self.n)])

    @property
    def rate(self) -> float:
        """Rate after decimation, Hz."""
        return 1.0 / (self.dt * self.filter.step)

    @property
    def duration(self) -> float:
        """Recorded time, s."""
        return float(sum(len(s) for s in self.segments) * self.dt)

    @property
    def outputs(self) -> NDArray[np.intp]:
        """Sample index that each filtered, decimated output is centred on, (M,)."""
        parts = [s.start + self.filter.outputs(len(s), self.margin) for s in self.segments]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.intp)

    def decimate(self, rows: Array) -> Array:
        """Filter and decimate rows (…, N) to (…, M), segment by segment."""
        parts = [self.filter.apply(rows[..., s.start : s.stop], self.margin) for s in self.segments]
        return np.concatenate(parts, axis=-1)

    def refiltered(self, cutoff: float, rate: float | None = None) -> Signals:
        """Return the same signals with another parallel filter."""
        return replace(self, filter=_plan(cutoff, rate, self.dt))


def _plan(cutoff: float, rate: float | None, dt: float) -> LowPass:
    wanted = RATE_PER_CUTOFF * cutoff if rate is None else rate
    step = max(1, int(1.0 / (dt * wanted)))
    return low_pass(cutoff, dt, step)


def prepare(
    recording: Recording,
    robot: Robot,
    options: SignalOptions | None = None,
    accelerations: tuple[Array, Array] | None = None,
) -> Signals:
    """Smooth a recording's positions and plan its filtering.

    Parameters
    ----------
    recording, robot, options
        The log, the robot and how to treat it.
    accelerations
        Measured accelerations of links and motors, each (N, n), for logs made of simulations that have them.

    Raises
    ------
    LogError
        If no segment is long enough.
    DataError
        If no joint moves.
    """
    options = options or SignalOptions()
    dt = recording.dt
    usual = EFFECT_CUTOFF if robot.effects else DEFAULT_CUTOFF
    cutoff = min(usual, 0.4 / dt) if options.cutoff is None else options.cutoff
    filter_ = _plan(cutoff, options.rate, dt)
    minimum = max(MINIMUM_SAMPLES, 2 * filter_.half + 2 * filter_.step)
    segments = tuple(s for s in recording.segments if len(s) >= minimum)
    if not segments:
        longest = max((len(s) for s in recording.segments), default=0)
        raise LogError(
            f"{', '.join(recording.files) or 'log'}: {longest} samples in one stretch are too few",
            detail=f"a low-pass of {cutoff:g} Hz at {1 / dt:g} Hz needs at least {minimum}",
            hint="record longer, or raise --cutoff",
        )
    lasting, needed = sum(len(s) for s in segments) * dt, INSTANTS / (2 * min(cutoff, DEFAULT_CUTOFF))
    if lasting < needed:
        raise LogError(
            f"{', '.join(recording.files) or 'log'}: {lasting:.3g} s of motion are too few",
            detail=f"below {min(cutoff, DEFAULT_CUTOFF):g} Hz a joint's {INSTANTS} parameters need {needed:.3g} s",
            hint="record longer",
        )
    link, motor = _channels(recording, robot)
    if options.smoothing == "butterworth":
        smooth = _butterworth(recording.t, link, motor, segments, dt, options)
    else:
        smooth = _splined(recording, link, motor, segments, options, accelerations)
    low, high, mean = _ranges(smooth.motion, excerpts(segments, dt))
    still = _still(low, high, smooth.noise)
    if still.any():  # stretches of a long log are enough to see that a joint moves, not that it does not
        low, high, mean = _ranges(smooth.motion, segments)
        still = _still(low, high, smooth.noise)
    still |= _constant(link, segments) | _constant(motor, segments) | _held(link, motor, robot, segments)
    sensed, doubts = sensors_of(recording, excerpts(segments, dt))
    read = _torque_noise(recording.tau_link, segments, dt) if sensed.any() and recording.tau_link is not None else None
    motion = _at_rest(smooth.motion, still, mean)
    if still.all():
        ranges = zip(robot.joint_names, high[0] - low[0], strict=True)
        spans = ", ".join(f"{name}: {span:.2g}" for name, span in ranges)
        raise DataError(
            f"{', '.join(recording.files) or 'log'}: no joint moves",
            detail=f"range of motion in rad or m: {spans}",
            hint="dynamic parameters need motion; record an exciting trajectory (elid excite)",
        )
    knots = smooth.knots
    widest = float(np.nanmax(knots)) if np.isfinite(knots).any() else 0.0
    top = _top_speed(motion, segments, dt)
    most, share = SLOW_KEPT if options.slow_motion else SLOW
    # what static friction holds back in a joint that does not move is not known: none of its motor rows counts
    lowest = np.where(still, most, np.minimum(most, share * top))
    if options.min_velocity is not None:
        lowest = np.full(robot.n, options.min_velocity)
    return Signals(
        joints=robot.joint_names,
        dt=dt,
        motion=motion,
        tau=recording.tau,
        tau_link=recording.tau_link,
        temperature=recording.temperature,
        segments=segments,
        noise=Noise(
            smooth.noise[0],
            smooth.noise[1],
            _torque_noise(recording.tau, segments, dt),
            np.zeros(0) if read is None else read,
        ),
        knots=knots,
        filter=filter_,
        margin=round(2 * widest / dt),
        min_velocity=lowest,
        still=still,
        velocity_used=np.any([ratio > 0 for _, ratio in smooth.rates], axis=0)
        if smooth.rates
        else np.zeros(2 * robot.n, dtype=bool),
        rates=smooth.rates,
        notes=smooth.notes,
        sensed=sensed,
        doubts=doubts,
        recording=recording,
        cutoff_free=options.cutoff is None,
    )


@dataclass(frozen=True)
class _Smooth:
    """Smooth motion, with what was learnt on the way."""

    motion: Motion
    noise: tuple[Array, Array]
    knots: Array
    rates: tuple[tuple[int, Array], ...] = ()
    notes: tuple[str, ...] = ()


def _channels(recording: Recording, robot: Robot) -> tuple[Array, Array]:
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


def _splined(
    recording: Recording,
    link: Array,
    motor: Array,
    segments: tuple[Segment, ...],
    options: SignalOptions,
    accelerations: tuple[Array, Array] | None,
) -> _Smooth:
    n, dt = link.shape[1], recording.dt
    strides = _choose((link, motor), segments, dt, n, options, ())
    rates, notes = _rates(recording, accelerations, (link, motor), segments, strides, options)
    if rates:
        strides = _choose((link, motor), segments, dt, n, options, rates)
    alike = _alike((link, motor)) and not rates
    squares, counts = np.zeros((2, n)), np.zeros((2, n))
    pieces: list[Piece] = []
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
                    pieces.append(Piece(segment, "link" if name == "link" else "motor", joints, fit.spline))
                    squares[row, joints] += fit.rms**2 * len(segment)
                    counts[row, joints] += len(segment)
    noise = np.sqrt(squares / counts)
    used = tuple((r.derivative, r.ratio) for r in rates)
    return _Smooth(
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
    scores = np.zeros((len(candidates), sides * n))
    for length, spans in _of_equal_length(excerpts(segments, dt), together=not rates):
        part = np.concatenate([channel[span].T for span in spans for channel in channels[:sides]])
        noise = np.array([white_noise(channel) for channel in part]) if rates else np.zeros(0)
        for row, stride in enumerate(candidates):
            if length <= (_WIDEST - 1) * stride:
                scores[row] = np.inf
            elif rates:
                scores[row] += _fused_score(part, [(r, r.values[:, spans[0]]) for r in rates], noise, stride, dt)
            else:
                scores[row] += fit_spline(part, stride, dt).aicc.reshape(len(spans), -1).sum(axis=0)
    best = np.argmin(scores, axis=0)
    finest = np.minimum(best[:n], best[-n:])
    return np.array([candidates[k] for k in finest], dtype=np.intp)


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
        bool(np.array_equal(link[:STRETCH], motor[:STRETCH], equal_nan=True))
        and bool(np.array_equal(link, motor, equal_nan=True))
    )


def excerpts(
    segments: Sequence[Segment], dt: float, samples: int = JUDGED, shortest: float = _WIDEST * KNOTS[1]
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


def _fused_score(part: Array, rates: Sequence[tuple[Rate, Array]], noise: Array, stride: int, dt: float) -> Array:
    """Return Akaike's criterion of splines seen through positions and rates of known noise, (channels,)."""
    fit = fit_spline(part, stride, dt, [(r.derivative, values, r.ratio) for r, values in rates])
    squares = fit.squares.copy()
    for rate, values in rates:
        squares += rate.ratio**2 * np.nansum((values - fit.spline.evaluate(rate.derivative)) ** 2, axis=1)
    score: Array = squares / np.maximum(noise, 1e-300) ** 2 + 2.0 * fit.freedom
    return score


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


def _butterworth(
    t: Array, link: Array, motor: Array, segments: tuple[Segment, ...], dt: float, options: SignalOptions
) -> _Smooth:
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
    return _Smooth(motion, (noise[0], noise[1]), np.full(n, np.nan))


def _stretches(segments: Sequence[Segment]) -> Iterator[slice]:
    for segment in segments:
        for start in range(segment.start, segment.stop, STRETCH):
            yield slice(start, min(start + STRETCH, segment.stop))


def _ranges(motion: Motion, segments: Sequence[Segment]) -> tuple[Array, Array, Array]:
    """Return smallest, largest and mean position of links and motors, (2, n) each; NaN where there is none."""
    n = motion[0:0].q.shape[1]
    low, high, total, count = np.full((2, n), np.nan), np.full((2, n), np.nan), np.zeros((2, n)), np.zeros((2, n))
    for part in _stretches(segments):
        here = motion.positions(part)
        for side, values in enumerate(here):
            low[side] = np.fmin(low[side], np.fmin.reduce(values, axis=1))
            high[side] = np.fmax(high[side], np.fmax.reduce(values, axis=1))
            known = np.isfinite(values)
            count[side] += np.count_nonzero(known, axis=1)
            total[side] += np.sum(values, axis=1, where=known)
    return low, high, np.where(count > 0, total / np.maximum(count, 1), 0.0)


def _still(low: Array, high: Array, noise: tuple[Array, Array]) -> NDArray[np.bool_]:
    span = np.nan_to_num(high - low)
    scale = np.nan_to_num(np.fmax(np.abs(low), np.abs(high)))
    least = np.fmax(np.fmax(STILL * np.stack(noise), 1e-9 * scale), 1e-12)
    still: NDArray[np.bool_] = np.any(span <= least, axis=0)
    return still


def _constant(raw: Array, segments: Sequence[Segment]) -> NDArray[np.bool_]:
    """Return which channels hold one value only, (n,): splines of a constant vibrate at their ends by rounding."""
    constant = np.ones(raw.shape[1], dtype=bool)
    first = np.full(raw.shape[1], np.nan)
    for part in _stretches(segments):
        values = raw[part]
        finite = np.isfinite(values)
        unset = np.isnan(first) & finite.any(axis=0)
        first[unset] = values[finite.argmax(axis=0), np.arange(values.shape[1])][unset]
        constant &= np.all((values == first) | ~finite, axis=0)
        if not constant.any():
            break
    constant &= np.isfinite(first)
    return constant


def _held(link: Array, motor: Array, robot: Robot, segments: Sequence[Segment]) -> NDArray[np.bool_]:
    """Return which revolute joints are held in place, (n,): they tremble in their friction, which no model here has."""
    rows = np.concatenate([np.arange(s.start, s.stop, max(1, len(s) // GLANCE)) for s in segments])
    held = np.array([joint.revolute for joint in robot.joints])
    for side in (link, motor):
        values = side[rows]
        let_go(side)
        known = np.isfinite(values).any(axis=0)
        filled = np.where(np.isfinite(values), values, np.where(known, np.nan, 0.0))
        low, inner, outer, high = np.nanpercentile(filled, [0, 2, 98, 100], axis=0)
        held &= (outer - inner < HELD) & (high - low < JOLT)
    return held


def _at_rest(motion: Motion, still: NDArray[np.bool_], mean: Array) -> Motion:
    """Return the motion; a joint that does not move rests exactly at its mean, so that its columns are exact."""
    if not still.any():
        return motion
    rest = np.where(still, mean, np.nan)
    if isinstance(motion, SplineMotion):
        return motion.resting(rest)
    arrays = [a.copy() for a in (motion.q, motion.dq, motion.ddq, motion.theta, motion.dtheta, motion.ddtheta)]
    for k in np.flatnonzero(still):
        for number, array in enumerate(arrays):
            array[:, k] = 0.0 if number % 3 else rest[number // 3, k]
    return Motion(motion.t, *arrays)


def _top_speed(motion: Motion, segments: Sequence[Segment], dt: float) -> Array:
    """Return the speed that each motor exceeds in a twentieth of the time, (n,); of a long log, in stretches of it."""
    speeds = np.concatenate([np.abs(motion[part].dtheta) for part in _stretches(excerpts(segments, dt))])
    top: Array = np.quantile(speeds, 0.95, axis=0)
    return top


def _torque_noise(tau: Array, segments: tuple[Segment, ...], dt: float) -> Array:
    """Return the standard deviation of white torque noise from sixth differences, (n,) (sum of squares 924).

    The median tells it from jumps, which friction and controllers make and which are no noise; of a torque in coarse
    steps the median may be 0, and the mean square is taken.
    """
    sixth = np.concatenate([np.diff(tau[s.start : s.stop], 6, axis=0) for s in excerpts(segments, dt)])
    result = np.full(tau.shape[1], np.nan)
    for k in range(tau.shape[1]):
        known = sixth[np.isfinite(sixth[:, k]), k]
        if not len(known):
            continue
        middle = 1.4826 * float(np.median(np.abs(known)))
        result[k] = (middle if middle > 0 else float(np.sqrt(np.mean(known**2)))) / np.sqrt(924.0)
    return result
