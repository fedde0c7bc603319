"""The mapping language: where each signal of a log is, in which unit and sign (--map, and a robot file's `log:`).

Value at the joint = sign · scale · (raw value in `unit`), divided by the gear ratio for a motor-side position
or velocity and multiplied by it for a motor-side torque (`side: motor`), plus `offset` (SI, joint side), plus the
signal named by `add`.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import UsageError, did_you_mean
from elid_cli.logs.mapping.left_out import KEY as LEFT_OUT
from elid_cli.logs.mapping.left_out import parse_left_out
from elid_cli.logs.mapping.long_table import KEY as LONG
from elid_cli.logs.mapping.long_table import parse_long
from elid_cli.robot.robot import Robot
from elid_cli.robot.written_keys import written_at
from elid_cli.signals.recording import ACCEL, GYRO, INERTIAL, MEASURED

POSITIONS = ("q", "theta", "q_des")
VELOCITIES = ("dq", "dtheta", "dq_des")
TORQUES = ("tau", "tau_link", "tau_ff")
GAINS = ("kp", "kd")
COMMANDS = ("q_des", "dq_des", "tau_ff", *GAINS)
"""What the drive was told, held until the next sample."""
SIGNALS = (*MEASURED, *INERTIAL, *COMMANDS)
KEYS = ("from", "value", "field", "joints", "unit", "scale", "offset", "sign", "side", "add", "time", "unwrap")
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
ANGLES = {"rad": 1.0, "deg": math.pi / 180, "rev": 2 * math.pi, "turn": 2 * math.pi, "m": 1.0, "mm": 1e-3, "cm": 1e-2}
RATES = {"rad/s": 1.0, "deg/s": math.pi / 180, "rev/s": 2 * math.pi, "rpm": math.pi / 30, "m/s": 1.0, "mm/s": 1e-3}
EFFORTS = {"N.m": 1.0, "Nm": 1.0, "N·m": 1.0, "mN.m": 1e-3, "mNm": 1e-3, "kN.m": 1e3, "N": 1.0, "kN": 1e3, "mN": 1e-3}
ACCELERATIONS = {"m/s^2": 1.0, "m/s²": 1.0, "g": 9.80665, "mg": 9.80665e-3}
STIFFNESSES = {"N.m/rad": 1.0, "N.m/deg": 180 / math.pi, "N.m.s/rad": 1.0, "N.m.s/deg": 180 / math.pi, "N/m": 1.0}
EFFORTS |= {"A": 1.0, "mA": 1e-3, "V": 1.0, "%": 1e-2, "percent": 1e-2, "‰": 1e-3, "permille": 1e-3}

UNIT_WORDS = {
    "deg": "deg", "°": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "grados": "deg", "degrés": "deg",
    "rad": "rad", "radian": "rad", "radians": "rad", "rev": "rev", "turn": "rev", "turns": "rev", "umdr": "rev",
    "umdrehungen": "rev", "tours": "rev", "u": "rev", "m": "m", "mm": "mm", "cm": "cm", "nm": "N.m", "mnm": "mN.m",
    "knm": "kN.m", "n": "N", "kn": "kN", "a": "A", "amp": "A", "ma": "mA", "v": "V", "%": "%", "percent": "%", "‰": "‰",
    "s": "s", "sec": "s", "sek": "s", "ms": "ms", "us": "us", "µs": "us", "ns": "ns", "deg/s": "deg/s", "°/s": "deg/s",
    "grad/s": "deg/s", "rpm": "rpm", "u/min": "rpm", "1/min": "rpm", "min-1": "rpm", "rad/s": "rad/s", "m/s": "m/s",
    "m/s^2": "m/s^2", "m/s²": "m/s^2", "m/s2": "m/s^2", "m/s/s": "m/s^2",
}  # fmt: skip
"""Units as headers and people write them, in lower case without spaces and dots -> as the language has them."""


def plain_unit(text: str) -> str:
    """Return a unit as `UNIT_WORDS` has it: in small letters, without signs of multiplication and brackets."""
    return re.sub(r"[\s*·.]", "", text.lower().strip("[]()"))


@dataclass(frozen=True)
class SignalMap:
    """Where one signal is, and how its numbers become SI values at the joint."""

    signal: str
    source: str | tuple[str | None, ...]
    """Column pattern, dataset path or topic; or one column per joint."""
    field: str = ""
    joints: Mapping[str, str | int] | None = None
    """The robot's joint -> its name (or index) in the log; None: the same names; empty: not known."""
    factor: tuple[float, ...] | float = 1.0
    """SI value of one unit."""
    unit: str = ""
    """One unit, or one per joint, as written."""
    scale: tuple[float, ...] | float = 1.0
    offset: tuple[float, ...] | float = 0.0
    sign: tuple[float, ...] | float = 1.0
    motor_side: bool = False
    add: str = ""
    time: str = ""
    """Column or dataset with this signal's own stamps."""
    written: Mapping[str, Any] | None = None
    """As it stands in a mapping."""
    value: tuple[float, ...] | float | None = None
    """A constant in place of a channel."""
    unwrap: bool = False
    """Whether the angle wraps at one turn of its unit and is to be made continuous first."""

    def gain(self, robot: Robot) -> Array:
        """Return the factor from raw to SI joint-side values, shape (n,)."""
        gain = np.broadcast_to(self.factor, robot.n) * np.broadcast_to(self.scale, robot.n)
        gain = gain * np.broadcast_to(self.sign, robot.n)
        if self.motor_side:
            ratios = robot.known_ratios(f"{self.signal}: side: motor", self.joints)
            power = 1 if self.signal in TORQUES else 2 if self.signal in GAINS else -1
            gain = gain * ratios**power
        return np.asarray(gain, dtype=float)

    @property
    def turn(self) -> float:
        """One turn in the log's own unit, which is the same at all joints."""
        factor = self.factor[0] if isinstance(self.factor, tuple) else self.factor
        return 2 * math.pi / factor

    def offsets(self, robot: Robot) -> Array:
        """Return the offsets in SI units at the joint, shape (n,)."""
        return np.array(np.broadcast_to(self.offset, robot.n), dtype=float)


