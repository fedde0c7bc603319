"""One stretch of motor positions and torques as the motor side's estimation uses it: thinned, its noise and band known.

Noise is what the spectrum shows where nothing moves; the band ends where the positions sink into it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import LinkSensors
from elid_cli.estimation.motor_side.operators import SHORT_WIDTH, WIDTH, stencil, thin

HIGHEST = 70.0
"""Limit of a band, Hz: above, splines would need too many knots."""
HIGHEST_OF_RATE = 0.12
"""The same over the sample rate: two samples per knot."""
QUIET = (0.55, 0.97)
"""Part of the spectrum up to the Nyquist frequency that holds noise only."""
STRIBECK_WIDTHS = (2.5, 6.0, 14.0)
"""Widths of the friction's bumps, in units of its own width at zero speed."""
HARRIS = (0.35875, -0.48829, 0.14128, -0.01168)
"""Terms of the Blackman-Harris window (Harris 1978), of cosines of 0 to 3 turns."""
_SUBSAMPLES = 9


@dataclass(frozen=True)
class Samples:
    """Samples of motors on one even time base, with what their noise is."""

    t: Array
    """s, (N,)."""
    theta: Array
    """rad (m) at the joint, (N, n)."""
    tau: Array
    """N·m (N) at the joint, (N, n)."""
    width: Array
    """Speed within which friction changes its sign, rad/s (m/s), (n,)."""
    noise: tuple[Array, Array]
    """Standard deviations of theta's and tau's white noise, (n,) each."""
    sensors: tuple[LinkSensors, ...]
    """Sensors on links, of every kind."""

    def part(self, part: slice) -> Samples:
        """Return some of the samples, their noise being what the whole shows."""
        seen = tuple(own.part(part) for own in self.sensors)
        return replace(self, t=self.t[part], theta=self.theta[part], tau=self.tau[part], sensors=seen)

    @property
    def rate(self) -> float:
        """Hz."""
        return (len(self.t) - 1) / float(self.t[-1] - self.t[0])


def samples_of(t: Array, theta: Array, tau: Array, width: Array, sensors: Sequence[LinkSensors]) -> Samples:
    """Return samples with the noise that their spectra show."""
    rate = (len(t) - 1) / float(t[-1] - t[0])
    seen = tuple(replace(own, noise=noise_of(own.values, rate)) if own.joints else own for own in sensors)
    return Samples(t, theta, tau, width, (noise_of(theta, rate), noise_of(tau, rate)), seen)


