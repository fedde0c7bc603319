"""Batches of clean logs on the second simulator: coverage of intervals, false alarms, what is called unexplained.

    python -m tests.system.reproduce.plain_batches [--logs N] [--kinds NAME ...] [--accurate] [--diagnose]

Prints per kind of sensors: intervals judged, share that holds the truth, rms and largest |z| of supported parameters,
and how many logs were called insufficient (identify) or given an effect or something unexplained (diagnose).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elid_cli.diagnosis.diagnose import diagnose
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import Sensors, log, random_arm


@dataclass(frozen=True)
class Kind:
    """One kind of logs: how they are taken, of what arm."""

    sensors: Sensors
    joints: int = 2
    rigid: tuple[int, ...] = ()
    duration: float = 20.0


KINDS: dict[str, Kind] = {
    "17 bit, 1 kHz": Kind(Sensors(bits=17)),
    "14 bit": Kind(Sensors(bits=14)),
    "12 bit": Kind(Sensors(bits=12)),
    "hold, half a sample": Kind(Sensors(bits=17, delay=0.5)),
    "1.5 samples late": Kind(Sensors(bits=17, delay=1.5)),
    "5 samples late": Kind(Sensors(bits=17, delay=5)),
    "200 Hz, 1.5 late": Kind(Sensors(rate=200, bits=16, delay=1.5), duration=40),
    "2 kHz": Kind(Sensors(rate=2000, bits=16, delay=0.5), duration=8),
    "velocities": Kind(Sensors(bits=15, velocities=True)),
    "noise of 20 ms": Kind(Sensors(bits=17, torque=0.005, memory=0.02)),
    "noise of 60 ms": Kind(Sensors(bits=17, torque=0.005, memory=0.06)),
    "one loud torque": Kind(Sensors(bits=17, torques=(1, 10))),
    "offsets": Kind(Sensors(bits=17, offsets=(2.0, -0.5))),
    "jitter": Kind(Sensors(bits=17, jitter=0.03)),
    "5 s": Kind(Sensors(bits=17), duration=5),
    "60 s": Kind(Sensors(bits=16), duration=60),
    "rigid": Kind(Sensors(bits=16, delay=1.5), rigid=(0, 1)),
    "mixed of 3": Kind(Sensors(bits=17, delay=0.5), joints=3, rigid=(0,)),
    "rigid of 6": Kind(Sensors(bits=17), joints=6, rigid=tuple(range(6)), duration=30),
    "elastic of 7": Kind(Sensors(bits=18), joints=7, duration=30),
}


def made(kind: Kind, number: int) -> tuple[Robot, Recording]:
    """Return the true robot and a log of one kind."""
    arm = random_arm(np.random.default_rng(1000 + number), kind.joints, kind.rigid)
    return arm.described(), log(arm, seed=number, duration=kind.duration, sensors=kind.sensors)


def deviations(parameters: object) -> Iterator[float]:
    """Yield the errors of supported parameters in standard errors."""
    for item in parameters:  # type: ignore[attr-defined]
        if item.verdict == "supported" and np.isfinite(item.reference):
            yield (item.estimate - item.reference) / item.std_error


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--logs", type=int, default=5)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--accurate", action="store_true")
    parser.add_argument("--diagnose", action="store_true")
    asked = parser.parse_args()
    print(f"{'kind':22s} {'intervals':>9s} {'held %':>7s} {'rms z':>6s} {'max z':>6s}  alarms")
    every: list[float] = []
    for name in asked.kinds:
        kind, found, alarms = KINDS[name], list[float](), list[str]()
        for number in range(asked.first, asked.first + asked.logs):
            robot, recording = made(kind, number)
            if asked.diagnose:
                from elid_cli.diagnosis.refit import identified

                answer = diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate)))
                alarms += [f"{e.effect}@{e.joint}" for e in answer.effects]
                alarms += [f"unexplained {u.joint}" for u in answer.unexplained]
                after = identified(answer.state_after, answer.after, 0)
                found += deviations(after.parameters)
                continue
            fit = identify(robot, prepare(recording, robot), EstimateOptions(accurate=asked.accurate))
            found += deviations(fit.parameters)
            if getattr(fit, "model", "") == "insufficient":
                alarms.append("insufficient")
            alarms += [w[:60] for w in fit.warnings]
        every += found
        z = np.array(found)
        print(
            f"{name:22s} {len(z):9d} {100 * np.mean(np.abs(z) < 1.96):7.1f} {np.sqrt(np.mean(z**2)):6.2f} "
            f"{np.abs(z).max():6.1f}  {'; '.join(alarms)}",
            flush=True,
        )
    z = np.array(every)
    print(f"{'all':22s} {len(z):9d} {100 * np.mean(np.abs(z) < 1.96):7.1f} {np.sqrt(np.mean(z**2)):6.2f}")


if __name__ == "__main__":
    main()
