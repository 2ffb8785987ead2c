"""Places in a scene's plain form, by name or number.

They are the places of its structure, its forces and its absorbers.

The table ``places`` of a scene gives names to places in the form of the structure's table: shares
of a beam's length, rows of matrices, nodes with directions, or numbers of a model's places.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from impact_env.checks import count, fraction, positive, require
from impact_env.modes import Structure, mode_shapes
from impact_env.parameters import Beam
from impact_env.plain_files import NUMBER_CODEC, require_keys
from impact_env.plain_structures import (
    PLACE_CODECS,
    STRUCTURES,
    PointForce,
    read_forces,
)

SEVERAL_KEY = "several"
SCENE_KEYS = (*STRUCTURES, "absorber", "force", "places")
# keys of a structure's table that are places, or lists of them, and may be names of the table
# ``places``
PLACE_KEYS = {
    "beam": ("force_position", "absorber_position", "response_position"),
    **dict.fromkeys(PLACE_CODECS, ("force", "absorber", "response")),
    "model": (),
    "cyclic": (),
}


def find_structure_kind(plain: Mapping[str, Any], path: str) -> str:
    """Return the kind of structure in a scene's plain form, one of `STRUCTURES`.

    It is a beam if the form names none. Raises ParameterError for other keys and for two
    structures.
    """
    require_keys(path.rstrip(".") or "structure", plain, dict.fromkeys(SCENE_KEYS))
    kinds = [kind for kind in STRUCTURES if kind in plain]
    allowed = "left out beside another structure: a scene has one of them"
    require(
        len(kinds) <= 1,
        f"{path}{kinds[0] if kinds else ''}",
        plain.get(kinds[0]) if kinds else None,
        allowed,
    )
    kind = kinds[0] if kinds else "beam"
    for key in ("force", "places") if kind == "cyclic" else ():
        allowed = (
            "left out beside cyclic: its force is given by engine_order and amplitude_n, its "
            "places by sectors"
        )
        require(key not in plain, f"{path}{key}", plain.get(key), allowed)
    return kind


def read_structure(
    plain: Mapping[str, Any], folder: Path, path: str
) -> tuple[Structure, tuple[PointForce, ...] | None]:
    """Return the structure of a scene's plain form, and further forces.

    These are the forces of the table ``force`` that the structure's modes do not include yet, or
    None.
    """
    kind = find_structure_kind(plain, path)
    table = _resolve_names(plain, kind, path)
    forces = _read_scene_forces(plain, kind, path)
    if forces is not None and kind in PLACE_CODECS and isinstance(table, Mapping):
        require(
            "force" not in table, f"{path}{kind}.force", table.get("force"), "left out beside force"
        )
        table = {**table, "force": forces}
        forces = None
    absorber = plain.get("absorber")
    placed = isinstance(table, Mapping) and isinstance(absorber, Mapping) and "place" in absorber
    if kind == "beam" and placed:
        assert isinstance(absorber, Mapping)
        own = table.get("absorber_position")
        require(own is None, f"{path}beam.absorber_position", own, "left out beside absorber.place")
        place = _beam_place(plain, f"{path}absorber.place", absorber["place"])
        table = {**table, "absorber_position": place}
    return STRUCTURES[kind](folder).read(f"{path}{kind}", table), forces


def _read_names(plain: Mapping[str, Any], path: str) -> Mapping[str, Any]:
    names = plain.get("places", {})
    allowed = "a table of names and places, as the structure's table has them"
    require(isinstance(names, Mapping), f"{path}places", names, allowed)
    return names


def _find_named_place(plain: Mapping[str, Any], path: str, place: Any, key: str) -> Any:
    """Return a place, which may be given by a name of the table ``places``.

    ``key``: name of the place's key in errors.
    """
    if not isinstance(place, str):
        return place
    names = _read_names(plain, path)
    allowed = f"a place, or one of the names in places: {', '.join(names) or 'there are none'}"
    require(place in names, key, place, allowed)
    return names[place]


def _resolve_names(plain: Mapping[str, Any], kind: str, path: str) -> Any:
    """Return the table of a structure with names of places replaced by the places."""
    table = plain.get(kind, {})
    _read_names(plain, path)
    if not isinstance(table, Mapping):
        return table
    result = dict(table)
    for key in PLACE_KEYS[kind]:
        value = result.get(key)
        where = f"{path}{kind}.{key}"
        if isinstance(value, list | tuple):
            result[key] = [_find_named_place(plain, path, one, where) for one in value]
        elif value is not None:
            result[key] = _find_named_place(plain, path, value, where)
    return result


def _read_scene_forces(
    plain: Mapping[str, Any], kind: str, path: str
) -> tuple[PointForce, ...] | None:
    """Return the forces of a scene's table ``force``, None without."""
    if "force" not in plain:
        return None
    tables = plain["force"]
    named = tables
    where = f"{path}force"
    if kind == "beam":
        beam = plain.get("beam")
        own = beam.get("force_position") if isinstance(beam, Mapping) else None
        require(own is None, f"{path}beam.force_position", own, "left out beside force")
    if isinstance(tables, list | tuple):
        tables = [
            {**one, "place": _find_named_place(plain, path, one["place"], f"{where}[{k}].place")}
            if isinstance(one, Mapping) and "place" in one
            else one
            for k, one in enumerate(tables)
        ]
    forces = read_forces(where, tables, PLACE_CODECS.get(kind, NUMBER_CODEC))
    return tuple(
        replace(force, name=str(table["place"])) for force, table in zip(forces, named, strict=True)
    )


