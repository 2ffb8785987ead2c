"""Other models of the absorber, for a measurement that the chosen one does not explain."""

from collections.abc import Sequence
from dataclasses import replace

from impact_env.laws import make, values
from impact_env.parameters import RigidWalls, SlidingAbsorber
from impact_env.scene import Scene
from optimisation.calibration.parameters import (
    FRICTION_LIMIT,
    RESTITUTION,
    Prior,
    require_impact_absorber,
    usual_prior,
)

COMPLIANT = "compliant walls"
YIELDING = "restitution falls with speed"
WITHOUT_FRICTION = "no friction"
WITH_FRICTION = "friction"


def list_alternatives(
    scene: Scene, priors: Sequence[Prior], resonance: int
) -> dict[str, tuple[Scene, tuple[Prior, ...]]]:
    """Return other models by name, each a scene and its priors.

    They are springs as walls, walls with a restitution that falls with the speed, and added or
    omitted friction. Unequal gaps are not a further model, because only the total clearance acts on
    a mass without centring force.
    """
    absorber = require_impact_absorber(scene)
    walls = absorber.walls
    if not isinstance(walls, RigidWalls):
        return {}
    own = values(absorber)
    models: dict[str, tuple[Scene, tuple[Prior, ...]]] = {}
    for name, key in ((COMPLIANT, "contact_stiffness"), (YIELDING, "yield_velocity")):
        prior = usual_prior(key, scene, resonance)
        middle = (prior.low * prior.high) ** 0.5
        restitution = min(max(walls.restitution, 0.05), 1.0)
        chosen = own | {key: middle, RESTITUTION: restitution}
        if name == COMPLIANT:
            chosen.pop("static_friction_ratio", None)
        other = make("impact", chosen)
        other_priors = [one for one in priors if one.name != "static_friction_ratio"]
        models[name] = Scene(scene.model, other), (*other_priors, prior)
    if absorber.friction is not None:
        without = tuple(
            one for one in priors if one.name not in (FRICTION_LIMIT, "static_friction_ratio")
        )
        frictionless = replace(absorber, friction=None)
        if without:
            models[WITHOUT_FRICTION] = Scene(scene.model, frictionless), without
    else:
        prior = usual_prior(FRICTION_LIMIT, scene, resonance)
        chosen = own | {FRICTION_LIMIT: (prior.low + prior.high) / 2}
        with_friction = make("impact", chosen)
        assert isinstance(with_friction, SlidingAbsorber)
        models[WITH_FRICTION] = Scene(scene.model, with_friction), (*priors, prior)
    return models
