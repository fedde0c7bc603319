"""From a recording to what the regressor needs: smooth motion of every joint and a plan of filter and decimation.

The torque is not smoothed: it is filtered in parallel with the model's columns.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.checks import options_given
from elid_cli.errors import DataError, LogError, UsageError, check_kind
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import command_torque, error_integrals
from elid_cli.signals.excerpts import excerpts
from elid_cli.signals.fitting_robot import check_accelerations, check_fits, check_joints, check_robot
from elid_cli.signals.knots import channels_of, filtered, splined
from elid_cli.signals.lowpass import LowPass, low_pass
from elid_cli.signals.motion import Motion, joined_motion
from elid_cli.signals.moving_joints import at_rest, constant, extremes, held, stationary, top_speed
from elid_cli.signals.options import RATE_PER_CUTOFF
from elid_cli.signals.options import SignalOptions as SignalOptions
from elid_cli.signals.recording import Recording, Segment, with_commands
from elid_cli.signals.torque_sensors import sensors_of
from elid_cli.tables import Shown

DEFAULT_CUTOFF = 10.0
"""Cut-off of the parallel filter, Hz, unless the data or the user choose another."""
EFFECT_CUTOFF = 20.0
"""The same where the robot file declares effects, whose shapes show in faster changes than inertia does."""
SLOW, SLOW_KEPT = (0.05, 0.05), (0.01, 0.005)
"""Largest speed that counts as reversing, rad/s (m/s), and its largest part of the top speed."""
MINIMUM_SAMPLES = 40
FEWEST_PIECES = 4
"""Pieces that splines of a given spacing have at least."""
INSTANTS = 14
"""Independent instants, two per period of the cut-off, that a log needs: as many as a joint has parameters."""


@dataclass(frozen=True)
class Noise:
    """Estimated standard deviation of the noise of each channel, (n,); NaN where the channel is absent."""

    q: Array
    theta: Array
    tau: Array
    tau_link: Array = field(default_factory=lambda: np.zeros(0))
    """Empty where the log has no joint torque sensor that is used."""


@dataclass(frozen=True, repr=False)
class Signals(Shown):
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
    rounded: bool = False
    """Whether friction turns with the direction of motion over a width, as in simulators, and not at once."""
    sensed: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Joints whose torque sensor is used beside the motor's torque, (n,); empty: none."""
    link_torque: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Joints whose `tau` is what the torque sensor in the transmission reads, for want of the motor's, (n,)."""
    doubts: tuple[str, ...] = ()
    """Why the torque sensors of other joints are not used, a sentence each."""
    command_torque: Array | None = None
    """The part of the torques that a delay of the channel moves (`command_torque`), (N, n); None: all of them."""
    error_integrals: Array | None = None
    """Integrals of kp (q_des - q) and of kp q_des (`error_integrals`), N·m·s (N·s), (2, N, n); None: of no commands."""
    recording: Recording | None = None
    """What the signals were made from: estimators that model the raw samples start there."""
    slow_left_out: bool = False
    """Whether the user said below which speed samples are left out: then they are, even where a motor glides."""
    cutoff_free: bool = False
    """Whether the user left the cut-off of the filter to the data."""
    moved: Array = field(default_factory=lambda: np.zeros(0))
    """By how much each torque channel has been moved to where it acts, s, (n,); empty: none."""
    first: object = field(default=None, compare=False, repr=False)
    """The first fit of the simulated motion where one was made on the way (`first_fits.FirstFit`): it knows what it is
    of, and whoever begins with the same one need not make it again."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def delayed(self) -> Array:
        """What a delay of the torque channels moves, (N, n): torques, or what commands make of computed ones."""
        return self.tau if self.command_torque is None else self.command_torque

    @property
    def missing_link(self) -> NDArray[np.bool_]:
        """Joints of which the log holds no link position, (n,): their transmission counts as rigid."""
        return np.zeros(self.n, dtype=bool) if self.recording is None else self.recording.missing_link

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

    def alone(self) -> Signals:
        """Return the samples of the segments without those between them: of a long log, where these are excerpts."""
        if sum(map(len, self.segments)) == self.motion.samples:
            return self
        parts = [slice(segment.start, segment.stop) for segment in self.segments]
        ends = np.cumsum([len(segment) for segment in self.segments]).tolist()
        segments = tuple(Segment(end - len(s), end, s.source) for s, end in zip(self.segments, ends, strict=True))

        def joined(values: Array | None) -> Array | None:
            return None if values is None else np.concatenate([values[part] for part in parts])

        motion, integrals = joined_motion([self.motion[part] for part in parts]), self.error_integrals
        if integrals is not None:
            integrals = np.concatenate([integrals[:, part] for part in parts], axis=1)
        tau = np.concatenate([self.tau[part] for part in parts])
        return replace(
            self, motion=motion, tau=tau, tau_link=joined(self.tau_link), temperature=joined(self.temperature),
            command_torque=joined(self.command_torque), error_integrals=integrals, segments=segments,
        )  # fmt: skip

    def decimate(self, rows: Array) -> Array:
        """Filter and decimate rows (…, N) to (…, M), segment by segment."""
        parts = [self.filter.apply(rows[..., s.start : s.stop], self.margin) for s in self.segments]
        return np.concatenate(parts, axis=-1)

    def refiltered(self, cutoff: float, rate: float | None = None) -> Signals:
        """Return the same signals with another parallel filter."""
        return replace(self, filter=_plan(cutoff, rate, self.dt))


def _check_slow(name: str, value: float | None, lasting: float) -> None:
    """Refuse a frequency, Hz, of which a log of `lasting` s holds no period, before a filter of that length is made."""
    if value is not None and value * lasting < 1:
        raise UsageError(
            f"--{name} {value:g}: one period of it is longer than the log, {lasting:.3g} s",
            hint=f"more than {1 / lasting:.2g}, or leave it out",
        )


def _possible(cutoff: float, dt: float) -> float:
    """Return a cut-off, Hz, that a log of sample time `dt`, s, can be filtered at (UsageError: it cannot)."""
    highest = 0.5 / dt
    if np.isfinite(cutoff) and cutoff >= highest:
        raise UsageError(
            f"--cutoff {cutoff:g}: the log's {1 / dt:.6g} Hz hold nothing above {highest:.6g} Hz",
            detail="such a low-pass takes nothing away",
            hint=f"less than {highest:.6g}, or leave it out",
        )
    return cutoff


def _plan(cutoff: float, rate: float | None, dt: float) -> LowPass:
    wanted = RATE_PER_CUTOFF * cutoff if rate is None else rate
    step = max(1, int(1.0 / (dt * wanted)))
    return low_pass(cutoff, dt, step)


def check_signals(signals: object, robot: Robot) -> None:
    """Refuse what are no signals (UsageError), or those of other joints than the robot's (LogError)."""
    check_robot(robot)
    check_kind("signals", signals, Signals, "prepare(recording, robot) makes signals of a recording")
    assert isinstance(signals, Signals)
    check_joints(signals.joints, robot)


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
    UsageError
        Smooth commands of a log that holds torques, a cut-off that it has no frequencies above, or an argument of
        another kind.
    """
    options = options_given("prepare", options, SignalOptions)
    check_fits(recording, robot)
    check_accelerations(accelerations, recording)
    recording = with_commands(recording, options.commands, commanded=bool(recording.commanded.all()))
    dt = recording.dt
    _check_slow("cutoff", options.cutoff, dt * recording.samples)
    _check_slow("rate", options.rate, dt * recording.samples)
    usual = EFFECT_CUTOFF if robot.effects else DEFAULT_CUTOFF
    cutoff = min(usual, 0.4 / dt) if options.cutoff is None else _possible(options.cutoff, dt)
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
    if options.knots is not None and options.knots > lasting / FEWEST_PIECES:
        raise UsageError(
            f"--knots {options.knots:g}: splines with knots that far apart are no motion in {lasting:.3g} s of log",
            hint=f"less than {lasting / FEWEST_PIECES:.3g}, such as 0.05, or leave it out",
        )
    link, motor = channels_of(recording, robot)
    if options.smoothing == "butterworth":
        smooth = filtered(recording.t, link, motor, segments, dt, options)
    else:
        smooth = splined(recording, link, motor, segments, options, accelerations)
    low, high, mean = extremes(smooth.motion, excerpts(segments, dt))
    still = stationary(low, high, smooth.noise)
    if still.any():  # stretches of a long log are enough to see that a joint moves, not that it does not
        low, high, mean = extremes(smooth.motion, segments)
        still = stationary(low, high, smooth.noise)
    still |= constant(link, segments) | constant(motor, segments) | held(link, motor, robot, segments)
    sensed, doubts = sensors_of(recording, excerpts(segments, dt))
    behind = sensed & recording.link_torque
    tau, commanded = command_torque(recording)
    sensed &= ~behind
    if behind.any() and recording.tau_link is not None:
        tau = np.where(behind, recording.tau_link, tau)
    read = (
        noise_between_jumps(recording.tau_link, segments, dt)
        if sensed.any() and recording.tau_link is not None
        else None
    )
    motion = at_rest(smooth.motion, still, mean)
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
    top = top_speed(motion, segments, dt)
    most, share = SLOW_KEPT if options.slow_motion else SLOW
    # what static friction holds back in a joint that does not move is not known: none of its motor rows counts
    lowest = np.where(still, most, np.minimum(most, share * top))
    if options.min_velocity is not None:
        lowest = np.full(robot.n, options.min_velocity)
    return Signals(
        joints=robot.joint_names,
        dt=dt,
        motion=motion,
        tau=tau,
        tau_link=recording.tau_link,
        temperature=recording.temperature,
        segments=segments,
        noise=Noise(
            smooth.noise[0],
            smooth.noise[1],
            noise_between_jumps(tau, segments, dt),
            np.zeros(0) if read is None else read,
        ),
        knots=knots,
        filter=filter_,
        margin=round(2 * widest / dt),
        min_velocity=lowest,
        slow_left_out=options.min_velocity is not None,
        still=still,
        velocity_used=np.any([ratio > 0 for _, ratio in smooth.rates], axis=0)
        if smooth.rates
        else np.zeros(2 * robot.n, dtype=bool),
        rates=smooth.rates,
        notes=smooth.notes,
        sensed=sensed,
        link_torque=behind,
        doubts=doubts,
        command_torque=commanded,
        error_integrals=error_integrals(recording),
        recording=recording,
        cutoff_free=options.cutoff is None,
    )


def noise_between_jumps(values: Array, segments: tuple[Segment, ...], dt: float) -> Array:
    """Return the standard deviation of white noise in channels (N, n) from sixth differences, (n,) (squares' sum 924).

    The median tells it from jumps, which friction, controllers and gaps make and which are no noise; of a channel in
    coarse steps the median may be 0, and the mean square is taken.
    """
    sixth = np.concatenate([np.diff(values[s.start : s.stop], 6, axis=0) for s in excerpts(segments, dt)])
    result = np.full(values.shape[1], np.nan)
    for k in range(values.shape[1]):
        known = sixth[np.isfinite(sixth[:, k]), k]
        if not len(known):
            continue
        middle = 1.4826 * float(np.median(np.abs(known)))
        result[k] = (middle if middle > 0 else float(np.sqrt(np.mean(known**2)))) / np.sqrt(924.0)
    return result