@dataclass(frozen=True)
class TimeMap:
    """Where the time is; `factor` is the unit in s, or None where it is to be told from the numbers."""

    source: str
    field: str = ""
    factor: float | None = None

    @property
    def written(self) -> dict[str, str]:
        """The entry of a mapping that says the same."""
        unit = next((name for name, factor in TIME_UNITS.items() if factor == self.factor), "")
        entry = {"from": self.source, "field": self.field, "unit": unit}
        return {key: value for key, value in entry.items() if value}


SignalMaps = dict[str, SignalMap]


def parse_mapping(raw: Mapping[str, Any], robot: Robot, where: str) -> tuple[SignalMaps, TimeMap | None]:
    """Return the signals and the time of a mapping as written in YAML.

    Raises
    ------
    UsageError
        Naming file and line, or `where` if they are not known, the signal and the key, with the nearest valid name.
    """
    if not isinstance(raw, Mapping):
        raise UsageError(f"{where}: a mapping is signals with their places", hint="q: {from: /arm/joint_states}")
    signals: SignalMaps = {}
    time: TimeMap | None = None
    for name, spec in raw.items():
        at = written_at(name, where)
        if name == LONG:
            parse_long(spec, at)
            continue
        if name == LEFT_OUT:
            if where != "--map":
                raise UsageError(f"{at}: {LEFT_OUT} is of one log, not of a robot", hint="--leave-out START:STOP")
            parse_left_out(spec, at)
            continue
        entry = _entry(name, spec, at)
        if name == "t":
            time = _time(entry, at)
        elif set(entry) <= {"from", "field"} and all(isinstance(value, str) for value in entry.values()):
            signals[str(name)] = _named(str(name), tuple(entry.items()))
        else:
            option = f"--{name}" if name in GAINS and set(entry) == {"value"} and where == "--map" else ""
            signals[str(name)] = _signal(str(name), entry, robot, option or f"{at}: {name}")
    return signals, time


@lru_cache(maxsize=1024)
def _named(name: str, entry: tuple[tuple[str, str], ...]) -> SignalMap:
    """Return a signal that is only named, which every log and robot has alike."""
    given = dict(entry)
    return SignalMap(signal=name, source=given.get("from", ""), field=given.get("field", ""), written=given)


