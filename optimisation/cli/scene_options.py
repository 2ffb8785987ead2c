"""Options of what is simulated: structure, absorber and load.

The scene, the method and the schedule are made from them.
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import click
import numpy as np
from click.core import ParameterSource

from impact_env.checks import positive, require
from impact_env.drive import default_rate, linear_sweep
from impact_env.laws import CONCEPTS, make
from impact_env.loads import Loads, Random, Samples
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    RigidWalls,
    SlidingAbsorber,
    friction_damper,
)
from impact_env.plain import (
    StructureWarning,
    load_structure,
    to_beam,
    to_disk,
    to_scene,
)
from impact_env.plain_files import read_plain
from impact_env.plain_loads import read_loads, to_loads
from impact_env.scene import Scene, beam_scene
from impact_env.structures.cyclic import BladedDisk
from optimisation.absorber_rules import (
    PAPER_FRICTION,
    RESTITUTION,
    best_friction,
    rigid_walls,
)
from optimisation.bounds import design_force, design_gap
from optimisation.cli.common import BadInput
from optimisation.cli.options import (
    LOADS_IN_SHORT,
    TABLE,
    OptionSpec,
    list_specs,
    option,
    option_values,
)
from optimisation.contact import ALLOWED, YIELD_PRESSURE, YieldLimit, check_contact
from optimisation.gap_advice import Limits
from optimisation.mounting import model_with_absorber_at
from optimisation.sweep_range import usable_mass_ratio
from optimisation.tuned import minimax

structure_option = TABLE["structure"]
CONSTRAINTS = ("stroke", "impact_speed", "yield_stress")
CONSTRAINT_MORE = (
    "stroke (m, from the middle of the cavity), impact_speed (m/s, the largest), yield_stress "
    "(Pa, of the softer body of --contact, "
    f"whose peak pressure stays below {YIELD_PRESSURE:g} times it)."
)
FRICTION_TEXT = f"the paper's {PAPER_FRICTION} N by the scaling law, in proportion to the gap"


def read_structure(path: Path) -> Structure:
    """Return the structure of a file, and print its warnings, one a line.

    Raises BadInput for a bladed disk.
    """
    if "cyclic" in read_plain(path):
        raise BadInput(
            f"{path} is not allowed: a bladed disk is given with its absorbers, as --scene of "
            "sweep, compare or design gap"
        )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", StructureWarning)
        structure = load_structure(path)
    for warning in caught:
        if issubclass(warning.category, StructureWarning):
            click.echo(f"warning: {warning.message}", err=True)
        else:
            warnings.warn_explicit(
                warning.message, warning.category, warning.filename, warning.lineno
            )
    return structure


def refuse_with_scene(*names: str) -> None:
    """Raise BadInput if one of the options that are named was given beside --scene."""
    for name in names:
        if is_option_set(name):
            raise BadInput(
                f"--{name.replace('_', '-')} does not go with --scene: the file says what "
                "structure and absorber are"
            )


def read_disk(path: Path | None, *names: str) -> BladedDisk | None:
    """Return the bladed disk of a scene's file, None for no file and for another structure.

    Raises BadInput if one of the options that are named was given beside the file.
    """
    if path is None:
        return None
    refuse_with_scene(*names)
    plain = read_plain(path)
    return to_disk(plain, path.parent) if "cyclic" in plain else None


@dataclass(frozen=True, kw_only=True)
class DeviceOptions:
    """Options for structure and scene of commands that choose or evaluate a device.

    The scene is a structure with an impact absorber. None: not given.
    """

    structure: Path | None = option("structure")
    scene: Path | None = option(
        "scene", help="Structure and impact absorber from a .toml or .json file"
    )

    @property
    def beam(self) -> Beam:
        """The beam that is taken without a file."""
        return Beam()


@dataclass(frozen=True, kw_only=True)
class BeamOptions(DeviceOptions):
    """Options of the paper's beam as well."""

    modes: int = option("modes", default=Beam.modes)
    damping: float = option("damping", default=Beam.damping_ratio)

    @property
    def beam(self) -> Beam:
        """The beam that the options describe."""
        return Beam(modes=self.modes, damping_ratio=self.damping)


@dataclass(frozen=True, kw_only=True)
class AbsorberOptions(DeviceOptions):
    """Place and mass of one absorber."""

    position: float = option("position")
    mass_ratio: float = option("mass_ratio")
    mass_kg: float | None = option("mass_kg")


