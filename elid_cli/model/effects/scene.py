"""What effects are computed from: the motion, the torques and the model as far as it is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from elid_cli._types import Array
from elid_cli.model.terms.base_term import Side
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion

if TYPE_CHECKING:
    from elid_cli.model.effects.effect import Effect

DIRECTION_WIDTH = 5e-3
"""Joint-side speed, rad/s, over which sign(v) is rounded as tanh(v / width), in effects and simulations only."""
ARM = 0.1
"""m; speeds of prismatic joints count as those of a point at this distance from a revolute joint's axis. Rounded over
5 mm/s, the friction of a lift at 0.2 m/s would look like Stribeck friction."""


T = TypeVar("T")


class EquationRow(NamedTuple):
    """A row of eq. (13): the link or motor equation of joint `joint` (from 0)."""

    side: Side
    joint: int


@dataclass(frozen=True)
class Scene:
    """What effects are computed from: the motion, the torques and the model as far as it is known.

    Arrays are (N, n), SI, at N consecutive instants `dt` apart (N = 1 in a simulator).
    """

    robot: Robot
    motion: Motion
    dt: float
    tau: Array
    """Motor torque as logged."""
    load: Array
    """Torque through the transmission, K (theta - q) or its best estimate (zeros where unknown)."""
    predicted: Array
    """Motor torque that the present model predicts (zeros where unknown)."""
    parameters: Array
    """Standard parameters of the present model, any representative of the base parameters, shape (p,)."""
    duration: float
    """Length of the whole log, s; effects that vary with time are scaled by it."""
    stiffness: Array
    """Transmission stiffness as far as known, shape (n,); NaN where unknown or rigid."""
    rotors: Mapping[int, float] = field(default_factory=dict)
    """Inertia at the joint, kg·m² (kg), that `load` leaves to the rotor of a rigid joint, where motion shows rotor and
    bodies in sums only: the robot file's, which is a reference, or what friction under load tells."""
    with_bodies: Mapping[int, float] = field(default_factory=dict)
    """Inertia at the joint, kg·m² (kg), that `parameters` count to the bodies and `load` leaves to the rotor."""
    cutoff: float = np.inf
    """Frequency up to which the equations are compared, Hz."""
    starts: Sequence[int] = (0,)
    """Indices at which a new segment begins; effects with memory start afresh there."""
    temperature: Array | None = None
    command_torque: Array | None = None
    """The part of the motor torques that a delay of the channel moves; None: all of them."""
    error_integral: Array | None = None
    """Integral of kp (q_des - q) in logs of commands, N·m·s (N·s), (N, n); None in others."""
    tau_link: Array | None = None
    """Measured torque in the transmission, where joint torque sensors exist."""
    rounding: Array | None = None
    """Speed over which the sign of motors' velocity is rounded, (n,); None: `DIRECTION_WIDTH`."""
    found: Sequence[tuple[Effect, Array]] = ()
    """Effects that the present model has beside its parameters, with their amplitudes, (d,)."""
    alone: Array | None = None
    """What the parameters alone predict, where `predicted` holds the torque of the effects, too; None: it does not."""
    late: Array | None = None
    """Delays of the torque channels, s, (n,), that the present model corrects to first order; None: it corrects none.
    """
    cache: dict[object, Any] = field(default_factory=dict, compare=False, repr=False)
    """Results that several effects share, keyed by (name, …)."""
    _of_motion: dict[object, Any] = field(init=False, default_factory=dict, compare=False, repr=False)

    @property
    def samples(self) -> int:
        """Number of instants."""
        return self.motion.samples

    def of_motion(self, key: object, make: Callable[[], T]) -> T:
        """Return what follows from the motion alone; it is kept by its key, but for a simulator's one instant."""
        if self.samples == 1:
            return make()
        if key not in self._of_motion:
            self._of_motion[key] = make()
        found: T = self._of_motion[key]
        return found

    def direction(self, joint: int) -> Array:
        """Return the rounded sign of motor velocity, shape (N,), which nobody may change."""
        width = float((direction_widths(self.robot) if self.rounding is None else self.rounding)[joint])
        return self.of_motion(("direction", joint), lambda: np.tanh(self.motion.dtheta[:, joint] / width))

    def speed(self, joint: int) -> Array:
        """Return the size of motor velocity, shape (N,), which nobody may change."""
        return self.of_motion(("speed", joint), lambda: np.abs(self.motion.dtheta[:, joint]))

    def top_speed(self, joint: int, share: float = 0.98) -> float:
        """Return the motor velocity that is not exceeded in a share of the instants."""
        return self.of_motion(("top", joint, share), lambda: float(np.quantile(self.speed(joint), share)))

    def coulomb(self, joint: int) -> float:
        """Return a joint's Coulomb friction as the present model has it, N·m (N)."""
        return float(self.parameters[self.robot.parameter_names().index(StandardParameter("fs", joint))])

    def deflection(self, joint: int) -> Array:
        """Return q - theta, shape (N,)."""
        return self.motion.q[:, joint] - self.motion.theta[:, joint]


def direction_widths(robot: Robot, width: float = DIRECTION_WIDTH) -> Array:
    """Return the speed over which the sign of each joint's velocity is rounded, (n,), rad/s or m/s."""
    return np.array([width if joint.revolute else ARM * width for joint in robot.joints])


def with_stiffness(scene: Scene, joint: int, stiffness: float) -> Scene:
    """Return a scene with another stiffness of a joint, as its file has it or by which its standard error moves it.

    A fit without a fault between the encoders takes what that adds for a deflection, and its K comes out too small.
    """
    known = np.array(scene.stiffness, dtype=float)
    known[joint] = stiffness
    return replace(scene, stiffness=known)
