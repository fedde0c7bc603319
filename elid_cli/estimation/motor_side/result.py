"""What the motor side says of every transmission: a stiffness, or that this log does not show it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from elid_cli.errors import in_words
from elid_cli.estimation.result import Verdict
from elid_cli.model.antiresonance import PAST, log_rate
from elid_cli.robot.parameter import StandardParameter
from elid_cli.signals.recording import LINK_SENSORS

if TYPE_CHECKING:
    from elid_cli.estimation.motor_side.response import Response

NOT_SHOWN = "not shown by this log"
CLEAR = 5.0
"""Standard errors of load friction from which it is told."""
TOLD = 2
"""Gates that a reason names."""
LACKS = frozenset({"misfit", "noise"})
"""Gates that a model which lacks something does not pass, whatever the motion."""
FOLLOWS = {
    "noise": "misfit", "rotor": "sign", "rotor_told": "sign", "other_rotor": "sign", "damping": "sign",
}  # fmt: skip
"""Gates that are not told beside another one: without a spring a rotor and a damper are nothing of the robot's."""
ENOUGH = (
    "this motion passes the antiresonance, as far as this fit can tell, so another like it shows no more. Look for a "
    "wrong torque scale, friction that differs between driving and back-driving, an error that repeats with the gear's "
    "angle, a mode of the links; elid diagnose names some of these"
)
"""What is said of a joint whose stiffness another motion would not show."""


@dataclass(frozen=True)
class NextMotion:
    """The motion that would show a stiffness."""

    torque: tuple[float, float]
    """Amplitude of a torque multisine, N·m (N): from, to."""
    top: float
    """Its highest frequency, Hz."""
    known: bool
    """Whether `top` follows from a stiffness that the robot file gives."""
    joint: str
    """The joint's name."""

    unit: str = "N·m"
    """Of the torque, or force."""

    @property
    def words(self) -> str:
        """The motion, and the command that makes it, as one sentence."""
        return f"{self.motion}; `elid excite --robot FILE -o stiffness.csv --show-stiffness {self.option}` makes it"

    @property
    def motion(self) -> str:
        """The motion in words."""
        low, high = (_plain(value, 2) for value in self.torque)
        why = "1.3 times the antiresonance that the file's K means" if self.known else "a guess from this log's band"
        return (
            f"10 s, logged at {log_rate(self.top):.0f} Hz, of slow wide motion with a torque multisine of {low} to "
            f"{high} {self.unit} on top, 1 Hz to {_plain(self.top)} Hz ({why})"
        )

    @property
    def option(self) -> str:
        """The joint, with the antiresonance to expect where the robot file's K does not tell it."""
        return self.joint if self.known else f"{self.joint}:{_plain(self.top / PAST)}"


