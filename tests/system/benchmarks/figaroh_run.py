"""FIGAROH's identification of a recorded log, timed: `python figaroh_run.py robot.urdf log.npz [--decimate]`.

Run by an interpreter that has FIGAROH (the extra `peers`); elid is not imported. Its own pipeline is called: median and
Butterworth filter, derivatives, the regressor with friction and rotor inertia, base parameters by QR, weighted least
squares with standard deviations. Printed are CPU seconds from arrays in memory to the answer.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import time
from typing import Any

import numpy as np
from figaroh.identification.base_identification import BaseIdentification
from figaroh.tools.load_robot import load_robot

CUTOFF = 10.0
"""Hz, near to what elid chooses for this log."""


def identification(urdf: str, log: dict[str, Any]) -> BaseIdentification:
    """Return FIGAROH's identification of a log with t (N,), q and tau (N, n), configured as by a file."""

    class Rigid(BaseIdentification):  # type: ignore[misc]  # nothing is known of its types
        def load_param(self, config_file: str, setting_type: str = "identification") -> None:
            joints = list(self.robot.model.names)[1:]
            places, nothing = list(range(len(joints))), [0.0] * len(joints)
            filtering = {"nbutter": 4, "f_butter": CUTOFF, "med_fil": 5, "f_sample": 1000}
            self.identif_config = {
                "robot_name": self.robot.model.name, "active_joints": joints, "act_idxq": places, "act_idxv": places,
                "is_joint_torques": True, "is_external_wrench": False, "force_torque": None, "ts": 1e-3,
                "has_friction": True, "has_actuator_inertia": True,
                "has_joint_offset": False, "has_coupled_wrist": False,
                "fv": nothing, "fs": nothing, "Ia": nothing, "off": nothing, "Iam6": 0, "fvm6": 0, "fsm6": 0,
                "filter_config": {"differentiation_method": "gradient", "filter_params": filtering},
            }  # fmt: skip

        def load_trajectory_data(self, data_source: str | None = None) -> dict[str, Any]:
            motion = {"positions": log["q"], "velocities": None, "accelerations": None}
            return {"timestamps": log["t"], "torques": log["tau"], **motion}

    return Rigid(load_robot(urdf, package_dirs="."), "no file")


def main() -> None:
    """Print CPU seconds, base parameters and the rms residual as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("urdf")
    parser.add_argument("log")
    parser.add_argument("--decimate", action="store_true")
    chosen = parser.parse_args()
    found = identification(chosen.urdf, dict(np.load(chosen.log)))
    begin = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        found.initialize()
        found.solve(decimate=chosen.decimate, plotting=False, wls=True)
    seconds = time.process_time() - begin
    print(json.dumps({"cpu": seconds, "base": len(found.phi_base), "rms": float(found.rms_error)}))


if __name__ == "__main__":
    main()
