"""The structures that studies of loads share, and how their bands are told."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.optimize

from impact_env.modes import ModalModel, modal_model, mode_shapes
from impact_env.parameters import Beam
from optimisation.bounds import design_force

MODES, MASS_RATIO, GAP, RESTITUTION = 5, 0.02, 1e-3, 0.7
BAND = (0.05, 0.5, 0.95)


class Settings(NamedTuple):
    """Runs for each point, and whether it is only a look."""

    members: int
    quick: bool


@dataclass(frozen=True)
class Case:
    """A beam, the places of its absorber and of its response, and the forces for which the design rule gives `GAP` there."""

    name: str
    beam: Beam

    @cached_property
    def model(self) -> ModalModel:
        """The modal model."""
        return modal_model(self.beam)

    @property
    def mass(self) -> float:
        """Mass of the absorber in kg."""
        return MASS_RATIO * self.model.beam_mass

    @cached_property
    def forces(self) -> tuple[float, float]:
        """Forces in N near the first and the second resonance."""
        return design_force(self.model, self.mass, GAP, 1), design_force(self.model, self.mass, GAP, 2)

    @cached_property
    def node(self) -> float:
        """Where the second mode stands still, a share of the length."""
        return float(scipy.optimize.brentq(lambda x: mode_shapes(self.beam, [x])[0, 1], 0.3, 0.95))

    def at(self, *positions: float) -> ModalModel:
        """Return the model with absorbers elsewhere, the response read at the same place."""
        beam = replace(self.beam, response_position=self.beam.absorber_position)
        return modal_model(replace(beam, absorber_position=positions[0]), positions if len(positions) > 1 else None)


CASES = {
    case.name: case
    for case in (
        Case("cantilever", Beam(modes=MODES)),
        Case("supported beam", Beam(modes=MODES, ends="pinned-pinned", absorber_position=0.35, force_position=0.2)),
    )
}


def band_text(values: Sequence[float] | None) -> str:
    """Return median and band, nothing of None."""
    if values is None:
        return ""
    low, middle, high = np.quantile(values, BAND)
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"
