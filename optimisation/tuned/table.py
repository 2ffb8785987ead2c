"""All tunings of one absorber mass and one resonance, side by side and scored over one range."""

from dataclasses import dataclass

import numpy as np

from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, TunedAbsorber
from optimisation.tuned.closed_forms import PAPER, den_hartog, paper_rule, undamped_h2, undamped_minimax
from optimisation.tuned.scoring import HIGH, LOW, peak, require_wide_range
from optimisation.tuned.search import h2_norm, minimax, minimum_h2

NONE, PAPER_VALUES, RULE, EXACT, EXACT_H2, MINIMAX, MINIMUM_H2 = "none", "paper", "den_hartog", "undamped_minimax", "undamped_h2", "minimax", "h2"
_PRINTED = 1e-3  # the paper prints its values to this accuracy


@dataclass(frozen=True)
class Tuning:
    """A tuned absorber (None: no absorber) with its scores: ``peak`` in m/N at ``peak_ratio`` (to omega_r), ``h2`` in m/(N sqrt(s))."""

    key: str
    label: str
    absorber: TunedAbsorber | None
    peak: float
    peak_ratio: float
    h2: float


@dataclass(frozen=True, eq=False)
class TuningTable:
    """Tunings, the first without absorber; ``low`` and ``high`` are the scoring range over omega_r."""

    model: ModalModel
    mass_ratio: float
    resonance: int
    low: float
    high: float
    tunings: tuple[Tuning, ...]

    @property
    def omega(self) -> float:
        """Resonance frequency of the free beam in rad/s."""
        return self.model.resonance_omega(self.resonance)

    def relative_peak(self, tuning: Tuning) -> float:
        """Return the peak over that without absorber."""
        return tuning.peak / self.tunings[0].peak

    def relative_h2(self, tuning: Tuning) -> float:
        """Return the H2 norm over that without absorber."""
        return tuning.h2 / self.tunings[0].h2

    def ratios(self, absorber: TunedAbsorber) -> tuple[float, float]:
        """Return omega_a/omega_r and c/(2 m_a omega_a) of an absorber."""
        mass = absorber.mass_ratio * self.model.beam_mass
        omega = float(np.sqrt(absorber.stiffness / mass))
        return omega / self.omega, absorber.damping / (2 * mass * omega)


def paper_tuning(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1) -> TunedAbsorber:
    """Return the paper's own values where its rule gives them (its beam, mass and first resonance), otherwise what its rule gives."""
    rule = paper_rule(model, mass_ratio, resonance)
    printed = abs(rule.stiffness / PAPER.stiffness - 1) < _PRINTED and abs(rule.damping / PAPER.damping - 1) < _PRINTED
    return PAPER if printed and mass_ratio == PAPER.mass_ratio else rule


def tuning_table(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1, low: float = LOW, high: float = HIGH) -> TuningTable:
    """Return all tunings of an absorber of ``mass_ratio`` (to the beam's mass), tuned to a resonance and scored over low..high times omega_r.

    Raises ParameterError for numbers out of range, a mode without damping, a node at the absorber, and a scoring range that cannot hold both split
    peaks (`require_wide_range`).
    """
    require_wide_range(model, mass_ratio, resonance, low, high)
    case = (mass_ratio, resonance)
    paper = paper_tuning(model, *case)
    absorbers: list[tuple[str, str, TunedAbsorber | None]] = [
        (NONE, "no absorber", None),
        (PAPER_VALUES, "paper's values" if paper is PAPER else "paper's rule", paper),
        (RULE, "Den Hartog", den_hartog(model, *case)),
        (EXACT, "minimax of one undamped mode", undamped_minimax(model, *case)),
        (EXACT_H2, "H2 optimum of one undamped mode", undamped_h2(model, *case)),
        (MINIMAX, "smallest peak, all modes", minimax(model, *case, low, high)),
        (MINIMUM_H2, "smallest H2 norm, all modes", minimum_h2(model, *case, low, high)),
    ]
    tunings = tuple(
        Tuning(key, label, absorber, *peak(model, absorber, resonance, low, high), h2_norm(model, absorber, resonance, low, high))
        for key, label, absorber in absorbers
    )
    return TuningTable(model, mass_ratio, resonance, low, high, tunings)
