"""What a diagnosis says of elasticity: of joints that count as rigid, and of modes that may be a joint's own."""

from __future__ import annotations

from elid_cli.diagnosis import Diagnosis, FoundEffect
from elid_cli.logs.checks.required import COUNTS_AS_RIGID
from elid_cli.model.effects import effect_classes
from elid_cli.report.answers.summary import listed


def taken_as_rigid(found: Diagnosis) -> str:
    """Return which joints that are taken as rigid and left with a residual yield, or may: a sentence, or nothing."""
    high = {row.joint for row in found.rows_after if row.high} | {item.joint for item in found.unexplained}
    yielding = [line.split(":")[0] for line in found.recording.warnings if COUNTS_AS_RIGID in line]
    if yielding and high:
        which, goes = ("transmission", "yields") if len(yielding) == 1 else ("transmissions", "yield")
        return f" The {which} of {listed(yielding)} {goes}: declared elastic, what that does is taken out."
    names = [name for name in found.yielding if name in high]
    if not names:
        return _yielding_unseen(found) if high else ""
    who = "it is" if len(names) == 1 else "they are"
    return (
        f" The robot file has {listed(names)} elastic; without link position {who} rigid here, and the elasticity may "
        "be what is left: elid identify looks for it."
    )


def _yielding_unseen(found: Diagnosis) -> str:
    """Return that a rest may be a transmission's, where joints with geared motors count as rigid."""
    left = {item.joint for item in found.unexplained}
    names = [
        joint.name
        for joint in found.robot.joints
        if joint.name in left and not joint.elastic and joint.gear_ratio and joint.torque_at == "motor"
    ]
    if not names:
        return ""
    it = "a transmission that yields leaves" if len(names) == 1 else "transmissions that yield leave"
    return f" The robot file has {listed(names)} rigid; {it} such a rest, too (transmission: elastic)."


def own_elasticity(found: Diagnosis, effect: FoundEffect) -> str:
    """Return what a mode at a joint may be whose elasticity the robot file declares and no link position shows.

    The model takes such a joint as rigid, and its link swings against its motor as a structure would; nothing of
    others.
    """
    if not effect_classes()[effect.effect].like_a_spring or effect.joint not in found.yielding:
        return ""
    return (
        f"It may be the elasticity of {effect.joint} itself: the robot file has this joint elastic, and without link "
        "position the log shows its antiresonance as such a mode. elid identify looks for its stiffness."
    )
