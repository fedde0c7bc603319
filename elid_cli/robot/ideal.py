"""Drives of which a description says nothing, taken as ideal: without friction and rotor inertia."""

from __future__ import annotations

from dataclasses import replace

from elid_cli.robot.robot import Robot

DRIVE = ("Ja", "Jm", "fs", "fv")
"""Parameters of a drive that may be taken as 0; behind an elastic transmission a rotor needs its inertia."""


def with_ideal_drives(robot: Robot) -> Robot:
    """Return the robot with 0 for friction and rotor inertia that it does not give; a note of it names them.

    Bodies and stiffnesses stay unknown where they are, and so does the rotor's inertia of an elastic joint.
    """
    joints, named = list(robot.joints), []
    for k, (joint, rotor) in enumerate(zip(robot.joints, robot.rotor_names, strict=True)):
        kinds = ("fs", "fv") if joint.elastic else (rotor.kind, "fs", "fv")
        lacking = [kind for kind in kinds if kind not in joint.parameters]
        joints[k] = replace(joint, parameters=dict(joint.parameters) | dict.fromkeys(lacking, 0.0))
        named += [f"{joint.name} {' '.join(lacking)}"] if lacking else []
    said = (f"taken as 0, as the description does not give them: {'; '.join(named)}",) if named else ()
    return replace(robot, joints=tuple(joints), notes=(*robot.notes, *said))
