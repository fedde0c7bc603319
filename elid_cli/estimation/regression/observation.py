"""What estimation sees: every row group's columns and right-hand side, filtered, decimated and masked.

The regressor at the log's rate is never held: it is computed, filtered and decimated block by block, and what
remains is a few thousand equations per row group.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.filtered_rows import FilteredBlock, observed_blocks
from elid_cli.model.regressor import SENSOR_KINDS, EstimationRow, Regressor, RegressorPlan, RowPlan
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

REVERSAL_SHARE = 0.02
"""A filtered sample is masked when more than this share of its filter window lies in a reversal."""


@dataclass(frozen=True)
class RowGroup:
    """One row group after filtering: ``columns.T @ parameters = target`` at M instants.

    `columns` is (p_r, M) for the standard parameters in `index`; `use` marks the instants that count.
    """

    row: EstimationRow
    index: NDArray[np.intp]
    columns: Array
    target: Array
    use: NDArray[np.bool_]

    @property
    def count(self) -> int:
        """Number of instants that count."""
        return int(np.count_nonzero(self.use))


@dataclass(frozen=True)
class Observation:
    """All row groups of a log, with the torques and their derivative on the same instants."""

    robot: Robot
    groups: tuple[RowGroup, ...]
    parameters: int
    """Number of standard parameters p."""
    t: Array
    """Time of each instant, s, (M,)."""
    segment: NDArray[np.intp]
    """Segment of each instant, (M,)."""
    tau: Array
    """Filtered motor torques, (n, M)."""
    tau_rate: Array
    """Filtered time derivative of the motor torques, N·m/s, (n, M)."""
    rate: float
    """Instants per second."""
    reversing: NDArray[np.bool_]
    """Instants at which a joint's motor reverses or sticks, (n, M); masked in `groups` unless unmasked."""
    known: NDArray[np.bool_]
    """Instants at which a joint's torque is known, (n, M)."""
    channels: Array
    """Filtered deflections (theta - q), their rates, link velocities and accelerations, (4 n, M)."""
    blocks: tuple[FilteredBlock, ...] = ()
    """What `groups` were made of, where one block held it all; else none is kept."""
    reductions: list[object] = field(init=False, default_factory=list, repr=False, compare=False)
    """What `triangles.to_triangles` made of it last: with some of those columns only, or more instants, it need not be
    made again."""
    own: list[object] = field(init=False, default_factory=list, repr=False, compare=False)
    """Its own columns reduced (`own_columns`), once it has been reduced with others beside them."""

    @property
    def instants(self) -> int:
        """Number of instants M."""
        return int(self.t.shape[0])

    def group(self, row: EstimationRow) -> RowGroup:
        """Return the row group of `row`."""
        return next(group for group in self.groups if group.row == row)

    @property
    def independent(self) -> tuple[RowGroup, ...]:
        """Return row groups of which none is a sum of others: of a joint with a torque sensor, the sensor's three."""
        read = {group.row.joint for group in self.groups if group.row.kind in SENSOR_KINDS}
        return tuple(g for g in self.groups if g.row.joint not in read or g.row.kind in SENSOR_KINDS)

    def spring_row(self, joint: int) -> EstimationRow:
        """Return the row that the transmission of a joint shows in: against its sensor, or against the motor."""
        read = EstimationRow("spring", joint)
        return read if any(group.row == read for group in self.groups) else EstimationRow("motor", joint)

    @property
    def masked(self) -> Array:
        """Share of instants masked around reversals, per joint, (n,)."""
        used = np.zeros((self.robot.n, self.instants), dtype=bool)
        for group in self.groups:
            if group.row.kind not in ("load", "spring"):  # no friction in these: reversals count
                used[group.row.joint] |= group.use
        hidden = (self.known & ~used).sum(axis=1)
        return np.asarray(hidden / np.maximum(self.known.sum(axis=1), 1))

    @property
    def gliding(self) -> NDArray[np.bool_]:
        """Joints whose reversals count, (n,)."""
        found = np.zeros(self.robot.n, dtype=bool)
        for group in self.groups:
            if group.row.kind in ("sum", "motor", "drive"):
                found[group.row.joint] |= bool((group.use & self.reversing[group.row.joint]).any())
        return found

    def unmasked(self, joints: NDArray[np.bool_]) -> Observation:
        """Return the observation with the reversals of some joints (n,) counted as well."""

        def counted(group: RowGroup) -> RowGroup:
            if not joints[group.row.joint] or group.row.kind in ("link", "load", "spring"):
                return group
            known = self.known[group.row.joint]
            return replace(group, use=known & np.isfinite(group.target) if group.row.kind == "drive" else known)

        found = replace(self, groups=tuple(map(counted, self.groups)))
        found.reductions[:] = self.reductions
        return found

    def only(self, chosen: NDArray[np.bool_]) -> Observation:
        """Return the observation with the instants outside `chosen` (M,) masked."""
        return replace(self, groups=tuple(replace(g, use=g.use & chosen) for g in self.groups))


