"""What figures show of a described robot on a log: torques, residuals and what they may follow, springs, coverage."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import Triangles
from elid_cli.estimation.validation.prediction import Validation, validate
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.effects.declared import resolve
from elid_cli.model.regressor import EstimationRow
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


@dataclass(frozen=True)
class SpringView:
    """One transmission: what it transmitted against how far it was deflected, at M instants.

    Reversals are kept, since hysteresis shows there; NaN where a stretch ends.
    """

    joint: str
    unit: str
    deflection: Array
    """theta - q, rad (m)."""
    transmitted: Array
    """Motor torque less the motor's own inertia and friction, N·m (N)."""
    modelled: Array
    """What the description says: K (theta - q) and the effects of the transmission."""
    rising: NDArray[np.bool_]
    """Whether the deflection grows."""
    used: NDArray[np.bool_]
    """Instants that count (not masked around a reversal of the motor, where its friction is undefined)."""
    stiffness: float
    known: bool
    """Whether the stiffness is more than what a fit had to put there: False where it was refused."""


@dataclass(frozen=True)
class Coverage:
    """Where one joint has been: position against velocity, at the log's rate."""

    joint: str
    revolute: bool
    q: Array
    dq: Array
    limits: tuple[float, float] | None


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
                unit="N·m" if joint.revolute else "N",
                t=found.observation.t,
                measured=_broken(found.observation.tau[k], found.observation),
                residual=_broken(found.residual[total], found.observation),
                used=group.use,
                spring_residual=_broken(found.residual[motor], found.observation) if motor in found.residual else None,
                variables=variables(found.robot, signals, found.observation, k),
                floor=None if floor is None else floor.get(total),
                spring_floor=None if floor is None else floor.get(motor),
            )
        )
    return tuple(views)


def variables(robot: Robot, signals: Signals, observation: Observation, joint: int) -> dict[str, Array]:
    """Return what a joint's residual may follow, with units, each (M,)."""
    motion, at = signals.motion, signals.outputs
    angle, torque = ("rad", "N·m") if robot.joints[joint].revolute else ("m", "N")
    found = {
        f"velocity ({angle}/s)": motion.dtheta[at, joint],
        f"position ({angle})": motion.theta[at, joint],
        f"motor torque ({torque})": observation.tau[joint],
        "time (s)": observation.t,
    }
    if robot.joints[joint].elastic:
        deflection = _deflection(observation, joint, robot.parameter_names())
        raw = motion.theta[at, joint] - motion.q[at, joint]
        found[f"deflection (m{angle})"] = 1e3 * (raw if deflection is None else deflection)
    return found


def spring_views(found: Validation, signals: Signals, refused: Collection[str] = ()) -> tuple[SpringView, ...]:
    """Return the deflection-torque curve of every elastic joint whose stiffness the description gives.

    `refused` names parameters that the log does not support.
    """
    bare = _without_spring_effects(found, signals)
    views = []
    for k, joint in enumerate(found.robot.joints):
        row = EstimationRow("motor", k)
        stiffness = joint.parameters.get("K")
        if row not in found.residual or not joint.elastic or stiffness is None or signals.still[k]:
            continue
        group = found.observation.group(row)
        deflection = _deflection(found.observation, k, found.robot.parameter_names())
        if deflection is None or not group.use.any():
            continue
        transmitted = stiffness * deflection + bare.residual[row]
        views.append(
            SpringView(
                joint=joint.name,
                unit="N·m" if joint.revolute else "N",
                deflection=_broken(deflection, found.observation),
                transmitted=transmitted,
                modelled=transmitted - found.residual[row],
                rising=np.gradient(deflection) > 0,
                used=group.use,
                stiffness=float(stiffness),
                known=f"K{k + 1}" not in refused,
            )
        )
    return tuple(views)


def coverage(robot: Robot, signals: Signals) -> tuple[Coverage, ...]:
    """Return where every joint has been."""
    inside = np.concatenate([np.arange(s.start, s.stop) for s in signals.segments])
    return tuple(
        Coverage(joint.name, joint.revolute, signals.motion.q[inside, k], signals.motion.dq[inside, k],
                 joint.limits.position)
        for k, joint in enumerate(robot.joints)
    )  # fmt: skip


def singular_values(
    base: BaseParameters, triangles: Triangles, weights: Mapping[EstimationRow, float]
) -> tuple[Array, int]:
    """Return the singular values of the weighted regressor, columns of unit norm, largest first, and the rank kept.

    Columns beyond the standard parameters (nuisances, effects) are left out; so are columns that are zero.
    """
    system = triangles.stacked(weights)[:, : triangles.parameters]
    norms = np.linalg.norm(system, axis=0)
    live = norms > 0
    values = np.linalg.svd(system[:, live] / norms[live], compute_uv=False)
    return np.asarray(values), base.count


def organised(residual: Array, values: Array) -> float:
    """Return the share of a residual's mean square that its mean over bins of a variable explains."""
    order = np.argsort(values, kind="stable")
    bins = np.array_split(residual[order], BINS)
    total = float(np.sum(residual**2))
    return sum(len(b) * float(np.mean(b)) ** 2 for b in bins if len(b)) / total if total > 0 else 0.0


def _deflection(observation: Observation, joint: int, names: Sequence[str]) -> Array | None:
    """Return the deflection that multiplies a stiffness, as filtered and corrected, (M,); None where there is none."""
    groups = [g for g in observation.groups if (g.row.kind, g.row.joint) == ("motor", joint)]
    for group in groups:
        place = np.flatnonzero(group.index == names.index(f"K{joint + 1}"))
        if place.size:
            return np.asarray(group.columns[int(place[0])])
    return None


def _broken(values: Array, observation: Observation) -> Array:
    """Return values with NaN where a stretch begins, so that no line is drawn across a gap."""
    result = np.array(values, dtype=float)
    result[1:][np.diff(observation.stretch) != 0] = np.nan
    return result


def _without_spring_effects(found: Validation, signals: Signals) -> Validation:
    """Return the same description judged without its effects of the transmission: their torque is then residual."""
    kept = tuple(spec for spec in found.robot.effects if resolve(found.robot, spec)[0].place != "spring")
    if len(kept) == len(found.robot.effects):
        return found
    return validate(replace(found.robot, effects=kept), signals)
