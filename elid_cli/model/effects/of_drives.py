"""What a robot declares of its drives beyond the gains that a log tells."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import RobotError
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.declared import resolve
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals


def declared_gains(robot: Robot) -> Array:
    """Return what the torques that a log tells are over those that act, (n,).

    Raises
    ------
    RobotError
        A declared gain leaves no torque.
    """
    gains = 1.0 + _declared(robot, "gain")
    for joint in np.flatnonzero(gains <= 0).tolist():
        raise RobotError(
            f"{robot.name}: {effect_that(of_drive='gain').name} of {robot.joint_names[joint]} leaves no torque",
            hint="it is the share by which the logged torque is too large, above -1",
        )
    return gains


def declared_integrals(robot: Robot) -> Array:
    """Return the integral over the proportional gain of every joint's drive, 1/s, (n,)."""
    return np.maximum(_declared(robot, "integral"), 0.0)


def declared_filters(robot: Robot) -> Array:
    """Return the time constant of the filter of velocity of every joint's drive, s, (n,)."""
    return np.maximum(_declared(robot, "filter"), 0.0)


def _declared(robot: Robot, which: Literal["gain", "integral", "filter"]) -> Array:
    """Return the amplitudes of the declared effects of drives, (n,)."""
    found = np.zeros(robot.n)
    for spec in robot.effects:
        kind, joint = resolve(robot, spec)
        if kind.of_drive == which:
            found[joint] = float(spec.parameters.get(kind.amplitudes[0].name, 0.0))
    return found


def with_integrals(robot: Robot, signals: Signals) -> tuple[Robot, Signals]:
    """Return the robot without the integral terms that it declares, and the signals with the torques that hold them."""
    rates = declared_integrals(robot)
    kept = tuple(spec for spec in robot.effects if resolve(robot, spec)[0].of_drive != "integral")
    if signals.error_integrals is None or len(kept) == len(robot.effects):
        return robot, signals
    return replace(robot, effects=kept), with_drives(signals, rates)


def as_acting(robot: Robot, signals: Signals) -> Signals:
    """Return the signals with the torques that act as the robot declares its drives, in place of what the log tells."""
    return with_drives(signals, declared_integrals(robot), declared_gains(robot))


def with_drives(signals: Signals, integrals: Array, gains: Array | float = 1.0) -> Signals:
    """Return the signals with the torques of drives with integral terms, 1/s, and gains, (n,) each."""
    if signals.error_integrals is None or not (np.any(integrals) or np.any(gains != 1.0)):
        return signals
    error, asked = signals.error_integrals
    commanded = None if signals.command_torque is None else (signals.command_torque + integrals * asked) / gains
    return replace(
        signals, tau=(signals.tau + integrals * error) / gains, command_torque=commanded,
        error_integrals=signals.error_integrals / gains,
    )  # fmt: skip
