"""Flexible mode: a link, tool or base that swings at a frequency of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.free_decay import decaying, free_decay, missing_torque
from elid_cli.model.effects.kinds import OscillatorEffect
from elid_cli.model.effects.rows import link_row
from elid_cli.model.effects.scene import Scene

SPACING = 1.12
"""Ratio of neighbouring frequencies: a search from the nearest one still climbs the right peak."""
LOWEST = 2.5
"""Hz; below it a mode lies among the frequencies of the motion, where it imitates anything."""
STANDING = 0.02
"""Share of the top speed below which a joint counts as standing at a segment's start."""


class FlexibleMode(OscillatorEffect):
    """An inertia on a spring, carried by one link and shaken by its acceleration.

    z is its angle against the link: z'' = -ω² z - 2 ζ ω z' - q''. The link feels the spring and damper that hold it.
    Slowly moved, the column is q'' itself, a rigid inertia that the base parameters hold already.
    """

    name = "flexible_mode"
    summary = "structural vibration of link or base at a fixed frequency"
    equation = "link equation: -inertia (ω² z + 2 damping ω z'),  z'' = -ω² z - 2 damping ω z' - q'',  ω = 2π frequency"
    physics = "A slender link, a tool, a pedestal or a cable package bends and rings after every jerk."
    typical = "5-40 Hz, damping ratio 0.005-0.05"
    fingerprint = "whole joint, one frequency, the same at every speed, that rings after jerks"
    record = "jerky motion, logged and filtered well above the frequency; an accelerometer on the suspect"
    place = "link"
    least_gain = 0.15  # its column lives where the splines' errors are largest
    amplitudes = (Parameter("inertia", "kg·m²", "inertia that swings", low=0.0),)
    shapes = (
        Parameter("frequency", "Hz", "its natural frequency with the link held", low=0.05),
        Parameter("damping", "1", "its damping ratio", low=1e-4, high=0.9),
    )
    example = {"inertia": 0.3, "frequency": 9.0, "damping": 0.02}
    like_a_spring = True

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return frequencies spread over what the log resolves, and the strongest lines of the unexplained torque."""
        length = scene.samples * scene.dt
        low, high = max(LOWEST, 4.0 / length if length > 0 else LOWEST), min(40.0, 0.2 / scene.dt)
        if high <= low:
            return []
        spread = np.geomspace(low, high, max(2, round(math.log(high / low) / math.log(SPACING)))).tolist()
        return [(f, 0.02) for f in sorted({*spread, *lines(scene, joint, low, high)})]

    @classmethod
    def distinct(cls, scene: Scene, joint: int, shape: Sequence[float], present: Sequence[Sequence[float]]) -> bool:
        """Whether the frequency is another one."""
        return all(abs(math.log(shape[0] / other[0])) > 2 * math.log(SPACING) for other in present)

    @property
    def pole(self) -> complex:
        """Pole of the oscillator in the upper half plane, rad/s."""
        omega, zeta = 2 * math.pi * self.shape[0], self.shape[1]
        return complex(-zeta * omega, omega * math.sqrt(1 - zeta**2))

    def rates(self, scene: Scene, state: Array) -> Array:
        """Return (z', z'') for states (z, z')."""
        omega, zeta = 2 * math.pi * self.shape[0], self.shape[1]
        z, dz = state
        return np.stack([dz, -(omega**2) * z - 2 * zeta * omega * dz - scene.motion.ddq[:, self.joint]])

    def columns_of(self, scene: Scene, state: Array) -> Columns:
        """Return the column of the inertia in the link row."""
        omega, zeta = 2 * math.pi * self.shape[0], self.shape[1]
        return link_row(self.joint, -(omega**2 * state[0] + 2 * zeta * omega * state[1]))

    def columns(self, scene: Scene) -> Columns:
        """Run the oscillator through the log; every segment starts with the vibration that its torque shows."""
        return self._with_starts(scene, [pair for pair in scene.found if not self._is_same(pair[0])])

    def _with_starts(self, scene: Scene, others: Sequence[tuple[Effect, Array]]) -> Columns:
        """Return the column with the free decays that what is missing beside other effects shows."""
        modes = [(effect, linear) for effect, linear in others if isinstance(effect, FlexibleMode)]
        rest = [pair for pair in others if not isinstance(pair[0], FlexibleMode)]
        missing = missing_torque(scene, self.joint, rest)
        ((row, (response,)),) = self.columns_of(scene, self.history(scene)).items()
        for mode, linear in modes:
            if mode.joint == self.joint:  # other modes as they are where this one is not known: no circle
                missing = missing - linear @ mode._with_starts(scene, [])[row]
        return {row: (response + free_decay(scene, self.joint, self.pole, response, missing))[None]}

    def _is_same(self, other: Effect) -> bool:
        """Whether an effect is this mode, at whatever shape it had before."""
        same = isinstance(other, FlexibleMode) and other.joint == self.joint
        return same and abs(math.log(self.shape[0] / other.shape[0])) <= 2 * math.log(SPACING)

    def history(self, scene: Scene) -> Array:
        """Return (z, z') at every instant, shape (2, N), exact for an acceleration that is linear between samples.

        Every segment starts as if its first acceleration had lasted for long, or at rest.
        """
        pole, dt = self.pole, scene.dt
        step = np.exp(pole * dt)
        whole = (step - 1) / pole  # what a constant input adds in a step
        ramp = (step - 1 - pole * dt) / (pole**2 * dt)  # what one that rises from 0 to 1 adds
        states = np.zeros((2, scene.samples))
        bounds = [*sorted({0, *scene.starts}), scene.samples]
        for start, stop in pairwise(bounds):
            push = scene.motion.ddq[start:stop, self.joint]
            if not len(push):
                continue
            # a joint that stands has not shaken anything yet; one that moves has done so for long
            speed = scene.motion.dq[start:stop, self.joint]
            standing = abs(speed[0]) <= STANDING * float(np.max(np.abs(speed)))
            rest = 0.0 if standing else -push[0] / pole  # y of y' = pole y + push that a constant push leaves alone
            driven = ramp * push
            driven[1:] += (whole - ramp) * push[:-1]
            driven[0] = rest
            y = decaying(complex(step), driven)
            # impulse response of z: -exp(-ζωt) sin(ω_d t)/ω_d
            states[0, start:stop] = -y.imag / pole.imag
            states[1, start:stop] = -(pole * y + push).imag / pole.imag
        return states


def lines(scene: Scene, joint: int, low: float, high: float, most: int = 3) -> list[float]:
    """Return the frequencies (Hz) at which the torque's spectrum stands out most against its prediction."""
    missing = scene.tau[:, joint] - scene.predicted[:, joint]
    size = min(len(missing), 1 << round(math.log2(max(8.0 / scene.dt, 64.0))))
    if size < 64 or not np.any(scene.predicted[:, joint]):
        return []
    window = np.hanning(size)
    pieces = [missing[k : k + size] for k in range(0, len(missing) - size + 1, size // 2)]
    power = np.mean([np.abs(np.fft.rfft(window * (piece - piece.mean()))) ** 2 for piece in pieces], axis=0)
    frequency = np.fft.rfftfreq(size, scene.dt)
    # against the median of the neighbourhood, since the spectrum falls steeply
    width = 15
    padded = np.pad(power, width, mode="edge")
    level = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1), axis=1)
    ratio = np.where((frequency > low) & (frequency < high), power / np.maximum(level, 1e-300), 0.0)
    found = []
    for _ in range(most):
        k = int(np.argmax(ratio))
        if ratio[k] < 4:
            break
        found.append(float(frequency[k]))
        ratio[max(k - 6, 0) : k + 7] = 0.0
    return found
