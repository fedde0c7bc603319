"""The described robot driven by what a log commanded, against what the log measured."""

from elid_cli.experiment.replay.replay import Replay, ReplayOptions, replay

__all__ = ["Replay", "ReplayOptions", "replay"]
