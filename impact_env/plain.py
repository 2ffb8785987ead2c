"""A scene, a drive and a method as plain data in SI units.

Plain data are nested dicts of numbers, strings and lists, as in JSON or TOML. The conversion is
exact in both directions.

`load_structure` reads a structure from a file of its own.

`docs/scenes.md` describes the form. A missing key has the default of the class. Anything else that
does not fit raises ParameterError with the key's path, the value and what is allowed. Fields of
the classes declare the keys (`impact_env.fields`); the codecs below convert the values.
"""

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from impact_env.checks import ParameterError, fraction, instance, one_of, require, text
from impact_env.drive import Drive, FrequencySchedule
from impact_env.laws import CONCEPTS, GRAVITY_KEY, HEAVY, concept, make, values
from impact_env.methods import METHODS, Method
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    SeveralAbsorbers,
    SlidingAbsorber,
    shared_masses,
    suspension_frequencies,
)
from impact_env.plain_disks import disk_codec_for
from impact_env.plain_files import (
    ROW_CODEC,
    Codec,
    dataclass_codec,
    dataclass_keys,
    read_plain,
    require_keys,
)
from impact_env.plain_places import (
    SCENE_KEYS,
    SEVERAL_KEY,
    find_force_shapes,
    find_structure_kind,
    read_structure,
    resolve_absorber_places,
)
from impact_env.plain_places import find_force_amplitude as find_force_amplitude
from impact_env.plain_structures import BEAM_CODEC, MODEL_CODEC, STRUCTURES, apply_forces
from impact_env.scene import Scene, beam_scene
from impact_env.structures.checks import StructureWarning as StructureWarning
from impact_env.structures.checks import list_warnings
from impact_env.structures.cyclic import BladedDisk
from impact_env.structures.modal import order_by_frequency, require_modes_once

Plain = dict[str, Any]
INFINITY = "infinity"  # JSON has no infinite number


# an absorber's older form had tables of their own for walls and friction: where its keys are now
OLDER_TABLES = {
    "walls": {"gap_m": "gap", "restitution": "restitution", "stiffness_n_m": "contact_stiffness"},
    "friction": {"limit_n": "friction_limit", "stiffness_n_m": "friction_stiffness"},
}
OLDER_KEYS = {"stiffness_n_m": "stiffness", "damping_n_s_m": "damping"}


def _from_older(path: str, plain: Mapping[str, Any]) -> dict[str, Any]:
    """Return an absorber's values in the present form.

    Values in an older form are converted with a warning.
    """
    result = dict(plain)
    old = {name for name in (*OLDER_TABLES, *OLDER_KEYS) if name in plain}
    for name, keys in OLDER_TABLES.items():
        table = result.pop(name, None)
        if table is not None:
            require_keys(f"{path}.{name}", table, {"kind": "", **keys})
            result |= {keys[key]: value for key, value in table.items() if key != "kind"}
    result = {OLDER_KEYS.get(key, key): value for key, value in result.items()}
    if old:
        warnings.warn(
            (
                f"{path}: {', '.join(sorted(old))} is an older form; from the next version on it "
                "is an error: docs/scenes.md"
            ),
            FutureWarning,
            2,
        )
    return result


def _read_single_absorber(
    path: str, plain: Any, more: tuple[str, ...] = ()
) -> tuple[Absorber | None, dict[str, Any]]:
    """Return the single absorber of a plain form, and the values of its keys in ``more``."""
    require(isinstance(plain, Mapping), path, plain, "a table of an absorber's values")
    concept = one_of(f"{path}.kind", plain.get("kind", "impact"), ABSORBER_KINDS)
    result = _from_older(path, {key: value for key, value in plain.items() if key != "kind"})
    require_keys(
        path,
        result,
        dict.fromkeys((*CONCEPTS[concept], *((GRAVITY_KEY,) if concept in HEAVY else ()), *more)),
    )
    shared = {key: result.pop(key) for key in more if key in result}
    if result.get("gap") == INFINITY:
        result["gap"] = math.inf
    try:
        return make(concept, result), shared
    except ParameterError as error:
        raise error.at_key(
            path, {name: name for name in (*CONCEPTS[concept], GRAVITY_KEY)}
        ) from error


