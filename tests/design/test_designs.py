from dataclasses import replace

import handed_in
import numpy as np
import pytest
from core import STEEL

from impact_env import (
    Beam,
    SeveralAbsorbers,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
    modal_model,
)
from optimisation.bounds import design_gap
from optimisation.comparison import force_grid
from optimisation.objectives import Condition, Constraint, Objective
from optimisation.problem import Problem
from optimisation.space import DEFAULT_FREE, VARIABLES, Design, DesignSpace, design_space
from optimisation.tuned import (
    den_hartog,
    effective_mass_ratio,
    minimax,
    minimum_h2,
    paper_rule,
    undamped_h2,
    undamped_minimax,
)


def test_defaults_are_the_papers() -> None:
    assert design_space("impact").default.absorber() == impact_absorber(1e-3, 0.7, 0.1, 0.02)
    assert design_space("friction").default.absorber() == friction_damper()
    assert design_space("tuned").default.absorber() == TunedAbsorber()
    half = impact_absorber(1e-3, 0.7, 0.05, 0.01)
    assert design_space("several").default.absorber() == SeveralAbsorbers((half, half), (1.0, 1.0))
    assert all(
        design_space(concept).default.values["position"] == 1.0
        for concept in ("impact", "friction", "tuned")
    )


@pytest.mark.parametrize("concept", VARIABLES)
def test_every_corner_of_a_space_is_a_scene(concept: str) -> None:
    space = design_space(concept, [v.name for v in VARIABLES[concept]])
    for share in (0.0, 0.3, 1.0):
        scene = space.at([share] * len(space.free)).scene(Beam(modes=2))
        assert scene.absorber is not None
        assert scene.absorber_mass == pytest.approx(
            space.at([share] * len(space.free)).values["mass_ratio"] * Beam().mass
        )


def test_several_absorbers_have_their_own_values_and_one_budget() -> None:
    values = {"gap_1": 5e-4, "gap_2": 2e-4, "position_2": 0.6, "share": 0.25}
    design = design_space(
        "several", fixed={"friction_limit_2": 0, "restitution_2": 0.5, "mass_ratio": 0.04}
    ).design(values)
    assert design.absorber() == SeveralAbsorbers(
        (impact_absorber(5e-4, 0.7, 0.05, 0.01), impact_absorber(2e-4, 0.5, None, 0.03)), (1.0, 0.6)
    )
    scene = design.scene(Beam(modes=3, absorber_position=0.5))
    np.testing.assert_allclose(scene.model.tip_shape, modal_model(Beam(modes=3)).tip_shape)
    np.testing.assert_allclose(
        scene.absorber_shapes[1], modal_model(Beam(modes=3, absorber_position=0.6)).tip_shape
    )


def test_chosen_variables_are_free_and_the_others_fixed() -> None:
    space = design_space(
        "impact", ["gap", "mass_ratio"], {"gap": (5e-4, 8e-4)}, {"restitution": 0.5}
    )
    assert [v.name for v in space.free] == ["gap", "mass_ratio"]
    assert space.describe()["fixed"] == {"restitution": 0.5, "friction_limit": 0.1, "position": 1.0}
    assert space.default.values["gap"] == 8e-4  # the paper's 1e-3, cut to the bounds
    assert space.paper.values == {
        "gap": 1e-3,
        "restitution": 0.7,
        "friction_limit": 0.1,
        "mass_ratio": 0.02,
        "position": 1.0,
    }  # never cut
    assert tuple(v.name for v in design_space("impact").free) == DEFAULT_FREE["impact"]


