"""What completes a URDF or MJCF, as a text for the YAML beside it: what is known as keys, the rest as comments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from elid_cli.errors import first_of, visible
from elid_cli.robot.locking import beside_chain
from elid_cli.robot.robot import Robot, Transmission
from elid_cli.robot.yaml import emit, inline, quoted

LISTED = 8
"""Joints that a sentence names."""


@dataclass(frozen=True)
class Completion:
    """What is known of a robot and its logs beyond the robot's own file, and what is not."""

    tip: str = ""
    """The link whose chain is kept; empty: all joints."""
    lock: Mapping[str, float] = field(default_factory=dict)
    """Joints that are held, with their values in rad or m."""
    gear_ratios: Mapping[str, float] = field(default_factory=dict)
    transmissions: Mapping[str, Transmission] = field(default_factory=dict)
    control: Mapping[str, float | Mapping[str, float]] = field(default_factory=dict)
    """Gains ``kp``, ``kd`` of the drives."""
    log: Mapping[str, Any] = field(default_factory=dict)
    """The mapping of its logs, as the user has confirmed it."""
    logged: str = ""
    """The log that was looked at; empty: none."""
    found: Mapping[str, str] = field(default_factory=dict)
    """Signals that need no mapping -> where that log keeps them."""
    guesses: tuple[str, ...] = ()
    """Lines of a mapping guessed from names, which nobody has confirmed."""
    missing: tuple[str, ...] = ()
    """Signals that are needed and that that log does not show."""
    absent: tuple[str, ...] = ()
    """Joints that it does not hold."""
    standing: Mapping[str, float] = field(default_factory=dict)
    """Joints that stand still in it, and are locked there, rad or m."""
    chain: str = ""
    """Link whose chain has as many joints as that log, a table without names, has columns for; empty: not needed."""

    def unknown_ratios(self, robot: Robot) -> tuple[str, ...]:
        """Return the joints that move whose gear ratio neither the robot's file nor anybody has told."""
        told = {*self.gear_ratios, *self.absent, *self.standing, *self.held(robot)}
        return tuple(j.name for j in robot.joints if j.gear_ratio is None and j.name not in told)

    def held(self, robot: Robot) -> tuple[str, ...]:
        """Return the joints that are held, beside the chain to the tip or by name."""
        return (*(beside_chain(robot, self.tip) if self.tip else ()), *self.lock)

    def open_questions(self, robot: Robot) -> tuple[str, ...]:
        """Return what is not known, in sentences."""
        unknown = self.unknown_ratios(robot)
        said = (
            [f"gear ratio of {first_of(unknown, LISTED)}: the rotor is its inertia at the joint, Ja"] if unknown else []
        )
        said += [f"{line.partition(':')[0]}: guessed from names, a comment to be checked" for line in self.guesses]
        if self.chain and not self.tip:
            said.append(f"tip: {self.chain} if {visible(self.logged)} holds the joints that carry it alone")
        guessed = {line.partition(":")[0] for line in self.guesses}
        said += [f"{signal}: not found in {visible(self.logged)}" for signal in self.missing if signal not in guessed]
        if self.gains_missing:
            said.append("gains of the drives: the log holds commands and no torque")
        return tuple(said)

    @property
    def gains_missing(self) -> bool:
        """Whether the torque is to be computed from commands and the gains are not known."""
        known = set(self.found) | set(self.log)
        return "q_des" in known and not known & {"tau", "tau_link", "kp"} and "kp" not in self.control


def completion_text(robot: Robot, known: Completion) -> str:
    """Return the YAML beside the file of `robot` (as read without it), which reads back to what is known."""
    return "".join(f"{line}\n" for line in _lines(robot, known))


def _lines(robot: Robot, known: Completion) -> Iterator[str]:
    file = visible(Path(robot.source).name)
    yield f"# What {file} does not say, for elid: read with every --robot {file}."
    yield "# What is not known is a comment: take its # off where you know, or leave it. elid says what it then does."
    yield ""
    yield from _kept(known)
    if robot.gravity == (0.0, 0.0, -9.81):
        yield "# gravity: [0, 0, -9.81]   # m/s² in the frame of the base; as it stands here where nothing else is said"
        yield ""
    yield "# transmission: elastic, rigid, or auto: elastic where the log holds motor and link position, else rigid"
    yield "# gear_ratio: turns of the rotor per turn of the joint; not known: the rotor is its inertia at the joint, Ja"
    yield "# also: motor_axis: [0, 0, 1]   limits: {torque: 87}   parameters: {K: 2000, fs: 0.5}"
    yield "joints:"
    held = known.held(robot)
    for joint in (joint for joint in robot.joints if joint.name not in held):
        yield f"  {quoted(joint.name)}:"
        yield f"    transmission: {known.transmissions.get(joint.name, joint.transmission)}"
        if joint.name in known.gear_ratios:
            yield f"    gear_ratio: {known.gear_ratios[joint.name]!r}"
        elif joint.gear_ratio is not None:
            yield f"    # gear_ratio: {joint.gear_ratio:.12g}   # {file} says so"
        else:
            yield "    # gear_ratio: ?"
    yield from _control(known)
    yield from _log(known)


def _kept(known: Completion) -> Iterator[str]:
    if known.tip:
        yield f"tip: {quoted(known.tip)}   # all joints that do not move it are held at 0"
    elif known.chain:
        yield f"# tip: {quoted(known.chain)}   # if {visible(known.logged)} holds the joints that carry it alone"
    if known.lock:
        yield "lock:   # rad or m"
        yield from (f"  {quoted(name)}: {value!r}" for name, value in known.lock.items())
    if known.standing:
        where = inline({name: float(f"{value:.4g}") for name, value in known.standing.items()})
        yield f"# lock: {where}   # as {visible(known.logged)} has them, which is done where nothing else is said"
    unheld = {name: 0 for name in known.absent if name not in known.lock}
    if unheld and not known.tip:
        yield f"# lock: {inline(unheld)}   # not in {visible(known.logged)}: held at 0 where nothing else is said"
    if known.tip or known.chain or known.lock or known.standing or unheld:
        yield ""


def _control(known: Completion) -> Iterator[str]:
    if known.control:
        yield ""
        yield f"control: {inline(known.control)}   # N·m/rad and N·m·s/rad at the joint"
    elif known.gains_missing:
        yield ""
        yield "# control: {kp: ?, kd: ?}   # needed, as the log holds commands and no torque: N·m/rad, N·m·s/rad"


def _log(known: Completion) -> Iterator[str]:
    if not known.logged:
        return
    yield ""
    yield f"# Where {visible(known.logged)} keeps its signals"
    for signal, place in known.found.items():
        if signal not in known.log:
            yield f"#   {signal}: {visible(place)}   (found without being told)"
    guessed = {line.partition(":")[0] for line in known.guesses}
    if known.log:
        yield "log:"
        yield from (f"  {line}" for line in emit(dict(known.log)))
    elif known.guesses:
        yield "# log:"
    for line in known.guesses:
        yield f"#   {line}   # guessed from names: check it"
    for signal in known.missing:
        if signal not in guessed:
            yield f"#   {signal}: {{from: ?}}   # not found"
