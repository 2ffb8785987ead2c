"""From the options of scripts/sweep.py to scene, method and schedule."""

from __future__ import annotations

from typing import Any

from impact_env.drive import FrequencySchedule, constant_frequency, default_rate, linear_sweep
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.modes import ModalModel
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    CompliantWalls,
    RigidWalls,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    friction_law,
    positive,
)
from impact_env.plain import to_beam, to_scene
from impact_env.plain_files import read_plain
from impact_env.scene import Scene, beam_scene
from optimisation.bounds import design_force, design_gap
from optimisation.cli.common import BadInput
from optimisation.cli.structure_option import read_structure
from optimisation.friction_rule import best_friction
from optimisation.mounting import mounted
from optimisation.tuned import minimax

Options = dict[str, Any]  # the options of the command line; None: not given
FRICTION_DAMPER_LIMIT = friction_damper().friction.limit  # type: ignore[union-attr]
PARTS = {
    "impact": {"gap", "restitution", "friction_limit", "mass_ratio", "contact_stiffness", "friction_stiffness"},
    "friction": {"friction_limit", "mass_ratio", "friction_stiffness"},
    "tuned": {"mass_ratio", "stiffness", "absorber_damping"},
    "stuck": {"mass_ratio"},
    "none": set(),
}
DEFAULT_ABSORBER = "impact"
SCENE_OPTIONS = ("absorber", "modes", "damping", *sorted(set().union(*PARTS.values())))  # what a file of a scene says


def option_name(name: str) -> str:
    """Return an option as it is typed."""
    return "--" + name.replace("_", "-")


def kind_of(given: Options) -> str:
    """Return the absorber's kind, one of `PARTS`."""
    return DEFAULT_ABSORBER if given["absorber"] is None else str(given["absorber"])


def chosen(given: Options, **options: str) -> Options:
    """Return the parameters, named after the library, whose options were given; the others keep the library's defaults."""
    return {parameter: given[option] for parameter, option in options.items() if given[option] is not None}


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
            if given[name] is not None:
                raise BadInput(f"{option_name(name)} does not go with --scene: the file says what the scene is")
        return
    kind = kind_of(given)
    for name in sorted(set().union(*PARTS.values()) - PARTS[kind]):
        if given[name] is not None:
            kinds = " or ".join(k for k, parts in PARTS.items() if name in parts)
            raise BadInput(f"{option_name(name)} does not go with --absorber {kind}: it is for {kinds}")
    compliant, rubs = given["contact_stiffness"] is not None, given["friction_limit"] not in (None, 0)
    if compliant and given["restitution"] is not None:
        raise BadInput("--restitution does not go with --contact-stiffness: compliant walls lose nothing")
    if kind == "impact" and given["friction_stiffness"] is not None and not (compliant and rubs):
        raise BadInput(
            "--friction-stiffness needs --contact-stiffness and a --friction-limit above 0: walls and friction are both rigid or both compliant"
        )


def _refuse_runs(given: Options) -> None:
    if given["steps_per_period"] is not None and given["method"] == "exact":
        raise BadInput("--steps-per-period does not go with --method exact: it has no steps")
    if given["most_events"] is not None and given["method"] != "exact":
        raise BadInput(f"--most-events does not go with --method {given['method']}: it steps through time, whatever happens")
    constant = given["start"] == given["stop"]
    if constant and given["periods"] is None:
        raise BadInput(f"--to = {given['stop']} equal to --from is a constant frequency: it needs --periods")
    if not constant and given["periods"] is not None:
        raise BadInput("--periods is for a constant frequency, --to equal to --from: the length of a sweep follows from its rate")
    if constant and given["percent_per_100_periods"] is not None:
        raise BadInput("--percent-per-100-periods does not go with a constant frequency, --to equal to --from")
    if given["down"] and not given["start"] < given["stop"]:
        raise BadInput(f"--down swaps --from and --to: it needs --from = {given['start']} below --to = {given['stop']}")


def make_absorber(given: Options, model: ModalModel | None = None) -> Absorber | None:
    """Return the absorber that the options describe; what is not given keeps the library's default, or on a file's ``model`` follows from a rule."""
    kind, limit, stiffness = kind_of(given), given["friction_limit"], given["contact_stiffness"]
    mass, usual = chosen(given, mass_ratio="mass_ratio"), {} if model is None else by_rule(kind, given, model)
    if kind == "none":
        return None
    if kind == "stuck":
        return StuckAbsorber(**mass)
    if kind == "tuned":
        return TunedAbsorber(**{**usual, **mass, **chosen(given, stiffness="stiffness", damping="absorber_damping")})
    if kind == "friction":
        return friction_damper(**{**usual, **mass, **chosen(given, friction_limit="friction_limit", friction_stiffness="friction_stiffness")})
    gap = {**usual, **chosen(given, gap="gap")}
    walls = RigidWalls(**gap, **chosen(given, restitution="restitution")) if stiffness is None else CompliantWalls(stiffness, **gap)
    tangential = stiffness if given["friction_stiffness"] is None else given["friction_stiffness"]
    return SlidingAbsorber(**mass, walls=walls, friction=friction_law(limit, tangential))


def force_by_rule(given: Options, model: ModalModel) -> float:
    """Return the force in N for which the design rule gives the gap that was given, or the library's default gap, which then is used."""
    ratio = DEFAULT_MASS_RATIO if given["mass_ratio"] is None else given["mass_ratio"]
    if given["gap"] is None and kind_of(given) == "impact":
        given["gap"] = RigidWalls.gap
    gap = RigidWalls.gap if given["gap"] is None else given["gap"]
    return design_force(model, positive("mass_ratio", ratio) * model.beam_mass, positive("gap", gap), given["resonance"])


def by_rule(kind: str, given: Options, model: ModalModel) -> Options:
    """Return what suits a structure that is not the paper's beam: the gap by the design rule, the LTVA tuned, the damper by the energy of a cycle."""
    ratio = DEFAULT_MASS_RATIO if given["mass_ratio"] is None else given["mass_ratio"]
    mass, force, resonance = positive("mass_ratio", ratio) * model.beam_mass, given["force"], given["resonance"]
    if kind == "impact" and given["gap"] is None:
        return {"gap": design_gap(model, mass, force, resonance)}
    if kind == "friction" and given["friction_limit"] is None:
        return {"friction_limit": best_friction(model, mass, force, resonance)[0]}
    if kind == "tuned" and (given["stiffness"] is None or given["absorber_damping"] is None):
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
    rate = given["percent_per_100_periods"]
    return linear_sweep(omega, start, stop, default_rate(scene.model, (given["resonance"],)) if rate is None else rate)
