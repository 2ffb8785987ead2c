"""A scene, a drive and a method as plain data: nested dicts of numbers, strings and lists, so JSON or TOML, in SI units. Both ways are exact.

`docs/scenes.md` describes the form. A key that is left out has the default of the class; everything else that does not fit is a ParameterError
that names the key's path, the value and what is allowed. The tables below are the form: key -> argument of the class, and its sort.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from impact_env.drive import Drive, FrequencySchedule
from impact_env.forms import NUMBER, ROW, WHOLE, Keys, Sort, either, form, optional, require_keys
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.modes import Structure
from impact_env.parameters import (
    Beam,
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    ParameterError,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    fraction,
    friction_damper,
    friction_law,
    positive,
    require,
)
from impact_env.plain_structures import BEAM, MODEL, STRUCTURES
from impact_env.scene import Scene, beam_scene
from impact_env.shared_mass import shared_masses

Plain = dict[str, Any]
INFINITY = "infinity"  # JSON has no infinite number


def _is(kind: type) -> Any:
    return lambda value: isinstance(value, kind)


GAP = Sort(
    lambda path, plain: math.inf if isinstance(plain, str) and plain == INFINITY else NUMBER.read(path, plain),
    lambda gap: INFINITY if math.isinf(gap) else float(gap),
)
WALLS = either(
    {
        "rigid": (_is(RigidWalls), form(RigidWalls, {"gap_m": ("gap", GAP), "restitution": ("restitution", NUMBER)})),
        "compliant": (_is(CompliantWalls), form(CompliantWalls, {"stiffness_n_m": ("stiffness", NUMBER), "gap_m": ("gap", NUMBER)})),
    },
    "rigid",
)


def _rubbing(rigid: Any, elastic: Any) -> Sort:
    limit: Keys = {"limit_n": ("limit", NUMBER)}
    kinds = {
        "coulomb": (_is(CoulombFriction), form(rigid, limit)),
        "elastic": (_is(ElasticCoulombFriction), form(elastic, {**limit, "stiffness_n_m": ("stiffness", NUMBER)})),
    }
    return either(kinds, "coulomb")


def _coulomb(limit: float) -> Any:
    return friction_law(limit)


def _elastic(limit: float, stiffness: float) -> Any:
    return friction_law(limit, stiffness)


def _damper_coulomb(limit: float) -> Any:
    return friction_damper(limit).friction


def _damper_elastic(limit: float, stiffness: float) -> Any:
    return friction_damper(limit, friction_stiffness=stiffness).friction


MASS: Keys = {"mass_ratio": ("mass_ratio", NUMBER)}
# beside walls a limit of 0 is no friction; a damper without friction would be nothing, and is refused
DAMPER: Keys = {**MASS, "friction": ("friction", _rubbing(_damper_coulomb, _damper_elastic))}
IMPACT: Keys = {**MASS, "walls": ("walls", WALLS), "friction": ("friction", optional(_rubbing(_coulomb, _elastic)))}
DEFAULT_WALLS, DEFAULT_RUBBING = RigidWalls(), friction_damper().friction


@dataclass(frozen=True)
class _Member:
    """One of several absorbers at its ``position``, with a mass of its own or a ``share`` of one."""

    position: float
    mass_ratio: float | None = None
    share: float | None = None
    walls: RigidWalls | CompliantWalls | None = None
    friction: CoulombFriction | ElasticCoulombFriction | None = None

    def __post_init__(self) -> None:
        fraction("position", self.position)
        for name in ("mass_ratio", "share"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name))


PLACE: Keys = {"position": ("position", NUMBER), "share": ("share", NUMBER)}
MEMBER = either(
    {
        "impact": (lambda member: member.walls is not None, form(partial(_Member, walls=DEFAULT_WALLS), {**PLACE, **IMPACT})),
        "friction": (lambda member: member.walls is None, form(partial(_Member, friction=DEFAULT_RUBBING), {**PLACE, **DAMPER})),
    },
    "impact",
)


def _members(path: str, plain: Any) -> list[_Member]:
    require(isinstance(plain, list | tuple), path, plain, "a list of tables, one for each absorber")
    return [MEMBER.read(f"{path}[{i}]", member) for i, member in enumerate(plain)]


def _several(absorbers: list[_Member], mass_ratio: float | None = None) -> SeveralAbsorbers:
    """Return several absorbers that either have a mass each, or share one as those of `impact_absorbers` do."""
    own, shares = ([getattr(member, name) for member in absorbers] for name in ("mass_ratio", "share"))
    alone = any(mass is not None for mass in own)
    allowed = "either a mass_ratio for each, or for none: then they share one, in equal parts or with a share for each"
    for name, values in (("mass_ratio", own), ("share", shares)):
        require(len({value is None for value in values}) <= 1, f"absorbers' {name}", values, allowed)
    require(not alone or (mass_ratio is None and shares[0] is None), "absorbers' mass_ratio", own, allowed)
    if absorbers and not alone:
        total = {} if mass_ratio is None else {"mass_ratio": mass_ratio}
        own = list(shared_masses(len(absorbers), **total, shares=None if shares[0] is None else shares))
    masses = zip(absorbers, own, strict=True)
    return SeveralAbsorbers(tuple(SlidingAbsorber(mass, one.walls, one.friction) for one, mass in masses), tuple(one.position for one in absorbers))


def _write_several(several: SeveralAbsorbers) -> Plain:
    pairs = zip(several.absorbers, several.positions, strict=True)
    return {"absorbers": [MEMBER.write(_Member(place, one.mass_ratio, None, one.walls, one.friction)) for one, place in pairs]}


_SEVERAL = form(_several, {"absorbers": ("absorbers", Sort(_members, list)), **MASS})
TUNED: Keys = {**MASS, "stiffness_n_m": ("stiffness", NUMBER), "damping_n_s_m": ("damping", NUMBER)}
ABSORBER = either(
    {
        "impact": (lambda a: isinstance(a, SlidingAbsorber) and a.walls is not None, form(partial(SlidingAbsorber, walls=DEFAULT_WALLS), IMPACT)),
        "friction": (_is(SlidingAbsorber), form(partial(SlidingAbsorber, friction=DEFAULT_RUBBING), DAMPER)),
        "tuned": (_is(TunedAbsorber), form(TunedAbsorber, TUNED)),
        "stuck": (_is(StuckAbsorber), form(StuckAbsorber, MASS)),
        "several": (_is(SeveralAbsorbers), Sort(_SEVERAL.read, _write_several)),
    }
)


SCENE_KEYS = (*STRUCTURES, "absorber")
SCHEDULE = form(FrequencySchedule, {"times_s": ("times", ROW), "omegas_rad_s": ("omegas", ROW), "reference_rad_s": ("reference", NUMBER)})
DRIVE = form(Drive, {"amplitude_n": ("amplitude", NUMBER), "phase_rad": ("phase", NUMBER), "schedule": ("schedule", SCHEDULE)})
STEPS: Keys = {"steps_per_period": ("steps_per_period", WHOLE)}
METHOD = either(
    {
        "exact": (_is(Exact), form(Exact, {})),
        "moreau": (_is(Moreau), form(Moreau, STEPS)),
        "runge-kutta": (_is(RungeKutta), form(RungeKutta, {**STEPS, "steps_per_contact": ("steps_per_contact", WHOLE)})),
    },
    "exact",
)


def to_scene(plain: Mapping[str, Any], folder: Path | None = None) -> Scene:
    """Return the scene of a plain form; an empty one is the paper's beam without absorber.

    ``folder``: where the files lie that it names (default: the current one). Raises ParameterError for unknown keys, wrong types and
    values, with the key's path.

    >>> str(to_scene({"beam": {"modes": 3}, "absorber": {"kind": "stuck", "mass_ratio": 0.05}}))
    '3 modes, stuck absorber, mass ratio 0.05'
    """
    structure = to_structure(plain, folder)
    absorber = optional(ABSORBER).read("scene.absorber", plain.get("absorber"))
    try:
        return beam_scene(structure, absorber)
    except ParameterError as error:
        raise ParameterError(f"scene: {error}") from error


def to_structure(plain: Mapping[str, Any], folder: Path | None = None, path: str = "scene.") -> Structure:
    """Return what a scene's plain form puts the absorber on: a beam, the paper's by default, or a modal model; arguments as in `to_scene`.

    ``path``: what an error names before the key.
    """
    require_keys(path.rstrip(".") or "structure", plain, dict.fromkeys(SCENE_KEYS))
    given = [kind for kind in STRUCTURES if kind in plain]
    allowed = "left out beside another structure: a scene has one of them"
    require(len(given) <= 1, f"{path}{given[0] if given else ''}", plain.get(given[0]) if given else None, allowed)
    kind = given[0] if given else "beam"
    structure: Structure = STRUCTURES[kind](folder or Path()).read(f"{path}{kind}", plain.get(kind, {}))
    return structure


def to_beam(plain: Mapping[str, Any]) -> Beam | None:
    """Return the beam that a scene's plain form names, the default one if it names none, or None if it has another structure."""
    require_keys("scene", plain, dict.fromkeys(SCENE_KEYS))
    return None if any(kind in plain for kind in STRUCTURES if kind != "beam") else BEAM.read("scene.beam", plain.get("beam", {}))


