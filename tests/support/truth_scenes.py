"""Scenes of every kind of contact, for comparisons with the references."""

from __future__ import annotations

from impact_env import (
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    Scene,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
    friction_damper,
    impact_absorber,
    impact_absorbers,
)
from impact_env.parameters import Absorber

SCENES: dict[str, Absorber] = {
    "friction": friction_damper(0.3),
    "impacts": impact_absorber(restitution=0.8),
    "impacts and friction": impact_absorber(restitution=0.6, friction_limit=0.1),
    "chatter": impact_absorber(restitution=0.3),
    "no rebound": impact_absorber(restitution=0.0, friction_limit=0.05),
    "springs": SlidingAbsorber(walls=CompliantWalls(3e5)),
    "elastic friction": SlidingAbsorber(friction=ElasticCoulombFriction(0.5, 7e4)),
    "springs and elastic friction": SlidingAbsorber(walls=CompliantWalls(7e5, 3e-4), friction=ElasticCoulombFriction(0.1, 7e4)),
    "tuned": TunedAbsorber(),
    "stuck": StuckAbsorber(),
}
STUCK_BESIDE = SeveralAbsorbers(
    (impact_absorber(3e-4, 0.6, 0.05, 0.012), impact_absorber(2e-4, 0.8, 0.15, 0.02), friction_damper(0.1, 0.01)), (1.0, 0.7, 0.5)
)
TORN = SeveralAbsorbers((impact_absorber(1e-3, 0.0, None, 0.5), impact_absorber(1e-4, 0.0, None, 0.5), friction_damper(1.0, 0.25)), (1.0, 1.0, 1.0))
HELD = Beam(modes=2, damping_ratio=0.05)
# name: scene, force in N, frequency ratio, pseudo periods
SEVERAL: dict[str, tuple[Scene, float, float, float]] = {
    "impacts of three": (
        beam_scene(Beam(modes=3), impact_absorbers((3e-4, 1e-4, 2e-4), (1.0, 0.55, 0.8), (0.8, 1.0, 0.9), shares=(0.5, 0.2, 0.3))),
        4.0,
        0.98,
        2.5,
    ),
    "sticking beside impacts": (beam_scene(Beam(modes=2), STUCK_BESIDE), 4.0, 0.98, 2.3),
    "torn loose": (beam_scene(Beam(modes=1, damping_ratio=0.0), TORN), 10.0, 1.0, 1.5),
    "chatter of two": (beam_scene(HELD, impact_absorbers((1e-5, 1e-5), (1.0, 0.8), restitution=0.0, mass_ratio=0.2)), 5.0, 0.3, 2.9),
}
