"""Figures 3-7 of the paper, drawn from elid's simulations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elid_cli.experiment.simulation import Simulation
from tests.system.reproduce.paper_logs import FRICTION

Array = NDArray[np.float64]


def figures(folder: Path, planar: Simulation, puma: Simulation | None) -> None:
    """Write figure3.png … figure7.png; 6 and 7 only with a simulation of the PUMA 560."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    folder.mkdir(parents=True, exist_ok=True)

    def save(name: str, x: Array, lines: Sequence[tuple[str, Array]], x_label: str, y_label: str) -> None:
        figure, axes = pyplot.subplots(figsize=(7, 4))
        for label, y in lines:
            axes.plot(x, y, label=label)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.legend()
        figure.tight_layout()
        figure.savefig(folder / name)
        pyplot.close(figure)

    v = np.linspace(-1.5, 1.5, 601)
    a, s, f = np.abs(v) + 1e-9, np.sign(v), FRICTION[0]
    complete = f[0] * v + f[1] * s - f[2] * s * np.exp(-a / f[3]) - f[4] * s * np.exp(-1 / (f[5] * a))
    save("figure3.png", v, [("eq. (43)", complete), ("Coulomb", f[1] * s)], "velocity [rad/s]", "friction [N·m]")

    def motion_figures(numbers: tuple[int, int], what: Simulation) -> None:
        m, n = what.motion, what.tau.shape[1]
        save(
            f"figure{numbers[0]}a.png", m.t, [(f"u{k + 1}", what.tau[:, k]) for k in range(n)], "t [s]", "torque [N·m]"
        )
        save(f"figure{numbers[0]}b.png", m.t, [(f"q{k + 1}", m.q[:, k]) for k in range(n)], "t [s]", "position [rad]")
        gap = np.degrees(m.q - m.theta)
        lines = [(f"q{k + 1} - theta{k + 1}", gap[:, k]) for k in range(n)]
        save(f"figure{numbers[1]}.png", m.t, lines, "t [s]", "deflection [deg]")

    motion_figures((4, 5), planar)
    if puma is not None:
        motion_figures((6, 7), puma)