@dataclass(frozen=True, kw_only=True)
class SweepRunOptions:
    """How runs are made, of commands that sweep; None: not given."""

    rate: float | None = option("rate")
    seed: int = option("seed")
    threads: int | None = option("threads")
    cluster: str | None = option("cluster")


@dataclass(frozen=True, kw_only=True)
class SummaryOptions:
    """Where the summary is written besides the folder; None: not given."""

    json: Path | None = option("json", help="Write the summary here, too")


@dataclass(frozen=True, kw_only=True)
class ImpactOptions:
    """Restitution and friction of a device whose gap is chosen; None: not given."""

    restitution: float = option("restitution", default=RESTITUTION)
    friction_limit: float | None = option(
        "friction_limit",
        help="Friction limit at any gap, 0 for none",
        default_text=FRICTION_TEXT,
    )


@dataclass(frozen=True, kw_only=True)
class RecommendationOptions(SummaryOptions):
    """What a recommended device must keep, and what is written of it; None or empty: not given."""

    contact: tuple[str, str, float] | None = option(
        "contact", more=f"Estimates contact time and force. Each material is {ALLOWED}."
    )
    constraint: tuple[tuple[str, float], ...] = option(
        "constraint",
        more=CONSTRAINT_MORE,
        type=click.Tuple([click.Choice(CONSTRAINTS), float]),
        usual=True,
    )
    device: Path | None = option("device", usual=True)
    history: Path | None = option("history")
    no_card: bool = option("no_card")


def read_limits(options: RecommendationOptions) -> tuple[Limits, YieldLimit | None]:
    """Return the limits of stroke and impact speed, and the limit of impacts by yield.

    Raises BadInput or ParameterError.
    """
    values = {name: positive(f"constraint {name}", value) for name, value in options.constraint}
    limits = Limits(values.get("stroke"), values.get("impact_speed"))
    stress = values.get("yield_stress")
    if options.contact is None:
        if stress is not None:
            raise BadInput(
                "--constraint yield_stress needs --contact: materials and radius that touch"
            )
        return limits, None
    first, second, radius = check_contact(options.contact, "radius of --contact in m")
    if stress is not None:
        return limits, YieldLimit((first, second), radius, stress)
    if options.no_card:
        raise BadInput("--contact does not go with --no-card: its estimate is on the card")
    return limits, None


def values_of(device: SlidingAbsorber) -> tuple[float, float]:
    """Return restitution and friction limit in N of an impact absorber, 0 without friction."""
    friction = 0.0 if device.friction is None else device.friction.limit
    return rigid_walls(device).restitution, friction


class DeviceSource(NamedTuple):
    """A structure with its file, and the impact absorber of --scene.

    Without a file (None) the structure is the beam of the options, or that of a scene.
    """

    structure: Structure
    device: SlidingAbsorber | None = None
    file: Path | None = None


def read_source(
    options: DeviceOptions, *allowed: str, position: float | None = None
) -> DeviceSource:
    """Return the structure that the options describe.

    If a ``position`` is given, the absorber is placed there.

    Raises BadInput for an option of the structure or the absorber beside --scene, but for those of
    ``allowed``, and for options of the beam beside --structure.
    """
    specs = list_specs(type(options))
    if options.scene is not None:
        names = [
            name
            for name, spec in specs.items()
            if spec.section in ("Structure", "Absorber") and name not in ("scene", *allowed)
        ]
        return DeviceSource(*read_device(options.scene, *names))
    refuse_with_structure(options.structure, *(name for name in OF_BEAM if name in specs))
    if options.structure is None:
        beam = options.beam
        if position is not None:
            beam = replace(beam, absorber_position=position)
        return DeviceSource(beam)
    structure = read_structure(options.structure)
    if position is None or not is_option_set("position"):
        return DeviceSource(structure, None, options.structure)
    if isinstance(structure, Beam):
        placed: Structure = replace(structure, absorber_position=position)
    else:
        placed = model_with_absorber_at(structure, position)
    return DeviceSource(placed, None, options.structure)


def read_source_model(
    options: DeviceOptions, *allowed: str, position: float | None = None
) -> tuple[ModalModel, SlidingAbsorber | None]:
    """Return the modal model of `read_source`, and the absorber of --scene."""
    structure, device, file = read_source(options, *allowed, position=position)
    if device is None and file is None and isinstance(structure, Beam):
        return modal_model(structure), None
    return model_with_absorber_at(structure), device


