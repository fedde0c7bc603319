"""The questions of `elid init` in a terminal: each with what the log and the robot's file propose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import click

from elid_cli.errors import ElidError, UsageError, visible
from elid_cli.robot.completion import Completion
from elid_cli.robot.robot import BASE, Robot

T = TypeVar("T")
NONE = "-"
"""The answer that a signal is not in the log, or that no chain is meant where one is proposed."""
MEANINGS = {
    "t": "time", "q": "position of the link", "theta": "position of the motor", "tau": "torque of the motor",
    "dq": "velocity of the link", "dtheta": "velocity of the motor", "tau_link": "joint torque sensor",
    "temperature": "°C",
}  # fmt: skip
"""What a signal is, in a question's words."""


def asked(robot: Robot, look: Callable[[Mapping[str, float], Mapping[str, Any]], Completion], tip: str) -> Completion:
    """Return what the user says of a robot.

    Parameters
    ----------
    robot
        As its own file describes it.
    look
        Returns what the log shows of it (`first_look`) with some joints held and a mapping.
    tip
        The link of ``--tip``, which is then not asked for.
    """
    from elid_cli.robot.locking import beside_chain, locked

    tip = tip or _tip(robot, look({}, {}).chain)
    chain = dict.fromkeys(beside_chain(robot, tip), 0.0) if tip else {}
    known = look(chain, {})
    if known.absent:
        value = _value(f"{known.logged} lacks {_names(known.absent)}. Held at (rad or m)", "0", _numbers(1))[0]
        known = look({**chain, **dict.fromkeys(known.absent, value)}, {})
    seen = locked(robot, known.lock)
    lock = {name: value for name, value in known.lock.items() if name not in chain}
    known = replace(known, tip=tip, lock=lock, gear_ratios=_ratios(known.unknown_ratios(seen)))
    known = replace(known, transmissions=_transmissions(seen))
    if known.logged:
        known = _signals(seen, known, lambda mapping: look({**chain, **lock}, mapping))
    if known.gains_missing:
        told = "The log holds commands and no torque. Gains of the drives at the joint"
        kp = _gains(f"{told}: kp, N·m/rad", seen.joint_names)
        kd = _gains("kd, N·m·s/rad", seen.joint_names) if kp is not None else None
        known = replace(known, control={name: gain for name, gain in (("kp", kp), ("kd", kd)) if gain is not None})
    return known


def _tip(robot: Robot, proposed: str) -> str:
    from elid_cli.robot.locking import beside_chain

    carriers = {robot.parents[k] for k in range(robot.n)}
    tips = [name for k, name in enumerate(robot.joint_names) if k not in carriers]
    if len(tips) < 2:
        return ""

    def check(text: str) -> str:
        text = "" if text == NONE else text
        if text:
            beside_chain(robot, text)
        return text

    links = [name for name, joint in robot.links.items() if joint in tips and joint != BASE]
    every = f"{NONE}: all" if proposed else "Enter: all"
    return _value(f"The robot ends in {_names(links or tips)}. One chain: to which? ({every})", proposed, check)


def _ratios(joints: tuple[str, ...]) -> dict[str, float]:
    if not joints:
        return {}
    many = "one or, with commas, one each; " if len(joints) > 1 else ""
    text = f"Rotor turns per turn of {_names(joints)} ({many}Enter: not known)"

    def read(answer: str) -> dict[str, float]:
        given = _numbers(len(joints))(answer) if answer else []
        if any(abs(ratio) < 1e-9 for ratio in given):
            raise UsageError("0 is no gear ratio; 1 is a direct drive")
        return dict(zip(joints, given * len(joints) if len(given) == 1 else given, strict=True)) if given else {}

    return _value(text, "", read)


def _transmissions(robot: Robot) -> dict[str, Any]:
    from elid_cli.robot.schema import TRANSMISSIONS

    text = "Transmissions: elastic, rigid, or auto (as the log shows)"
    chosen = click.prompt(text, default="auto", type=click.Choice(TRANSMISSIONS), err=True, show_choices=False)
    return dict.fromkeys(robot.joint_names, chosen) if chosen != "auto" else {}


def _gains(text: str, joints: tuple[str, ...]) -> float | dict[str, float] | None:
    def read(answer: str) -> float | dict[str, float] | None:
        given = _numbers(len(joints))(answer) if answer else []
        if any(gain < 0 for gain in given):
            raise UsageError("gains are not negative")
        if len(given) < 2:
            return given[0] if given else None
        return dict(zip(joints, given, strict=True))

    return _value(f"{text} (Enter: not known)", "", read)


def _signals(robot: Robot, known: Completion, look: Callable[[Mapping[str, Any]], Completion]) -> Completion:
    """Return what is known once the user has confirmed, or told, where each signal is."""
    guesses = {line.partition(":")[0]: line.partition(":")[2].strip() for line in known.guesses}
    wanted = list(dict.fromkeys([*known.missing, *guesses]))
    for signal, place in known.found.items():
        click.echo(f"  {visible(signal)}: {visible(place)}", err=True)
    if known.found and not click.confirm(f"{visible(known.logged)}: is that right?", default=True, err=True):
        wanted = list(dict.fromkeys([*known.found, *wanted]))
    if wanted:
        click.echo("Places: a column, topic.field, or {from: …, unit: deg, side: motor}.", err=True)
    said: dict[str, Any] = {}
    for signal in wanted:
        proposal = guesses.get(signal) or known.found.get(signal) or NONE
        spec = _place(signal, proposal, robot, lambda spec, s=signal: look({**said, s: spec}))  # type: ignore[misc]
        if spec is not None:
            said[signal] = spec
    again = look(said) if said else known
    left = tuple(signal for signal in again.missing if signal not in said)
    return replace(
        known, log=said, found={s: p for s, p in again.found.items() if s not in said}, missing=left, guesses=()
    )


def _place(signal: str, proposal: str, robot: Robot, look: Callable[[Any], Completion]) -> Any:
    """Return the entry of a mapping that the user gives; None where the signal is not in the log."""
    from elid_cli.logs import read_map_options
    from elid_cli.logs.mapping.language import parse_mapping

    meaning = MEANINGS.get(signal, "what the drive was told")

    def read(answer: str) -> Any:
        if answer == NONE:
            return None
        spec = read_map_options([f"{signal}: {answer}" if answer.startswith("{") else f"{signal}={answer}"])[signal]
        parse_mapping({signal: spec}, robot, "answer")
        if signal in look(spec).missing:
            raise UsageError(f"the log does not hold {answer} for these joints")
        return spec

    return _value(f"{signal} ({meaning}): where? ({NONE}: not in the log)", proposal, read)


def _value(text: str, default: str, read: Callable[[str], T]) -> T:
    """Ask until an answer can be read; what is wrong with the others is said."""
    while True:
        answer = click.prompt(visible(text), default=default, show_default=bool(default), err=True)
        try:
            return read(str(answer).strip())
        except (ElidError, ValueError) as fault:
            hint = f" ({fault.hint})" if isinstance(fault, ElidError) and fault.hint else ""
            click.echo(f"  {visible(str(getattr(fault, 'message', fault)))}{visible(hint)}", err=True)


def _numbers(most: int) -> Callable[[str], list[float]]:
    """Return a reader of one number or, with commas, of `most`."""
    from elid_cli.robot.expressions import evaluate

    def read(answer: str) -> list[float]:
        numbers = [evaluate(part) for part in answer.split(",")]
        if len(numbers) not in (1, most):
            raise UsageError(f"{len(numbers)} numbers for {most} joints")
        return numbers

    return read


def _names(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(names)
