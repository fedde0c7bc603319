"""Logs: one module per format (``*_log.py``), found by themselves; from files to a `Recording` and back."""

from elid_cli.logs.adapt import robot_as_logged
from elid_cli.logs.mapping.options import read_map_options
from elid_cli.logs.reading import read_recording
from elid_cli.logs.writing import write_recording

__all__ = [
    "read_map_options",
    "read_recording",
    "robot_as_logged",
    "write_recording",
]
