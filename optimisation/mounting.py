"""A structure with the places of absorber and level, and structures with other frequencies.

A design study asks how quiet a place of the structure is. On a beam that names no response position
this is the free end, also where an absorber sits elsewhere, or the absorber's own place if the beam
has no free end. A modal model has its places.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from impact_env.checks import finite, instance
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import Absorber, Beam, SeveralAbsorbers, SlidingAbsorber
from impact_env.plain import from_scene
from impact_env.scene import Scene, beam_scene

FIRST_PLACE = 1  # of a modal model's places for absorbers


def with_response_point(structure: Structure) -> Structure:
    """Return the structure with the place where the level is read."""
    if isinstance(structure, ModalModel) or structure.response_position is not None:
        return structure
    return replace(
        structure,
        response_position=1.0 if structure.ends.endswith("free") else structure.absorber_position,
    )


def model_with_absorber_at(structure: Structure, position: float | None = None) -> ModalModel:
    """Return the modal model with the places of absorber and level.

    ``position``: place of the absorber as a share of the length (None: the structure's own place).

    On a modal model a ``position`` is the number of one of its `places`, counted from 1, and the
    first is its own.
    """
    structure = instance("structure", structure, Structure)
    placed = with_response_point(structure)
    if isinstance(placed, ModalModel):
        own = position is None and placed.absorber_shapes is None
        return (
            placed
            if own
            else placed.with_absorber_at(FIRST_PLACE if position is None else position)
        )
    if position is not None:
        placed = replace(placed, absorber_position=position)
    return modal_model(placed)


def scene_on(structure: Structure, absorber: Absorber | None, *positions: float) -> Scene:
    """Return the scene of an absorber on a structure at a position, or of several absorbers.

    Without a position the absorber is at the structure's own place. Each of several absorbers has a
    position.

    Several absorbers on a beam have their own positions; the argument is then not used.
    """
    structure = instance("structure", structure, Structure)
    if not isinstance(absorber, SeveralAbsorbers):
        return Scene(model_with_absorber_at(structure, *positions), absorber)
    if isinstance(structure, ModalModel):
        return Scene(structure.with_absorbers_at(positions), absorber)
    return beam_scene(with_response_point(structure), absorber)


def detune(structure: Structure, share: float) -> Structure:
    """Return a structure whose frequencies are shifted by a share, a beam by its stiffness."""
    share = finite("share", share)
    structure = instance("structure", structure, Structure)
    if isinstance(structure, ModalModel):
        return structure.detuned(share) if share else structure
    stiffer = (1 + share) ** 2
    sections = tuple(
        replace(section, bending_stiffness=section.bending_stiffness * stiffer)
        for section in structure.sections
    )
    soft = (
        None
        if structure.suspension_frequency is None
        else structure.suspension_frequency * (1 + share)
    )
    return replace(
        structure,
        bending_stiffness=structure.bending_stiffness * stiffer,
        sections=sections,
        suspension_frequency=soft,
    )


def to_dict(structure: Structure) -> dict[str, object]:
    """Return a structure's identity as JSON values.

    Defaults of a beam that the paper's beam lacks are left out.
    """
    if isinstance(structure, ModalModel):
        return {
            name: x.tolist() if hasattr(x, "tolist") else x
            for name, x in vars(structure).items()
            if x is not None
        }
    plain = {
        name: list(x) if isinstance(x, tuple) else dict(x) if isinstance(x, Mapping) else x
        for name, x in vars(structure).items()
    }
    plain["sections"] = [vars(section) for section in structure.sections]
    usual = {
        "ends": Beam.ends,
        "tip_mass": 0.0,
        "sections": [],
        "response_position": None,
        "suspension_frequency": None,
    }
    return {name: x for name, x in plain.items() if name not in usual or x != usual[name]}


def device_scene(structure: Structure, absorber: SlidingAbsorber) -> dict[str, Any]:
    """Return structure and absorber as the plain data of a scene: a beam as a beam."""
    if isinstance(structure, Beam):
        return from_scene(Scene(modal_model(structure), absorber), structure)
    return from_scene(Scene(model_with_absorber_at(structure), absorber))
