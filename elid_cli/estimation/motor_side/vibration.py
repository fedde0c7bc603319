"""How the fitted robot answers to small torques of its motors: linear about every pose of the log.

Of links q and motors θ: M q'' + J_c θ'' = K (θ - q) + damping, and J (θ'' + A q'') + friction + K (θ - q) = τ, with A
and J_c what bodies and rotors that they carry do to each other. Friction is a damper that takes as much power, gravity
is left out: it acts below the frequencies that are asked for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.latent_fit import LatentFit

POSES = 40
"""Poses of a log that are looked at, about."""
LOOKS = 50
"""Frequencies at which rigid joints are compared at first, and again between the last two."""


class Vibration:
    """The fitted robot about poses of its log.

    Parameters
    ----------
    found
        The fit. Compliances that are not positive count as rigid.
    """

    def __init__(self, found: LatentFit) -> None:
        link, x, at, now = found.problem.link, found.x, found.problem.unknowns.places, found.model
        self.n = link.n
        pose = now.q[0][:: max(1, len(now.q[0]) // POSES)]
        zero, unit = np.zeros_like(pose), np.eye(link.n)
        rest = link.terms(pose, zero, zero)
        self._compliance = np.where(link.elastic, np.maximum(x[at["c"]], 0.0), 0.0)
        self._damping, self._rotor = x[at["damping"]], np.diag(x[at["J"]])
        self._mass = link.mass(pose, x[at["p"]])
        coupled = bool(len(rest.by_acceleration))
        self._load = rest.by_acceleration @ self._rotor if coupled else np.zeros_like(self._mass)
        carried = [link.terms(pose, zero, zero + row).carried for row in unit]
        self._carried = self._rotor @ np.stack(carried, axis=2)
        friction = now.tau - x[at["J"]] * (now.acceleration + now.terms.carried) - now.spring - x[at["offset"]]
        power, square = np.mean(friction * now.speed, axis=0), np.mean(now.speed**2, axis=0)
        self._friction = np.diag(power / np.maximum(square, 1e-300))

    def acceleration(self, frequency: Array, *, rigid: bool = False) -> NDArray[np.complexfloating]:
        """Return every motor's acceleration per torque of its own, 1/(kg·m²) (1/kg), (F, poses, n).

        `frequency` is in Hz, (F,); `rigid` makes all joints rigid.
        """
        s = 2j * np.pi * frequency[:, None, None, None]
        lag = 1 - s * self._damping[:, None] + (s * self._damping[:, None]) ** 2
        yields = -(s**2) * (0.0 if rigid else 1.0) * self._compliance[:, None] * lag
        links = np.linalg.solve(np.eye(self.n) - yields * self._mass, np.eye(self.n) + yields * self._load)
        inertia = self._rotor + self._load + (self._carried + self._mass) @ links + self._friction / s
        return np.asarray(np.linalg.inv(inertia).diagonal(axis1=2, axis2=3))

    def antiresonance(self, joint: int) -> float:
        """Return the frequency at which the links swing against this joint's held motor and its spring, Hz."""
        return self._frequency(joint, held=True)

    def resonance(self, joint: int) -> float:
        """Return the frequency at which links and motors swing against each other by this joint's spring, Hz."""
        return self._frequency(joint, held=False)

    def rigid_to(self, joint: int, error: float) -> float:
        """Return the lowest frequency at which a rigid robot's torque for the motor's motion is `error` off, Hz."""
        low, high = 0.0, self.resonance(joint)
        for _ in range(2):
            frequency = np.linspace(low, high, LOOKS + 1)[1:]
            elastic, rigid = (self.acceleration(frequency, rigid=rigid)[:, :, joint] for rigid in (False, True))
            off = np.flatnonzero(np.median(np.abs(rigid / elastic - 1), axis=1) > error)
            place = int(off[0]) if len(off) else LOOKS - 1
            low, high = frequency[place] - (high - low) / LOOKS, frequency[place]
        return float(high)

    def _frequency(self, joint: int, *, held: bool) -> float:
        """Return the frequency of the mode that strains one spring most, the median over poses."""
        soft = self._compliance > 0
        springs = np.diag(np.where(soft, 1 / np.where(soft, self._compliance, 1.0), 0.0))
        whole = np.block([[self._mass, self._load], [self._carried, np.broadcast_to(self._rotor, self._mass.shape)]])
        stiff = np.block([[springs, -springs], [-springs, springs]])
        free = self._free(soft, joint if held else None)
        mass = free.T @ (0.5 * (whole + whole.swapaxes(1, 2))) @ free
        squares, modes = np.linalg.eig(np.linalg.solve(mass, np.broadcast_to(free.T @ stiff @ free, mass.shape)))
        motion = free @ modes.real
        strain = springs.diagonal()[:, None] * (motion[:, : self.n] - motion[:, self.n :]) ** 2
        share = strain[:, joint] / np.maximum(strain.sum(axis=1), 1e-300)
        chosen = np.argmax(np.where(squares.real > 1e-6 * squares.real.max(), share, -1.0), axis=1)
        found = np.take_along_axis(squares.real, chosen[:, None], axis=1)
        return float(np.median(np.sqrt(np.maximum(found, 0.0)))) / (2 * np.pi)

    def _free(self, soft: NDArray[np.bool_], held: int | None) -> Array:
        """Return what links and motors do per free coordinate: the links, and the motors of elastic joints."""
        one = np.eye(self.n)
        motors = np.flatnonzero(soft & (np.arange(self.n) != (-1 if held is None else held)))
        return np.block([[one, np.zeros((self.n, len(motors)))], [np.where(soft, 0.0, one), one[:, motors]]])
