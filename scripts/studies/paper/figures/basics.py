"""The figure of the tuned absorbers, and of the paper's step against the exact method."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from impact_env.frequency import tip_response
from impact_env.modes import modal_model
from impact_env.parameters import Beam, TunedAbsorber
from studies.paper.style import LOOKS, MM, REFERENCE, finish, line, panels
from studies.study import Json


def save(path: Path, values: Json) -> None:
    """Draw the tip amplitude over the frequency with each tuning, and levels at the paper's step over the exact ones."""
    figure, axes = panels(1, 2, 3.0)
    response, step = axes[0]
    model, ratio = modal_model(Beam()), np.linspace(0.7, 1.3, 1201)
    shown = {"paper": LOOKS[1], "Den Hartog": LOOKS[0], "smallest peak": LOOKS[2]}
    free = MM * np.abs(tip_response(model, None, ratio * model.omega[0]))
    response.plot(ratio, free, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=1, label="no absorber")
    for name, look in shown.items():
        own = values["tuned"]["tunings"][name]
        absorber = TunedAbsorber(stiffness=own["stiffness"], damping=own["damping"])
        line(response, ratio, MM * np.abs(tip_response(model, absorber, ratio * model.omega[0])), look, f"LTVA: {name}", marked=False)
    response.set(xlabel="frequency over the first resonance", ylabel="tip amplitude in mm/N", ylim=(0, 0.25), xlim=(0.7, 1.3))
    rows = values["step"]
    for shift, method, look, label in ((-0.12, "exact", LOOKS[0], "exact"), (0.12, "moreau", LOOKS[1], "Moreau, the paper's step")):
        found = 100 * np.array([np.array(row[method]) / row["exact"][0] for row in rows])
        errors = (found[:, 0] - found[:, 1], found[:, 2] - found[:, 0])
        at = np.arange(len(rows)) + shift
        step.errorbar(at, found[:, 0], yerr=errors, color=look.colour, ls="", marker=look.marker, lw=1.2, capsize=2.5, label=label)
    step.set_xticks(range(len(rows)), [f"{row['case'].split(',')[0].removesuffix(' modes')}, {row['force']:g}" for row in rows])
    step.set(xlabel="modes, force in N", ylabel="level in % of the exact median")
    step.margins(y=0.25)
    finish(axes, path, figure)