def read_device(path: Path, *names: str) -> tuple[Structure, SlidingAbsorber]:
    """Return the structure and the impact absorber of a file.

    Raises BadInput if one of the options ``names`` is given as well.
    """
    refuse_with_scene(*names)
    plain = read_plain(path)
    scene = to_scene(plain, path.parent)
    beam = to_beam(plain)
    absorber = scene.absorber
    if not isinstance(absorber, SlidingAbsorber) or not isinstance(absorber.walls, RigidWalls):
        raise BadInput(
            f"--scene = {path} is not allowed: a scene with one impact absorber between rigid walls"
        )
    mass_ratio = usable_mass_ratio(f"{path}: mass_ratio", absorber.mass_ratio)
    absorber = replace(absorber, mass_ratio=mass_ratio)
    if beam is None:
        return scene.model, absorber
    return (
        beam
        if beam.response_position is not None
        else replace(beam, response_position=beam.absorber_position)
    ), absorber


def mass_ratio_of(mass_ratio: float, mass_kg: float | None, structure_mass: float) -> float:
    """Return the mass ratio, that of --mass-kg if given; raises BadInput if both are."""
    if mass_kg is None:
        return mass_ratio
    if is_option_set("mass_ratio"):
        raise BadInput("--mass-kg does not go with --mass-ratio: each says what the mass is")
    require(
        0 < mass_kg <= structure_mass,
        "mass_kg",
        mass_kg,
        f"above 0 and at most the structure's {structure_mass:.4g} kg",
    )
    return mass_kg / structure_mass


def mass_ratios_of(
    ratios: Sequence[float], masses_kg: Sequence[float], structure_mass: float
) -> tuple[float, ...]:
    """Return the mass ratios of repeated --mass-ratio or --mass-kg.

    The result is empty if neither is given. Raises BadInput if both are given.
    """
    if not masses_kg:
        return tuple(ratios)
    if ratios:
        raise BadInput("--mass-kg does not go with --mass-ratio: each says what the masses are")
    return tuple(mass_ratio_of(DEFAULT_MASS_RATIO, mass, structure_mass) for mass in masses_kg)


def is_option_set(name: str) -> bool:
    """Return whether an option of the running command was given explicitly.

    The result is False if the option has its default, or if the command does not have it.
    """
    return click.get_current_context().get_parameter_source(name) not in (
        None,
        ParameterSource.DEFAULT,
        ParameterSource.DEFAULT_MAP,  # the default of an older name of the command
    )


def refuse_with_structure(structure: Path | None, *names: str) -> None:
    """Raise BadInput if one of the options is given together with a structure.

    The structure's file already contains what these options set.
    """
    for name in names:
        if structure is not None and is_option_set(name):
            raise BadInput(
                f"--{name.replace('_', '-')} does not go with --structure: the file says what "
                "the structure is"
            )


NODE_TOL = 1e-6  # of the largest of a place's mode shapes: finite elements have such noise at nodes
OUTSIDE_SHARE = (
    1e-3  # of a load's mean square: from there on it is told that it lies above the modes
)


def _in_short(text: str, model: ModalModel, resonance: int) -> dict[str, Any] | None:
    """Return the table that a short form stands for, None for the name of a file."""
    kind, *numbers = text.split(":")
    if kind not in LOADS_IN_SHORT or not numbers or Path(text).exists():
        return None
    names = LOADS_IN_SHORT[kind]
    try:
        numbers_by_name = dict(zip(names, map(float, numbers), strict=True))
    except ValueError:
        raise BadInput(f"--load {text}: {':'.join((kind, *names)).upper()}, numbers") from None
    if kind == "random":
        spectrum = [
            [numbers_by_name["low_hz"], numbers_by_name["value"]],
            [numbers_by_name["high_hz"], numbers_by_name["value"]],
        ]
        return {"kind": kind, "spectrum": spectrum, "duration_s": numbers_by_name["duration_s"]}
    if kind == "shock":
        return {"kind": kind, "pulse": "half-sine", **numbers_by_name}
    sweep = linear_sweep(
        model.resonance_omega(resonance), percent_per_100_periods=default_rate(model, (resonance,))
    )
    schedule = {
        "times_s": sweep.times.tolist(),
        "omegas_rad_s": sweep.omegas.tolist(),
        "reference_rad_s": sweep.reference,
    }
    return {"kind": kind, **numbers_by_name, "schedule": schedule}