def _write_single_absorber(absorber: Absorber | None) -> Plain:
    result = {"kind": concept(absorber), **values(absorber)}
    return result | ({"gap": INFINITY} if result.get("gap") == math.inf else {})


def _read_several(path: str, plain: Mapping[str, Any]) -> SeveralAbsorbers:
    """Return several absorbers of a plain form.

    Each has a mass of its own, or they share one mass as those of `impact_absorbers`.
    """
    require_keys(path, plain, dict.fromkeys(("absorbers", "mass_ratio")), ("absorbers",))
    members = plain["absorbers"]
    require(
        isinstance(members, list | tuple),
        f"{path}.absorbers",
        members,
        "a list of tables, one for each absorber",
    )
    every: list[SlidingAbsorber] = []
    extras: list[dict[str, Any]] = []
    for i, member in enumerate(members):
        where = f"{path}.absorbers[{i}]"
        one, more = _read_single_absorber(where, member, ("position", "share"))
        if not isinstance(one, SlidingAbsorber):
            raise ParameterError(
                f"{where}.kind = {member['kind']!r} is not allowed: impact or friction among "
                "several"
            )
        require(
            "position" in more,
            where,
            dict(member),
            "the key position must be given: it has no default",
        )
        every.append(one)
        extras.append(
            {"position": fraction(f"{where}.position", more["position"])}
            | ({"share": fraction(f"{where}.share", more["share"])} if "share" in more else {})
        )
    own = [member.get("mass_ratio") for member in members]
    shares = [more.get("share") for more in extras]
    alone = any(mass is not None for mass in own)
    allowed = (
        "either a mass_ratio for each, or for none: then they share one, in equal parts or with a "
        "share for each"
    )
    for name, numbers in (("mass_ratio", own), ("share", shares)):
        require(
            len({value is None for value in numbers}) <= 1,
            f"{path}: absorbers' {name}",
            numbers,
            allowed,
        )
    require(
        not alone or ("mass_ratio" not in plain and shares[0] is None),
        f"{path}: absorbers' mass_ratio",
        own,
        allowed,
    )
    try:
        if every and not alone:
            parts = None if shares[0] is None else [share for share in shares if share is not None]
            masses = shared_masses(
                len(every), plain.get("mass_ratio", DEFAULT_MASS_RATIO), shares=parts
            )
            every = [replace(one, mass_ratio=mass) for one, mass in zip(every, masses, strict=True)]
        return SeveralAbsorbers(tuple(every), tuple(more["position"] for more in extras))
    except ParameterError as error:
        raise error.at_key(path, {}) from error


def _read_absorber(path: str, plain: Any) -> Absorber | None:
    require(isinstance(plain, Mapping), path, plain, "a table of an absorber's values")
    require(
        "kind" in plain, f"{path}.kind", None, f"one of {', '.join((*ABSORBER_KINDS, SEVERAL_KEY))}"
    )
    if plain["kind"] == SEVERAL_KEY:
        return _read_several(path, {key: value for key, value in plain.items() if key != "kind"})
    kind = one_of(f"{path}.kind", plain["kind"], (*ABSORBER_KINDS, SEVERAL_KEY))
    return _read_single_absorber(path, {**plain, "kind": kind})[0]


def _write_absorber(absorber: Absorber) -> Plain:
    if not isinstance(absorber, SeveralAbsorbers):
        return _write_single_absorber(absorber)
    pairs = zip(absorber.absorbers, absorber.positions, strict=True)
    return {
        "kind": SEVERAL_KEY,
        "absorbers": [{"position": place, **_write_single_absorber(one)} for one, place in pairs],
    }


