"""Friction and torques that an MJCF cannot hold, from elid's --write-actuators FILE.json, applied in MuJoCo.

mujoco.set_mjcb_passive(Effects(model, "arm.actuators.json")), then mj_step as ever. Copy this file: it needs no elid.
"""

import json
import warnings
from pathlib import Path

import mujoco
import numpy as np

# p: parameters; v, x: speed and angle of the motor (of the link for effects at the link), s: rounded direction;
# bend, rate: q - theta and its rate; load: torque through the transmission; torque: the motor's. All at the joint.


def servo(p, v, load, torque):
    """Return what a member of the family M2 to M6 adds to Coulomb friction."""
    pair = (torque, load) if p["model"] >= 5 else (abs(torque + load) / 2,) * 2
    if p["model"] >= 5 and torque + load < 0:
        pair = (-torque, -load)
    at_rest = p["static"] + p["static_motor"] * pair[0] + p["static_external"] * pair[1]
    if torque * load > 0:
        at_rest += p["driving"] * load**2 if abs(torque) > abs(load) else p["driven"] * torque**2
    fades = np.exp(-((abs(v) / p["velocity"]) ** p.get("exponent", 1)))
    return p["motor"] * pair[0] + p["external"] * pair[1] + fades * at_rest


LAWS = {
    "stribeck": lambda p, v, x, s, bend, rate, load, torque: (
        p["amplitude"] * np.exp(-(max(abs(v) / p["velocity"], 1e-12) ** p.get("exponent", 1)))
    ),
    "load_friction": lambda p, v, x, s, bend, rate, load, torque: p["coefficient"] * abs(load),
    "backdriving_friction": lambda p, v, x, s, bend, rate, load, torque: (
        p["coefficient"] * (abs(load) * s - load * abs(s)) / 2
    ),
    "position_friction": lambda p, v, x, s, bend, rate, load, torque: (
        p["amplitude"] * np.sin(p["order"] * x + p["phase"])
    ),
    "servo_friction": lambda p, v, x, s, bend, rate, load, torque: servo(p, v, load, torque),
    "link_coulomb": lambda p, v, x, s, bend, rate, load, torque: p["friction"],
    "asymmetric_coulomb": lambda p, v, x, s, bend, rate, load, torque: p["difference"] * abs(s),
    "asymmetric_viscous": lambda p, v, x, s, bend, rate, load, torque: p["difference"] * abs(v),
    "quadratic_viscous": lambda p, v, x, s, bend, rate, load, torque: p["amplitude"] * s * abs(v) ** p["power"],
    "torque_ripple": lambda p, v, x, s, bend, rate, load, torque: p["amplitude"] * np.sin(p["order"] * x + p["phase"]),
    "link_viscous": lambda p, v, x, s, bend, rate, load, torque: p["friction"] * v,
    "link_spring": lambda p, v, x, s, bend, rate, load, torque: p["stiffness"] * x + p["preload"],
    "transmission_damping": lambda p, v, x, s, bend, rate, load, torque: p["damping"] * rate,
    "cubic_stiffness": lambda p, v, x, s, bend, rate, load, torque: p["cubic"] * bend**3,
    "backlash": lambda p, v, x, s, bend, rate, load, torque: -p["stiffness"] * np.clip(bend, -p["gap"], p["gap"]),
}


class Effects:
    """A passive force: dry friction goes into MuJoCo's own frictionloss, which holds a joint at rest."""

    def __init__(self, model, path):
        told = json.loads(Path(path).read_text("utf-8"))
        joints = {model.joint(k).name for k in range(model.njnt)}
        self.effects, self.frictionloss = [], model.dof_frictionloss.copy()
        aside = [f"{j}: delay {late:g} s" for j, late in told["actuators"].get("delay", {}).items() if late]
        constant = {"effect": "", "parameters": {}, "as": "torque", "at": "motor", "in_mjcf": False}
        offsets = told["actuators"].get("offset", {}).items()
        for e in told["effects"] + [{**constant, "joint": j, "offset": o} for j, o in offsets if o]:
            if e["in_mjcf"] or e["joint"] not in joints:
                continue
            if e["at"] in ("torque", "encoder", "sensor"):
                aside.append(f"{e['joint']}: {e['effect']} {e['parameters']}")
                continue
            if e["effect"] and e["effect"] not in LAWS:
                raise ValueError(f"{e['effect']} of {e['joint']} is no passive force")
            name = e["joint"]
            gear = told["gear_ratio"].get(name, 1.0)
            rotor, turns = told.get("rotors", {}).get(name, (name + "_rotor", gear))
            turns = turns if rotor in joints else 1.0
            motor = rotor if rotor in joints else name
            ids = (model.joint(n).id for n in (name, motor))
            self.effects.append((e, *ids, turns, told["direction_width"][name]))
        if aside:
            warnings.warn(f"not applied, as it is the drive's or a sensor's: {'; '.join(aside)}", stacklevel=2)

    def __call__(self, model, data):
        """Add the torques to data.qfrc_passive, and set the frictionloss of the coming step."""
        moving = np.zeros(model.nv)
        mujoco.mj_mulM(model, data, moving, data.qacc)
        moving += data.qfrc_bias - model.dof_armature * data.qacc
        friction = self.frictionloss.copy()
        for e, joint, motor, turns, width in self.effects:
            dof, own = model.jnt_dofadr[joint], model.jnt_dofadr[motor]
            q, dq = data.qpos[model.jnt_qposadr[joint]], data.qvel[dof]
            x, v = data.qpos[model.jnt_qposadr[motor]] / turns, data.qvel[own] / turns
            bend, rate, load = q - x, dq - v, moving[dof]
            torque = (data.qfrc_actuator[own] + data.qfrc_applied[own]) * turns
            if joint != motor:  # an elastic joint is a tendon beside a rotor of its own
                spring = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, model.joint(joint).name + "_transmission")
                load = -model.tendon_stiffness[spring] * bend if spring >= 0 else load
            if e["at"] == "link":
                x, v, own, turns = q, dq, dof, 1.0
            law = LAWS.get(e["effect"])
            size = law(e["parameters"], v, x, np.tanh(v / width), bend, rate, load, torque) if law else e["offset"]
            if e["as"] == "friction":
                friction[own] += (size - e.get("in_dynamic_friction", 0.0)) / abs(turns)
            elif e["at"] == "spring":
                data.qfrc_passive[dof] -= size
                data.qfrc_passive[own] += size / turns
            else:
                data.qfrc_passive[own] -= size / turns
        model.dof_frictionloss[:] = np.maximum(friction, 0.0)
