"""A recorded log after reading: raw signals of every joint on one uniform time base, and what was repaired."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import UsageError, check_kind
from elid_cli.tables import Shown

MEASURED = ("q", "theta", "tau", "dq", "dtheta", "tau_link", "temperature")
"""Signals of joints: positions of links and motors, motors' torques, velocities, torque sensors, temperatures."""
GYRO = ("gyro_x", "gyro_y", "gyro_z")
"""Signals of gyroscopes: angular velocities about the sensors' own axes."""
ACCEL = ("accel_x", "accel_y", "accel_z")
"""Signals of accelerometers: specific forces (acceleration minus gravity) along the sensors' own axes."""
LINK_SENSORS = {"gyroscope": GYRO, "accelerometer": ACCEL}
"""Sensors that links carry -> their signals, one for each axis."""
INERTIAL = (*GYRO, *ACCEL)


def joints_computed(source: str, joints: Sequence[str]) -> NDArray[np.bool_]:
    """Return the joints whose torque is computed, (n,), by its source: `command`, or `command of JOINT …`."""
    words = source.split()
    found = [words[:1] == ["command"] and (len(words) == 1 or name in words[2:]) for name in joints]
    return np.array(found, dtype=bool)


@dataclass(frozen=True)
class Segment:
    """A stretch of samples [start, stop) that is contiguous in time and from one file; `source` indexes files."""

    start: int
    stop: int
    source: int = 0

    def __len__(self) -> int:
        return self.stop - self.start


