"""The figure of the tuned absorbers, and of the paper's step against the exact method."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from impact_env.frequency import tip_response
from impact_env.modes import modal_model
from impact_env.parameters import Beam, TunedAbsorber
from optimisation.studies.paper.style import LOOKS, MM, REFERENCE, finish, line, panels
from optimisation.studies.study import Json


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
    for k, (case, look) in enumerate(zip(dict.fromkeys(row["case"] for row in values["step"]), LOOKS, strict=False)):
        rows = [row for row in values["step"] if row["case"] == case]
        for shift, (method, own) in enumerate((("exact", look), ("moreau", LOOKS[k + 2]))):
            found = MM * np.array([row[method] for row in rows])
            at = [row["force"] * (1 + 0.02 * shift) for row in rows]
            label = f"{case}: {'exact' if method == 'exact' else 'Moreau'}"
            errors = (found[:, 0] - found[:, 1], found[:, 2] - found[:, 0])
            step.errorbar(at, found[:, 0], yerr=errors, color=own.colour, ls=own.dashes, marker=own.marker, ms=3.5, lw=1.1, capsize=2, label=label)
    step.set(xlabel="force in N", ylabel="response level in mm", ylim=(0, None))
    finish(axes, path, figure)
