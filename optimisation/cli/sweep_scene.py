"""From the options of a command to scene, method and schedule."""

from collections.abc import Callable, Mapping
from typing import Any

import click

from impact_env.drive import FrequencySchedule, constant_frequency, default_rate, linear_sweep
from impact_env.laws import CONCEPTS, make
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.modes import ModalModel
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    RigidWalls,
    friction_damper,
    positive,
)
from impact_env.plain import to_beam, to_scene
from impact_env.plain_files import read_plain
from impact_env.scene import Scene, beam_scene
from optimisation.bounds import design_force, design_gap
from optimisation.cli.common import BadInput, Command
from optimisation.cli.load_option import refuse_beside_load
from optimisation.cli.structure_option import read_structure
from optimisation.friction_rule import best_friction
from optimisation.mounting import mounted
from optimisation.tuned import minimax

Options = dict[str, Any]  # the options of the command line; None: not given
FRICTION_DAMPER_LIMIT = friction_damper().friction.limit  # type: ignore[union-attr]
OPTIONS = {"damping": "absorber_damping"}  # options that are called otherwise than the value that they give: --damping is the structure's
PARTS = {kind: {OPTIONS.get(name, name) for name in keys} for kind, keys in CONCEPTS.items()}
DEFAULT_ABSORBER = "impact"
SCENE_OPTIONS = ("absorber", "modes", "damping", *sorted(set().union(*PARTS.values())))  # what a file of a scene says


BESIDE_LOAD = ("force", "phase", "start", "stop", "rate", "periods", "down")  # what a file of loads says


def absorber_options(defaults: Mapping[str, str]) -> Callable[[Command], Command]:
    """Add an option for each plain name of the table of laws; ``defaults``: the help's words in place of the library's default."""
    keys = {name: key for concept in CONCEPTS.values() for name, key in concept.items()}
    usual = {"mass_ratio": str(DEFAULT_MASS_RATIO), "restitution": str(RigidWalls.restitution)} | dict(defaults)

    def add(command: Command) -> Command:
        for name, key in reversed(keys.items()):
            kinds = [kind for kind, known in CONCEPTS.items() if name in known]
            text = f"{key.what}{f', in {key.unit}' if key.unit else ''} ({', '.join(kinds)})."
            text += f"  [default: {usual[name]}]" if name in usual else ""
            command = click.option(option_name(OPTIONS.get(name, name)), type=float, help=text)(command)
        return command

    return add


def option_name(name: str) -> str:
    """Return an option as it is typed."""
    return "--" + name.replace("_", "-")


def kind_of(given: Options) -> str:
    """Return the absorber's kind, one of `PARTS`."""
    return DEFAULT_ABSORBER if given["absorber"] is None else str(given["absorber"])


def chosen(given: Options, **options: str) -> Options:
    """Return the parameters, named after the library, whose options were given; the others keep the library's defaults."""
    return {parameter: given[option] for parameter, option in options.items() if given.get(option) is not None}


def refuse_contradictions(given: Options) -> None:
    """Raise BadInput if two options do not go together."""
    refuse_parts(given)
    _refuse_runs(given)


def refuse_parts(given: Options) -> None:
    """Raise BadInput if two options of the scene do not go together."""
    if given["structure"] is not None:
        for name in ("scene", "modes", "damping"):
            if given[name] is not None:
                raise BadInput(f"{option_name(name)} does not go with --structure: the file says what the structure is")
    if given["scene"] is not None:
        for name in SCENE_OPTIONS:
            if given.get(name) is not None:
                raise BadInput(f"{option_name(name)} does not go with --scene: the file says what the scene is")
        return
    kind = kind_of(given)
    for name in sorted(set().union(*PARTS.values()) - PARTS[kind]):
        if given.get(name) is not None:
            kinds = " or ".join(k for k, parts in PARTS.items() if name in parts)
            raise BadInput(f"{option_name(name)} does not go with --absorber {kind}: it is for {kinds}")