def noise_of(values: Array, rate: float) -> Array:
    """Return the standard deviation of white noise of each column (N, n) from the quiet end of its spectrum, (n,)."""
    f, power = spectrum(values, rate, min(1024, len(values) // 4 * 2))
    quiet = (f > QUIET[0] * rate / 2) & (f < QUIET[1] * rate / 2)
    found: Array = np.sqrt(np.median(power[quiet], axis=0) / 0.97 * rate / 2)
    return found


def spectrum(values: Array, rate: float, size: int) -> tuple[Array, Array]:
    """Return frequencies, Hz, and one-sided power densities of columns (N, n) by Welch's method (1967).

    Half-overlapping pieces of `size` samples under a four-term Blackman-Harris window, their means taken off.
    """
    window = np.polynomial.chebyshev.chebval(np.cos(2 * np.pi * np.arange(size) / size), HARRIS)
    starts = range(0, len(values) - size + 1, size - size // 2)
    pieces = np.stack([values[start : start + size] for start in starts])
    pieces = (pieces - pieces.mean(axis=1, keepdims=True)) * window[:, None]
    power = np.asarray(np.mean(np.abs(np.fft.rfft(pieces, axis=1)) ** 2, axis=0), dtype=np.float64)
    power /= rate * float(window @ window)
    power[1:-1] *= 2
    f = np.asarray(np.fft.rfftfreq(size, 1 / rate), dtype=np.float64)
    return f, power


def band_of(values: Array, noise: Array, rate: float) -> Array:
    """Return the highest frequency at which each column (N, n) clearly exceeds its noise (n,), Hz, (n,)."""
    f, power = spectrum(values, rate, min(2048, len(values) // 2))
    loud = (power > 6.0 * noise**2 / (rate / 2)) & (f < min(HIGHEST, HIGHEST_OF_RATE * rate))[:, None]
    highest = [f[np.flatnonzero(column)[-1]] if column.any() else 0.0 for column in loud.T]
    return np.array(highest)


class MotorLog:
    """A stretch thinned to at most `rate`, Hz, with difference operators and friction's shapes.

    Every sample is a mean under a triangular kernel; friction, which is not linear, is averaged under the same one.
    """

    def __init__(self, samples: Samples, rate: float) -> None:
        step = max(1, round(samples.rate / rate))
        theta_noise, tau_noise = samples.noise
        self.samples = samples
        self.theta, gain = thin(samples.theta, step)
        self.tau, _ = thin(samples.tau, step)
        self.dt = step / samples.rate
        self.count, self.n = self.theta.shape
        self.t = samples.t[0] + (step - 1) / samples.rate + np.arange(self.count) * self.dt
        self.theta_noise = np.maximum(theta_noise * gain, 1e-9 * self.theta.std(axis=0) + 1e-15)
        self.tau_noise = np.maximum(tau_noise * gain, 1e-6 * self.tau.std(axis=0) + 1e-12)
        self.torque = np.maximum(self.tau.std(axis=0), 1e-12)
        """Standard deviation of the torques, N·m (N), (n,)."""
        own = [thin(kind.values, step)[0] if kind.joints else np.zeros((self.count, 0)) for kind in samples.sensors]
        self.sensed = np.concatenate(own, axis=1)
        """What sensors on links measure, kind by kind, (N, 3 m)."""
        noise, spread = np.concatenate([kind.noise for kind in samples.sensors]), self.sensed.std(axis=0)
        self.sensed_noise = np.maximum(noise * gain, 1e-6 * spread + 1e-12)
        floors = [np.full(len(kind.noise), kind.kind.floor) for kind in samples.sensors]
        self.sensed_size = np.concatenate(floors) * spread
        """What the least noise of their rows is a share of, (3 m,)."""
        self.width = samples.width
        self._averaged = _kernel_instants(step, samples.rate)
        self._kept: dict[object, Any] = {}

    def kept(self, name: object, made: Callable[[], Any]) -> Any:
        """Return what several fits of this log use, made once."""
        if name not in self._kept:
            self._kept[name] = made()
        return self._kept[name]

    @cached_property
    def rates(self) -> tuple[Any, Any]:
        """First and second differences over nine samples."""
        return stencil(self.count, 1, WIDTH, self.dt), stencil(self.count, 2, WIDTH, self.dt)

    @cached_property
    def short_rates(self) -> tuple[Any, Any]:
        """First and second differences over few samples, for small corrections."""
        return stencil(self.count, 1, SHORT_WIDTH, self.dt), stencil(self.count, 2, SHORT_WIDTH, self.dt)

    @cached_property
    def _acting(self) -> Any:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.t, self.tau)

    def torque_at(self, delay: float) -> Array:
        """Return the torques as they acted `delay` s before, (N, n)."""
        return self.tau if delay == 0 else np.asarray(self._acting(self.t - delay))

    def direction(self, speed: Array, acceleration: Array) -> Array:
        """Return friction's smooth sign of the speed under the thinning kernel, (N, n)."""
        found = np.zeros_like(speed)
        for shift, weight in self._averaged:
            found += weight * np.tanh((speed + acceleration * shift) / self.width)
        return found

    def direction_slopes(self, speed: Array, acceleration: Array) -> Array:
        """Return the derivatives of `direction` by speed and acceleration, (2, N, n)."""
        found = np.zeros((2, *speed.shape))
        for shift, weight in self._averaged:
            slope = 1 - np.tanh((speed + acceleration * shift) / self.width) ** 2
            slope *= weight / self.width
            found[0] += slope
            found[1] += shift * slope
        return found

    def bumps(self, speed: Array, acceleration: Array) -> Array:
        """Return sign(v) exp(-(v/w)²) of every Stribeck width, under the kernel, too, (bumps, N, n)."""
        found = np.zeros((len(STRIBECK_WIDTHS), *speed.shape))
        for shift, weight in self._averaged:
            v = (speed + acceleration * shift) / self.width
            sign, square = weight * np.tanh(v), v**2
            for bump, share in zip(found, STRIBECK_WIDTHS, strict=True):
                bump += sign * np.exp(square * (-1 / share**2))
        return found

    def bump_slopes(self, speed: Array, acceleration: Array) -> Array:
        """Return the derivatives of `bumps` by speed and acceleration, (2, bumps, N, n)."""
        found = np.zeros((2, len(STRIBECK_WIDTHS), *speed.shape))
        for shift, weight in self._averaged:
            v = (speed + acceleration * shift) / self.width
            sign, square, over = np.tanh(v), v**2, weight / self.width
            steep, bent = (1 - sign**2) * over, (2 * v * sign) * over
            for k, share in enumerate(STRIBECK_WIDTHS):
                slope = (steep - bent * (1 / share**2)) * np.exp(square * (-1 / share**2))
                found[0, k] += slope
                found[1, k] += shift * slope
        return found


def _kernel_instants(step: int, rate: float) -> list[tuple[float, float]]:
    """Return instants within the thinning kernel, s from its middle, and their weights."""
    if step == 1:
        return [(0.0, 1.0)]
    place = np.linspace(-1, 1, _SUBSAMPLES)[1:-1]
    weight = (1 - np.abs(place)) / np.sum(1 - np.abs(place))
    return list(zip((place * step / rate).tolist(), weight.tolist(), strict=True))
