"""Options that say what is simulated: structure, absorber, load; and the scene, method and schedule that they describe."""

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from click.core import ParameterSource

from impact_env.drive import FrequencySchedule, constant_frequency, default_rate, linear_sweep
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
    positive,
    require,
)
from impact_env.plain import (
    StructureWarning,
    find_force_amplitude,
    from_scene,
    load_structure,
    to_beam,
    to_disk,
    to_scene,
)
from impact_env.plain_files import read_plain
from impact_env.plain_loads import read_loads, to_loads
from impact_env.scene import Scene, beam_scene
from impact_env.structures.cyclic import BladedDisk
from optimisation.absorber_rules import best_friction
from optimisation.bounds import design_force, design_gap
from optimisation.cli.common import BadInput, Command, file_option, stack_options
from optimisation.extremes import usable_mass_ratio
from optimisation.files import write_json
from optimisation.mounting import model_with_absorber_at
from optimisation.tuned import minimax

PLACE = "Place of absorber and response, over the length; of a beam from a file the absorber's only; of modes the number of a place."
position_option = click.option(
    "--position", type=float, default=Beam.absorber_position, show_default=True, help=PLACE
)
RESONANCES_HELP = "Two resonances to look at, counted from 1; twice the same: one."
structure_option = file_option(
    "--structure",
    "Structure from a .toml or .json file in place of the paper's beam (docs/your_structure.md).",
)
scene_option = file_option(
    "--scene",
    "Structure and impact absorber from a .toml or .json file, as design_gap --device writes it.",
)
mass_option = click.option(
    "--mass-kg", type=float, help="Absorber mass in kg, in the place of its ratio."
)