def from_scene(scene: Scene, beam: Beam | None = None) -> Plain:
    """Return a scene's plain form, with all keys: `to_scene` gives the same scene back, bit for bit.

    A scene knows its modes and not the beam they came from, so the form has the modal model; with the ``beam`` of the scene it has the beam
    instead, which is shorter. Raises ParameterError if that is not the scene's beam.
    """
    absorber = {} if scene.absorber is None else {"absorber": ABSORBER.write(scene.absorber)}
    model = MODEL.write(scene.model)
    if beam is None:
        return {"model": model, **absorber}
    require(model == MODEL.write(beam_scene(beam, scene.absorber).model), "beam", beam, "the beam whose modes the scene has")
    return {"beam": BEAM.write(beam), **absorber}


def to_drive(plain: Mapping[str, Any]) -> Drive:
    """Return the drive of a plain form: ``amplitude_n``, ``phase_rad`` and ``schedule`` with ``times_s``, ``omegas_rad_s``, ``reference_rad_s``.

    Raises ParameterError for unknown keys, wrong types and values, with the key's path.
    """
    drive: Drive = DRIVE.read("drive", plain)
    return drive


def from_drive(drive: Drive) -> Plain:
    """Return a drive's plain form; `to_drive` gives the same drive back, bit for bit."""
    plain: Plain = DRIVE.write(drive)
    return plain


def to_method(plain: Mapping[str, Any]) -> Method:
    """Return the method of a plain form: ``kind``, one of exact (default), moreau and runge-kutta, and its steps."""
    method: Method = METHOD.read("method", plain)
    return method


def from_method(method: Method) -> Plain:
    """Return a method's plain form."""
    plain: Plain = METHOD.write(method)
    return plain