@pytest.mark.parametrize("concept", VARIABLES)
def test_scaled_designs_are_alike_on_a_scaled_structure(concept: str) -> None:
    """Scaled designs are equivalent on a scaled structure.

    Lengths, masses and times have other units. The same coordinates give the same absorber, with
    each value in its new unit.
    """
    length = 3.0
    stiffness = 5.0
    density = 0.4
    beam = Beam(
        length=0.5 * length,
        bending_stiffness=362.88 * stiffness,
        mass_per_length=1.1275 * density,
        modes=3,
    )
    mass = density * length
    time = np.sqrt(mass / (stiffness / length**3))
    wide = (0.5, 1.6)
    force = 2.0  # times the force: the motion grows by force over stiffness
    motion = force * length**3 / stiffness
    here = Problem(
        design_space(concept),
        (Condition(1, 3.5, wide), Condition(2, 20.0, wide)),
        beam=Beam(modes=3),
    )
    scaled = Problem(
        design_space(concept),
        (Condition(1, 3.5 * force, wide), Condition(2, 20.0 * force, wide)),
        beam=beam,
    )
    units = {
        "gap": motion,
        "friction_limit": force,
        "stiffness": mass / time**2,
        "damping": mass / time,
    }
    for share in (0.1, 0.7):
        own, other = (
            problem.space.at([share] * len(problem.space.free)) for problem in (here, scaled)
        )
        for name, value in own.values.items():
            kind = name[:-2] if name[-1].isdigit() else name
            assert other.values[name] == pytest.approx(units.get(kind, 1.0) * value, rel=1e-6), name
    assert scaled.space.coordinates(scaled.space.default) == pytest.approx(
        here.space.coordinates(here.space.default), rel=1e-6
    )


def test_bounds_hold_the_rule_on_another_beam_and_place() -> None:
    conditions = (Condition(1, 0.5),)
    problem = Problem(
        design_space("impact", ["gap", "friction_limit", "position"]), conditions, beam=STEEL
    )
    for position in (0.8, 1.0):
        model = modal_model(replace(STEEL, absorber_position=position))
        rule = design_gap(model, 0.02 * model.beam_mass, 0.5)
        design = problem.space.decoded({"gap": 1.0, "friction_limit": 0.1, "position": position})
        assert design.values["gap"] == pytest.approx(rule, rel=1e-9)
        assert design.values["friction_limit"] == pytest.approx(
            0.1 * 0.02 * model.beam_mass * rule * model.omega[0] ** 2, rel=1e-9
        )
        assert problem.space.coordinates(design) == pytest.approx(
            {"gap": 1.0, "friction_limit": 0.1, "position": position}, rel=1e-9
        )
    assert problem.rate == 1.0


def test_bounds_in_si_units_are_not_scaled() -> None:
    space = design_space("impact", ["gap", "friction_limit"], {"gap": (5e-4, 2e-3)})
    problem = Problem(space, (Condition(1, 0.5),), beam=STEEL)
    assert problem.space.at([0.0, 0.5]).values["gap"] == pytest.approx(5e-4)
    assert problem.space.at([1.0, 0.5]).values["gap"] == pytest.approx(2e-3)
    assert problem.space.free[0].unit == "m"


# Whatever is handed in to designs, objectives and tunings: refused by name, or right.


SPACE = design_space("impact")
OWN = {
    Design: {"concept": "impact", "values": dict(SPACE.default.values)},
    DesignSpace: {"concept": "impact", "free": SPACE.free},
    design_space: {"concept": "impact"},
    Constraint: {"name": "stroke"},
}
TUNINGS = (
    den_hartog,
    effective_mass_ratio,
    minimax,
    minimum_h2,
    paper_rule,
    undamped_h2,
    undamped_minimax,
)
PUBLIC = (*OWN, Condition, Objective, force_grid, *TUNINGS)


@pytest.mark.parametrize("make", PUBLIC, ids=lambda make: make.__name__)
@pytest.mark.filterwarnings("ignore")
def test_whatever_is_handed_in_is_refused_by_name_or_right(make: object) -> None:
    complaints = list(
        handed_in.complaints(
            make.__name__, make, OWN.get(make, {}), dear=make in (minimax, minimum_h2)
        )
    )
    assert not [problem for problem in complaints if problem is not None]


def test_values_at_a_bound_are_named_with_it() -> None:
    space = design_space("impact", ["gap", "restitution", "position"])
    inside = {"gap": 1e-3, "restitution": 0.6, "position": 0.7}
    assert space.at_bounds(space.design(inside)) == []
    for k, variable in enumerate(space.free):
        for share, word, bound in ((0.0, "lower", variable.low), (1.0, "upper", variable.high)):
            shares = [0.5] * len(space.free)
            shares[k] = share
            at_bounds = space.at_bounds(space.at(shares))
            if (variable.name, word) == ("position", "upper"):  # the beam's end
                assert at_bounds == []
            else:
                line = f"{variable.name} at its {word} bound of {bound:g} {variable.unit}"
                assert at_bounds == [line.rstrip()]