def find_force_shapes(structure: Structure, forces: tuple[PointForce, ...]) -> Any:
    """Return the mode shapes (P, N_m) at the places of forces on a beam or a modal model."""
    if isinstance(structure, Beam):
        places = [fraction(f"force[{k}].place", one.place) for k, one in enumerate(forces)]
        return mode_shapes(structure, places)
    number = len(structure.places)
    allowed = f"the number of one of the model's places for absorbers, 1 to {number}"
    return [
        structure.places[count(f"force[{k}].place", one.place, 1, number, allowed) - 1]
        for k, one in enumerate(forces)
    ]


def _beam_place(plain: Mapping[str, Any], key: str, place: Any) -> float:
    """Return a place on a beam, a share of the length or a name."""
    return fraction(key, _find_named_place(plain, "scene.", place, key))


def resolve_absorber_places(
    plain: Mapping[str, Any], path: str
) -> tuple[Any, tuple[int, ...] | None]:
    """Return the table of the absorber without the keys ``place``, and the places' numbers.

    The numbers count the places of the structure from 1. They are None if no place is given. On a
    beam the place of one absorber becomes the beam's, and several absorbers have positions.
    """
    absorber = plain.get("absorber")
    if not isinstance(absorber, Mapping):
        return absorber, None
    kind = find_structure_kind(plain, path)
    members = absorber.get("absorbers")
    where = f"{path}absorber"
    if absorber.get("kind") != SEVERAL_KEY or not isinstance(members, list | tuple):
        table = {key: value for key, value in absorber.items() if key != "place"}
        if "place" not in absorber:
            return table, None
        if kind == "beam":
            _beam_place(plain, f"{where}.place", absorber["place"])
            return table, None
        return table, (_find_place_number(plain, kind, f"{where}.place", absorber["place"]),)
    placed = [isinstance(one, Mapping) and "place" in one for one in members]
    if not any(placed):
        return absorber, None
    require(all(placed), f"{where}.absorbers", placed, "a place for each of them, or for none")
    tables = []
    numbers = []
    for k, one in enumerate(members):
        key = f"{where}.absorbers[{k}]"
        require("position" not in one, f"{key}.position", one.get("position"), "left out: place")
        rest = {name: value for name, value in one.items() if name != "place"}
        if kind == "beam":
            tables.append({**rest, "position": _beam_place(plain, f"{key}.place", one["place"])})
        else:
            numbers.append(_find_place_number(plain, kind, f"{key}.place", one["place"]))
            tables.append({**rest, "position": 1.0})
    repeated = [n for n in numbers if numbers.count(n) > 1]
    require(not repeated, f"{where}.absorbers", f"place {repeated[:1]} twice", "each place once")
    return {**absorber, "absorbers": tables}, tuple(numbers) or None


def _find_place_number(plain: Mapping[str, Any], kind: str, key: str, place: Any) -> int:
    """Return the number, from 1, of an absorber's place among those of the structure.

    The place is given by its number, or by a name in the structure's list ``absorber``.
    """
    if not isinstance(place, str):
        return count(key, place, 1)
    names = _read_names(plain, "scene.")
    if kind == "model":
        return count(key, _find_named_place(plain, "scene.", place, key), 1)
    table = plain.get(kind)
    own = table.get("absorber") if isinstance(table, Mapping) else None
    every = list(own) if isinstance(own, list | tuple) else [own]
    wanted = names.get(place)
    allowed = (
        f"the number, from 1, of a place in {kind}.absorber, or a name of one of them in places"
    )
    matches = [
        n
        for n, one in enumerate(every, 1)
        if one == place or (wanted is not None and one == wanted)
    ]
    require(len(matches) > 0, key, place, allowed)
    return matches[0]


def find_force_amplitude(plain: Mapping[str, Any]) -> float | None:
    """Return the amplitude in N of the first force of a scene's plain form, or of a disk's.

    The result is None if the form has no force.
    """
    for table in (plain.get("force"), plain.get("cyclic")):
        first = table[0] if isinstance(table, list | tuple) and table else table
        if isinstance(first, Mapping) and "amplitude_n" in first:
            return positive("amplitude_n", first["amplitude_n"])
    return None
