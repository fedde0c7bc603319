"""One fit's stretch of log: what it reaches, and the knots, filters and problems that follow from that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.latent import Latent
from elid_cli.estimation.motor_side.link_side import LinkSide
from elid_cli.estimation.motor_side.motor_log import MotorLog, Samples, band_of
from elid_cli.estimation.motor_side.unknowns import RotorPrior, Unknowns

LOWEST_BAND = 4.0
"""Hz; knots for less would not follow friction."""
TORQUE_CUT = 1.2
"""Cut-off of the torque rows over the end of the band."""
KNOT_SHARE, KNOTS = 0.2, (0.003, 0.012)
"""Distance of knots in periods of the band's end, and its limits, s."""
FELT = 0.5
"""The same over that where accelerometers feel the second derivative itself. Measured: arms of two joints without noise
at ordinary knots up to 2.6 % too stiff, at half the distance 0.3 %."""

ROUGH, ROUGH_TORQUE, FINER = 3e-5, 0.003, 3.0
"""Noise of positions and torques, shares of their standard deviations, to which a search takes finer ones to be, where
positions are finer by this factor: their valleys are so narrow, and reach so high in frequency, that a search from
rigid joints ends beside them (measured: `planar2` with positions to 3e-6 of their size, none of 18 logs found)."""


@dataclass(frozen=True)
class Setting:
    """A stretch of log, its robot's link side and what is known of the rotors."""

    samples: Samples
    link: LinkSide
    rotors: RotorPrior

    @cached_property
    def bands(self) -> Array:
        """Highest frequency at which each joint's position exceeds its noise, Hz, (n,)."""
        return band_of(self.samples.theta, self.samples.noise[0], self.samples.rate)

    @cached_property
    def band(self) -> float:
        """The highest frequency at which positions or sensors on links exceed their noise, Hz, for knots and filters.

        Accelerometers see links ring where positions show nothing: knots that cannot follow that bend the stiffness.
        """
        own = [band_of(kind.values, kind.noise, self.samples.rate) for kind in self.samples.sensors if kind.joints]
        return max(float(np.concatenate([self.bands, *own]).max()), LOWEST_BAND)

    @property
    def rougher(self) -> Setting | None:
        """The same as if its sensors were rougher, for a search; None where that makes no difference."""
        positions, torques = self.samples.noise
        rough = ROUGH * self.samples.theta.std(axis=0), ROUGH_TORQUE * self.samples.tau.std(axis=0)
        if not np.any(rough[0] > FINER * positions):
            return None
        noise = np.maximum(positions, rough[0]), np.maximum(torques, rough[1])
        return replace(self, samples=replace(self.samples, noise=noise))

    def within(self, factor: float) -> Setting:
        """Return the same with friction that changes its sign within another speed, by its factor."""
        return replace(self, samples=replace(self.samples, width=factor * self.samples.width))

    @property
    def spacing(self) -> float:
        """Distance of knots, s."""
        share = KNOT_SHARE * (FELT if any(kind.joints and kind.kind.placed for kind in self.samples.sensors) else 1.0)
        return float(np.clip(share / self.band, *KNOTS))

    @property
    def cutoff(self) -> float:
        """Cut-off of the torque rows, Hz."""
        return TORQUE_CUT * self.band

    @cached_property
    def log(self) -> MotorLog:
        """The stretch with two samples per knot."""
        return MotorLog(self.samples, 2 / self.spacing)

    @cached_property
    def unknowns(self) -> Unknowns:
        """The unknowns."""
        return Unknowns(self.link)

    def problem(self, parts: Sequence[str], lost_scale: Array | None = None) -> Latent:
        """Return the latent problem with some of the columns that are optional."""
        return Latent(self.log, self.unknowns, self.spacing, self.rotors, parts, lost_scale)
