"""Options that the commands of design studies share, and the problem that they describe."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.ensemble import available_cores
from impact_env.loads import Loads
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, ParameterError, RigidWalls, positive
from optimisation.bounds import LEAST_REACH, design_force, reach
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    BadInput,
    parse_uncertain,
    rate_option,
    stack_options,
    threads_option,
    uncertain_option,
)
from optimisation.comparison import RESONANCES
from optimisation.executors import cluster_option
from optimisation.machine import conditions, peak_memory
from optimisation.mounting import model_with_absorber_at
from optimisation.objectives import LIMITABLE, Condition, Constraint, Objective
from optimisation.problem import Problem
from optimisation.space import (
    DEFAULT_FREE,
    FRICTION_LIMIT,
    GAP,
    IMPACT,
    MASS_RATIO,
    POSITION,
    RESTITUTION,
    TUNED,
    VARIABLES,
    DesignSpace,
    design_space,
)
from optimisation.sweep_range import find_common_range, split_frequencies

RANGE_FORCES = 8  # forces between a third and three times the given one, for the objective range
QUICK_SPEED = 10.0
QUICK_MEMBERS = 2


def load_conditions(loads: Loads, spread: bool = False) -> tuple[Condition, ...]:
    """Return the conditions under loads: as they are, or with ``spread`` times factors."""
    factors = np.geomspace(1 / 3, 3, RANGE_FORCES) if spread else np.ones(1)
    return tuple(Condition(1, float(factor), loads=loads) for factor in factors)


def make_conditions(
    space: DesignSpace,
    structure: Structure,
    at: list[tuple[int, float]],
    spread: bool = False,
) -> tuple[Condition, ...]:
    """Return conditions that are swept over one range for all absorbers up to the heaviest of the space, see `optimisation.sweep_range`."""
    factors = np.geomspace(1 / 3, 3, RANGE_FORCES) if spread else np.ones(1)
    ranges = {resonance: range_of(space, structure, resonance) for resonance, _ in at}
    return tuple(
        Condition(resonance, force * float(factor), ranges[resonance])
        for resonance, force in at
        for factor in factors
    )


PLACES = 9  # of a free position, for which the range is found


def range_of(space: DesignSpace, structure: Structure, resonance: int) -> tuple[float, float]:
    """Return the range of the sweeps near a resonance, for the heaviest absorber of a space at any of its places.

    A tuned absorber has to have both its peaks in it, also where other resonances are close.
    """
    free = {variable.name: variable for variable in space.free}
    heaviest = free[MASS_RATIO].high if MASS_RATIO in free else space.default.values[MASS_RATIO]
    models = [model_with_absorber_at(structure)]
    if isinstance(structure, ModalModel) and POSITION in free:
        models = [model_with_absorber_at(structure, k + 1) for k in range(len(structure.places))]
    elif POSITION in free:
        places = np.linspace(free[POSITION].low, free[POSITION].high, PLACES)
        models = [model_with_absorber_at(structure, float(place)) for place in places]
    low, high = find_common_range(models, heaviest, resonance)
    if space.concept == TUNED:
        ratio = heaviest * models[0].beam_mass
        for model in models:
            first, second = split_frequencies(ratio * float(model.tip_shape[resonance - 1]) ** 2)
            low = min(low, 0.99 * first)
            high = max(high, 1.01 * second)
    return low, high


BROKEN_OFF = "Broken off; the study keeps what is finished."
GOES_ON = "the same command goes on from here."


class At(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """RESONANCE:FORCE, the force in N."""

    name = "resonance:force"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, float]:
        """Return the resonance and the force in ``value``, or fail with the form that is allowed."""
        if isinstance(value, tuple):
            return value
        try:
            resonance, force = str(value).split(":")
            return int(resonance), float(force)
        except ValueError:
            self.fail(f"{value!r} is not RESONANCE:FORCE, as in 1:3.5", param, ctx)


RESONANCES_HELP = f"{scenes.RESONANCES_HELP} Forces by the design rule."
CONSTRAINT_HELP = f"Upper limit of {', '.join(LIMITABLE)}, in SI units, or of MODULE:FUNCTION."
shared_options = stack_options(  # of every design study
    (
        scenes.structure_option,
        scenes.scene_option,
        scenes.load_option,
        click.option(
            "--resonances",
            type=(int, int),
            default=RESONANCES,
            show_default=True,
            help=RESONANCES_HELP,
        ),
        click.option(
            "--free", multiple=True, metavar="NAME", help="Variable to search; may be repeated."
        ),
        click.option(
            "--bounds",
            multiple=True,
            type=(str, float, float),
            metavar="NAME LOW HIGH",
            help="Bounds of a free variable, in SI units.",
        ),
        click.option(
            "--fix",
            multiple=True,
            type=(str, float),
            metavar="NAME VALUE",
            help="Value of a variable not searched.  [default: the paper's]",
        ),
        scenes.mass_option,
        uncertain_option,
        click.option(
            "--members",
            type=click.IntRange(min=1),
            help=f"Runs for each point.  [default: {DEFAULT_MEMBERS}, for fronts 4]",
        ),
        click.option(
            "--batch",
            type=click.IntRange(min=2),
            help="Runs in one call: the population of CMA-ES and NSGA-II, members of a round of gp.",
        ),
        click.option(
            "--seed",
            type=click.IntRange(min=0),
            default=0,
            show_default=True,
            help="Seed of search and members.",
        ),
        click.option(
            "--modes",
            type=click.IntRange(min=1),
            default=Beam.modes,
            show_default=True,
            help="Modes of the beam.",
        ),
        rate_option,
        click.option(
            "--constraint",
            multiple=True,
            type=(str, float),
            metavar="NAME LIMIT",
            help=CONSTRAINT_HELP,
        ),
        click.option(
            "--quick",
            is_flag=True,
            help=f"A look: {QUICK_MEMBERS} members and sweeps {QUICK_SPEED:g} times as fast, unless given.",
        ),
        threads_option,
        cluster_option,
    )
)
study_option = click.option(
    "--study",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Study file.  [default: study.journal in the folder, quick.journal with --quick]",
)


def variables_help() -> str:
    """Return the concepts' variables for a help text."""
    lines = ["\b", "Variables and bounds:"]
    for concept, variables in VARIABLES.items():
        lines += [
            f"  {concept}: "
            + ", ".join(f"{v.name} {v.low:g} to {v.high:g} {v.unit}".rstrip() for v in variables)
        ]
    return "\n".join(lines)


