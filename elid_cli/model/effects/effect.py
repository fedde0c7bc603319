"""What an effect knows: a term that the 14-parameters-per-joint model lacks.

An effect is one file in `library` holding one subclass of `Effect`, and no other file knows its name: whatever a fit,
a search or a report must know of it, it says of itself here. Its formula stands once, in `columns`:
identification, diagnosis and prediction evaluate it on a whole log, the simulator on one instant at a time.
All columns are on the model's side of the equation (model = torque), so a positive friction has a positive
coefficient in the motor row. A spring-path effect enters the link row with + and the motor row with -.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.parameter import Parameter as Parameter
from elid_cli.model.effects.relations import Member as Member
from elid_cli.model.effects.relations import Same as Same
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.robot import Robot

Shapes = tuple[tuple[float, ...], ...]
"""Shapes of several terms."""
Simulated = Literal["torque", "robot", "motor", "log", "loop"]
"""How an effect enters a simulation: ``torque`` through its columns (or its state), ``robot`` by `Effect.altered`,
``motor`` by `Effect.delivered`, ``log`` by `Effect.logged`; ``loop`` by a drive's position loop, in a replay alone."""
Place = Literal["motor", "link", "spring", "chain", "torque", "encoder", "sensor"]
"""Where an effect acts: a motor row, a link row, both rows of the spring with opposite signs, the link rows of
the whole chain, the torque channel, the position channels, or the reading of the joint torque sensor."""

Channel = Literal["link", "position", "torque"]
"""Channels that may be late: positions and velocities of the link, or of link and motor, and torque of the motor."""
Nuisance = Literal["delay", "offset", "reading gain", "reading offset"]
"""Faults of a motor's torque channel, and of a joint torque sensor, that every fit estimates along."""
Columns = Mapping[EquationRow, Array]
"""Row -> array (d, N), one row per amplitude, in the order of `Effect.amplitudes`."""


@dataclass(frozen=True)
class Alteration:
    """Another robot, or other standard parameters, from time `start` (s) on (see `Effect.altered`)."""

    start: float
    robot: Robot
    parameters: Array