def _read_disk_absorbers(path: str, plain: Any, number: int) -> tuple[SlidingAbsorber, ...]:
    """Return the absorbers of a disk in its ``number`` of sectors with an absorber.

    They come from one table, whose values may be lists, or from a table for each absorber.
    """
    require(isinstance(plain, Mapping), path, plain, "a table of an absorber's values")
    kinds = ("impact", "friction", SEVERAL_KEY)
    kind = one_of(f"{path}.kind", plain.get("kind"), kinds)
    if kind == SEVERAL_KEY:
        keys = {key: value for key, value in plain.items() if key != "kind"}
        require_keys(path, keys, dict.fromkeys(("absorbers",)), ("absorbers",))
        tables = plain["absorbers"]
        listed = isinstance(tables, list | tuple)
        require(listed, f"{path}.absorbers", tables, "a list of tables, one for each absorber")
        lengths = {"absorbers": len(tables)}
        places = [f"{path}.absorbers[{i}]" for i in range(len(tables))]
    else:
        lists = {key: value for key, value in plain.items() if isinstance(value, list | tuple)}
        lengths = {key: len(value) for key, value in lists.items()}
        places = [f"{path}[{i}]" if lists else path for i in range(number if lists else 1)]
    for key, length in lengths.items():
        allowed = f"one for each of the {number} sectors with an absorber"
        require(length == number, f"{path}.{key}", f"{length} of them", allowed)
    if kind != SEVERAL_KEY:
        tables = [
            {**plain, **{key: value[i] for key, value in lists.items()}} for i in range(len(places))
        ]
    every = []
    for place, table in zip(places, tables, strict=True):
        one, _ = _read_single_absorber(place, table)
        own_kind = table.get("kind")
        allowed = "impact or friction in the sectors of a disk"
        require(isinstance(one, SlidingAbsorber), f"{place}.kind", own_kind, allowed)
        assert isinstance(one, SlidingAbsorber)
        every.append(one)
    return tuple(every) if len(every) == number else tuple(every) * number


ABSORBER_KINDS = tuple(name for name in CONCEPTS if name != "none")
ABSORBER_CODEC = Codec(_read_absorber, _write_absorber)


SCHEDULE_CODEC = dataclass_codec(
    FrequencySchedule, dataclass_keys(FrequencySchedule, times=ROW_CODEC, omegas=ROW_CODEC)
)
DRIVE_CODEC = dataclass_codec(
    Drive, dataclass_keys(Drive, without=("force_place",), schedule=SCHEDULE_CODEC)
)
METHOD_CODECS = {
    name: dataclass_codec(kind, dataclass_keys(kind)) for name, kind in METHODS.items()
}


def to_scene(plain: Mapping[str, Any], folder: Path | None = None) -> Scene:
    """Return the scene of a plain form; an empty form is the paper's beam without absorber.

    ``folder`` is the folder of the files that the form names (default: the current one). Raises
    ParameterError for unknown keys, wrong types and values, with the key's path.

    >>> str(to_scene({"beam": {"modes": 3}, "absorber": {"kind": "stuck", "mass_ratio": 0.05}}))
    '3 modes, stuck absorber, mass ratio 0.05'
    """
    folder = instance("folder", folder, Path | None)
    disk = to_disk(plain, folder)
    if disk is not None:
        try:
            return disk.scene()
        except ParameterError as error:
            raise error.at_key("scene", {}) from error
    table, numbers = resolve_absorber_places(plain, "scene.")
    absorber = None if table is None else ABSORBER_CODEC.read("scene.absorber", table)
    structure, forces = read_structure(plain, folder or Path(), "scene.")
    try:
        placed = structure
        if isinstance(structure, ModalModel) and numbers is not None:
            several = isinstance(absorber, SeveralAbsorbers)
            placed = (
                structure.with_absorbers_at(numbers)
                if several
                else structure.with_absorber_at(numbers[0])
            )
        scene = beam_scene(placed, absorber)
        if forces is None:
            return scene
        shapes = find_force_shapes(structure, forces)
        return Scene(apply_forces(scene.model, forces, shapes), scene.absorber)
    except ParameterError as error:
        raise error.at_key("scene", {}) from error