def warn_of_nodes(model: ModalModel, *resonances: int, moves_base: bool = False) -> None:
    """Print a warning for each resonance whose mode has a node at a place in use.

    These are the places of force or base motion, absorber and level. At a node the mode is not
    excited, damped or measured.
    """
    places = {
        "the base's motion": model.base_participation if moves_base else None,
        "the force's place": None if moves_base else np.abs(model.force_pattern),
        "the absorber's place": np.max(np.abs(model.places), axis=0),
        "the place of the level": model.level_shape,
    }
    for resonance in dict.fromkeys(resonances):
        if not 1 <= resonance <= model.modes:  # refused where it is used
            continue
        hertz = model.resonance_omega(resonance) / (2 * math.pi)
        still = [
            name
            for name, shape in places.items()
            if shape is not None and abs(shape[resonance - 1]) <= NODE_TOL * np.max(np.abs(shape))
        ]
        if still:
            click.echo(
                (
                    f"warning: resonance {resonance}, at {hertz:.4g} Hz, has a node at "
                    f"{' and '.join(still)}"
                ),
                err=True,
            )


def require_load_of_each_place(model: ModalModel, loads: Loads) -> None:
    """Raise ParameterError if one of the places of ``force`` has no load.

    This applies to loads that have places of their own. A place without load would have no force.
    """
    if not loads.force_places:
        return
    acts = any(piece.place is None and not piece.moves_base for piece in loads.pieces())
    for name in model.force_place_names or ():
        allowed = "the place of a load, as the other places of force are, or left out of force"
        require(acts or name in loads.force_places, "force.place", name, allowed)


def loads_of(
    path: Path, model: ModalModel, resonance: int = 1, *, all_places: bool = True
) -> Loads:
    """Return the loads of a file, or of a short form; tell of what lies above the modes.

    ``all_places``: each place of the table ``force`` must have a load where loads have places.
    """
    reference = model.resonance_omega(resonance)
    short = _in_short(str(path), model, resonance)
    loads = read_loads(path, reference) if short is None else to_loads({"load": short}, reference)
    if all_places:
        require_load_of_each_place(model, loads)
    highest = float(model.omega.max()) / (2 * math.pi)
    for part in loads.parts:
        if (
            isinstance(part, Random | Samples)
            and (share := part.share_above(highest)) > OUTSIDE_SHARE
        ):
            name = "random load" if isinstance(part, Random) else "record"
            click.echo(
                (
                    f"warning: {100 * share:.3g} % of the {name}'s mean square lies above the "
                    f"highest mode, {highest:.4g} Hz"
                ),
                err=True,
            )
        if isinstance(part, Samples) and (offset := part.drift()) is not None:
            moved = abs(offset) * part.duration**2 / 2
            click.echo(
                f"warning: the base's record has an offset of {offset:.3g} m/s^2: from rest "
                f"its displacement drifts by {moved:.3g} m, "
                "and a free absorber is pushed to one wall; subtract the mean",
                err=True,
            )
    warn_of_nodes(model, resonance, moves_base=loads.moves_base)
    return loads


def refuse_with_load(
    load: Path | None, *names: str, why: str = "the file says what acts, and for how long"
) -> None:
    """Raise BadInput if one of the options that are named was given beside --load."""
    options = {
        parameter.name: parameter.opts[0]
        for parameter in click.get_current_context().command.params
    }
    for name in names:
        if load is not None and is_option_set(name):
            raise BadInput(f"{options[name]} does not go with --load: {why}")


OF_BEAM = ("modes", "damping")
FRICTION_DAMPER_LIMIT = friction_damper().friction.limit  # type: ignore[union-attr]
OPTIONS = {
    "damping": "absorber_damping"
}  # options that are called otherwise than the value that they give: --damping is the structure's
DEFAULT_ABSORBER = "impact"
SLIDING_VALUES = ("mass_ratio", "gap", "restitution", "friction_limit")
ALL_VALUES = tuple({name: None for keys in CONCEPTS.values() for name in keys})
VALUE_DEFAULTS = {
    "mass_ratio": str(DEFAULT_MASS_RATIO),
    "gap": str(RigidWalls.gap),
    "restitution": str(RigidWalls.restitution),
}
LOAD_OPTIONS = (
    "force",
    "phase",
    "start",
    "stop",
    "rate",
    "periods",
    "down",
)  # what a file of loads says


def option_name(name: str) -> str:
    """Return an option as it is typed."""
    return "--" + name.replace("_", "-")


