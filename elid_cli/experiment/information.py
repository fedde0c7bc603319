"""Information that a planned motion gives about the base parameters, and its gradient with respect to the motion.

Rows are those of estimation (sum and motor rows), weighted by their expected residual. Motors are taken to move as
their links do; the deflection that shows a stiffness is the transmitted torque of the reference parameters over K.
All quantities are sums over the regressor's entries, so that every gradient is one weighted sum over the
derivatives of the regressor by position, velocity and acceleration of each joint at each instant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.model.regressor import Regressor, inputs_of
from elid_cli.robot.parameter import StandardParameter
from elid_cli.signals.motion import Motion

States = tuple[Array, Array, Array]
"""(q, q', q''), each (N, n)."""

SHOWN = 1e-9
"""Pivot below which a column counts as unseen, columns of unit norm."""
_STEP = 1e-5
"""Step of the one-sided differences of the regressor, in rad, rad/s and rad/s² alike."""


@dataclass(frozen=True)
class PlannedRows:
    """Rows of a planned motion: link and motor (or sum) rows over all parameters, (rows, N, p)."""

    link: Array
    motor: Array


@dataclass(frozen=True)
class Evaluation:
    """What a motion is worth."""

    log_det: float
    """Logarithm of the determinant of the information of the base parameters, half of it (log volume)."""
    std_error: Array
    """Predicted standard deviations of the base parameters, (b,)."""
    condition: float
    """Condition number of the weighted base regressor, columns of unit norm, in a well-conditioned basis."""


@dataclass(frozen=True)
class Weights:
    """What a search maximises."""

    volume: float = 1.0
    """Weight of the log volume (D-optimality)."""
    angles: float = 0.0
    """Weight against the log of the summed variance inflation of the columns, which bounds the condition number."""
    aims: tuple[int, ...] = ()
    """Base parameters whose log standard deviations are subtracted."""


class Information:
    """Information of planned motions of one robot.

    Inside, the leftmost base is replaced by the columns that a pivoted QR prefers for a sample motion: the same
    information, far better conditioned (PUMA 560: 1e1 against 1e4).

    Parameters
    ----------
    model, base
        The robot's model and structural base parameters.
    parameters
        Standard parameters (p,) that give the torques.
    residual
        Expected residual rms of each joint's sum and motor rows, N·m, (2, n).
    samples
        Independent samples that a log of the motion holds, over the number of planned instants.
    sample
        A motion that moves all joints.

    Raises
    ------
    DataError
        The sample motion does not show all base parameters (a joint cannot move).

    """

    def __init__(
        self, model: Regressor, base: BaseParameters, parameters: Array, residual: Array, samples: float, sample: States
    ) -> None:
        self.model, self.base, self.parameters = model, base, parameters
        self.weights = np.sqrt(samples) / residual
        self._elastic = np.flatnonzero(model.robot.elastic)
        self._springs = np.array([model.index[StandardParameter("K", int(k))] for k in self._elastic], dtype=np.intp)
        self._slots = [(item.row, item.columns, item.slots) for item in model.equations.rows]
        self._columns = self._preferred(sample)
        self._to_base = base.transform[:, self._columns]

    def _preferred(self, sample: States) -> NDArray[np.intp]:
        """Return the columns that a pivoted QR prefers, (b,)."""
        from scipy.linalg import qr

        self._columns = np.arange(len(self.parameters))
        system = self._weighted(self._rows(sample))
        norms = np.linalg.norm(system, axis=0)
        # a parameter that moves nothing may leave rounding, which scaled would look like a column of its own
        live = np.flatnonzero((norms > 0) & np.any(self.base.transform != 0, axis=0))
        factor, order = qr(system[:, live] / norms[live], mode="r", pivoting=True)
        pivots = np.abs(np.diag(factor))
        if len(pivots) < self.base.count or pivots[self.base.count - 1] < SHOWN * pivots[0]:
            raise DataError(
                f"{self.model.robot.name}: random motion does not show all base parameters",
                hint="a joint's limits leave it no room, or the trajectory is too short",
            )
        return np.asarray(live[order[: self.base.count]], dtype=np.intp)

    def loads(self, states: States) -> tuple[Array, Array]:
        """Return the torques through the transmissions and of the motors, each (N, n)."""
        rows = self._rows(states)
        load = (rows.link @ self.parameters).T
        return load, load + (rows.motor @ self.parameters).T

    def torques(self, states: States) -> Array:
        """Return the motor torques of a motion, (N, n)."""
        rows = self._rows(states)
        return np.asarray(((rows.link + rows.motor) @ self.parameters).T)

    def evaluate(self, states: States) -> Evaluation:
        """Return what a motion is worth."""
        _, factor, norms = self._factored(self._rows(states))
        inverse = np.linalg.inv(factor) / norms[:, None]
        spread = self._to_base @ inverse
        return Evaluation(
            float(np.log(np.abs(np.diag(factor))).sum() + np.log(norms).sum()),
            np.sqrt(np.einsum("ij,ij->i", spread, spread)),
            float(np.linalg.cond(factor)),
        )

    def gain(self, states: States, weights: Weights, torque_slope: Array | None = None) -> tuple[float, States]:
        """Return the value to be maximised and its derivatives by (q, q', q''), each (N, n).

        Parameters
        ----------
        states
            The motion.
        weights
            What counts how much.
        torque_slope
            Derivative by the motor torques, (N, n), of something else that is added to the value by the caller.

        """
        rows = self._rows(states)
        q, factor, norms = self._factored(rows)
        inverse = np.linalg.inv(factor) / norms[:, None]
        value = weights.volume * float(np.log(np.abs(np.diag(factor))).sum() + np.log(norms).sum())
        slope = weights.volume * (q @ inverse.T)
        for k in weights.aims:
            spread = self._to_base[k] @ inverse
            variance = float(spread @ spread)
            value -= 0.5 * np.log(variance)
            slope += np.outer(q @ spread, inverse @ spread) / variance
        if weights.angles:
            # variance inflation of column k: M_kk (M^-1)_kk, 1 when it is orthogonal to all others
            variances = np.einsum("ij,ij->i", inverse, inverse)
            total = float(variances @ norms**2)
            value -= weights.angles * np.log(total)
            own = q @ (factor * norms * variances)
            others = q @ ((inverse.T * norms**2) @ inverse @ inverse.T)
            slope -= weights.angles * 2 / total * (own - others)
        return value, self._by_states(states, rows, self._unweighted(slope, rows.link.shape[1]), torque_slope)

    def _factored(self, rows: PlannedRows) -> tuple[Array, Array, Array]:
        """Return (q, r, norms) with ``q r diag(norms)`` the weighted regressor."""
        system = self._weighted(rows)
        norms = np.linalg.norm(system, axis=0)
        norms = np.maximum(norms, 1e-12 * norms.max())
        q, factor = np.linalg.qr(system / norms)
        # what cannot be seen is taken as hardly seen, so that a search can climb out of it
        diagonal = np.arange(len(norms))
        small = np.abs(factor[diagonal, diagonal]) < SHOWN
        factor[diagonal[small], diagonal[small]] = SHOWN
        return q, factor, norms

    def _rows(self, states: States) -> PlannedRows:
        """Return link and motor rows with no deflection, as they are before the springs' columns are set."""
        q, dq, ddq = states
        motion = Motion(np.zeros(q.shape[0]), q, dq, ddq, q, dq, ddq)
        plan = self.model.equations
        out = np.empty((plan.program.outputs, q.shape[0]))
        plan.program.run(inputs_of(motion), out)
        n, p = self.model.robot.n, len(self.parameters)
        link, motor = np.zeros((n, q.shape[0], p)), np.zeros((n, q.shape[0], p))
        for row, columns, slots in self._slots:
            (motor if row.kind == "motor" else link)[row.joint][:, columns] = out[slots].T
        return PlannedRows(link, motor)

    def _weighted(self, rows: PlannedRows) -> Array:
        """Return the weighted regressor (rows * N, b): sum rows of all joints, motor rows of elastic ones."""
        total = (rows.link + rows.motor) * self.weights[0][:, None, None]
        own = rows.motor[self._elastic].copy()
        for place, (k, spring) in enumerate(zip(self._elastic, self._springs, strict=True)):
            own[place][:, spring] = rows.link[k] @ self.parameters / self.parameters[spring]
        own *= self.weights[1][self._elastic][:, None, None]
        system = np.concatenate([total, own]).reshape(-1, len(self.parameters))
        return np.ascontiguousarray(system[:, self._columns])

    def _unweighted(self, slope: Array, samples: int) -> PlannedRows:
        """Return the derivative by link and motor rows, given that by the weighted base regressor."""
        n, p = self.model.robot.n, len(self.parameters)
        full = np.zeros((n + len(self._elastic), samples, p))
        full[:, :, self._columns] = slope.reshape(len(full), samples, -1)
        total = full[:n] * self.weights[0][:, None, None]
        own = full[n:] * self.weights[1][self._elastic][:, None, None]
        link, motor = total.copy(), total
        for place, (k, spring) in enumerate(zip(self._elastic, self._springs, strict=True)):
            by_load = own[place][:, spring] / self.parameters[spring]
            link[k] += by_load[:, None] * self.parameters
            own[place][:, spring] = 0.0
            motor[k] = motor[k] + own[place]
        return PlannedRows(link, motor)

    def _by_states(self, states: States, rows: PlannedRows, slope: PlannedRows, torque_slope: Array | None) -> States:
        """Return derivatives by every joint's position, velocity and acceleration at every instant."""
        link, motor = slope.link, slope.motor
        if torque_slope is not None:
            by_torque = torque_slope.T[:, :, None] * self.parameters
            link, motor = link + by_torque, motor + by_torque
        samples, n = states[0].shape
        moved = [np.tile(a, (3 * n, 1)) for a in states]
        for order in range(3):
            for k in range(n):
                block = slice((order * n + k) * samples, (order * n + k + 1) * samples)
                moved[order][block, k] += _STEP
        plan = self.model.equations
        motion = Motion(np.zeros(len(moved[0])), moved[0], moved[1], moved[2], moved[0], moved[1], moved[2])
        out = np.empty((plan.program.outputs, len(moved[0])))
        plan.program.run(inputs_of(motion), out)
        total = np.zeros((3 * n, samples))
        for row, columns, slots in self._slots:
            source, weight = (rows.motor, motor) if row.kind == "motor" else (rows.link, link)
            change = out[slots].reshape(len(columns), 3 * n, samples) - source[row.joint][:, columns].T[:, None]
            total += np.einsum("cks,sc->ks", change, weight[row.joint][:, columns])
        derivatives = (total / _STEP).reshape(3, n, samples)
        return derivatives[0].T, derivatives[1].T, derivatives[2].T


def residuals_of(torque: Array, share: float, elastic: NDArray[np.bool_]) -> Array:
    """Return expected residual rms of sum and motor rows, (2, n): a share of each torque's rms (the largest's 1 %).

    The motor row of an elastic joint also bears the noise of its measured deflection and is taken twice as noisy.
    """
    rms = np.sqrt(np.mean(torque**2, axis=0))
    size = share * np.maximum(rms, 0.01 * rms.max())
    return np.stack([size, np.where(elastic, 2.0, 1.0) * size])
