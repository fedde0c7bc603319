"""Say which parameters can be identified, from the robot alone or from what a log excites.

Section 5 of the paper: independent, in a combination only, or not at all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from elid_cli.cli import options
from elid_cli.cli.group import verb
from elid_cli.cli.inputs import load_robot, log_request
from elid_cli.cli.options import Gates, Output, Source, Spread

if TYPE_CHECKING:
    from elid_cli.robot.robot import Robot


@verb("elid classify --robot puma560", "elid classify run07.mcap --robot puma560")
@options.source(required=False)
@options.spread
@options.gathered("gates", Gates, options.require_independent)
@options.output
def classify(source: Source, spread: Spread, gates: Gates, output: Output) -> None:
    """Say which of the robot's parameters are independent, which only show in combinations, and which not at all.

    With a log: also what its motion excites, and why anything is missing.
    """
    from elid_cli.cli.gates import check_gates, check_names
    from elid_cli.cli.output import emit
    from elid_cli.cli.progress import progress

    with progress(output, "reading") as advance:
        from elid_cli.model.base_parameters import find_base
        from elid_cli.model.regressor import Regressor
        from elid_cli.report.answers.classification import classification_report

        machine = load_robot(source.robot)
        base = find_base(Regressor(machine))
        check_names(gates, machine)
        recording = found = None
        if not source.logs:
            _check_effects(machine)
        else:
            from elid_cli.estimation.identify import EstimateOptions, identify_logs

            by_torque = EstimateOptions(fit="torque")  # which knows the bodies as well
            answer = identify_logs(log_request(source, machine, spread, output, advance), by_torque)
            found, recording = answer.found, answer.recording
    emit(classification_report(machine, base, source.robot, found, recording), output)
    check_gates(gates, classes=base.classes if found is None else found.this_log)


def _check_effects(robot: Robot) -> None:
    """Refuse a declared effect without the joint that it needs, as identification does.

    Whether one can exist at its joint may depend on the log: of transmissions that are `auto`, say.
    """
    from elid_cli.model.effects.declared import resolve

    for spec in robot.effects:
        if spec.joint is None:
            resolve(robot, spec)