def absorber_specs(*names: str, **default_texts: str) -> dict[str, tuple[str, OptionSpec]]:
    """Return the options for an absorber's parameters.

    They go by the plain names of the table of absorbers: the given ``names``, or all of them.

    A value that is not given keeps the library's default; ``default_texts`` are the words of the
    help for it.
    """
    texts = VALUE_DEFAULTS | default_texts
    specs = {}
    for name in names or ALL_VALUES:
        keys = {kind: known[name] for kind, known in CONCEPTS.items() if name in known}
        more = "" if names else f"For {', '.join(keys)}."
        parameter = OPTIONS.get(name, name)
        if name in TABLE and name == parameter:
            spec = replace(TABLE[name], default=None, more=more)
        else:
            declared = next(iter(keys.values())).metadata
            spec = OptionSpec(
                names=(option_name(parameter),),
                help=declared["description"],
                unit=declared["unit"],
                more=more,
                section="Absorber",
            )
        specs[name] = (parameter, replace(spec, default_text=texts.get(name, "")))
    return specs


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """Structure and absorber of a command that simulates one scene; None: not given.

    ``values`` has those of the absorber that are given, by their plain names.
    """

    scene: Path | None = option("scene")
    structure: Path | None = option("structure")
    absorber: str | None = None
    modes: int | None = option("modes")
    damping: float | None = option("damping")
    values: Mapping[str, float] = option_values(absorber_specs(*SLIDING_VALUES))
    mass_kg: float | None = option("mass_kg")
    force: float | None = None
    resonance: int = 1


def list_option(name: str, text: str, letter: str, default_text: str) -> str:
    """Return an option of numbers with commas between, empty if it is not given."""
    listed: str = option(
        OptionSpec(
            names=(name,),
            help=text,
            type=str,
            metavar=f"{letter},{letter},...",
            default="",
            default_text=default_text,
        )
    )
    return listed


@dataclass(frozen=True, kw_only=True)
class MapOptions:
    """Values of the scenes of a map, as numbers with commas between; empty: not given."""

    map_modes: str = list_option(
        "--map-modes", "Numbers of modes of a map, at most --modes", "N", "--modes"
    )
    map_restitutions: str = list_option(
        "--map-restitutions", "Restitutions of a map", "E", "--restitution"
    )
    map_friction_limits: str = list_option(
        "--map-friction-limits", "Friction limits of a map in N", "F", "--friction-limit"
    )


Scenes = TypeVar("Scenes", bound=SceneOptions)


class MadeScene(NamedTuple):
    """A scene, its beam, and the force in N.

    The beam is None if a file has another structure. The force is None if it is neither given nor
    follows from a rule.
    """

    scene: Scene
    beam: Beam | None
    force: float | None


def kind_of(options: SceneOptions) -> str:
    """Return the absorber's kind, one of `impact_env.laws.CONCEPTS`."""
    return DEFAULT_ABSORBER if options.absorber is None else options.absorber


def refuse_parts(options: SceneOptions) -> None:
    """Raise BadInput if two options of the scene do not go together."""
    beam = {"modes": options.modes, "damping": options.damping}
    if options.structure is not None:
        for name, of_structure in {"scene": options.scene, **beam}.items():
            if of_structure is not None:
                raise BadInput(
                    f"{option_name(name)} does not go with --structure: the file says what "
                    "the structure is"
                )
    own: dict[str, object] = {
        OPTIONS.get(name, name): value for name, value in options.values.items()
    }
    if options.scene is not None:
        own |= {"absorber": options.absorber, "mass_kg": options.mass_kg, **beam}
        for name, value in own.items():
            if value is not None:
                raise BadInput(
                    f"{option_name(name)} does not go with --scene: the file says what the scene is"
                )
        return
    kind = kind_of(options)
    for name in sorted(options.values):
        if name not in CONCEPTS[kind]:
            kinds = " or ".join(k for k, known in CONCEPTS.items() if name in known)
            option = option_name(OPTIONS.get(name, name))
            raise BadInput(f"{option} does not go with --absorber {kind}: it is for {kinds}")
    if options.mass_kg is not None and "mass_ratio" not in CONCEPTS[kind]:
        raise BadInput(f"--mass-kg does not go with --absorber {kind}: it has no mass")


def with_mass_ratio(options: Scenes, structure_mass: float) -> Scenes:
    """Return the options with the mass ratio that corresponds to --mass-kg, if given.

    Raises BadInput if both mass and mass ratio are given.
    """
    if options.mass_kg is None:
        return options
    ratio = mass_ratio_of(DEFAULT_MASS_RATIO, options.mass_kg, structure_mass)
    return replace(options, values={**options.values, "mass_ratio": ratio}, mass_kg=None)


