"""Scenes in a few words, for people."""

from __future__ import annotations

from impact_env.parameters import Absorber, CompliantWalls, ElasticCoulombFriction, RigidWalls, SeveralAbsorbers, StuckAbsorber, TunedAbsorber


def number_of_modes(modes: int) -> str:
    """Return "1 mode" or "10 modes"."""
    return f"{modes} mode{'s' * (modes != 1)}"


def absorber_words(absorber: Absorber | None) -> str:
    """Return an absorber's kind and values; a sliding one's gap in mm, its friction limit in N."""
    if absorber is None:
        return "no absorber"
    mass = f"mass ratio {absorber.mass_ratio:g}"
    if isinstance(absorber, StuckAbsorber):
        return f"stuck absorber, {mass}"
    if isinstance(absorber, TunedAbsorber):
        return f"tuned absorber, {mass}, stiffness {absorber.stiffness:g} N/m, damping {absorber.damping:g} N s/m"
    if isinstance(absorber, SeveralAbsorbers):
        each = zip(absorber.absorbers, absorber.positions, strict=True)
        return "; ".join(f"at {position:g} of the length {absorber_words(one)}" for one, position in each)
    words = ["friction damper" if absorber.walls is None else "impact absorber", mass]
    if isinstance(absorber.walls, RigidWalls):
        words.append(f"gap {1e3 * absorber.walls.gap:g} mm, restitution {absorber.walls.restitution:g}")
    if isinstance(absorber.walls, CompliantWalls):
        words.append(f"gap {1e3 * absorber.walls.gap:g} mm, contact stiffness {absorber.walls.stiffness:g} N/m")
    words.append("no friction" if absorber.friction is None else f"friction limit {absorber.friction.limit:g} N")
    if isinstance(absorber.friction, ElasticCoulombFriction):
        words.append(f"friction stiffness {absorber.friction.stiffness:g} N/m")
    return ", ".join(words)