@dataclass(frozen=True, repr=False)
class Recording(Shown):
    """Raw signals (SI, joint side), columns in the robot's joint order.

    Within a segment samples are `dt` apart; between segments nothing is known. `q` and `theta` are equal
    for a rigid joint of which only one was logged. Samples that were missing are NaN and stay NaN.
    """

    joints: tuple[str, ...]
    dt: float
    """Sample time, s."""
    t: Array
    """Time, s, from 0 at the first sample of the log, shape (N,)."""
    q: Array
    """Link positions, rad or m, shape (N, n); NaN columns where a joint has no link encoder."""
    theta: Array
    """Motor positions divided by the gear ratio, rad or m, shape (N, n)."""
    tau: Array
    """Motor torques at the joint, N·m or N, shape (N, n); NaN columns where a joint's torque is not logged."""
    dq: Array | None = None
    """Measured link velocities, rad/s or m/s, shape (N, n), or None; NaN columns where a joint has none."""
    dtheta: Array | None = None
    """Measured motor velocities divided by the gear ratio, shape (N, n), or None."""
    tau_link: Array | None = None
    """Measured torque in the transmission, N·m, shape (N, n), or None; NaN columns where a joint has none."""
    temperature: Array | None = None
    """Temperatures, °C, shape (N, n), or None."""
    gyro: Mapping[str, Array] = field(default_factory=dict)
    """Angular velocities of the links, each in the axes of a sensor on it, rad/s: `GYRO` -> (N, n), NaN columns where a
    link has no sensor; empty where none has."""
    accel: Mapping[str, Array] = field(default_factory=dict)
    """Specific forces (acceleration minus gravity: 9.81 m/s² upwards at rest) at sensors on the links, each in the
    sensor's axes: `ACCEL` -> (N, n), as `gyro`."""
    commands: Mapping[str, Array] = field(default_factory=dict)
    """What the drives were told, where it was logged: ``q_des dq_des tau_ff kp kd``, held from one sample to the next,
    SI at the joint, each of shape (N, n); NaN columns where a joint has none."""
    smooth: bool | None = None
    """Whether commands change smoothly from sample to sample, as where drives are told more often than is logged, or
    are held; None: nobody said, and they count as held."""
    doubted: bool = False
    """Whether they may as well be the other of the two: neither the log nor anybody says."""
    interpolated: bool = False
    """Whether drives go to each commanded position on a line over one period of commands: `q_des` is that line then,
    and commands change on lines from sample to sample."""
    inferred: bool = False
    """Whether `smooth` is what the motion says: nobody said."""
    segments: tuple[Segment, ...] = ()
    files: tuple[str, ...] = ()
    sha256: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()
    """What was repaired, one sentence each, in the order it was done."""
    notes: tuple[str, ...] = ()
    """What the reader noticed and did not change (which clock was taken, which signal came from where)."""
    warnings: tuple[str, ...] = ()
    """What looks wrong and needs the user (units, signs, swapped channels), with a mapping to paste."""
    sources: dict[str, str] = field(default_factory=dict)
    """Signal name -> where it was read from, for reports."""
    bridged: tuple[tuple[str, int, Array], ...] = ()
    """Signal, joint and the times, s, shape (K,), of samples that were missing or broken and are interpolated."""
    parts: int = 1
    """Logs, or episodes of them, whose times `t` joins."""

    def __post_init__(self) -> None:
        """Refuse lists and the like in place of the arrays that every recording has (UsageError)."""
        for name in ("t", "q", "theta", "tau"):
            hint = "recording_of makes a recording of lists and arrays, aligned and checked"
            check_kind(f"Recording: {name}", getattr(self, name), np.ndarray, hint)

    def signal(self, name: str) -> Array | None:
        """Return a signal or command by its name, shape (N, n), or None where the log has none."""
        several = {**self.commands, **self.gyro, **self.accel}
        values: Array | None = several[name] if name in several else getattr(self, name, None)
        return values

    @property
    def changing(self) -> bool:
        """Whether commands change between samples, smoothly or on lines, and are not held for theirs."""
        return bool(self.smooth) or self.interpolated

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Joints whose links carry a gyroscope, (n,)."""
        return self._carrying(self.gyro, GYRO)

    @property
    def accelerated(self) -> NDArray[np.bool_]:
        """Joints whose links carry an accelerometer, (n,)."""
        return self._carrying(self.accel, ACCEL)

    def _carrying(self, held: Mapping[str, Array], axes: Sequence[str]) -> NDArray[np.bool_]:
        """Return the joints, (n,), whose links have every axis of a sensor."""
        if any(axis not in held for axis in axes):
            return np.zeros(self.n, dtype=bool)
        return np.array([not any(is_empty(held[axis][:, k]) for axis in axes) for k in range(self.n)])

    @property
    def link_torque(self) -> NDArray[np.bool_]:
        """Joints of which only a torque sensor in the transmission was logged, (n,)."""
        if self.tau_link is None:
            return np.zeros(self.n, dtype=bool)
        return np.array([is_empty(self.tau[:, k]) and not is_empty(self.tau_link[:, k]) for k in range(self.n)])

    @property
    def missing_link(self) -> NDArray[np.bool_]:
        """Joints of which one side of the transmission was not logged, (n,): it counts as rigid."""
        both = self.link_torque
        return np.array(
            [
                is_empty(q) or bool(both[k] and q[0] == self.theta[0, k] and np.array_equal(q, self.theta[:, k]))
                for k, q in enumerate(self.q.T)
            ]
        )

    @property
    def commanded(self) -> NDArray[np.bool_]:
        """Joints whose torque was computed from commands and gains, (n,)."""
        computed = joints_computed(self.sources.get("tau", ""), self.joints)
        return computed if "q_des" in self.commands else np.zeros(self.n, dtype=bool)

    def mean_temperatures(self) -> dict[str, float]:
        """Return the mean temperature of every joint that has one, °C."""
        columns = () if self.temperature is None else zip(self.joints, self.temperature.T, strict=True)
        return {joint: float(np.nanmean(column)) for joint, column in columns if np.isfinite(column).any()}

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.t.shape[0])

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def rate(self) -> float:
        """Sample rate, Hz."""
        return 1.0 / self.dt

    @property
    def duration(self) -> float:
        """Recorded time without the gaps between segments, s."""
        return float(sum((len(s) - 1) * self.dt for s in self.segments))


def without_samples(joints: tuple[str, ...], dt: float, samples: int, **told: Any) -> Recording:
    """Return a recording of `samples` that holds none of them, its arrays of a shape that takes no room.

    `told` are further fields, all of them descriptions.
    """
    empty = np.broadcast_to(np.nan, (samples, len(joints)))
    return Recording(joints, dt, np.broadcast_to(np.nan, (samples,)), empty, empty, empty, **told)


def with_commands(recording: Recording, how: str | None, *, commanded: bool) -> Recording:
    """Return a recording whose commands are held or smooth; None: as it is.

    `commanded` says whether commands drive all joints; of others none may be smooth (UsageError).
    """
    if how == "smooth" and not commanded:
        raise UsageError("--commands smooth: the log holds torques", hint="leave it out: it is of command logs")
    return recording if how is None else replace(recording, smooth=how == "smooth")


def is_empty(column: Array) -> bool:
    """Whether a column holds no number at all; its first one decides for most."""
    return bool(np.isnan(column[:1]).all() and np.isnan(column).all())


NAMED = 6
"""Logs that a sentence about several of them names."""


def unique_notices(said: Iterable[tuple[str, Iterable[str]]]) -> list[str]:
    """Return what was said of logs, (name, sentences) each, every sentence once, after the names of its logs.

    An empty name stands for the only log, which need not be named.
    """
    logs: dict[str, dict[str, None]] = {}
    for name, sentences in said:
        for sentence in sentences:
            logs.setdefault(sentence, {})[name] = None
    return [_named(tuple(names)) + sentence for sentence, names in logs.items()]


def notices_of(parts: Sequence[Recording], kind: str) -> list[str]:
    """Return the ``repairs``, ``notes`` or ``warnings`` of several recordings, each once, with the logs it is of."""
    return unique_notices((part.files[0] if len(part.files) == 1 else "", getattr(part, kind)) for part in parts)


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    listed = ", ".join(name for name in names[:NAMED] if name)
    return f"{listed}{more}: " if listed else ""


def repeated(files: Sequence[str], sha256: Sequence[str]) -> list[str]:
    """Return one sentence per file that holds the same bytes as one before it."""
    first: dict[str, str] = {}
    said = []
    for file, digest in zip(files, sha256, strict=False):
        if digest in first:
            said.append(
                f"{file}: the same bytes as {first[digest]}: a log counted twice makes standard errors too small"
            )
        first.setdefault(digest, file)
    return said