def make_absorber(options: SceneOptions, model: ModalModel | None = None) -> Absorber | None:
    """Return the absorber that the options describe.

    Parameters that are not given have the library's defaults, or follow from rules on the ``model``
    of a file.
    """
    kind = kind_of(options)
    usual = {} if model is None or kind == "none" else by_rule(kind, options, model)
    return make(kind, usual | dict(options.values))


def mass_of(options: SceneOptions, model: ModalModel) -> float:
    """Return the absorber's mass in kg."""
    ratio = options.values.get("mass_ratio", DEFAULT_MASS_RATIO)
    return positive("mass_ratio", ratio) * model.beam_mass


def force_by_rule(options: SceneOptions, model: ModalModel) -> float:
    """Return the force in N for which the design rule gives the absorber's gap.

    The gap is the one of the options or the library's default.
    """
    gap = positive("gap", options.values.get("gap", RigidWalls.gap))
    return design_force(model, mass_of(options, model), gap, options.resonance)


def by_rule(kind: str, options: SceneOptions, model: ModalModel) -> dict[str, Any]:
    """Return the default parameters of an absorber for a structure other than the paper's.

    The impact absorber's gap follows from the design rule, the friction damper's limit from the
    energy of a cycle. The tuned absorber is tuned by `minimax`.

    Without a force the gap is the library's, for which `force_by_rule` gives the force.
    """
    values = options.values
    mass = mass_of(options, model)
    resonance = options.resonance
    force = force_by_rule(options, model) if options.force is None else options.force
    if kind == "impact" and "gap" not in values:
        if options.force is None:
            return {"gap": RigidWalls.gap}
        return {"gap": design_gap(model, mass, force, resonance)}
    if kind == "friction" and "friction_limit" not in values:
        return {"friction_limit": best_friction(model, mass, force, resonance)[0]}
    if kind == "tuned" and not {"stiffness", "damping"} <= values.keys():
        tuned = minimax(model, values.get("mass_ratio", DEFAULT_MASS_RATIO), resonance)
        return {"stiffness": tuned.stiffness, "damping": tuned.damping}
    return {}


def make_scene(options: SceneOptions) -> MadeScene:
    """Return the scene that the options describe, with its force.

    On a structure other than the paper's beam the design rule gives the force, unless it is given.
    """
    if options.scene is not None:
        plain = read_plain(options.scene)
        scene = to_scene(plain, options.scene.parent)
        warn_of_mass(scene)
        return MadeScene(scene, to_beam(plain), options.force)
    if options.structure is not None:
        structure = read_structure(options.structure)
        model = model_with_absorber_at(structure)
        options = with_mass_ratio(options, model.beam_mass)
        force = force_by_rule(options, model) if options.force is None else options.force
        beam = structure if isinstance(structure, Beam) else None
        return MadeScene(Scene(model, make_absorber(options, model)), beam, force)
    beam = Beam(
        modes=Beam.modes if options.modes is None else options.modes,
        damping_ratio=Beam.damping_ratio if options.damping is None else options.damping,
    )
    if options.mass_kg is not None:
        options = with_mass_ratio(options, modal_model(beam).beam_mass)
    return MadeScene(beam_scene(beam, make_absorber(options)), beam, options.force)


HEAVY = 0.5  # of the structure's mass


def warn_of_mass(scene: Scene) -> None:
    """Print a warning if an absorber is heavier than half of the structure.

    Its mass may have been given in kg or in % instead of a ratio.
    """
    if scene.absorber is not None and scene.absorber.mass_ratio > HEAVY:
        click.echo(
            f"warning: mass_ratio {scene.absorber.mass_ratio:g} is an absorber of "
            f"{scene.absorber_mass:.4g} kg on a structure of "
            f"{scene.model.beam_mass:.4g} kg; the ratio is a share of the structure's mass",
            err=True,
        )


def make_method(name: str, steps_per_period: int | None) -> Method:
    """Return the method of a name: exact, moreau or runge-kutta.

    ``steps_per_period``: steps per period of the highest mode (None: the default of the method).
    """
    if name == "exact":
        return Exact()
    stepping = {"moreau": Moreau, "runge-kutta": RungeKutta}[name]
    return stepping() if steps_per_period is None else stepping(steps_per_period=steps_per_period)