@dataclass(frozen=True)
class MotorSideJoint:
    """One transmission whose link position nobody logged."""

    joint: str
    number: int
    """From 0."""
    verdict: Verdict
    stiffness: float = float("nan")
    """K, N·m/rad (N/m); NaN where refused."""
    std_error: float = float("nan")
    systematic: float = 0.0
    """Part of the standard error that is not the noise's: what load friction may hide, as it may differ between driving
    and back-driving, other forms of friction and of lost motion, and what moves with the rows that are used."""
    reference: float = float("nan")
    """K of the robot file; NaN where unknown."""
    rotor: float = float("nan")
    """The rotor's inertia as the joint sees it, kg·m² (kg); NaN where refused."""
    antiresonance: float = float("nan")
    """Frequency at which the links swing against the held motor and its spring, Hz; NaN where refused."""
    resonance: float = float("nan")
    """Frequency at which links and rotors swing against each other by its spring, Hz; NaN where refused."""
    rigid_to: float = float("nan")
    """Frequency up to which the torque of rigid joints is within 5 %, Hz; NaN where refused."""
    band: float = float("nan")
    """Highest frequency of the motor's motion above its noise, Hz."""
    failed: tuple[str, ...] = ()
    """Gates that were not passed, as in `verdict.WORDS`."""
    gates: Mapping[str, float] = field(default_factory=dict)
    """What the gates looked at."""
    reason: str = ""
    """Why it is weak or refused."""
    motion: NextMotion | None = None
    """None where it is known, or no other motion would show it."""
    response: Response | None = None
    """The motor's acceleration over its torque; None where refused."""
    together: str = ""
    """Of several logs: how many show it, and whether these agree."""
    by_log: tuple[tuple[str, MotorSideJoint], ...] = ()
    """Of several logs: what each of them says, by its name."""

    @property
    def parameter(self) -> StandardParameter:
        """The stiffness by its name."""
        return StandardParameter("K", self.number)

    @property
    def says(self) -> str:
        """The reason with what would show the stiffness, a sentence or two."""
        return self._said("" if self.motion is None else self.motion.words)

    @property
    def told(self) -> str:
        """The same without the command that makes the motion."""
        return self._said("" if self.motion is None else self.motion.motion)

    def _said(self, motion: str) -> str:
        if self.verdict != "refused":
            return "; ".join(part for part in (self.together, self.reason) if part)
        shown = f"; what would show it: {motion}" if motion else f"; {ENOUGH}" if self.lacking else ""
        return f"{NOT_SHOWN} ({self.reason}){shown}"

    @property
    def lacking(self) -> bool:
        """Whether it is refused for what the model lacks: its motion suffices."""
        return self.verdict == "refused" and self.motion is None and bool(LACKS & set(self.failed))

    @property
    def load_friction(self) -> float:
        """Friction over the load that it grows with, where that is clear; else 0."""
        share = self.gates.get("load", 0.0)
        return share if self.verdict != "refused" and share > CLEAR * self.gates.get("load_error", np.inf) else 0.0

    @property
    def relative_error(self) -> float:
        """|estimate - reference| / |reference|; NaN where either is unknown."""
        return abs(self.stiffness - self.reference) / abs(self.reference) if self.reference else float("nan")


@dataclass(frozen=True)
class LinkSensor:
    """A sensor on a link, and what was found of it."""

    kind: str
    """As in `LINK_SENSORS`."""
    joint: str
    """The joint that moves the link."""
    reason: str = ""
    """Why it was not used; empty where it was."""
    mounting: tuple[tuple[float, ...], ...] = ()
    """Rows of M: what it measures is M times the link's angular velocity, or specific force, in the link's frame."""
    bias: tuple[float, ...] = ()
    """rad/s or m/s²."""
    delay: float = float("nan")
    """s by which it is late."""
    place: tuple[float, ...] = ()
    """Where on the link an accelerometer sits, m in the link's frame."""


@dataclass(frozen=True)
class MotorSide:
    """What the motor side says of every joint whose link position is hidden."""

    joints: tuple[MotorSideJoint, ...]
    misfit: float = float("nan")
    """Cost per degree of freedom of the fit: 1 is the sensors' noise."""
    seconds: float = float("nan")
    """Length of the stretch that was used, s."""
    sensors: tuple[LinkSensor, ...] = ()
    """Sensors on links that the log has."""
    corrected: bool = False
    """Whether the fit of all other parameters had the links' motion from what was found."""

    @property
    def found(self) -> list[MotorSideJoint]:
        """The joints of which it gives a stiffness."""
        return [joint for joint in self.joints if joint.verdict != "refused"]

    @property
    def source(self) -> str:
        """What the stiffnesses are from."""
        used = {sensor.kind for sensor in self.sensors if not sensor.reason}
        names = [f"{kind}s" for kind in LINK_SENSORS if kind in used]
        return f"motor position and torque and from {in_words(names)}" if names else "motor position and torque alone"

    def of(self, number: int) -> MotorSideJoint | None:
        """Return what is said of a joint, counted from 0."""
        return next((joint for joint in self.joints if joint.number == number), None)


def _plain(value: float, digits: int = 3) -> str:
    """Return a number with some digits and without an exponent."""
    return f"{float(f'{value:.{digits}g}'):.10g}"


def why(failed: tuple[str, ...]) -> str:
    """Return the weightiest failed gates in words: others follow from them."""
    from elid_cli.estimation.motor_side.verdict import WORDS

    weightiest = sorted({name for name in failed if FOLLOWS.get(name) not in failed}, key=list(WORDS).index)
    return "; ".join(WORDS[name] for name in weightiest[:TOLD])
