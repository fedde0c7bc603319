"""Where identification asks the motor side, and what becomes of the answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from elid_cli.errors import DataError
from elid_cli.estimation.motor_side.hidden import hidden_joints
from elid_cli.estimation.result import EstimateOptions, Identification
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

if TYPE_CHECKING:
    from elid_cli.estimation.motor_side.result import MotorSide, MotorSideJoint

ENOUGH = 3.0
"""Independent instants per parameter of a joint that a lower cut-off must leave."""
PARAMETERS = 6
"""Base parameters of a rigid joint, about."""
LOWEST = 1.0
"""Hz."""
STARVED = 0.95
"""Share of a joint's samples near reversals, from which on a lower cut-off leaves too little."""
Fit = Callable[[Signals, EstimateOptions], Identification]
"""Identifies rigid joints from signals."""


def asked_motor_side(robot: Robot, signals: Signals, options: EstimateOptions) -> MotorSide | None:
    """Return what motors say of transmissions whose links the logs do not hold; None: not asked.

    Fits that hold on to what they were told do not ask.
    """
    recording = signals.recording
    if recording is None or not asks(options) or not hidden_joints(robot, recording):
        return None
    from elid_cli.estimation.motor_side.estimate import motor_side
    from elid_cli.estimation.motor_side.several import motor_side_of_files

    if len({segment.source for segment in signals.segments}) > 1:
        return motor_side_of_files(robot, recording, signals.still)
    return motor_side(robot, recording, signals.still)


def asks(options: EstimateOptions) -> bool:
    """Whether an estimate with these options asks the motor side."""
    return options.guards and not options.hold


def fitted_below(
    signals: Signals, side: MotorSide | None, options: EstimateOptions, identified: Fit
) -> tuple[Identification, bool]:
    """Return what signals say below what the motor side found, and whether the links' motion was corrected.

    Where that leaves hardly a sample of a joint, they are not filtered so low.
    """
    below = below_resonance(signals, side)
    try:
        straight = straightened(below, side, options, identified)
        found = straight or identified(below, options)
    except DataError:
        if below is signals:
            raise
        return identified(signals, options), False
    if below is not signals and starved(found):
        return identified(signals, options), False
    return found, straight is not None


def below_resonance(signals: Signals, side: MotorSide | None) -> Signals:
    """Return the signals filtered at where rigid joints stop describing what was found, unless the user chose.

    All other parameters are those of rigid joints.
    """
    limit = rigid_limit(side)
    if limit is None or not signals.cutoff_free or limit >= signals.filter.cutoff:
        return signals
    if 2.0 * limit * signals.duration < ENOUGH * PARAMETERS:
        return signals
    return replace(signals.refiltered(limit), cutoff_free=False)


def starved(found: Identification) -> bool:
    """Whether a fit had hardly a sample of a joint: low filters reach from all others to a reversal."""
    masked = found.settings.get("masked")
    return isinstance(masked, list) and any(share > STARVED for share in masked)


def rigid_limit(side: MotorSide | None) -> float | None:
    """Return the frequency up to which rigid joints describe all that was found, Hz; None where nothing was."""
    found = [joint.rigid_to for joint in side.joints if joint.verdict != "refused"] if side else []
    return max(min(found), LOWEST) if found else None


def straightened(
    signals: Signals, side: MotorSide | None, options: EstimateOptions, identified: Fit
) -> Identification | None:
    """Return the identification with the links' motion that follows from what was found (`hidden_motion`).

    None where nothing was, or the samples themselves are fitted, or the signals go on past what rigid joints describe.
    """
    limit = rigid_limit(side)
    samples = options.accurate or options.fit == "trajectory"
    if side is None or limit is None or samples or not _within(signals.filter.cutoff, limit):
        return None
    from elid_cli.estimation.motor_side.hidden_motion import widened, with_links

    rigid = identified(signals, replace(options, guards=False))
    straight = with_links(signals, side, rigid)
    return None if straight is None else widened(identified(straight, options), rigid)


def _within(cutoff: object, limit: float) -> bool:
    return isinstance(cutoff, float) and cutoff <= limit * 1.001


def with_motor_side(found: Identification, side: MotorSide | None, *, corrected: bool = False) -> Identification:
    """Return an identification that says what the motor side found.

    `corrected`: its fit had the hidden links' motion from that (`hidden_motion`). Otherwise its inertias, masses and
    first moments may be biased.
    """
    if side is None:
        return found
    hidden, notes = dict(found.hidden), list(found.notes)
    for joint in side.joints:
        name = StandardParameter("K", joint.number)
        notes = [note for note in notes if not note.startswith(f"{name} cannot be identified")]
        hidden.pop(name, None)
        if joint.verdict == "refused":
            hidden[name] = joint.reason
        else:
            notes.append(f"{name}: {_note(joint, side.source)}")
    from elid_cli.estimation.motor_side.hidden_motion import bent, with_doubted_friction

    limit = rigid_limit(side)
    if limit is not None:
        cutoff = found.settings.get("cutoff")
        word = "fitted below it"
        if corrected:
            word += (
                ", with the links' motion from that of the motors, the torque and K; a tenth of what that changes is "
                "in the standard errors"
            )
        elif not _within(cutoff, limit):
            word = f"but fitted up to {cutoff:.3g} Hz: expect a bias (less with --cutoff {limit:.3g})"
        notes.append(f"all other parameters are those of rigid joints, which hold up to {limit:.3g} Hz; {word}")
    if (limit is not None and not corrected) or any(_may_bend(found, joint) for joint in side.joints):
        found = bent(found)
    found = with_doubted_friction(found, side.joints)
    return replace(found, hidden=hidden, notes=tuple(notes), motor_side=replace(side, corrected=corrected))


def _may_bend(found: Identification, joint: MotorSideJoint) -> bool:
    """Whether a joint whose stiffness the log does not show may yield in the fit's band, by the robot file's K."""
    if joint.verdict != "refused":
        return False
    from elid_cli.model.antiresonance import RIGID_ERROR, expected_antiresonance

    cutoff = found.settings.get("cutoff")
    expected = expected_antiresonance(found.robot, joint.number, others_move=False)
    # a link below its antiresonance f0 needs 1 / (1 - (f / f0)^2) of the torque of a rigid one
    stiff = isinstance(cutoff, float) and cutoff <= expected * (RIGID_ERROR / (1.0 + RIGID_ERROR)) ** 0.5
    return not stiff


def _note(joint: MotorSideJoint, source: str) -> str:
    why = f" ({joint.reason}: right only if friction and gravity are as modelled)" if joint.verdict == "weak" else ""
    logs = f", {joint.together}" if joint.together else ""
    return f"from {source}, {joint.verdict}{why}{logs}; resonance {joint.resonance:.3g} Hz"
