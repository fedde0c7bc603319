"""What a saved result says of a trajectory fit: errors of the positions, and every drive's values with verdicts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.result import Identification, Verdict
from elid_cli.estimation.trajectory.differing import errors_alone
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.found_effects import settled
from elid_cli.estimation.trajectory.softening import gains_of
from elid_cli.estimation.trajectory.unknowns import PARAMETERS
from elid_cli.estimation.validation.verdicts import TORQUE_SHARE, WEAK
from elid_cli.robot.robot import Robot

NAMES = (*PARAMETERS, "offset")
"""Of the drive parameters of `unknowns.KINDS`, as they are told."""


def softness(robot: Robot, fit: TrajectoryFit) -> dict[str, float]:
    """Return what friction that fades in takes off the squared error not fitted, of the joints where it was found."""
    return {robot.joint_names[joint]: gain for joint, gain in gains_of(fit).items()}


def settings_of(found: Identification, fit: TrajectoryFit, moves: NDArray[np.bool_]) -> dict[str, object]:
    """Return what JSON says of the fit: errors of the positions, rad (m), and every drive parameter with its errors.

    `found` is what least squares say of the same log: the size of the torques. `moves` are the parameters that the
    motion depends on, (n, 4).
    """
    robot, own = fit.unknowns.robot, fit.unknowns
    values = own.joint_values(settled(fit))
    errors, between, within = (own.joint_values(part) for part in (fit.deviation, fit.between, fit.within))
    another = own.joint_values(fit.another) if own.recordings == 1 else None
    verdicts = _verdicts(found, fit, errors, moves)
    alone = {"estimate": fit.alone, "std_error": errors_alone(fit)} if own.own else {}
    alone = {name: part[:, : own.drives].reshape(len(part), robot.n, -1) for name, part in alone.items()}

    def told(joint: int, kind: int) -> dict[str, object]:
        if verdicts[joint][kind] == "refused":
            return {"estimate": None, "std_error": None, "verdict": "refused"}
        return {
            "estimate": float(values[joint, kind]), "std_error": float(errors[joint, kind]),
            "between_recordings": float(between[joint, kind]), "within_recording": float(within[joint, kind]),
            "another_recording": None if another is None else float(another[joint, kind]),
            "verdict": verdicts[joint][kind], "bias_possible": False,
            **({"by_recording": {name: part[:, joint, kind].tolist() for name, part in alone.items()}}
               if (joint, kind) in own.own else {}),
        }  # fmt: skip

    return {
        "steps": fit.steps,
        "delays": fit.delays.tolist(),
        "fading_friction": softness(robot, fit),
        **({} if fit.unseen is None else {"unseen_loop": fit.unseen}),
        "position_rms": dict(zip(robot.joint_names, fit.rms.tolist(), strict=True)),
        "position_rms_before": dict(zip(robot.joint_names, fit.rms_before.tolist(), strict=True)),
        "joint_parameters": {
            joint: {name: told(k, c) for c, name in enumerate(NAMES)} for k, joint in enumerate(robot.joint_names)
        },
    }


def _verdicts(
    found: Identification, fit: TrajectoryFit, errors: Array, moves: NDArray[np.bool_]
) -> list[list[Verdict]]:
    """Return verdicts on the drive parameters, (n, 4).

    Known, as base parameters are: to a share of the value, or of the joint's torque. A friction of 0 is known so.
    """
    n = fit.unknowns.robot.n
    v = np.concatenate([item.v[item.counts][:, :n] for item in fit.tracked])
    a = np.concatenate([np.gradient(item.v[:, :n], item.run.dt, axis=0)[item.counts] for item in fit.tracked])
    one = np.ones(n)
    acting = np.stack([np.sqrt(np.mean(a**2, axis=0)), one, np.sqrt(np.mean(v**2, axis=0)), one], axis=1)
    verdicts: list[list[Verdict]] = []
    for k, joint in enumerate(fit.unknowns.robot.joint_names):
        torque = found.error[joint].torque_rms if joint in found.error else 0.0
        enough = np.maximum(WEAK * np.abs(fit.values[k]), WEAK * TORQUE_SHARE * torque / np.maximum(acting[k], 1e-12))
        verdicts.append(
            [
                "refused" if not moves[k, kind] else "supported" if errors[k, kind] <= enough[kind] else "weak"
                for kind in range(len(NAMES))
            ]
        )
    return verdicts