def read_structure(path: Path) -> Structure:
    """Return the structure of a file; its warnings are printed, a line each. Raises BadInput for a bladed disk."""
    if "cyclic" in read_plain(path):
        raise BadInput(
            f"{path} is not allowed: a bladed disk is given with its absorbers, as --scene of sweep, compare_absorbers or design_gap"
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


def read_disk(path: Path | None) -> BladedDisk | None:
    """Return the bladed disk of a scene's file, None for no file and for another structure."""
    if path is None:
        return None
    plain = read_plain(path)
    return to_disk(plain, path.parent) if "cyclic" in plain else None


def find_file_force(path: Path | None) -> float | None:
    """Return the amplitude in N of the first force in a file of a scene or structure; None where it has none."""
    return None if path is None else find_force_amplitude(read_plain(path))


def structure_of(
    path: Path | None, position: float = Beam.absorber_position, **options: Any
) -> Structure:
    """Return the structure of a file, or the beam that the ``parameters`` describe, with the absorber where --position says, if given."""
    if path is None:
        return Beam(absorber_position=position, **options)
    structure = read_structure(path)
    if not is_option_set("position"):
        return structure
    return (
        model_with_absorber_at(structure, position)
        if isinstance(structure, ModalModel)
        else replace(structure, absorber_position=position)
    )


def model_of(
    path: Path | None, position: float = Beam.absorber_position, **options: Any
) -> ModalModel:
    """Return the modal model of `structure_of`. On modes a position is the number of one of the file's places for absorbers."""
    structure = structure_of(path, position, **options)
    return modal_model(structure) if path is None else model_with_absorber_at(structure)


def read_device(path: Path, *names: str) -> tuple[Structure, SlidingAbsorber]:
    """Return the structure and the impact absorber of a file; raises BadInput if one of the options that are named was given beside it."""
    for name in names:
        if is_option_set(name):
            raise BadInput(
                f"--{name.replace('_', '-')} does not go with --scene: the file says what structure and absorber are"
            )
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


def write_device(path: Path, structure: Structure, absorber: SlidingAbsorber) -> None:
    """Write structure and absorber as a scene, which other commands read by --scene: a beam as a beam."""
    beam = structure if isinstance(structure, Beam) else None
    write_json(
        path,
        from_scene(
            Scene(
                model_with_absorber_at(structure) if beam is None else modal_model(beam), absorber
            ),
            beam,
        ),
    )


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


def is_option_set(name: str) -> bool:
    """Return whether an option of the command that runs was given, and has not its default; a command without it was not given it."""
    return click.get_current_context().get_parameter_source(name) not in (
        None,
        ParameterSource.DEFAULT,
    )


def refuse_with_structure(structure: Path | None, *names: str) -> None:
    """Raise BadInput if one of the options is given beside a structure, whose file says what it is about."""
    for name in names:
        if structure is not None and is_option_set(name):
            raise BadInput(
                f"--{name.replace('_', '-')} does not go with --structure: the file says what the structure is"
            )


def scene_options(restitution: str, friction: str = "") -> Callable[[Command], Command]:
    """Add the options of an absorber for commands on periodic motions; what is left out is None.

    ``restitution`` says which are allowed, ``friction`` is the default of the friction limit where it is to be told.
    """
    default_words = f"  [default: {friction}]" if friction else ""
    options = (
        file_option("--scene", "Beam and absorber from a .toml or .json file."),
        structure_option,
        click.option("--modes", type=int, help=f"Number of modes kept.  [default: {Beam.modes}]"),
        click.option(
            "--damping",
            type=float,
            help=f"Modal damping ratio, the same for all modes.  [default: {Beam.damping_ratio}]",
        ),
        click.option(
            "--mass-ratio",
            type=float,
            help=f"Absorber mass over beam mass.  [default: {DEFAULT_MASS_RATIO}]",
        ),
        click.option(
            "--gap", type=float, help=f"Clearance to either wall in m.  [default: {RigidWalls.gap}]"
        ),
        click.option(
            "--restitution",
            type=float,
            help=f"Coefficient of restitution{restitution}.  [default: {RigidWalls.restitution}]",
        ),
        click.option(
            "--friction-limit",
            type=float,
            help=f"Friction limit in N; 0: no friction.{default_words}",
        ),
    )

    return stack_options(options)


SHORT = {
    "base": ("acceleration_m_s2",),
    "unbalance": ("unbalance_kg_m",),
    "random": ("low_hz", "high_hz", "value", "duration_s"),
    "shock": ("peak_n", "pulse_s", "duration_s"),
}
load_option = file_option(
    "--load",
    "Loads other than one force, from a .toml or .json file (docs/loads.md): base, unbalance, tones, samples, random, shock. In short: "
    + ", ".join(":".join((kind, *names)).upper() for kind, names in SHORT.items())
    + ".",
)
NODE_TOL = 1e-6  # of the largest of a place's mode shapes: finite elements have such noise at nodes
OUTSIDE_SHARE = (
    1e-3  # of a load's mean square: from there on it is told that it lies above the modes
)


def _in_short(text: str, model: ModalModel, resonance: int) -> dict[str, Any] | None:
    """Return the table that a short form stands for, None for the name of a file."""
    kind, *numbers = text.split(":")
    if kind not in SHORT or not numbers or Path(text).exists():
        return None
    names = SHORT[kind]
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
    """Print a warning for each resonance whose mode does not move a place in use, at a node of which nothing is excited, absorbed or read."""
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
                f"warning: resonance {resonance}, at {hertz:.4g} Hz, has a node at {' and '.join(still)}",
                err=True,
            )


