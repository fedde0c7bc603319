"""Sizes of position errors in words: those of turning joints in mrad, those of sliding ones in mm."""

from __future__ import annotations

from collections.abc import Mapping

from elid_cli.robot.robot import Robot


def small_unit(robot: Robot, joint: str) -> str:
    """Return mrad or mm, as a joint turns or slides."""
    return f"m{robot.joint(joint).units[0]}"


def mean_words(robot: Robot, sizes: Mapping[str, float], digits: int, *, bare: bool = False) -> str:
    """Return the mean of joints' sizes, rad (m), in words: that of turning and that of sliding joints apart.

    `bare` leaves the unit out where all joints have the same.
    """
    units = dict.fromkeys(small_unit(robot, name) for name in sizes)
    parts = []
    for unit in units:
        own = {name: size for name, size in sizes.items() if small_unit(robot, name) == unit}
        mean = float(f"{1e3 * sum(own.values()) / len(own):.{digits}g}")
        of = f" ({', '.join(own)})" if len(units) > 1 else ""
        parts.append(f"{mean:.6g}" if bare and not of else f"{mean:.6g} {unit}{of}")
    return " and ".join(parts)


def largest_words(robot: Robot, sizes: Mapping[str, float]) -> str:
    """Return the largest of joints' rms sizes, rad (m), in words: that of turning and that of sliding joints apart."""
    worst: dict[str, str] = {}
    for name in sorted(sizes, key=lambda name: sizes[name]):
        worst[small_unit(robot, name)] = name
    parts = [f"{float(f'{1e3 * sizes[name]:.2g}'):.6g} {unit} rms (at {name})" for unit, name in worst.items()]
    return " and ".join(parts)
