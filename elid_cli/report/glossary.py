"""What elid's and the field's words mean, in a sentence each: a page explains them where they stand."""

from __future__ import annotations

TERMS = {
    "× noise": "The error over what the noise of the sensors alone would leave in it; 1 means that only noise is left.",
    "held-out error": "The rms error of the predicted motor torque on stretches of the log that the fit never saw.",
    "of torque": "The error as a share of the rms of the joint's torque.",
    "motor side": "The motor's own equation: motor torque less its inertia and friction, against the transmission's "
    "torque from the measured deflection.",
    "whole joint": "Motor and link equation together: the motor torque against the motion of all bodies, without the "
    "deflection.",
    "link side": "The link's equation: the joint torque sensor against what the motion of the bodies needs.",
    "equation": "Every elastic joint has two equations: the motor's, and the link's. Their sum is free of the spring.",
    "model": "How far the prediction can be trusted: good, fair or poor.",
    "explains": "Share of the squared held-out error that the effect takes away in the equation beside it: 1 less the "
    "square of the error with it over that without it.",
    "worst stretch": "The log is cut into four stretches of equal length, and each is predicted by a fit to the other "
    "three: the share of the squared error that the effect takes away in the stretch where it takes least. A real "
    "effect helps in every stretch (quarters in JSON).",
    "stretch": "A part of the log without interruption. Held-out stretches are those that the fit never saw.",
    "condition": "Condition number of the weighted regressor, columns of unit norm: how much an error of the torque "
    "can grow in the parameters. Rank margin: the smallest singular value kept over the largest one dropped.",
    "base parameter": "A combination of parameters (masses, first moments, inertias …) that a log can show; the single "
    "parameters in it cannot be told apart from any motion.",
    "± sd": "Standard error of the estimate; the true value lies within twice that in 95 % of all logs.",
    "verdict": "empty: known to 30 % or better, or to 0.3 % of the torque (one standard error; supported in JSON); "
    "known roughly: less well than that (weak in JSON); not shown: by this log (refused in JSON); may be biased: what "
    "the model lacks can move it by more than ± sd.",
    "file": "What the robot file says.",
    "differs": "How far the estimate is from what the robot file says.",
    "follows": "The variable that the residual goes with, and the share of its square that it explains.",
    "residual": "Measured less predicted torque.",
    "deflection": "Motor angle (at the joint) less joint angle: how far the transmission is wound up.",
    "torque rms": "The size of the joint's torque: the root of its mean square.",
}
"""Term -> explanation; terms are the words of column heads and labels."""


def explained(words: str) -> str | None:
    """Return the term of the glossary that a column's head or a label is, or None."""
    plain = words.split(" (")[0].strip()
    return plain if plain in TERMS else None
