"""The kinds of scenes, by what happens in them: what can simulate a scene, and what has to be compiled for it, follows from its kind."""

from __future__ import annotations

from enum import Enum

from impact_env.parameters import CompliantWalls, ElasticCoulombFriction, SeveralAbsorbers, SlidingAbsorber, StuckAbsorber, TunedAbsorber, instance
from impact_env.scene import Scene


class SceneKind(Enum):
    """A scene's kind."""

    LINEAR = "one linear regime"
    RIGID = "rigid contact"
    COMPLIANT = "compliant contact"
    SEVERAL = "several absorbers"


def kind_of(scene: Scene) -> SceneKind:
    """Return a scene's kind."""
    absorber = instance("scene", scene, Scene).absorber
    if isinstance(absorber, SeveralAbsorbers):
        return SceneKind.SEVERAL
    if absorber is None or isinstance(absorber, StuckAbsorber | TunedAbsorber):
        return SceneKind.LINEAR
    instance("absorber", absorber, SlidingAbsorber)
    if isinstance(absorber.walls, CompliantWalls) or isinstance(absorber.friction, ElasticCoulombFriction):
        return SceneKind.COMPLIANT
    return SceneKind.RIGID


def is_linear(scene: Scene) -> bool:
    """Return whether a scene is one linear regime, so that its response goes with the force."""
    return kind_of(scene) is SceneKind.LINEAR
