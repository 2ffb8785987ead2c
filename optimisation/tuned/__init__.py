"""Tuning of the linear absorber (LTVA): closed forms as start values and tests, numerical optima of the multi-mode model as the answer.

`optimisation.tuned.certificate` proves a largest amplitude between grid points; it needs cvxpy and is imported on its own.
"""

from optimisation.tuned.closed_forms import PAPER, den_hartog, effective_mass_ratio, paper_rule, undamped_h2, undamped_minimax
from optimisation.tuned.scoring import HIGH, LOW, highest_amplitude, peak, peaks, require_wide_range
from optimisation.tuned.search import h2_norm, h2_norm_everywhere, minimax, minimum_h2

__all__ = [
    "HIGH",
    "LOW",
    "PAPER",
    "den_hartog",
    "effective_mass_ratio",
    "h2_norm",
    "h2_norm_everywhere",
    "highest_amplitude",
    "minimax",
    "minimum_h2",
    "paper_rule",
    "peak",
    "peaks",
    "require_wide_range",
    "undamped_h2",
    "undamped_minimax",
]
