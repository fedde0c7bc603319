"""Simulated logs: a described robot, with its effects, follows a smooth reference under control, and a logger watches.

``simulate(robot, SimulationOptions(...))`` returns a `Recording`, ``run`` the exact motion as well.
"""

from elid_cli.experiment.simulation.control import ControlOptions, Gains
from elid_cli.experiment.simulation.run import JointFacts, Simulation, SimulationOptions, exact, filed, run, simulate
from elid_cli.experiment.simulation.sensors import SensorOptions

__all__ = [
    "ControlOptions",
    "Gains",
    "JointFacts",
    "SensorOptions",
    "Simulation",
    "SimulationOptions",
    "exact",
    "filed",
    "run",
    "simulate",
]