def _entry(name: Any, spec: Any, where: str) -> Mapping[str, Any]:
    if name != "t" and name not in SIGNALS:
        raise UsageError(
            f"{where}: unknown signal {name!r}", hint=did_you_mean(str(name), ("t", *SIGNALS, LONG, LEFT_OUT))
        )
    if isinstance(spec, str | list):
        spec = {"from": spec}
    if not isinstance(spec, Mapping):
        raise UsageError(f"{where}: {name}: expected {{from: …}}", detail=f"found {spec!r:.60}")
    for key in spec:
        if key not in KEYS:
            where = written_at(key, where)
            raise UsageError(f"{where}: {name}: unknown key {key!r}", hint=did_you_mean(str(key), KEYS))
    if "from" not in spec and "value" not in spec and not (name == "t" and "field" in spec):
        raise UsageError(f"{where}: {name}: no 'from'", hint="from: column pattern, dataset path or topic")
    return spec


def _time(spec: Mapping[str, Any], where: str) -> TimeMap:
    unit = None if spec.get("unit") is None else _text(spec["unit"], where, "t: unit")
    if unit is not None and unit not in TIME_UNITS:
        raise UsageError(f"{where}: t: unknown unit {unit!r}", hint=did_you_mean(str(unit), TIME_UNITS))
    for key in spec:
        if key not in ("from", "field", "unit"):
            raise UsageError(f"{where}: t: {key!r} does not apply to time", hint="from, field, unit")
    factor = TIME_UNITS[unit] if unit is not None else None
    return TimeMap(
        _text(spec.get("from", ""), where, "t: from"), _text(spec.get("field", ""), where, "t: field"), factor
    )


def _signal(name: str, spec: Mapping[str, Any], robot: Robot, where: str) -> SignalMap:
    side = spec.get("side", "joint")
    if side not in ("motor", "joint", "link"):
        raise UsageError(f"{where}: unknown side {side!r}", hint=did_you_mean(str(side), ("motor", "joint")))
    add = _text(spec.get("add", ""), where, "add")
    if add and (add not in SIGNALS or add == name):
        others = [signal for signal in SIGNALS if signal != name]
        raise UsageError(f"{where}: add: unknown signal {add!r}", hint=did_you_mean(add, others))
    unit, factor = _units(spec.get("unit", ""), name, robot, where)
    unwrap = spec.get("unwrap", False)
    if not isinstance(unwrap, bool):
        raise UsageError(f"{where}: unwrap: expected true or false", detail=f"found {unwrap!r:.60}")
    if unwrap and isinstance(factor, tuple) and len(set(factor)) > 1:
        raise UsageError(f"{where}: unwrap: needs one unit for all joints", detail=f"found {unit}")
    return SignalMap(
        signal=name,
        source=_places(spec.get("from", ""), robot, where),
        field=_text(spec.get("field", ""), where, "field"),
        joints=_joints(spec.get("joints"), robot, where),
        factor=factor,
        unit=unit,
        scale=_per_joint(spec.get("scale", 1.0), robot, f"{where}: scale"),
        offset=_per_joint(spec.get("offset", 0.0), robot, f"{where}: offset"),
        sign=_per_joint(spec.get("sign", 1.0), robot, f"{where}: sign"),
        motor_side=side == "motor",
        add=add,
        time=_text(spec.get("time", ""), where, "time"),
        value=_per_joint(spec["value"], robot, where if where.startswith("--k") else f"{where}: value")
        if "value" in spec
        else None,
        written=dict(spec),
        unwrap=unwrap,
    )


def _text(value: Any, where: str, key: str) -> str:
    if not isinstance(value, str):
        raise UsageError(f"{where}: {key}: expected text", detail=f"found {value!r:.60}")
    return value


def _places(value: Any, robot: Robot, where: str) -> str | tuple[str | None, ...]:
    if isinstance(value, list):
        if len(value) != robot.n:
            raise UsageError(f"{where}: from: {len(value)} places for {robot.n} joints")
        return tuple(None if place is None else _text(place, where, "from") for place in value)
    return _text(value, where, "from")