def to_structure(
    plain: Mapping[str, Any], folder: Path | None = None, path: str = "scene."
) -> Structure:
    """Return the structure of a scene's plain form, a beam or a modal model.

    The default is the paper's beam. Arguments are those of `to_scene`; errors have ``path`` before
    the key.
    """
    folder = instance("folder", folder, Path | None)
    path = text("path", path)
    structure, forces = read_structure(plain, folder or Path(), path)
    if forces is None:
        return structure
    model = modal_model(structure)
    return apply_forces(model, forces, find_force_shapes(structure, forces))


def to_disk(plain: Mapping[str, Any], folder: Path | None = None) -> BladedDisk | None:
    """Return the bladed disk with absorbers that a scene's plain form describes.

    The result is None if the form has another structure.

    Arguments and errors are those of `to_scene`; `from_disk` is its inverse.

    >>> masses = {"sectors": 10, "coupling": 0.01, "frequency_hz": 100.0, "mass_kg": 1.0}
    >>> disk = to_disk({"cyclic": masses, "absorber": {"kind": "impact", "gap": 5e-5}})
    >>> len(disk.absorbers)
    10
    """
    folder = instance("folder", folder, Path | None)
    if find_structure_kind(plain, "scene.") != "cyclic":
        return None
    disk = disk_codec_for(folder or Path()).read("scene.cyclic", plain["cyclic"])
    assert isinstance(disk, BladedDisk)
    if plain.get("absorber") is None:
        return disk
    number = len(disk.absorber_sectors)
    return disk.with_absorbers(_read_disk_absorbers("scene.absorber", plain["absorber"], number))


def from_disk(disk: BladedDisk) -> Plain:
    """Return a bladed disk's plain form, with the matrices of a sector.

    `to_disk` gives the same disk back, bit for bit.
    """
    disk = instance("disk", disk, BladedDisk)
    plain: Plain = {"cyclic": disk_codec_for(Path()).write(disk)}
    absorbers = [_write_single_absorber(one) for one in disk.absorbers]
    if len(set(disk.absorbers)) == 1:
        plain["absorber"] = absorbers[0]
    elif absorbers:
        plain["absorber"] = {"kind": SEVERAL_KEY, "absorbers": absorbers}
    return plain


NEEDED_BEAM_KEYS = (
    "length_m",
    "bending_stiffness_n_m2",
    "mass_per_length_kg_m",
)  # of a beam in a file


def load_structure(path: Path | str) -> Structure:
    """Return the structure that a TOML or JSON file describes.

    The file has one of the tables ``beam``, ``model``, ``universal``, ``matrices``, ``nastran`` and
    ``ansys``, and no absorber (`docs/scenes.md`). The response level is that at the place
    ``response`` of the file, or at the absorber's place without it.

    Parameters
    ----------
    path : path
        Name of the file.

    Returns
    -------
    Beam or ModalModel
        A beam from the table ``beam``, else modes.

    Raises
    ------
    ParameterError
        The file cannot be read, or a value is not allowed; the message names file, key and value.

    Warns
    -----
    StructureWarning
        A value is probably wrong: shapes that are not mass-normalised, coinciding frequencies,
        units, or resonances that do not move the places in use.
    """
    path = Path(instance("path", path, str | Path))
    plain = read_plain(path)
    try:
        structure = _read(plain, path)
    except ParameterError as error:
        raise error.at_key(str(path), {}) from error
    beam = structure if isinstance(structure, Beam) else None
    model = modal_model(structure)
    own = plain.get("matrices", {}).get("suspension_frequency_hz")
    rigid = beam.rigid_motions if beam is not None else 0
    if own is not None:
        rigid = sum(
            math.isclose(a, 2 * math.pi * b, rel_tol=1e-12)
            for a, b in zip(model.omega, suspension_frequencies(own, model.modes), strict=True)
        )
    # the modes of a ring come in pairs of one frequency
    for warning in () if "cyclic" in plain else list_warnings(model, beam, rigid):
        warnings.warn(f"{path}: {warning}", StructureWarning, stacklevel=2)
    return structure


