"""What several kinds of figures show of a robot on a log: torques, residuals and what they may follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.validation.prediction import Validation
from elid_cli.model.regressor import EstimationRow
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

BINS = 24
"""Bins over which a residual's mean is taken to see whether it follows a variable."""
SPRING_STANDS_OUT = 1.3
"""Residual of the motor row over that of the sum row above which the transmission is worth a figure of its own."""


@dataclass(frozen=True)
class JointView:
    """One joint of a log: arrays at the M instants after filtering and decimation, NaN where a stretch ends."""

    joint: str
    unit: str
    t: Array
    """s."""
    measured: Array
    """Filtered motor torque, N·m (N)."""
    residual: Array
    """Measured minus predicted, spring eliminated."""
    used: NDArray[np.bool_]
    """Instants that count (not masked around a reversal)."""
    spring_residual: Array | None
    """Measured minus predicted by the motor row alone; None for a rigid joint."""
    variables: Mapping[str, Array]
    """What a residual may follow, by name with unit."""
    floor: float | None = None
    """rms that the sensors' noise alone leaves in `residual`."""
    spring_floor: float | None = None

    @property
    def spring_stands_out(self) -> bool:
        """Whether the motor row alone holds more than the row without the spring: a fault of the transmission."""
        if self.spring_residual is None:
            return False
        sizes = [np.sqrt(np.nanmean(r[self.used] ** 2)) for r in (self.spring_residual, self.residual)]
        return bool(sizes[0] > SPRING_STANDS_OUT * sizes[1])


def joint_views(
    found: Validation, signals: Signals, floor: Mapping[EstimationRow, float] | None = None
) -> tuple[JointView, ...]:
    """Return a view of every joint whose torque is known.

    Parameters
    ----------
    found
        A robot description judged on the log.
    signals
        The log.
    floor
        Noise floor per row, where it is known.

    """
    views = []
    for k, joint in enumerate(found.robot.joints):
        total, motor = EstimationRow("sum", k), EstimationRow("motor", k)
        if total not in found.residual:
            continue
        group = found.observation.group(total)
        if not group.use.any():
            continue
        views.append(
            JointView(
                joint=joint.name,
                unit=joint.units[1],
                t=found.observation.t,
                measured=broken(found.observation.tau[k], found.observation),
                residual=broken(found.residual[total], found.observation),
                used=group.use,
                spring_residual=broken(found.residual[motor], found.observation) if motor in found.residual else None,
                variables=variables(found.robot, signals, found.observation, k),
                floor=None if floor is None else floor.get(total),
                spring_floor=None if floor is None else floor.get(motor),
            )
        )
    return tuple(views)


def variables(robot: Robot, signals: Signals, observation: Observation, joint: int) -> dict[str, Array]:
    """Return what a joint's residual may follow, with units, each (M,)."""
    motion, at = signals.motion, signals.outputs
    angle, torque = robot.joints[joint].units
    found = {
        f"velocity ({angle}/s)": motion.dtheta[at, joint],
        f"position ({angle})": motion.theta[at, joint],
        f"motor torque ({torque})": observation.tau[joint],
        "time (s)": observation.t,
    }
    if robot.joints[joint].elastic:
        deflection = deflection_of(observation, joint, robot.parameter_names())
        raw = motion.theta[at, joint] - motion.q[at, joint]
        found[f"deflection (m{angle})"] = 1e3 * (raw if deflection is None else deflection)
    return found


def organised(residual: Array, values: Array) -> float:
    """Return the share of a residual's mean square that its mean over bins of a variable explains."""
    order = np.argsort(values, kind="stable")
    bins = np.array_split(residual[order], BINS)
    total = float(np.sum(residual**2))
    return sum(len(b) * float(np.mean(b)) ** 2 for b in bins if len(b)) / total if total > 0 else 0.0


def deflection_of(observation: Observation, joint: int, names: Sequence[str]) -> Array | None:
    """Return the deflection that multiplies a stiffness, as filtered and corrected, (M,); None where there is none."""
    groups = [g for g in observation.groups if (g.row.kind, g.row.joint) == ("motor", joint)]
    for group in groups:
        place = np.flatnonzero(group.index == names.index(StandardParameter("K", joint)))
        if place.size:
            return np.asarray(group.columns[int(place[0])])
    return None


def broken(values: Array, observation: Observation) -> Array:
    """Return values with NaN where a stretch begins, so that no line is drawn across a gap."""
    result = np.array(values, dtype=float)
    result[1:][np.diff(observation.segment) != 0] = np.nan
    return result