def _joints(value: Any, robot: Robot, where: str) -> Mapping[str, str | int] | None:
    if value is None:
        return None
    if isinstance(value, list):
        if len(value) != robot.n:
            raise UsageError(f"{where}: joints: {len(value)} names for {robot.n} joints")
        value = dict(zip(robot.joint_names, value, strict=True))
    if not isinstance(value, Mapping):
        raise UsageError(f"{where}: joints: expected {{joint1: name in the log, …}}")
    for joint in value:
        if joint not in robot.joint_names:
            raise UsageError(f"{where}: joints: no joint {joint!r}", hint=did_you_mean(str(joint), robot.joint_names))
    return {str(joint): name if isinstance(name, int) else str(name) for joint, name in value.items()}


def _per_joint(value: Any, robot: Robot, where: str) -> tuple[float, ...] | float:
    if isinstance(value, Mapping):
        for joint in value:
            if joint not in robot.joint_names:
                raise UsageError(f"{where}: no joint {joint!r}", hint=did_you_mean(str(joint), robot.joint_names))
        neutral = 0.0 if where.endswith("offset") else 1.0
        value = [value.get(joint, neutral) for joint in robot.joint_names]
    if isinstance(value, list):
        if len(value) != robot.n:
            what = f"{where}: {len(value)} numbers for {robot.n} joint{'s' if robot.n > 1 else ''}"
            raise UsageError(what, hint="one number, or one per joint of --robot")
        return tuple(_number(item, where) for item in value)
    return _number(value, where)


def _number(value: Any, where: str) -> float:
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = float(value)  # YAML 1.1 reads 1e-3 as text
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UsageError(f"{where}: expected a finite number", detail=f"found {value!r:.60}")
    return float(value)


def _units(value: Any, name: str, robot: Robot, where: str) -> tuple[str, tuple[float, ...] | float]:
    """Return the unit as written and the SI value of one, or one per joint."""
    if isinstance(value, Mapping):
        for joint in value:
            if joint not in robot.joint_names:
                raise UsageError(f"{where}: unit: no joint {joint!r}", hint=did_you_mean(str(joint), robot.joint_names))
        value = [value.get(joint, "") for joint in robot.joint_names]
    if isinstance(value, list):
        if len(value) != robot.n:
            what = f"{where}: unit: {len(value)} units for {robot.n} joint{'s' if robot.n > 1 else ''}"
            raise UsageError(what, hint="one unit, or one per joint of --robot")
        units = [_text(item, where, "unit") for item in value]
        return ", ".join(units), tuple(_unit_factor(name, unit, where) if unit else 1.0 for unit in units)
    unit = _text(value, where, "unit")
    return unit, _unit_factor(name, unit, where) if unit else 1.0


def _unit_factor(signal: str, unit: str, where: str) -> float:
    table = ANGLES if signal in POSITIONS else ANGLES | RATES if signal in VELOCITIES else EFFORTS
    if signal in GAINS:
        table = STIFFNESSES
    if signal in GYRO:
        table = {unit: factor for unit, factor in RATES.items() if not unit.startswith("m")}
    if signal in ACCEL:
        table = ACCELERATIONS
    if signal == "temperature":
        table = {"degC": 1.0, "°C": 1.0, "C": 1.0}
    if signal in (*POSITIONS, *VELOCITIES) and unit.startswith("counts"):
        per_turn = unit.partition(":")[2]
        try:
            counts = float(per_turn)
        except ValueError:
            counts = 0.0
        if not (math.isfinite(counts) and counts != 0):
            raise UsageError(f"{where}: unit {unit!r} needs counts per turn", hint="unit: counts:4096")
        return 2 * math.pi / counts
    if unit not in table:
        meant = UNIT_WORDS.get(plain_unit(unit))
        gon = " (gradians, 400 to a turn, are counts:400)" if unit.lower() == "grad" else ""
        others = table if signal in INERTIAL else [*table, "counts:4096"]
        hint = f"did you mean {meant!r}?{gon}" if meant in table else did_you_mean(unit, others)
        raise UsageError(f"{where}: unknown unit {unit!r}", hint=hint)
    return table[unit]
