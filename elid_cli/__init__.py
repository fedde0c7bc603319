"""elid: dynamic parameters of robots with elastic joints, from a recorded log, and the effect the model lacks.

``import elid_cli`` offers the functions behind the commands (docs/how-to/python.md). Each is imported when it is first
asked for (PEP 562): importing the package takes neither NumPy nor time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
    from elid_cli.diagnosis.by_motion.result import MotionDiagnosis
    from elid_cli.diagnosis.diagnose import DiagnoseOptions, diagnose
    from elid_cli.diagnosis.result import Diagnosis
    from elid_cli.errors import DataError, ElidError, LogError, RobotError, UsageError
    from elid_cli.estimation.comparison import Comparison, Comparisons, SavedResult, compare, read_result
    from elid_cli.estimation.identified import Identified
    from elid_cli.estimation.identify import identify, identify_logs
    from elid_cli.estimation.judgement import JointError
    from elid_cli.estimation.physical.nearest import PhysicalParameters, make_physical
    from elid_cli.estimation.refined_robot import identified_robot
    from elid_cli.estimation.request import LogRequest
    from elid_cli.estimation.result import BaseEstimate, EstimateOptions, Identification
    from elid_cli.estimation.sampling.sets import ParameterSets, sample
    from elid_cli.estimation.streaming.files import write_triangles
    from elid_cli.estimation.streaming.fleet import reduced_logs
    from elid_cli.estimation.trend.trends import Trends, trend
    from elid_cli.estimation.validation.prediction import Validation, validate
    from elid_cli.experiment.excitation import Excitation, ExciteOptions, excite
    from elid_cli.experiment.reference import ReferenceOptions, write_trajectory
    from elid_cli.experiment.replay.replay import Replay, ReplayOptions, replay
    from elid_cli.experiment.resolve.plan import Resolution, ResolveOptions, resolve
    from elid_cli.experiment.resolve.question import Question, question_of, read_question
    from elid_cli.experiment.robot_file import write_robot
    from elid_cli.experiment.simulation.control import ControlOptions
    from elid_cli.experiment.simulation.run import SimulationOptions, simulate
    from elid_cli.experiment.simulation.sensors import SensorOptions
    from elid_cli.logs.arrays import recording_of
    from elid_cli.logs.inspect import LogInfo, inspect_log
    from elid_cli.logs.mapping.options import read_map_options
    from elid_cli.logs.reading import read_recording
    from elid_cli.logs.writing import write_recording
    from elid_cli.model.base_parameters import BaseParameters, find_base
    from elid_cli.model.effects import effect_classes
    from elid_cli.model.regressor import Regressor
    from elid_cli.robot.files import read_robot, shipped_robots
    from elid_cli.robot.robot import EffectSpec, Joint, Limits, Robot
    from elid_cli.signals.options import SignalOptions
    from elid_cli.signals.recording import Recording
    from elid_cli.signals.signals import Signals, prepare

__version__ = "0.2.0"

_PLACES = {
    "diagnosis.by_motion.diagnose": "diagnose_motion",
    "diagnosis.by_motion.result": "MotionDiagnosis",
    "diagnosis.diagnose": "DiagnoseOptions diagnose",
    "diagnosis.result": "Diagnosis",
    "errors": "DataError ElidError LogError RobotError UsageError",
    "estimation.comparison": "Comparison Comparisons SavedResult compare read_result",
    "estimation.identified": "Identified",
    "estimation.identify": "identify identify_logs",
    "estimation.judgement": "JointError",
    "estimation.physical.nearest": "PhysicalParameters make_physical",
    "estimation.refined_robot": "identified_robot",
    "estimation.request": "LogRequest",
    "estimation.result": "BaseEstimate EstimateOptions Identification",
    "estimation.sampling.sets": "ParameterSets sample",
    "estimation.streaming.files": "write_triangles",
    "estimation.streaming.fleet": "reduced_logs",
    "estimation.trend.trends": "Trends trend",
    "estimation.validation.prediction": "Validation validate",
    "experiment.excitation": "Excitation ExciteOptions excite",
    "experiment.reference": "ReferenceOptions write_trajectory",
    "experiment.replay.replay": "Replay ReplayOptions replay",
    "experiment.resolve.plan": "Resolution ResolveOptions resolve",
    "experiment.resolve.question": "Question question_of read_question",
    "experiment.robot_file": "write_robot",
    "experiment.simulation.control": "ControlOptions",
    "experiment.simulation.run": "SimulationOptions simulate",
    "experiment.simulation.sensors": "SensorOptions",
    "logs.arrays": "recording_of",
    "logs.inspect": "LogInfo inspect_log",
    "logs.mapping.options": "read_map_options",
    "logs.reading": "read_recording",
    "logs.writing": "write_recording",
    "model.base_parameters": "BaseParameters find_base",
    "model.effects": "effect_classes",
    "model.regressor": "Regressor",
    "robot.files": "read_robot shipped_robots",
    "robot.robot": "EffectSpec Joint Limits Robot",
    "signals.options": "SignalOptions",
    "signals.recording": "Recording",
    "signals.signals": "Signals prepare",
}
"""Module -> public names, the imports above again as data: type checkers read those, Python these."""
_HOMES = {name: module for module, names in _PLACES.items() for name in names.split()}

__all__ = [
    "BaseEstimate",
    "BaseParameters",
    "Comparison",
    "Comparisons",
    "ControlOptions",
    "DataError",
    "DiagnoseOptions",
    "Diagnosis",
    "EffectSpec",
    "ElidError",
    "EstimateOptions",
    "Excitation",
    "ExciteOptions",
    "Identification",
    "Identified",
    "Joint",
    "JointError",
    "Limits",
    "LogError",
    "LogInfo",
    "LogRequest",
    "MotionDiagnosis",
    "ParameterSets",
    "PhysicalParameters",
    "Question",
    "Recording",
    "ReferenceOptions",
    "Regressor",
    "Replay",
    "ReplayOptions",
    "Resolution",
    "ResolveOptions",
    "Robot",
    "RobotError",
    "SavedResult",
    "SensorOptions",
    "SignalOptions",
    "Signals",
    "SimulationOptions",
    "Trends",
    "UsageError",
    "Validation",
    "__version__",
    "compare",
    "diagnose",
    "diagnose_motion",
    "effect_classes",
    "excite",
    "find_base",
    "identified_robot",
    "identify",
    "identify_logs",
    "inspect_log",
    "make_physical",
    "prepare",
    "question_of",
    "read_map_options",
    "read_question",
    "read_recording",
    "read_result",
    "read_robot",
    "recording_of",
    "reduced_logs",
    "replay",
    "resolve",
    "sample",
    "shipped_robots",
    "simulate",
    "trend",
    "validate",
    "write_recording",
    "write_robot",
    "write_trajectory",
    "write_triangles",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its module and keep it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    value = globals()[name] = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    return value


def __dir__() -> list[str]:
    """Return the public names, imported or not, and Python's own: no folders, which look like functions."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__") and name.endswith("__"))})