def make_space(concept: str, options: dict[str, Any]) -> DesignSpace:
    """Return the space of a concept; with all concepts at once, what a concept lacks does not concern it."""
    known = {v.name for v in VARIABLES[concept]}
    every = options.get("every", False)
    free = [name for name in options["free"] if name in known or not every]
    bounds = {
        name: (low, high) for name, low, high in options["bounds"] if name in known or not every
    }
    fixed = _of_device(concept, options) | {
        name: value for name, value in fixed_of(options).items() if name in known or not every
    }
    return design_space(concept, free or None, bounds, fixed)


def fixed_of(options: dict[str, Any]) -> dict[str, float]:
    """Return the variables that --fix and --mass-kg fix; raises BadInput if both, or --free or --scene, say what the mass is."""
    fixed = dict(options["fix"])
    if options["mass_kg"] is not None:
        for option, names in (("--fix", fixed), ("--free", options["free"])):
            if MASS_RATIO in names:
                raise BadInput(
                    f"--mass-kg does not go with {option} {MASS_RATIO}: each says what the mass is"
                )
        if options["scene"] is not None:
            raise BadInput(
                "--mass-kg does not go with --scene: the file says what structure and absorber are"
            )
        fixed[MASS_RATIO] = (
            positive("mass_kg", options["mass_kg"])
            / model_with_absorber_at(structure_of(options)).beam_mass
        )
    return fixed


def _of_device(concept: str, options: dict[str, Any]) -> dict[str, float]:
    """Return the values, from the file of --scene, of variables that are not searched: the mass, and all others of an impact absorber."""
    structure_of(options)
    if options["scene"] is None:
        return {}
    device = options["device"]
    free = set(options["free"] or DEFAULT_FREE[concept])
    own = {MASS_RATIO: device.mass_ratio}
    if concept == IMPACT:
        friction = 0.0 if device.friction is None else device.friction.limit
        own |= {
            GAP: device.walls.gap,
            RESTITUTION: device.walls.restitution,
            FRICTION_LIMIT: friction,
        }
    return {name: value for name, value in own.items() if name not in free}


