"""The log of a motion as it would be if one hypothesis were true: the links follow it, the motors do what that takes.

The bodies' equation gives the torque through each transmission, the transmission's law with the effects on it the
motor's angle. Nothing is integrated and no noise is added: what is asked is only what the effects' columns are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.refined_robot import representative
from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.experiment.information import States
from elid_cli.experiment.resolve.question import Hypothesis, Question
from elid_cli.model.base_parameters import find_base
from elid_cli.model.consistency import consistency, prior
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.rows import derivative
from elid_cli.model.effects.scene import Scene, direction_widths
from elid_cli.model.regressor import Regressor
from elid_cli.robot.parameter import StandardParameter
from elid_cli.signals.lowpass import LowPass
from elid_cli.signals.motion import Motion
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import SLOW_KEPT, Noise, Signals

FINEST = 250.0
"""Samples per second from which a played log is fine enough: ten times the cut-off of a diagnosis."""
ROUNDS, SETTLED = 30, 1e-4
"""Steps in which the transmissions' deflections settle, half of what is missing each, and the change of them, as a part
of the largest, below which they have."""
CREEPING = 4.0
"""Widths of the rounded sign of velocity (`DIRECTION_WIDTH`) below which an instant does not count: what friction does
there is how the sign was rounded, not physics, and no plan may build on it."""
COUPLED, AGREED = 8, 1e-9
"""Rounds in which deflections and the rotors' accelerations come to agree, and the change, as a part, at which they
do."""
MARGIN = 0.05
"""s; what smoothing leaves out at either end of a log."""


@dataclass(frozen=True)
class Acting:
    """An effect at work: its columns times these amplitudes, (d,)."""

    effect: Effect
    amplitudes: Array
    values: Mapping[str, float]
    """The same by name, shapes among them."""


@dataclass(frozen=True)
class Played:
    """What a diagnosis would see of a played motion."""

    signals: Signals
    observation: Observation
    scene: Scene


class Bench:
    """Plays motions of one robot with the parameters that a diagnosis found.

    Raises
    ------
    DataError
        Parameters with which the robot's transmissions cannot be: a stiffness that is not positive.
    """

    def __init__(self, question: Question) -> None:
        self.question = question
        self.robot = question.robot
        self.model = Regressor(self.robot)
        base = find_base(self.model)
        reference = prior(self.robot, consistency(self.robot, self.robot.reference()).scales)
        found = np.array([question.base.get(name, np.nan) for name in base.names])
        self.standard = representative(base, found, reference)
        self.stiffness = np.full(self.robot.n, np.inf)
        for k in np.flatnonzero(self.robot.elastic):
            self.stiffness[k] = self.standard[self.model.index[StandardParameter("K", int(k))]]
        self._springless = self.standard.copy()
        self._springless[[k for k, name in enumerate(self.model.names) if name.kind == "K"]] = 0.0
        if not np.all(self.stiffness > 0):
            joint = self.robot.joint_names[int(np.argmax(~(self.stiffness > 0)))]
            raise DataError(
                f"{joint}: no stiffness to plan with", hint="give K in the robot file, or diagnose a log that shows it"
            )
        step = max(int(np.ceil(FINEST / question.rate)), 1)
        self.dt = 1.0 / (step * question.rate)

    @property
    def rate(self) -> float:
        """Samples per second of a played log."""
        return 1.0 / self.dt

    def at_rest(self) -> Scene:
        """Return a scene of the robot at rest, for what an effect must know to have units."""
        none = np.zeros((3, self.robot.n))
        return scene_of(self.model, self._signals(self._motion((none, none, none), none)), self.standard)

    def acting(self, hypothesis: Hypothesis, scene: Scene) -> Acting:
        """Return a hypothesis as an effect with its amplitudes; `scene` gives the units.

        Raises
        ------
        DataError
            It lacks a parameter.
        """
        try:
            amplitudes, shape = hypothesis.kind.coefficients(scene, hypothesis.number, hypothesis.parameters)
        except KeyError as problem:
            raise DataError(f"{hypothesis.name}: the diagnosis gives no {problem.args[0]}") from None
        effect = hypothesis.kind(hypothesis.number, shape)
        return Acting(effect, np.asarray(amplitudes, dtype=float), effect.named(scene, amplitudes))

    def play(self, states: States, effects: Sequence[Acting] = ()) -> Played:
        """Return what is seen of a motion (q, q', q''), (N, n) each `dt` apart, under some effects."""
        motion = self._motion(states, self._deflection(states, effects))
        signals = self._signals(motion)
        scene = scene_of(self.model, signals, self.standard)
        torque = scene.predicted.copy()
        for item in effects:
            if item.effect.simulated != "log":
                for row, columns in item.effect.columns(scene).items():
                    torque[:, row.joint] += item.amplitudes @ columns
        motion, torque = self._logged(motion, torque, effects)
        signals = replace(self._signals(motion), tau=torque)
        scene = scene_of(self.model, signals, self.standard)
        return Played(signals, observe(self.model, signals), scene)

    def _logged(self, motion: Motion, torque: Array, effects: Sequence[Acting]) -> tuple[Motion, Array]:
        """Return motion and torque as they are logged: a late or wrong channel is one in all that is made of it."""
        for item in effects:
            if item.effect.simulated != "log":
                continue
            happened = {"t": motion.t, "q": motion.q, "theta": motion.theta, "tau": torque, "dq": motion.dq,
                        "dtheta": motion.dtheta, "tau_link": self._loaded(motion.theta - motion.q)}  # fmt: skip
            seen = happened | dict(item.effect.logged(happened, self.dt, item.values))
            link, motor = seen["dq"], seen["dtheta"]
            ddq = motion.ddq if link is motion.dq else derivative(link, self.dt)
            ddtheta = motion.ddtheta if motor is motion.dtheta else derivative(motor, self.dt)
            motion = Motion(motion.t, seen["q"], link, ddq, seen["theta"], motor, ddtheta)
            torque = seen["tau"]
        return motion, torque

    def torques(self, states: States) -> Array:
        """Return the motor torques of a motion, (N, n), its instants however far apart: motors move as their links."""
        q, dq, ddq = states
        motion = Motion(np.zeros(len(q)), q, dq, ddq, q, dq, ddq)
        rows = self.model.rows(motion, self.model.equations)
        torque: Array = np.zeros(q.shape)
        for item in self.model.equations.rows:
            torque[:, item.row.joint] += self.standard[item.columns] @ rows[item.row]
        return torque

    def _deflection(self, states: States, effects: Sequence[Acting]) -> Array:
        """Return how far the motors are ahead of their links, (N, n)."""
        acting = [item for item in effects if item.effect.place in ("link", "spring", "chain")]
        found: Array = np.zeros(states[0].shape)
        for _ in range(COUPLED):  # links feel the rotors' accelerations, which follow from the deflections
            bodies = self._bodies(self._motion(states, found))
            before, found = found, self._settled(states, bodies, found, acting) if acting else bodies / self.stiffness
            if float(np.max(np.abs(found - before), initial=0.0)) <= AGREED * float(np.max(np.abs(found), initial=0.0)):
                break
        return found

    def _settled(self, states: States, bodies: Array, start: Array, acting: Sequence[Acting]) -> Array:
        """Return the deflections, (N, n), at which the transmissions carry what bodies and effects need."""
        found = start
        scene = scene_of(self.model, self._signals(self._motion(states, found)), self.standard)
        for _ in range(ROUNDS):
            scene = replace(scene, motion=self._motion(states, found), load=self._loaded(found), cache={})
            load = bodies.copy()
            for item in acting:
                for row, columns in item.effect.columns(scene).items():
                    if row.side == "link":
                        load[:, row.joint] += item.amplitudes @ columns
            wanted = load / self.stiffness
            change = float(np.max(np.abs(wanted - found), initial=0.0))
            found = 0.5 * (found + wanted)
            if change <= SETTLED * float(np.max(np.abs(wanted), initial=0.0)):
                break
        return found

    def _loaded(self, deflection: Array) -> Array:
        return np.asarray(np.where(np.isfinite(self.stiffness), self.stiffness, 0.0) * deflection)

    def _bodies(self, motion: Motion) -> Array:
        """Return the torques that the links need from their transmissions, (N, n)."""
        rows = self.model.rows(motion, self.model.equations)
        load: Array = np.zeros(motion.q.shape)
        for item in self.model.equations.rows:
            if item.row.kind == "link":
                load[:, item.row.joint] = self._springless[item.columns] @ rows[item.row]
        return load

    def _motion(self, states: States, ahead: Array) -> Motion:
        q, dq, ddq = states
        faster = derivative(ahead, self.dt)
        t: Array = np.arange(len(q), dtype=float) * self.dt
        return Motion(t, q, dq, ddq, q + ahead, dq + faster, ddq + derivative(faster, self.dt))

    def _signals(self, motion: Motion) -> Signals:
        """Return signals whose motion is exact, filtered as a diagnosis filters."""
        n, samples = self.robot.n, motion.samples
        unknown = np.full(n, np.nan)
        most, share = SLOW_KEPT
        sensed = np.zeros(n, dtype=bool)
        for item in self.question.noise:
            sensed[item.number] = "load" in item.rows
        plain = Signals(
            joints=self.robot.joint_names,
            dt=self.dt,
            motion=motion,
            tau=np.zeros((samples, n)),
            tau_link=self._loaded(motion.theta - motion.q) if sensed.any() else None,
            temperature=None,
            segments=(Segment(0, samples),),
            noise=Noise(unknown, unknown, unknown),
            knots=unknown,
            filter=LowPass(np.ones(1), 1, float("inf")),
            margin=round(MARGIN * self.rate),
            min_velocity=np.maximum(
                np.minimum(most, share * np.abs(motion.dtheta).max(axis=0)), CREEPING * direction_widths(self.robot)
            ),
            still=np.ptp(motion.q, axis=0) == 0,
            sensed=sensed,
        )
        return plain.refiltered(self.question.cutoff, self.question.rate)
