from __future__ import annotations

import numpy as np
import pytest

from impact_env import (
    Beam,
    ParameterError,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
    modal_model,
)
from optimisation.designs import FREE, VARIABLES, Design, DesignSpace, Variable, design_space


def test_defaults_are_the_papers() -> None:
    assert design_space("impact").default.absorber() == impact_absorber(1e-3, 0.7, 0.1, 0.02)
    assert design_space("friction").default.absorber() == friction_damper()
    assert design_space("tuned").default.absorber() == TunedAbsorber()
    half = impact_absorber(1e-3, 0.7, 0.05, 0.01)
    assert design_space("several").default.absorber() == SeveralAbsorbers((half, half), (1.0, 1.0))
    assert all(design_space(concept).default.values["position"] == 1.0 for concept in ("impact", "friction", "tuned"))


@pytest.mark.parametrize("concept", VARIABLES)
def test_every_corner_of_a_space_is_a_scene(concept: str) -> None:
    space = design_space(concept, [v.name for v in VARIABLES[concept]])
    for share in (0.0, 0.3, 1.0):
        scene = space.at([share] * len(space.free)).scene(Beam(modes=2))
        assert scene.absorber is not None
        assert scene.absorber_mass == pytest.approx(space.at([share] * len(space.free)).values["mass_ratio"] * Beam().mass)


def test_position_is_where_the_absorber_acts() -> None:
    space = design_space("impact", ["position"])
    model = space.design({"position": 0.5}).scene(Beam(modes=3)).model
    np.testing.assert_allclose(model.tip_shape, modal_model(Beam(modes=3, absorber_position=0.5)).tip_shape)
    assert abs(model.tip_shape[0]) < 0.5 * modal_model(Beam(modes=3)).tip_shape[0]


def test_several_absorbers_have_their_own_values_and_one_budget() -> None:
    values = {"gap_1": 5e-4, "gap_2": 2e-4, "position_2": 0.6, "share": 0.25}
    design = design_space("several", fixed={"friction_limit_2": 0, "restitution_2": 0.5, "mass_ratio": 0.04}).design(values)
    assert design.absorber() == SeveralAbsorbers((impact_absorber(5e-4, 0.7, 0.05, 0.01), impact_absorber(2e-4, 0.5, None, 0.03)), (1.0, 0.6))
    scene = design.scene(Beam(modes=3, absorber_position=0.5))
    np.testing.assert_allclose(scene.model.tip_shape, modal_model(Beam(modes=3)).tip_shape)
    np.testing.assert_allclose(scene.absorber_shapes[1], modal_model(Beam(modes=3, absorber_position=0.6)).tip_shape)


def test_no_friction_is_no_part() -> None:
    absorber = design_space("impact", ["gap"], fixed={"friction_limit": 0}).default.absorber()
    assert isinstance(absorber, SlidingAbsorber)
    assert absorber.friction is None
    assert isinstance(absorber.walls, RigidWalls)


def test_shares_and_values_are_inverse() -> None:
    for v in (Variable("a", "m", 1e-4, 1e-2, 1e-3, log=True), Variable("b", "", -1.0, 3.0, 0.0)):
        for share in (0.0, 0.25, 1.0):
            assert v.share_of(v.value_at(share)) == pytest.approx(share, abs=1e-12)
    assert Variable("a", "m", 1e-4, 1e-2, 1e-3, log=True).value_at(0.5) == pytest.approx(1e-3)


def test_chosen_variables_are_free_and_the_others_fixed() -> None:
    space = design_space("impact", ["gap", "mass_ratio"], {"gap": (5e-4, 8e-4)}, {"restitution": 0.5})
    assert [v.name for v in space.free] == ["gap", "mass_ratio"]
    assert space.fixed == {"restitution": 0.5, "friction_limit": 0.1, "position": 1.0}
    assert space.default.values["gap"] == 8e-4  # the paper's 1e-3, cut to the bounds
    assert space.describe()["version"] == 1
    assert tuple(v.name for v in design_space("impact").free) == FREE["impact"]


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (("spring",), ["concept", "'spring'", "impact, friction, tuned"]),
        (("impact", ["gaps"]), ["'gaps'", "gap, restitution"]),
        (("impact", ["gap", "gap"]), ["once"]),
        (("impact", ["gap"], {"gap": (1e-3, 1e-3)}), ["bounds of gap", "0.001"]),
        (("impact", ["gap"], {"gap": (2e-3, 1e-3)}), ["bounds of gap", "0.002"]),
        (("impact", ["gap"], {"gap": (0.0, 1e-3)}), ["bounds of gap", "above 0"]),
        (("impact", ["gap"], {"restitution": (0.1, 0.2)}), ["restitution", "free variables"]),
        (("impact", ["gap"], {"stiffness": (0.1, 0.2)}), ["stiffness"]),
        (("impact", ["restitution"], {"restitution": (0.5, 1.5)}), ["restitution", "1.5", "0 to 1"]),
        (("impact", ["position"], {"position": (0.5, 1.5)}), ["absorber_position", "1.5"]),
        (("friction", ["mass_ratio"], None, {"friction_limit": -1.0}), ["friction limit", "-1.0"]),
        (("friction", ["mass_ratio"], None, {"mass_ratio": 0.01}), ["mass_ratio", "not both"]),
        (("friction", []), ["free variables"]),
    ],
)
def test_bad_space_is_named(arguments: tuple[object, ...], names: list[str]) -> None:
    with pytest.raises(ParameterError) as error:
        design_space(*arguments)  # type: ignore[arg-type]
    assert all(name in str(error.value) for name in names), error.value


def test_value_outside_the_bounds_is_refused() -> None:
    space = design_space("impact", ["gap"])
    with pytest.raises(ParameterError, match=r"gap = 1\.0 is not allowed"):
        space.design({"gap": 1.0})
    with pytest.raises(ParameterError, match="values"):
        space.design({"restitution": 0.5})
    assert isinstance(space, DesignSpace)
    assert "gap 0.001" in str(Design("impact", space.default.values))