def structure_of(options: dict[str, Any]) -> Structure:
    """Return the structure of the file, read once, or the paper's beam with the options' modes."""
    if options["scene"] is not None:
        if "read" not in options:
            options["read"], options["device"] = scenes.read_device(
                options["scene"], "structure", "modes"
            )
        return options["read"]
    if options["structure"] is None:
        return replace(Beam(), modes=options["modes"])
    scenes.refuse_with_structure(options["structure"], "modes")
    if "read" not in options:
        options["read"] = scenes.read_structure(options["structure"])
    structure: Structure = options["read"]
    return structure


def forces_at(
    options: dict[str, Any], usual: tuple[tuple[int, float], ...]
) -> list[tuple[int, float]]:
    """Return the resonances and their forces: those of --at, the ``usual`` ones, or for a structure from a file those of --resonances by the rule.

    The rule's forces are those for a gap of 1 mm; by the scaling law another gap has the same answers at other forces. They stand to each other as
    the usual ones do to the design forces of the paper's beam.
    """
    if options["at"]:
        if scenes.is_option_set("resonances"):
            raise ParameterError(
                f"--resonances = {options['resonances']} is not allowed: beside --at, which names resonances with their forces"
            )
        at = list(options["at"])
        scenes.warn_of_nodes(
            model_with_absorber_at(structure_of(options)), *(resonance for resonance, _ in at)
        )
        return at
    if (
        options["structure"] is None
        and options["scene"] is None
        and not scenes.is_option_set("resonances")
    ):
        return list(usual)
    model = model_with_absorber_at(structure_of(options))
    paper = modal_model(Beam())
    structure_of(options)
    usual_ratio = (
        options["device"].mass_ratio if options["scene"] is not None else DEFAULT_MASS_RATIO
    )
    ratio = fixed_of(options).get(MASS_RATIO, usual_ratio)
    mass = positive(MASS_RATIO, ratio) * model.beam_mass
    shares = [
        force / design_force(paper, DEFAULT_MASS_RATIO * paper.beam_mass, RigidWalls.gap, resonance)
        for resonance, force in usual
    ]
    scenes.warn_of_nodes(model, *options["resonances"])
    for k in dict.fromkeys(options["resonances"]):
        if (free_over_rule := reach(model, mass, k)) < LEAST_REACH:
            click.echo(
                f"warning: at resonance {k} the free amplitude is {free_over_rule:.2g} of the rule's gap: no wall would be touched there",
                err=True,
            )
    wanted = tuple(dict.fromkeys(options["resonances"]))[: len(usual)]
    return [
        (k, float(f"{share * design_force(model, mass, RigidWalls.gap, k):.3g}"))
        for k, share in zip(wanted, shares, strict=False)
    ]


def loads_in(options: dict[str, Any]) -> Loads | None:
    """Return the loads of --load, None without it; raises BadInput for options that do not go with it."""
    scenes.refuse_with_load(options["load"], "at", "resonances", "rate")
    scenes.refuse_with_load(
        options["load"], "uncertain", why="there a member's loads are what differs"
    )
    return (
        None
        if options["load"] is None
        else scenes.loads_of(options["load"], model_with_absorber_at(structure_of(options)))
    )


def make_problem(
    concept: str,
    conditions: tuple[Condition, ...],
    objectives: tuple[Objective, ...],
    options: dict[str, Any],
) -> Problem:
    """Return the problem that the options describe."""
    members = options["members"] or (QUICK_MEMBERS if options["quick"] else DEFAULT_MEMBERS)
    constraints = tuple(Constraint(name, limit) for name, limit in options["constraint"])
    space = make_space(concept, options)
    uncertain = parse_uncertain(options["uncertain"])
    problem = Problem(
        space,
        conditions,
        objectives,
        constraints,
        structure_of(options),
        members,
        options["seed"],
        options["rate"],
        uncertain=uncertain,
    )
    return replace(problem, rate=QUICK_SPEED * problem.rate) if options["quick"] else problem


def conditions_of(options: dict[str, Any]) -> dict[str, object]:
    """Return versions, machine, threads and memory of a computation; worker processes of a cluster are not in it."""
    where = (
        {"cluster": options["cluster"]}
        if options["cluster"]
        else {"threads": options["threads"] or available_cores()}
    )
    versions = conditions(("numpy", "scipy", "numba", "optuna"))["versions"]
    return {"versions": versions, **where, "memory_bytes": peak_memory()}


def journal_of(options: dict[str, Any], folder: Path) -> Path:
    """Return the file named by --study, or the folder's own: a quick look has one for itself, as it is another study."""
    study: Path | None = options["study"]
    return study or folder / ("quick.journal" if options["quick"] else "study.journal")
