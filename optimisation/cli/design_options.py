"""Options that the commands of design studies share, and the problem that they describe."""

from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

from impact_env.checks import ParameterError, positive
from impact_env.curve import DEFAULT_MEMBERS
from impact_env.ensemble import Executor, available_cores
from impact_env.loads import Loads
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls
from optimisation.absorber_rules import rigid_walls
from optimisation.bounds import LEAST_REACH, design_force, reach
from optimisation.checkpoint import conditions, peak_memory
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import BadInput, parse_uncertain
from optimisation.cli.options import OptionSpec, at_least, option
from optimisation.cli.scene_options import DeviceSource
from optimisation.comparison import RESONANCES
from optimisation.executors import (
    COARSER,
    LONG_S,
    PlannedRuns,
    announce_coarse,
    announce_load_runs,
    announce_runs,
)
from optimisation.mounting import model_with_absorber_at
from optimisation.objectives import LIMITABLE, Condition, Constraint, Objective
from optimisation.problem import Problem, evaluate
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
    """Return conditions with one sweep range at each resonance for all designs of a space.

    The range suits all absorbers up to the heaviest of the space (`optimisation.sweep_range`).
    """
    factors = np.geomspace(1 / 3, 3, RANGE_FORCES) if spread else np.ones(1)
    ranges = {resonance: range_of(space, structure, resonance) for resonance, _ in at}
    return tuple(
        Condition(resonance, force * float(factor), ranges[resonance])
        for resonance, force in at
        for factor in factors
    )


PLACES = 9  # of a free position, for which the range is found


def range_of(space: DesignSpace, structure: Structure, resonance: int) -> tuple[float, float]:
    """Return the range of the sweeps near a resonance.

    It suits the heaviest absorber of a space at any of its places.

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


@dataclass(frozen=True, kw_only=True)
class StudyOptions(scenes.SweepRunOptions, scenes.DeviceOptions):
    """Options of every search of designs; None: not given.

    ``free_by_default`` are the variables that are searched where --free is not given, None for
    those of the concept. ``every_concept``: what a concept lacks does not concern it, as all are
    searched at once.
    """

    modes: int = option("modes", type=at_least(1), default=Beam.modes)
    mass_ratio: float | None = option(
        "mass_ratio",
        default=None,
        default_text="the paper's",
        more="In place of --fix mass_ratio.",
        usual=False,
    )
    mass_kg: float | None = option("mass_kg")
    load: Path | None = option("load")
    at: tuple[tuple[int, float], ...] = option("at")
    resonances: tuple[int, int] = option(
        "resonances",
        help="One or two resonances, with forces by the design rule",
        default=RESONANCES,
        usual=False,
    )
    free: tuple[str, ...] = option("free", help="Variable to search; may be repeated")
    bounds: tuple[tuple[str, float, float], ...] = option(
        OptionSpec(
            names=("--bounds",),
            help="Bounds of a free variable in SI units; may be repeated",
            type=(str, float, float),
            metavar="NAME LOW HIGH",
            multiple=True,
        )
    )
    fix: tuple[tuple[str, float], ...] = option(
        OptionSpec(
            names=("--fix",),
            help="Value of a variable that is not searched; may be repeated",
            type=(str, float),
            metavar="NAME VALUE",
            multiple=True,
            default_text="the paper's",
        )
    )
    uncertain: tuple[tuple[str, tuple[str, ...]], ...] = option("uncertain")
    constraint: tuple[tuple[str, float], ...] = option(
        "constraint", more=f"{', '.join(LIMITABLE)}, or MODULE:FUNCTION."
    )
    designs: int | None = option("designs")
    quick: bool = option(
        "quick",
        help="A first answer from few runs and fast sweeps",
        more=f"{QUICK_MEMBERS} members and sweeps {QUICK_SPEED:g} times as fast, unless given.",
    )
    members: int | None = option("members", default_text=f"{DEFAULT_MEMBERS}, for fronts 4")
    batch: int | None = option(
        "batch", more="The population of CMA-ES and NSGA-II, members of a round of gp."
    )
    study: Path | None = option("study")
    out: Path = option("out")
    free_by_default: tuple[str, ...] | None = None
    every_concept: bool = False

    @property
    def beam(self) -> Beam:
        """The paper's beam with the number of modes that is given."""
        return Beam(modes=self.modes)

    @property
    def searched(self) -> tuple[str, ...] | None:
        """Return the variables that are searched, None for those of the concept."""
        return self.free or self.free_by_default