class Effect(ABC):
    """One effect at one joint; instances carry the joint and the shape, amplitudes are fitted linearly.

    Parameters
    ----------
    joint
        Joint number from 0 (for effects of the whole robot: 0).
    shape
        Values of `shapes`, in order.
    """

    name: ClassVar[str]
    title: ClassVar[str] = ""
    """What sentences call it where its name, read aloud, is not enough."""
    summary: ClassVar[str]
    """One line for lists: what it is."""
    equation: ClassVar[str]
    physics: ClassVar[str]
    typical: ClassVar[str]
    fingerprint: ClassVar[str]
    """What its residual organises against, in which rows."""
    record: ClassVar[str]
    """What to record in order to see it and to separate it from its twins."""
    place: ClassVar[Place]
    amplitudes: ClassVar[tuple[Parameter, ...]]
    """Linear parameters."""
    shapes: ClassVar[tuple[Parameter, ...]] = ()
    """Nonlinear parameters."""
    example: ClassVar[Mapping[str, float]]
    """A value of every parameter that a file must give, such as a robot of some kg and some 100 N·m may have."""
    twins: ClassVar[tuple[str, ...]] = ()
    """Effects that no data, or only special data, can tell apart from this one; see `twins_of`."""
    taken: ClassVar[str] = ""
    """What its form takes for granted that few logs tell, as sentences; not where a joint has what it `comes_with`."""
    comes_with: ClassVar[tuple[str, ...]] = ()
    """Effects that a joint which has it has as a rule: a search looks for it beside them."""
    elastic_only: ClassVar[bool] = False
    """Whether it needs an elastic transmission (of the link's own: or a torque that is read behind the motor)."""
    strains_spring: ClassVar[bool] = False
    """Whether the amplitudes are angles (or times) that strain the spring, whose K makes torques of them."""
    like_weight: ClassVar[bool] = False
    """Whether masses and first moments take up nearly all of it, so that a fit that leaves noise asks for its size."""
    like_a_spring: ClassVar[bool] = False
    """Whether a joint's own transmission looks like it where the link's position is not logged."""
    of_channel: ClassVar[bool] = False
    """Whether it is in the torque channel, wherever that is read, although it stands in the motor row."""
    whole_robot: ClassVar[bool] = False
    """Whether the effect belongs to no single joint."""
    least_gain: ClassVar[float] = 0.1
    """Part of the held-out residual variance that a named effect takes away: smoothing imitates any less."""
    local: ClassVar[bool] = False
    """Whether the effect lives in a part of the log only, so that cross-validation over time cannot judge it."""
    carried: ClassVar[bool] = False
    """Whether it is a load that the body at the end of a branch takes up or puts down. One effect."""
    event: ClassVar[bool] = False
    """Whether it is something that happened while one log was recorded, and nothing of the robot: no file holds it."""
    from_model: ClassVar[bool] = False
    """Whether the columns come from the present model's torques, so that a fit has to be repeated until both agree."""
    quasi_static: ClassVar[bool] = False
    """Whether its form holds at low frequencies alone, and all joints that can have it are fitted with it together."""
    from_torque: ClassVar[bool] = False
    """Whether `Scene.predicted` has to hold the torque of the effects, too, its own among them."""
    of_motor_speed: ClassVar[bool] = False
    """Whether the columns follow from the speed of the joint's motor alone."""
    takes_energy: ClassVar[bool] = False
    """Whether it is a part of the motor's friction, which, all parts together, never drives the joint."""
    either_sign: ClassVar[str] = ""
    """Why physics allows amplitudes of both signs; empty: those in their bounds, of friction what does not drive."""
    memory: ClassVar[bool] = False
    """Whether the effect has an internal state (see `MemoryEffect`)."""
    by_motion: ClassVar[bool] = True
    """Whether a motion that is simulated under commands can hold it beside the dry friction that it has itself."""
    searched: ClassVar[bool] = True
    """Whether a diagnosis tries the effect by itself."""
    corrects: ClassVar[Channel | None] = None
    """The channel that is late by the first parameter, s: once known it is moved in time. One effect per channel."""
    turns_gravity: ClassVar[bool] = False
    """Whether the amplitudes are angles by which gravity is turned in the model itself, once known. One effect."""
    moves_zero: ClassVar[bool] = False
    """Whether its amplitude is by how much a joint's positions are read too large, in commands as well. One effect."""
    nuisance: ClassVar[Nuisance | None] = None
    """The nuisance that it is where every fit estimates it along. One effect per nuisance."""
    in_deflection: ClassVar[Literal["velocity", "constant", "position", "turn", ""]] = ""
    """What it adds to the deflection as two encoders show it. Such faults imitate physics: they are tried before."""
    usual_first: ClassVar[bool] = False
    """Whether the grid holds the forms in the order of their use: of equals the first is named."""
    always_fitted: ClassVar[str] = ""
    """Why the effect stays in the model where part of the log speaks against naming it; empty: it does not stay."""
    members: ClassVar[Mapping[str, Member]] = {}
    """Nested members of a family, the simplest first, by their published names; see `friction_family`."""
    acts_as: ClassVar[Literal["", "torque", "friction", "directed friction"]] = ""
    """What a simulator that lacks it applies by its parameters (docs/how-to/mujoco_effects.py): a torque; dry friction,
    which holds a joint at rest; that of unlike sizes forwards and backwards, as a torque; empty: nothing."""
    softens: ClassVar[bool] = False
    """Whether its amplitude is the Coulomb friction that fades in (`elid_cli.model.drives.Fading`) by its shape."""
    of_drive: ClassVar[Literal["", "limit", "gain", "kp", "kd", "integral", "filter", "hold", "step"]] = ""
    """What of a drive it is: largest torque (first shape), factor, integral gain over kp, filter of velocity, time that
    its torque is held for, step of the simulator that it acts in."""
    simulated: ClassVar[Simulated] = "torque"
    """Which of the simulator's hooks brings the effect into a simulated log."""

    def __init__(self, joint: int, shape: Sequence[float] = ()) -> None:
        if len(shape) != len(self.shapes):
            raise ValueError(f"{self.name} has {len(self.shapes)} shape parameters, got {len(shape)}")
        self.joint = joint
        self.shape = tuple(float(value) for value in shape)

    @classmethod
    def summary_of(cls, terms: Sequence[Mapping[str, float]], errors: Sequence[Mapping[str, float]] = ()) -> str:
        """Return what it is with these values of its parameters, where they say it more closely than `summary`.

        Parameters
        ----------
        terms, errors
            Of every term that it has at one joint, the values of its parameters and their standard errors.
        """
        return cls.summary

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return shapes from which a search starts, scaled to what the log holds; [()] without shapes.

        An empty list says that the log cannot show this effect at all (no torque near a limit, no full turn…).
        """
        return [()]

    @classmethod
    def same_here(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Same, ...]:
        """Return the twins that this log shows no difference from at all, whatever their size."""
        return ()

    @classmethod
    def can_be(cls, scene: Scene, joint: int, values: Mapping[str, float], errors: Mapping[str, float]) -> bool:
        """Return whether values and their standard errors leave room for one that can be built, in a twin's place."""
        return True

    @classmethod
    def same_together(cls, robot: Robot, found: Mapping[int, Mapping[str, float]]) -> tuple[Same, ...]:
        """Return what effects of this kind, by joint with their parameters, are together the same as."""
        return ()

    @classmethod
    def distinct(cls, scene: Scene, joint: int, shape: Sequence[float], present: Sequence[Sequence[float]]) -> bool:
        """Return whether the effect can stand at a joint in this shape, too, beside those with shapes `present`."""
        return not present

    @classmethod
    def holds(cls) -> bool:
        """Whether it is dry friction of a motor: a size times the direction of motion, which holds a joint at rest."""
        return cls.place == "motor" and cls.acts_as in ("friction", "directed friction")

    @classmethod
    def whole_curves(cls, scene: Scene, joint: int, shape: Sequence[float]) -> tuple[Shapes, ...]:
        """Return the curves that one term of this shape can be a part of: the shapes of their terms to start from.

        The usual curve comes first, and in it the term that is most like this one; () for most effects. A search finds
        one term of such a curve, whose other terms hide in the noise that it works under.
        """
        return ()

    @classmethod
    def looks(cls, scene: Scene, joint: int) -> int:
        """Return how many shapes the grid was chosen from: the look-elsewhere factor of a search."""
        return max(1, len(cls.grid(scene, joint)))

    @classmethod
    def reach(cls, scene: Scene, joint: int, shape: Sequence[float]) -> float:
        """Return how far around a shape of the grid a search refines it: the largest logarithm of a factor on it."""
        return 0.08 if cls.shapes and cls.shapes[0].name == "frequency" else 0.7

    @classmethod
    def applies(cls, robot: Robot, joint: int) -> bool:
        """Whether the effect can exist at this joint."""
        return not cls.unfit(robot, joint)

    @classmethod
    def number(cls, robot: Robot, joint: str | None) -> int:
        """Return the number of the joint at which a file declares it, by its name: 0 for effects of the whole robot."""
        return 0 if joint is None or cls.whole_robot else robot.joint_names.index(joint)

    def joint_name(self, robot: Robot) -> str | None:
        """Return the name of its joint; None for an effect of the whole robot."""
        return None if self.whole_robot else robot.joint_names[self.joint]

    @classmethod
    def unfit(cls, robot: Robot, joint: int) -> str:
        """Return why the effect cannot exist at this joint, as a sentence about it; empty where it can."""
        if cls.whole_robot and joint != 0:
            return "it belongs to the whole robot, not to one joint"
        at, behind = robot.joints[joint], robot.joints[joint].torque_at == "link"
        if cls.elastic_only and not (at.elastic or (behind and cls.place == "link")):
            return f"it needs an elastic transmission, and that of {at.name} is rigid"
        if cls.place == "motor" and not cls.of_channel and behind:
            return f"it needs the torque of the motor, and that of {at.name} is read behind it"
        return ""

    @classmethod
    def in_sums(cls, robot: Robot, joint: str | None = None) -> dict[str, str]:
        """Return, by amplitude, the sum that its value is of where motion shows no more, as ``m + 2*Iyy``."""
        return {}

    @abstractmethod
    def columns(self, scene: Scene) -> Columns:
        """Return the columns of the amplitudes in the rows they act on (link and motor rows, model side).

        A row of zeros is an amplitude that this robot cannot show (a tilt about an axis that no joint feels); its
        coefficient is 0.
        """

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return the parameters as files and reports name them, from fitted linear coefficients (d,).

        The default pairs `amplitudes` with the coefficients, in their `unit`, and `shapes` with the shape.
        """
        unit = self.unit(scene, self.joint)
        values = {p.name: float(c) / unit for p, c in zip(self.amplitudes, coefficients, strict=True)}
        values |= {p.name: s for p, s in zip(self.shapes, self.shape, strict=True)}
        return values

    @classmethod
    def unit(cls, scene: Scene, joint: int) -> float:
        """Return the coefficient of an amplitude of 1: K where an angle strains the spring."""
        return float(scene.stiffness[joint]) if cls.strains_spring else 1.0

    @classmethod
    def parameter_names(cls) -> tuple[str, ...]:
        """Return the names that a file may give, amplitudes before shapes."""
        return tuple(parameter.name for parameter in (*cls.amplitudes, *cls.shapes))

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`: return (linear coefficients (d,), shape) from named parameters.

        Raises
        ------
        KeyError
            If a parameter is missing.
        """

        def given(parameter: Parameter) -> float:
            default = parameter.default
            return float(values[parameter.name] if default is None else values.get(parameter.name, default))

        unit = cls.unit(scene, joint)
        return np.array([given(p) * unit for p in cls.amplitudes]), tuple(given(p) for p in cls.shapes)

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether fitted, named values are physically possible (a backlash must open, a delay must not lead)."""
        specs = (*cls.amplitudes, *cls.shapes)
        return all(p.low <= values[p.name] <= p.high for p in specs if p.name in values)

    @classmethod
    def least(cls, span: float) -> tuple[float, ...]:
        """Return the least shape that a joint can show whose angle, rad (m), covers `span`."""
        return tuple(parameter.low for parameter in cls.shapes)

    def grown(self, coefficients: Array) -> Effect:
        """Return the effect with what its shape takes from its own amplitudes (d,)."""
        return self

    def altered(self, robot: Robot, parameters: Array, coefficients: Array) -> Alteration:
        """Return what the robot becomes (``simulated = "robot"``: a payload, a tilted base).

        `parameters` are its standard ones so far, (p,); the amplitudes are those of `coefficients`.
        """
        raise NotImplementedError(f"{self.name} does not alter the robot")

    def delivered(self, command: Array, coefficients: Array) -> Array:
        """Return the torque that the motor delivers while `command` is logged (``simulated = "motor"``).

        N·m (N), any shape. It puts the torque channel right, as `corrects` does: what was logged is no part of a
        prediction, and a prediction is compared with what this returns.
        """
        raise NotImplementedError(f"{self.name} does not act in the motor")

    def logged(self, signals: Mapping[str, Array], dt: float, values: Mapping[str, float]) -> dict[str, Array]:
        """Return the signals that differ in the log from what happened (``simulated = "log"``).

        Parameters
        ----------
        signals
            What happened: ``t`` (N,), ``q``, ``theta``, ``tau``, ``dq``, ``dtheta``, ``tau_link`` (N, n); leave them as
            they are and return changed copies.
        dt
            Sample time, s.
        values
            The parameters as `named` gives them; with the signs of its amplitudes turned, a log is corrected.
        """
        raise NotImplementedError(f"{self.name} does not act in the log")

    def _in_channels(
        self, signals: Mapping[str, Array], names: Sequence[str], change: Callable[[Array], Array]
    ) -> dict[str, Array]:
        """Return copies of those channels that there are, with what is changed of this joint in them, (N,) each."""
        found = {name: np.array(signals[name]) for name in names if name in signals}
        for channel in found.values():
            channel[:, self.joint] = change(channel[:, self.joint])
        return found
