"""Whatever is handed in to designs, objectives and tunings: refused by name, or right."""

from __future__ import annotations

import handed_in
import pytest

from impact_env import ParameterError
from optimisation.comparison import compare, force_grid
from optimisation.designs import Design, DesignSpace, design_space
from optimisation.objectives import Condition, Constraint, Objective
from optimisation.tuned import den_hartog, effective_mass_ratio, minimax, minimum_h2, paper_rule, undamped_h2, undamped_minimax

SPACE = design_space("impact")
OWN = {
    Design: {"concept": "impact", "values": dict(SPACE.default.values)},
    DesignSpace: {"concept": "impact", "free": SPACE.free},
    design_space: {"concept": "impact"},
    Constraint: {"name": "stroke"},
}
TUNINGS = (den_hartog, effective_mass_ratio, minimax, minimum_h2, paper_rule, undamped_h2, undamped_minimax)
PUBLIC = (*OWN, Condition, Objective, force_grid, *TUNINGS)


@pytest.mark.parametrize("make", PUBLIC, ids=lambda make: make.__name__)
@pytest.mark.filterwarnings("ignore")
def test_whatever_is_handed_in_is_refused_by_name_or_right(make: object) -> None:
    found = list(handed_in.complaints(make.__name__, make, OWN.get(make, {}), dear=make in (minimax, minimum_h2)))  # type: ignore[arg-type]
    assert not [problem for problem in found if problem is not None]


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"beam": "beam"}, "beam"),
        ({"resonances": 1}, "resonances"),
        ({"resonances": [True]}, "resonances"),
        ({"mass_ratio": "0.02"}, "mass_ratio"),
        ({"force": [1.0]}, "force"),
        ({"gap": True}, "gap"),
    ],
)
def test_what_is_compared_is_refused_by_name(arguments: dict[str, object], name: str) -> None:
    with pytest.raises(ParameterError, match=name):
        compare(**arguments)  # type: ignore[arg-type]


def test_an_unknown_concept_is_no_tuned_absorber() -> None:
    with pytest.raises(ParameterError, match="concept = 'magic'"):
        Design("magic", SPACE.default.values).absorber()