def _read(plain: dict[str, Any], path: Path) -> Structure:
    kinds = [kind for kind in STRUCTURES if kind in plain]
    require(
        "absorber" not in plain,
        "absorber",
        plain.get("absorber"),
        "left out: a structure is what an absorber is put on (a scene has both)",
    )
    structure = to_structure(plain, path.parent, "")
    require(
        len(kinds) == 1,
        "structure",
        list(plain),
        f"a file with one of the tables {', '.join(STRUCTURES)}",
    )
    if "beam" in plain:
        missing = [
            key
            for key in (NEEDED_BEAM_KEYS[:1] if "section" in plain["beam"] else NEEDED_BEAM_KEYS)
            if key not in plain["beam"]
        ]
        require(
            not missing, "beam", list(plain["beam"]), f"the keys {', '.join(missing)} must be given"
        )
    if isinstance(structure, Beam):
        # in every command: where the absorber was, also if a search moves it
        at_absorber = structure.response_position is None
        own = structure.absorber_position
        return replace(structure, response_position=own) if at_absorber else structure
    if "model" in plain:
        require_modes_once(structure)
    return structure if "cyclic" in plain else order_by_frequency(structure)


def to_beam(plain: Mapping[str, Any]) -> Beam | None:
    """Return the beam of a scene's plain form, the default beam if it has no structure.

    The result is None for any other structure, and for a beam with several forces.
    """
    require_keys("scene", plain, dict.fromkeys(SCENE_KEYS))
    if "force" in plain or any(kind in plain for kind in STRUCTURES if kind != "beam"):
        return None
    structure, _ = read_structure(plain, Path(), "scene.")
    assert isinstance(structure, Beam)
    return structure


def from_scene(scene: Scene, beam: Beam | None = None) -> Plain:
    """Return a scene's plain form, with all keys.

    `to_scene` returns the same scene from it, bit for bit. The form has the modal model, because a
    scene does not contain its beam; with the argument ``beam`` it has the beam, which is shorter.
    Raises ParameterError if the scene does not have the modes of this beam. Use `from_disk` for
    bladed disks.
    """
    scene = instance("scene", scene, Scene)
    beam = instance("beam", beam, Beam | None)
    absorber = {} if scene.absorber is None else {"absorber": ABSORBER_CODEC.write(scene.absorber)}
    model = MODEL_CODEC.write(scene.model)
    if beam is None:
        return {"model": model, **absorber}
    require(
        model == MODEL_CODEC.write(beam_scene(beam, scene.absorber).model),
        "beam",
        beam,
        "the beam whose modes the scene has",
    )
    return {"beam": BEAM_CODEC.write(beam), **absorber}


def to_drive(plain: Mapping[str, Any]) -> Drive:
    """Return the drive of a plain form.

    Its keys are ``amplitude_n``, ``phase_rad`` and ``schedule`` with ``times_s``, ``omegas_rad_s``,
    ``reference_rad_s``.

    Raises ParameterError for unknown keys, wrong types and values, with the key's path.
    """
    return DRIVE_CODEC.read("drive", plain)


def from_drive(drive: Drive) -> Plain:
    """Return a drive's plain form, from which `to_drive` returns the same drive, bit for bit."""
    return DRIVE_CODEC.write(drive)


def to_method(plain: Mapping[str, Any]) -> Method:
    """Return the method of a plain form.

    Its keys are ``kind``, one of exact (default), moreau and runge-kutta, and the steps.
    """
    require(
        isinstance(plain, Mapping),
        "method",
        plain,
        f"a table whose kind is one of {', '.join(METHOD_CODECS)}",
    )
    kind = one_of("method.kind", plain.get("kind", "exact"), METHOD_CODECS)
    return METHOD_CODECS[kind].read(
        "method", {key: part for key, part in plain.items() if key != "kind"}
    )


def from_method(method: Method) -> Plain:
    """Return a method's plain form."""
    kind = next(
        name
        for name, known in METHODS.items()
        if isinstance(instance("method", method, Method), known)
    )
    return {"kind": kind, **METHOD_CODECS[kind].write(method)}