def observe(model: Regressor, signals: Signals, plan: RegressorPlan | None = None, *, mask: bool = True) -> Observation:
    """Compute, filter and decimate all rows of a log.

    Parameters
    ----------
    model
        The robot's model.
    signals
        Smooth motion and torque.
    plan
        Row pairing, by default sum and motor rows, and those of joint torque sensors where they are used.
    mask
        Mask instants around reversals of the motor, where Coulomb friction is undefined.
    """
    plan = plan or model.sensed(signals.sensed)
    n = model.robot.n
    outputs = signals.outputs
    columns = np.empty((plan.program.outputs, len(outputs)))
    tau, read = np.empty((n, len(outputs))), np.full((n, len(outputs)), np.nan)
    rate, channels = np.empty((n, len(outputs))), np.empty((4 * n, len(outputs)))
    reversal = np.zeros((n, len(outputs)))
    segment = np.zeros(len(outputs), dtype=np.intp)
    blocks: tuple[FilteredBlock, ...] = ()
    for block in observed_blocks(model, signals, plan):
        blocks = (block,) if block.last - block.first == len(outputs) else ()
        here = slice(block.first, block.last)
        for output, row in enumerate(block.place.tolist()):  # all at once would take another array of their size
            columns[output, here] = block.rows[row]
        tau[:, here], rate[:, here] = block.tau, block.tau_rate
        channels[:, here], reversal[:, here], segment[here] = block.channels, block.reversal, block.segment
        if len(block.tau_link):
            read[:, here] = block.tau_link
    known = np.isfinite(tau)
    reversing = (reversal > REVERSAL_SHARE) & ~signals.still[:, None]
    use: NDArray[np.bool_] = known & ~reversing if mask else known
    return Observation(
        model.robot,
        tuple(_equations(item, columns[item.slots], tau, read, use) for item in plan.rows),
        model.parameters,
        signals.motion.t[outputs],
        segment,
        tau,
        rate,
        signals.rate,
        reversing,
        known,
        channels,
        blocks,
    )


def _equations(item: RowPlan, columns: Array, tau: Array, read: Array, use: NDArray[np.bool_]) -> RowGroup:
    """Return one row group from its columns, the torques, the sensors' readings and the instants that count."""
    kind, joint = item.row
    if kind == "link":
        here: NDArray[np.bool_] = np.all(np.isfinite(columns), axis=0)
        return RowGroup(item.row, item.columns, columns, np.zeros(columns.shape[1]), here)
    if kind in ("load", "spring"):
        return RowGroup(item.row, item.columns, columns, read[joint], np.isfinite(read[joint]))
    if kind == "drive":
        target = tau[joint] - read[joint]
        return RowGroup(item.row, item.columns, columns, target, use[joint] & np.isfinite(target))
    return RowGroup(item.row, item.columns, columns, tau[joint], use[joint])


def pair(
    effects: Mapping[tuple[str, int], Array],
    robot: Robot,
    sensed: NDArray[np.bool_] | None = None,
    *,
    reading: bool = False,
) -> dict[EstimationRow, Array]:
    """Turn columns given for link and motor rows into columns of the rows of estimation.

    Parameters
    ----------
    effects
        (side, joint) -> (d, N), link and motor rows of eq. (13), model side.
    robot
        Tells which joints are rigid (sum row only).
    sensed
        Joints whose torque sensor is used, (n,): columns of their rows too.
    reading
        Whether the effect lies in a sensor's reading, which sum and motor rows do not know.
    """
    rows: dict[EstimationRow, Array] = {}
    for (side, joint), values in effects.items() if not reading else ():
        total, own = EstimationRow("sum", joint), np.array(values, dtype=float)
        rows[total] = rows[total] + own if total in rows else own
        if side == "motor" and robot.joints[joint].elastic:
            rows[EstimationRow("motor", joint)] = own  # the same array where nothing else acts: it is filtered once
    for joint in np.flatnonzero(sensed).tolist() if sensed is not None else ():
        if robot.joints[joint].elastic:
            rows |= _read(effects.get(("link", joint)), effects.get(("motor", joint)), joint, reading=reading)
    # what enters both rows of the spring cancels in their sum: such a row is not acted on at all
    return {row: values for row, values in rows.items() if np.any(values)}


def _read(link: Array | None, motor: Array | None, joint: int, *, reading: bool) -> dict[EstimationRow, Array]:
    """Return an effect's columns in the rows of a joint with a torque sensor.

    What acts on link and motor with opposite signs is a torque in the transmission, which the sensor reads along with
    the spring's; an error of the reading itself stands in all three rows.
    """
    if link is None:
        return {} if motor is None else {EstimationRow("drive", joint): np.array(motor, dtype=float)}
    if motor is None:
        return {EstimationRow("load", joint): np.array(link, dtype=float)}
    if reading:
        return {
            EstimationRow("load", joint): +link,
            EstimationRow("drive", joint): +motor,
            EstimationRow("spring", joint): +link,
        }
    return {EstimationRow("load", joint): link + motor, EstimationRow("spring", joint): np.array(motor, dtype=float)}