def _refuse_runs(given: Options) -> None:
    if given["steps_per_period"] is not None and given["method"] == "exact":
        raise BadInput("--steps-per-period does not go with --method exact: it has no steps")
    if given["most_events"] is not None and given["method"] != "exact":
        raise BadInput(f"--most-events does not go with --method {given['method']}: it steps through time, whatever happens")
    if given["measures"] is not None and given["method"] != "exact":
        raise BadInput(f"--measures does not go with --method {given['method']}: they are read from exact runs")
    if given["absolute"] and given["measures"] is None:
        raise BadInput("--absolute needs --measures: it says what these are of")
    refuse_beside_load(given["load"], *BESIDE_LOAD)
    if given["load"] is not None:
        return
    constant = given["start"] == given["stop"]
    if constant and given["periods"] is None:
        raise BadInput(f"--to = {given['stop']} equal to --from is a constant frequency: it needs --periods")
    if not constant and given["periods"] is not None:
        raise BadInput("--periods is for a constant frequency, --to equal to --from: the length of a sweep follows from its rate")
    if constant and given["rate"] is not None:
        raise BadInput("--rate does not go with a constant frequency, --to equal to --from")
    if given["down"] and not given["start"] < given["stop"]:
        raise BadInput(f"--down swaps --from and --to: it needs --from = {given['start']} below --to = {given['stop']}")


def make_absorber(given: Options, model: ModalModel | None = None) -> Absorber | None:
    """Return the absorber that the options describe; what is not given keeps the library's default, or on a file's ``model`` follows from a rule."""
    kind = kind_of(given)
    usual = {} if model is None or kind == "none" else by_rule(kind, given, model)
    return make(kind, usual | chosen(given, **{name: OPTIONS.get(name, name) for name in CONCEPTS[kind]}))


def force_by_rule(given: Options, model: ModalModel) -> float:
    """Return the force in N for which the design rule gives the gap that was given, or the library's default gap, which then is used."""
    ratio = DEFAULT_MASS_RATIO if given["mass_ratio"] is None else given["mass_ratio"]
    if given["gap"] is None and kind_of(given) == "impact":
        given["gap"] = RigidWalls.gap
    gap = RigidWalls.gap if given["gap"] is None else given["gap"]
    return design_force(model, positive("mass_ratio", ratio) * model.beam_mass, positive("gap", gap), given["resonance"])


def by_rule(kind: str, given: Options, model: ModalModel) -> Options:
    """Return the defaults for another structure than the paper's: the gap by the design rule, the LTVA tuned, the damper by the energy of a cycle."""
    ratio = DEFAULT_MASS_RATIO if given["mass_ratio"] is None else given["mass_ratio"]
    mass, force, resonance = positive("mass_ratio", ratio) * model.beam_mass, given["force"], given["resonance"]
    if kind == "impact" and given["gap"] is None:
        return {"gap": design_gap(model, mass, force, resonance)}
    if kind == "friction" and given["friction_limit"] is None:
        return {"friction_limit": best_friction(model, mass, force, resonance)[0]}
    if kind == "tuned" and (given.get("stiffness") is None or given.get("absorber_damping") is None):
        tuned = minimax(model, ratio, resonance)
        return {"stiffness": tuned.stiffness, "damping": tuned.damping}
    return {}


def make_scene(given: Options) -> tuple[Scene, Beam | None]:
    """Return the scene and its beam, which is None where a file has another structure."""
    if given["scene"] is not None:
        plain, folder = read_plain(given["scene"]), given["scene"].parent
        return to_scene(plain, folder), to_beam(plain)
    if given["structure"] is not None:
        structure = read_structure(given["structure"])
        model = mounted(structure)
        if given["force"] is None:
            given["force"] = force_by_rule(given, model)
        return Scene(model, make_absorber(given, model)), structure if isinstance(structure, Beam) else None
    beam = Beam(**chosen(given, modes="modes", damping_ratio="damping"))
    return beam_scene(beam, make_absorber(given)), beam


def make_method(given: Options) -> Method:
    """Return the method that the options ask for."""
    if given["method"] == "exact":
        return Exact()
    return {"moreau": Moreau, "runge-kutta": RungeKutta}[given["method"]](**chosen(given, steps_per_period="steps_per_period"))


def make_schedule(given: Options, scene: Scene) -> FrequencySchedule:
    """Return the sweep, or the constant frequency, that the options ask for."""
    omega, start, stop = scene.model.resonance_omega(given["resonance"]), given["start"], given["stop"]
    if start == stop:
        return constant_frequency(omega, start, given["periods"])
    if given["down"]:
        start, stop = stop, start
    rate = given["rate"]
    return linear_sweep(omega, start, stop, default_rate(scene.model, (given["resonance"],)) if rate is None else rate)
