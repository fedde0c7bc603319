"""elid: dynamic parameters of robots with elastic joints, from a recorded log, and the effect the model lacks."""

__version__ = "0.2.0"