def variables_help() -> str:
    """Return the concepts' variables for a help text."""
    lines = ["\b", "Variables and bounds:"]
    for concept, variables in VARIABLES.items():
        lines.append(f"  {concept}")
        lines += [f"    {v.name} {v.low:g} to {v.high:g} {v.unit}".rstrip() for v in variables]
    return "\n".join(lines)


def make_space(concept: str, options: StudyOptions, source: DeviceSource) -> DesignSpace:
    """Return the design space of a concept.

    If all concepts are searched at once, options for variables that a concept lacks are ignored.
    """
    known = {v.name for v in VARIABLES[concept]}
    every = options.every_concept
    free = [name for name in options.searched or () if name in known or not every]
    bounds = {name: (low, high) for name, low, high in options.bounds if name in known or not every}
    fixed = _of_device(concept, options, source) | {
        name: value
        for name, value in fixed_of(options, source).items()
        if name in known or not every
    }
    return design_space(concept, free or None, bounds, fixed)


def fixed_of(options: StudyOptions, source: DeviceSource) -> dict[str, float]:
    """Return the variables that are fixed by --fix and by the options of the mass.

    Raises BadInput if more than one of these options, --free and --scene give the mass.
    """
    fixed = dict(options.fix)
    for name, value in (("--mass-kg", options.mass_kg), ("--mass-ratio", options.mass_ratio)):
        if value is None:
            continue
        for other, names in (("--fix", fixed), ("--free", options.searched or ())):
            if MASS_RATIO in names:
                raise BadInput(
                    f"{name} does not go with {other} {MASS_RATIO}: each says what the mass is"
                )
    if options.mass_kg is not None and options.mass_ratio is not None:
        raise BadInput("--mass-kg does not go with --mass-ratio: each says what the mass is")
    if options.mass_ratio is not None:
        fixed[MASS_RATIO] = options.mass_ratio
    if options.mass_kg is not None:
        mass = model_with_absorber_at(source.structure).beam_mass
        fixed[MASS_RATIO] = positive("mass_kg", options.mass_kg) / mass
    return fixed


def _of_device(concept: str, options: StudyOptions, source: DeviceSource) -> dict[str, float]:
    """Return the values of the variables that are not searched, from the file of --scene.

    They are the mass, and for an impact absorber all other variables.
    """
    device = source.device
    if device is None:
        return {}
    free = set(options.searched or DEFAULT_FREE[concept])
    own = {MASS_RATIO: device.mass_ratio}
    if concept == IMPACT:
        friction = 0.0 if device.friction is None else device.friction.limit
        walls = rigid_walls(device)
        own |= {
            GAP: walls.gap,
            RESTITUTION: walls.restitution,
            FRICTION_LIMIT: friction,
        }
    return {name: value for name, value in own.items() if name not in free}


def read_source(options: StudyOptions) -> DeviceSource:
    """Return the structure and the absorber of --scene.

    The structure is that of the file, or the paper's beam with the options' modes.
    """
    return scenes.read_source(options, "concept")


def forces_at(
    options: StudyOptions, source: DeviceSource, usual: tuple[tuple[int, float], ...]
) -> list[tuple[int, float]]:
    """Return the resonances and their forces.

    They are those of --at or else the ``usual`` ones. For a structure from a file they are those of
    --resonances, with forces by the design rule.

    The rule's forces are those for a gap of 1 mm; by the scaling law another gap has the same
    answers at other forces. They stand to each other as the usual ones do to the design forces of
    the paper's beam.
    """
    model = model_with_absorber_at(source.structure)
    if options.at:
        if scenes.is_option_set("resonances"):
            raise ParameterError(
                f"--resonances = {options.resonances} is not allowed: beside --at, which "
                "names resonances with their forces"
            )
        scenes.warn_of_nodes(model, *(resonance for resonance, _ in options.at))
        return list(options.at)
    from_file = options.structure is not None or options.scene is not None
    if not from_file and not scenes.is_option_set("resonances"):
        return list(usual)
    paper = modal_model(Beam())
    usual_ratio = DEFAULT_MASS_RATIO if source.device is None else source.device.mass_ratio
    ratio = fixed_of(options, source).get(MASS_RATIO, usual_ratio)
    mass = positive(MASS_RATIO, ratio) * model.beam_mass
    shares = [
        force / design_force(paper, DEFAULT_MASS_RATIO * paper.beam_mass, RigidWalls.gap, resonance)
        for resonance, force in usual
    ]
    scenes.warn_of_nodes(model, *options.resonances)
    for k in dict.fromkeys(options.resonances):
        if (free_over_rule := reach(model, mass, k)) < LEAST_REACH:
            click.echo(
                (
                    f"warning: at resonance {k} the free amplitude is {free_over_rule:.2g} of the "
                    "rule's gap: no wall would be touched there"
                ),
                err=True,
            )
    wanted = tuple(dict.fromkeys(options.resonances))[: len(usual)]
    return [
        (k, float(f"{share * design_force(model, mass, RigidWalls.gap, k):.3g}"))
        for k, share in zip(wanted, shares, strict=False)
    ]


