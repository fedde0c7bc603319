"""Units and signs told from theta against q: noticed and proposed as a mapping, never applied."""

from __future__ import annotations

from elid_cli.logs.checks import Checked
from elid_cli.logs.repair import Aligned
from elid_cli.logs.resolve import Plan
from elid_cli.robot import Robot


def suspicions(checked: Checked, aligned: Aligned, robot: Robot, plan: Plan) -> list[str]:
    """Return one sentence per suspicion, with a mapping to paste."""
    return []