def loads_of(path: Path, model: ModalModel, resonance: int = 1) -> Loads:
    """Return the loads of a file, or of a short form; tell of what lies above the modes."""
    reference = model.resonance_omega(resonance)
    short = _in_short(str(path), model, resonance)
    loads = read_loads(path, reference) if short is None else to_loads({"load": short}, reference)
    highest = float(model.omega.max()) / (2 * math.pi)
    for part in loads.parts:
        if (
            isinstance(part, Random | Samples)
            and (share := part.share_above(highest)) > OUTSIDE_SHARE
        ):
            name = "random load" if isinstance(part, Random) else "record"
            click.echo(
                f"warning: {100 * share:.3g} % of the {name}'s mean square lies above the highest mode, {highest:.4g} Hz",
                err=True,
            )
        if isinstance(part, Samples) and (offset := part.drift()) is not None:
            moved = abs(offset) * part.duration**2 / 2
            click.echo(
                f"warning: the base's record has an offset of {offset:.3g} m/s^2: from rest its displacement drifts by {moved:.3g} m, "
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


Options = dict[str, Any]  # the options of the command line; None: not given
FRICTION_DAMPER_LIMIT = friction_damper().friction.limit  # type: ignore[union-attr]
OPTIONS = {
    "damping": "absorber_damping"
}  # options that are called otherwise than the value that they give: --damping is the structure's
PARTS = {kind: {OPTIONS.get(name, name) for name in keys} for kind, keys in CONCEPTS.items()}
DEFAULT_ABSORBER = "impact"
SCENE_OPTIONS = (
    "absorber",
    "modes",
    "damping",
    *sorted(set().union(*PARTS.values())),
)  # what a file of a scene says


LOAD_OPTIONS = (
    "force",
    "phase",
    "start",
    "stop",
    "rate",
    "periods",
    "down",
)  # what a file of loads says


def absorber_options(defaults: Mapping[str, str]) -> Callable[[Command], Command]:
    """Add an option for each plain name of the table of laws; ``defaults``: the help's words in place of the library's default."""
    keys = {name: key for concept in CONCEPTS.values() for name, key in concept.items()}
    usual = {
        "mass_ratio": str(DEFAULT_MASS_RATIO),
        "restitution": str(RigidWalls.restitution),
    } | dict(defaults)
    options = []
    for name, key in keys.items():
        kinds = [kind for kind, known in CONCEPTS.items() if name in known]
        text = f"{key.what}{f', in {key.unit}' if key.unit else ''} ({', '.join(kinds)})."
        text += f"  [default: {usual[name]}]" if name in usual else ""
        options.append(click.option(option_name(OPTIONS.get(name, name)), type=float, help=text))
    return stack_options(options)


def option_name(name: str) -> str:
    """Return an option as it is typed."""
    return "--" + name.replace("_", "-")


def kind_of(options: Options) -> str:
    """Return the absorber's kind, one of `PARTS`."""
    return DEFAULT_ABSORBER if options["absorber"] is None else str(options["absorber"])


def chosen(options: Options, **parameters: str) -> Options:
    """Return the parameters, named after the library, whose options were given; the others keep the library's defaults."""
    return {
        parameter: options[option]
        for parameter, option in parameters.items()
        if options.get(option) is not None
    }


def refuse_parts(options: Options) -> None:
    """Raise BadInput if two options of the scene do not go together."""
    if options["structure"] is not None:
        for name in ("scene", "modes", "damping"):
            if options[name] is not None:
                raise BadInput(
                    f"{option_name(name)} does not go with --structure: the file says what the structure is"
                )
    if options["scene"] is not None:
        for name in SCENE_OPTIONS:
            if options.get(name) is not None:
                raise BadInput(
                    f"{option_name(name)} does not go with --scene: the file says what the scene is"
                )
        return
    kind = kind_of(options)
    for name in sorted(set().union(*PARTS.values()) - PARTS[kind]):
        if options.get(name) is not None:
            kinds = " or ".join(k for k, parts in PARTS.items() if name in parts)
            raise BadInput(
                f"{option_name(name)} does not go with --absorber {kind}: it is for {kinds}"
            )


def refuse_runs(options: Options) -> None:
    """Raise BadInput if two options of the run do not go together."""
    if options["steps_per_period"] is not None and options["method"] == "exact":
        raise BadInput("--steps-per-period does not go with --method exact: it has no steps")
    if options["most_events"] is not None and options["method"] != "exact":
        raise BadInput(
            f"--most-events does not go with --method {options['method']}: it steps through time, whatever happens"
        )
    if options["measures"] is not None and options["method"] != "exact":
        raise BadInput(
            f"--measures does not go with --method {options['method']}: they are read from exact runs"
        )
    if options["absolute"] and options["measures"] is None:
        raise BadInput("--absolute needs --measures: it says what these are of")
    refuse_with_load(options["load"], *LOAD_OPTIONS)
    if options["load"] is not None:
        return
    constant = options["start"] == options["stop"]
    if constant and options["periods"] is None:
        raise BadInput(
            f"--to = {options['stop']} equal to --from is a constant frequency: it needs --periods"
        )
    if not constant and options["periods"] is not None:
        raise BadInput(
            "--periods is for a constant frequency, --to equal to --from: the length of a sweep follows from its rate"
        )
    if constant and options["rate"] is not None:
        raise BadInput("--rate does not go with a constant frequency, --to equal to --from")
    if options["down"] and not options["start"] < options["stop"]:
        raise BadInput(
            f"--down swaps --from and --to: it needs --from = {options['start']} below --to = {options['stop']}"
        )


def make_absorber(options: Options, model: ModalModel | None = None) -> Absorber | None:
    """Return the absorber that the options describe; what is not given keeps the library's default, or on a file's ``model`` follows from a rule."""
    kind = kind_of(options)
    usual = {} if model is None or kind == "none" else by_rule(kind, options, model)
    return make(
        kind, usual | chosen(options, **{name: OPTIONS.get(name, name) for name in CONCEPTS[kind]})
    )


def force_by_rule(options: Options, model: ModalModel) -> float:
    """Return the force in N for which the design rule gives the gap that was given, or the library's default gap, which then is used."""
    ratio = DEFAULT_MASS_RATIO if options["mass_ratio"] is None else options["mass_ratio"]
    if options["gap"] is None and kind_of(options) == "impact":
        options["gap"] = RigidWalls.gap
    gap = RigidWalls.gap if options["gap"] is None else options["gap"]
    return design_force(
        model,
        positive("mass_ratio", ratio) * model.beam_mass,
        positive("gap", gap),
        options["resonance"],
    )


def by_rule(kind: str, options: Options, model: ModalModel) -> Options:
    """Return the defaults for another structure than the paper's: the gap by the design rule, the LTVA tuned, the damper by the energy of a cycle."""
    ratio = DEFAULT_MASS_RATIO if options["mass_ratio"] is None else options["mass_ratio"]
    mass = positive("mass_ratio", ratio) * model.beam_mass
    force = options["force"]
    resonance = options["resonance"]
    if kind == "impact" and options["gap"] is None:
        return {"gap": design_gap(model, mass, force, resonance)}
    if kind == "friction" and options["friction_limit"] is None:
        return {"friction_limit": best_friction(model, mass, force, resonance)[0]}
    if kind == "tuned" and (
        options.get("stiffness") is None or options.get("absorber_damping") is None
    ):
        tuned = minimax(model, ratio, resonance)
        return {"stiffness": tuned.stiffness, "damping": tuned.damping}
    return {}


def make_scene(options: Options) -> tuple[Scene, Beam | None]:
    """Return the scene and its beam, which is None where a file has another structure."""
    if options["scene"] is not None:
        plain = read_plain(options["scene"])
        scene = to_scene(plain, options["scene"].parent)
        warn_of_mass(scene)
        return scene, to_beam(plain)
    if options["structure"] is not None:
        structure = read_structure(options["structure"])
        model = model_with_absorber_at(structure)
        if options["force"] is None:
            options["force"] = force_by_rule(options, model)
        return Scene(model, make_absorber(options, model)), structure if isinstance(
            structure, Beam
        ) else None
    beam = Beam(**chosen(options, modes="modes", damping_ratio="damping"))
    return beam_scene(beam, make_absorber(options)), beam


HEAVY = 0.5  # of the structure's mass


def warn_of_mass(scene: Scene) -> None:
    """Warn of an absorber that is heavier than half of the structure: its mass may be in kg or in %."""
    if scene.absorber is not None and scene.absorber.mass_ratio > HEAVY:
        click.echo(
            f"warning: mass_ratio {scene.absorber.mass_ratio:g} is an absorber of {scene.absorber_mass:.4g} kg on a structure of "
            f"{scene.model.beam_mass:.4g} kg; the ratio is a share of the structure's mass",
            err=True,
        )


def make_method(options: Options) -> Method:
    """Return the method that the options ask for."""
    if options["method"] == "exact":
        return Exact()
    return {"moreau": Moreau, "runge-kutta": RungeKutta}[options["method"]](
        **chosen(options, steps_per_period="steps_per_period")
    )


def make_schedule(options: Options, scene: Scene) -> FrequencySchedule:
    """Return the sweep, or the constant frequency, that the options ask for."""
    omega = scene.model.resonance_omega(options["resonance"])
    start = options["start"]
    stop = options["stop"]
    if start == stop:
        return constant_frequency(omega, start, options["periods"])
    if options["down"]:
        start, stop = stop, start
    rate = options["rate"]
    return linear_sweep(
        omega,
        start,
        stop,
        default_rate(scene.model, (options["resonance"],)) if rate is None else rate,
    )
