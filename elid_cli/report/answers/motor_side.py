"""What the motor side says of transmissions whose links nobody logged, as a table and as JSON."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from elid_cli.errors import in_words
from elid_cli.estimation.result import Identification
from elid_cli.report.answers.classification import verdict_mark
from elid_cli.report.answers.inputs import Items
from elid_cli.report.tree import Cell, Column, Quantity, Section, Table, Text, Tone, picked
from elid_cli.signals.recording import LINK_SENSORS

if TYPE_CHECKING:
    from elid_cli.estimation.motor_side.result import LinkSensor, MotorSideJoint

NOTE = (
    "rigid to: a rigid joint's torque is within 5 % up to there; antiresonance: link against this joint's held motor, "
    "the other motors free; resonance: link against rotor, all motors free"
)
NO_OTHER = "no other motion: first find what the model lacks, with elid diagnose"
TONES: dict[str, Tone] = {"supported": "good", "weak": "warn", "refused": "bad"}


def motor_side_sections(found: Identification) -> list[Section]:
    """Return a table of the joints and what refused ones lack; nothing where the motor side was not asked."""
    if found.motor_side is None:
        return []
    joints = found.motor_side.joints
    columns = (
        *Column.texts(joint="joint", verdict="verdict"),
        *Column.numbers(stiffness="K", std_error="± sd"),
        *Column.numbers("Hz", rigid_to="rigid to", antiresonance="antires.", resonance="resonance"),
    )
    rows = tuple(_row(found, joint) for joint in joints)
    texts: dict[str, list[MotorSideJoint]] = {}
    for joint in (joint for joint in joints if joint.told):
        texts.setdefault(joint.told, []).append(joint)
    said = [
        Text(f"motor_side{members[0].number}", f"{in_words([str(joint.parameter) for joint in members], 6)}: {text}")
        for text, members in texts.items()
    ]
    said += sensor_sections(found.motor_side.sensors)
    title = f"stiffness from {found.motor_side.source} (no link position in this log)"
    return [Table("motor_side", columns, rows, title=title, note=NOTE), *said]


def stiffness_items(found: Identification, robot: str) -> Items:
    """Return the motion that would show the stiffnesses that this log does not, and the command that plans it.

    `robot` is what ``--robot`` was given. Of those that no other motion would show, that.
    """
    joints = found.motor_side.joints if found.motor_side else ()
    motions = [joint.motion for joint in joints if joint.motion]
    lacking = [joint.joint for joint in joints if joint.lacking]
    none = ((f"for the stiffness of {in_words(lacking, 6)}", NO_OTHER),) if lacking else ()
    if not motions:
        return none
    command = ["elid", "excite", "--robot", robot, "-o", "stiffness.csv"]
    for motion in motions:
        command += ["--show-stiffness", motion.option]
    names = in_words([motion.joint for motion in motions], 6)
    wanted = "slow wide motion with a torque multisine past the antiresonance"
    return ((f"for the stiffness of {names}", wanted), ("command for that", shlex.join(command)), *none)


def sensor_sections(sensors: Sequence[LinkSensor]) -> list[Text]:
    """Return a sentence on every sensor; of several logs there may be more than one on a link."""
    names = [f"{sensor.kind}_{sensor.joint}" for sensor in sensors]
    places = [f"_{names[:k].count(name) + 1}" if name in names[:k] else "" for k, name in enumerate(names)]
    told = zip(names, places, sensors, strict=True)
    return [Text(f"{name}{place}", _sensor_words(sensor)) for name, place, sensor in told]


def _sensor_words(sensor: LinkSensor) -> str:
    """Return what was found of a sensor on a link, a sentence."""
    name = f"{sensor.kind} behind {sensor.joint}"
    if sensor.reason:
        return f"{name}: not used ({sensor.reason})"
    unit, scale = ("m/s²", 1.0) if sensor.place else ("mrad/s", 1e3)
    bias = ", ".join(f"{scale * value:.2g}" for value in sensor.bias)
    late = f"{abs(1e3 * sensor.delay):.2g} ms {'late' if sensor.delay > 0 else 'early'}"
    where = ", ".join("?" if math.isnan(value) else f"{value:.2f}" for value in sensor.place)
    place = f" at ({where}) m in the link's frame" if sensor.place else ""
    return f"{name}: used, its mounting found{place}; bias {bias} {unit}, {late}"


def _row(found: Identification, joint: MotorSideJoint) -> tuple[Cell, ...]:
    unit = stiffness_unit(found, joint)
    refused = joint.verdict == "refused"

    def frequency(value: float) -> Cell:
        return None if refused else Quantity(value, digits=3)

    return (
        joint.joint,
        replace(verdict_mark(joint.verdict), tone=TONES[joint.verdict]),
        None if refused else Quantity(joint.stiffness, unit, resolution=joint.std_error),
        None if refused else Quantity(joint.std_error, unit, resolution=joint.std_error),
        frequency(joint.rigid_to),
        frequency(joint.antiresonance),
        frequency(joint.resonance),
    )


def stiffness_unit(found: Identification, joint: MotorSideJoint) -> str:
    """Return the unit of a joint's stiffness."""
    return "{1}/{0}".format(*found.robot.joints[joint.number].units)


def stiffness_record(found: Identification, joint: MotorSideJoint) -> dict[str, Any]:
    """Return a stiffness as an entry of ``base_parameters`` of JSON; the estimate of a refused one is null."""
    return {
        "name": joint.parameter, "terms": {joint.parameter: 1}, "unit": stiffness_unit(found, joint),
        "class": "independent", "estimate": joint.stiffness,
        **picked(joint, "std_error reference relative_error verdict"),
    }  # fmt: skip


def motor_side_payload(found: Identification) -> dict[str, Any]:
    """Return the key ``motor_side`` of JSON: nothing where the motor side was not asked."""
    side = found.motor_side
    if side is None:
        return {}
    joints = {joint.joint: _joint_payload(joint) for joint in side.joints}
    sensors = {
        f"{kind}s": [_sensor_payload(sensor) for sensor in side.sensors if sensor.kind == kind] for kind in LINK_SENSORS
    }
    logged = {name: own for name, own in sensors.items() if own}
    return {"motor_side": {**picked(side, "misfit seconds corrected"), "joints": joints, **logged}}


def _sensor_payload(sensor: LinkSensor) -> dict[str, Any]:
    """Return a sensor on a link as an entry of its kind's list in JSON."""
    own = picked(sensor, "joint reason mounting bias delay")
    return own | ({"place": sensor.place} if sensor.kind == "accelerometer" else {})


def _joint_payload(joint: MotorSideJoint) -> dict[str, Any]:
    motion = joint.motion
    logs = {name: picked(own, "verdict stiffness std_error reason") for name, own in joint.by_log}
    return {
        **picked(joint, "verdict stiffness std_error"),
        "systematic": joint.systematic if joint.verdict != "refused" else None,
        **picked(joint, "rotor rigid_to antiresonance resonance band reason failed gates"),
        "next_motion": None if motion is None else picked(motion, "torque top words"),
        **({"by_log": logs} if logs else {}),
    }