def loads_in(options: StudyOptions, source: DeviceSource) -> Loads | None:
    """Return the loads of --load, or None without it.

    Raises BadInput for options that cannot be combined with it.
    """
    scenes.refuse_with_load(options.load, "at", "resonances", "rate")
    scenes.refuse_with_load(
        options.load, "uncertain", why="there a member's loads are what differs"
    )
    if options.load is None:
        return None
    return scenes.loads_of(options.load, model_with_absorber_at(source.structure))


def make_problem(
    space: DesignSpace,
    conditions: tuple[Condition, ...],
    objectives: tuple[Objective, ...],
    options: StudyOptions,
    source: DeviceSource,
) -> Problem:
    """Return the problem that the options describe."""
    members = options.members or (QUICK_MEMBERS if options.quick else DEFAULT_MEMBERS)
    constraints = tuple(Constraint(name, limit) for name, limit in options.constraint)
    problem = Problem(
        space,
        conditions,
        objectives,
        constraints,
        source.structure,
        members,
        options.seed,
        options.rate,  # type: ignore[arg-type]  # None: the usual rate
        uncertain=parse_uncertain(options.uncertain),
    )
    return replace(problem, rate=QUICK_SPEED * problem.rate) if options.quick else problem


def conditions_of(options: StudyOptions) -> dict[str, object]:
    """Return versions, machine, threads and memory of a computation.

    They do not include the worker processes of a cluster.
    """
    where = (
        {"cluster": options.cluster}
        if options.cluster
        else {"threads": options.threads or available_cores()}
    )
    versions = conditions(("numpy", "scipy", "numba", "optuna"))["versions"]
    return {"versions": versions, **where, "memory_bytes": peak_memory()}


def journal_of(options: StudyOptions, folder: Path) -> Path:
    """Return the study's file: that of --study, or the default file of the folder.

    With --quick the default file is another one, because it is another study.
    """
    return options.study or folder / ("quick.journal" if options.quick else "study.journal")


LESS = "--quick, fewer --designs or --members take less."


def announce_search(
    problem: Problem,
    designs: float,
    threads: int | None,
    cluster: str | None,
    executor: Executor,
) -> None:
    """Print how long a search takes, if it is long, and the level of the rule's design.

    The level is computed by single fast runs.

    ``designs``: how many are run with all members at the problem's rate. Workers of a cluster are
    not timed.
    """
    if cluster is not None:
        return
    rule = problem.space.default
    chunks = problem.chunks(rule, problem.ensemble[:1], problem.rate)
    if problem.under_loads:
        lane = chunks[0].lanes[0]
        number = round(designs * problem.members * len(problem.conditions))
        seconds = announce_load_runs(lane.scene, lane.drive, number, threads)
        rate = problem.rate
    else:
        planned = [
            PlannedRuns(
                chunk.lanes[0].scene,
                condition.force,
                condition.resonance,
                chunk.lanes[0].drive.schedule.periods,
                2 * designs * problem.members,
            )
            for condition, chunk in zip(problem.conditions, chunks, strict=True)
        ]
        seconds = announce_runs(planned, threads, LESS)
        rate = COARSER * problem.rate
    if seconds <= LONG_S:
        return
    few = problem.ensemble[:1]
    ((_, measured),) = evaluate(problem, [rule], few, rate, executor)
    score = problem.score(rule, measured, few, rate)
    if not score.failed:
        values = "; ".join(
            f"{objective.label} {value:.3g}"
            for objective, value in zip(problem.objectives, score.values, strict=True)
        )
        announce_coarse(f"the design rule's device has {values}.")
