"""Which parameters a robot is written with after a diagnosis.

Parameters that are estimated anew beside what was found need not predict unseen torque better: a log that hardly
determines the bodies gives others with every change, and a friction that helps at the search's cut-off may not at
identification's. Left-out stretches decide, at identification's cut-off: where they are predicted worse with what was
found, bodies and motors keep the values of the model before, and what lies between motor and link, which the torque of
the whole joint does not hold, those of the model after.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from elid_cli.estimation.judgement import JointError
from elid_cli.model.effects import effect_classes
from elid_cli.robot.robot import EffectSpec, Robot

ALIKE = 0.03
"""Part by which a joint's error on left-out stretches may rise …"""
MORE, PRICE = 0.1, 0.1
"""… and by which it may where squared errors, as shares of the torque, rise by this part of what others fall by."""
BETWEEN = ("spring", "encoder")
"""Places of effects between motor and link: the joint's whole torque does not hold them."""


def worse(before: Mapping[str, JointError], after: Mapping[str, JointError]) -> tuple[str, ...]:
    """Return the joints whose left-out torque the model after predicts worse, the worst first; () where it may stand.

    It may where no joint's error rises by more than a few per cent, and the errors as shares of the torque do not rise
    on the whole. A little more is let pass where far more is gained: any other model moves the errors of all joints.
    """
    known = [name for name in after if name in before and before[name].rms > 0]
    rise = {name: after[name].rms / before[name].rms for name in known}
    change = np.array([after[name].relative ** 2 - before[name].relative ** 2 for name in known])
    order = sorted(known, key=lambda name: -rise[name])
    if not known or (rise[order[0]] <= 1.0 + ALIKE and change.sum() <= 0):
        return ()
    cheap = np.sum(np.maximum(change, 0.0)) <= PRICE * np.sum(np.maximum(-change, 0.0))
    if rise[order[0]] <= 1.0 + MORE and cheap:
        return ()
    return tuple(name for name in order if rise[name] > 1.0) or (order[0],)


def robot_between(before: Robot, after: Robot) -> Robot:
    """Return the robot before with what lies between motor and link as the robot after has it: stiffnesses, effects."""
    joints = []
    for own, other in zip(before.joints, after.joints, strict=True):
        values = {**own.parameters, **{kind: v for kind, v in other.parameters.items() if kind == "K"}}
        joints.append(replace(own, parameters=MappingProxyType(values)))
    present = {(spec.effect, spec.joint) for spec in before.effects}
    effects = [spec for spec in after.effects if _between(spec) and (spec.effect, spec.joint) not in present]
    return replace(before, joints=tuple(joints), effects=(*before.effects, *effects))


def _between(spec: EffectSpec) -> bool:
    return effect_classes()[spec.effect].place in BETWEEN
