"""Exact periodic orbits with their stability, folds, births and mergers of isolas."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import click
import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    count,
    positive,
    require,
)
from impact_env.periodic.basins import DEFAULT_RUNS, find_basins
from impact_env.periodic.bifurcation_curves import CURVE_KINDS, bifurcation_curves
from impact_env.periodic.branch import FOLD, INTERRUPTED
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.hybrid_branches import HybridBranch, hybrid_branch, orbit_at
from impact_env.periodic.hybrid_case import HybridCase
from impact_env.periodic.hybrid_orbit import (
    HybridOrbit,
    NoHybridOrbit,
    find_hybrid_orbits,
    plain_hybrid_orbit,
)
from impact_env.periodic.isolas import find_folds, find_thresholds
from impact_env.periodic.offspring import all_orbits_over, descendants
from impact_env.periodic.orbit import Orbit, plain_orbit
from impact_env.periodic.orbit_branches import (
    OrbitBranch,
    lies_on,
    list_places,
    orbit_branch,
    orbit_branches,
)
from impact_env.periodic.orbit_table import (
    ORBIT_COLUMNS,
    bifurcation_rows,
    branch_rows,
    orbit_rows,
)
from impact_env.periodic.response_curve import ResponseCurve, orbit_curve
from impact_env.periodic.survey import (
    OrbitSearch,
    attractors,
    closed_form_orbits,
    drop_repeated,
    orbits_over,
)
from impact_env.periodic.validation import validation_alongside
from impact_env.plain import to_scene
from impact_env.plain_files import read_plain
from optimisation.absorber_rules import rigid_walls
from optimisation.bounds import design_force, design_gap
from optimisation.cli.common import (
    BadInput,
    check_targets,
    command,
    end_early,
    file_option,
    json_option,
    name_files,
    plain_errors,
    stack_options,
    stop_on_interrupt,
)
from optimisation.cli.scene_options import (
    is_option_set,
    model_of,
    read_device,
    refuse_with_structure,
    scene_option,
    structure_option,
)
from optimisation.files import write_files
from optimisation.mounting import model_with_absorber_at
from optimisation.page import markdown
from optimisation.progress import stages_bar
from optimisation.report import periodic_figures as report

FORCE = 1.5  # N, the paper's moderate level of excitation
FORCE_HELP = f"Amplitude of the harmonic force in N; not used for thresholds.  [default: {FORCE}, with --structure or --scene by the design rule]"
GAP_HELP = f"Clearance to either wall in m.  [default: {RigidWalls.gap}, with --structure and --force by the design rule]"
# of the first resonance, the paper's range
FROM = 0.9
TO = 1.06
# frequencies listed, and those from which branches lead to a single one, with its neighbourhood
POINTS = 81
AROUND = 21
RANGE = 0.02
# parameters that branches and curves are followed over, and their names in Python
PARAMETER_NAMES = {
    "force": "force",
    "gap": "gap",
    "restitution": "restitution",
    "friction-limit": "friction_limit",
    "mass-ratio": "mass_ratio",
    "damping": "damping_ratio",
    "position": "absorber_position",
}
BRANCH_PARAMETERS = (*PARAMETER_NAMES, "frequency")
CURVES = {kind.replace(" ", "-"): kind for kind in CURVE_KINDS}
OPTIONS_OF_FILE = (
    "structure",
    "modes",
    "damping",
    "mass_ratio",
    "gap",
    "restitution",
    "friction_limit",
)  # what a scene's file says
UNITS = {  # of each of these: its name in files, in figures, and the figure's unit
    "force": ("force_N", "force in N", 1.0),
    "gap": ("gap_m", "gap in mm", 1e3),
    "restitution": ("restitution", "restitution", 1.0),
    "friction-limit": ("friction_limit_N", "friction limit in N", 1.0),
    "mass-ratio": ("mass_ratio", "mass ratio", 1.0),
    "damping": ("damping_ratio", "damping ratio of the first mode", 1.0),
    "position": ("absorber_position", "place of the absorber over the length", 1.0),
}
ShowProgress = Callable[[str, int, int], None]
Array = NDArray[np.float64]


def searched(
    case: Case,
    ratios: Array,
    symmetric: bool,
    show: ShowProgress,
    settle: bool = True,
    starts: int = DEFAULT_RUNS,
    seed: int = 0,
) -> Iterator[OrbitSearch]:
    """Yield the orbits at each ratio (M,): the symmetric ones only, or also what leaves their branches and, with ``settle``, what runs end on."""
    if symmetric:
        return orbits_over(case, ratios, lambda done, total: show("frequencies", done, total))
    return all_orbits_over(
        case, ratios, show, settle=settle and starts > 0, starts=starts, seed=seed
    )


def listed(
    case: Case, options: dict[str, Any], show: ShowProgress, complete: list[bool]
) -> list[OrbitSearch]:
    """Orbits at the frequencies asked for. At a single one branches come from its neighbourhood, and runs add what they settle to."""
    found: list[OrbitSearch] = []
    with stop_on_interrupt(complete):
        if options["at"] is None:
            found += searched(
                case,
                np.linspace(options["start"], options["stop"], options["points"]),
                options["symmetric"],
                show,
                starts=options["starts"],
                seed=options["seed"],
            )
            return found
        around(case, options, show, found)
        here = found[0]
        for settled in () if options["symmetric"] else attractors(here.case, here.orbits):
            if isinstance(settled, NoOrbit):
                found[0] = replace(found[0], refused=(*found[0].refused, settled))
            else:
                found[0] = replace(
                    found[0], orbits=tuple(drop_repeated([*found[0].orbits, settled]))
                )
        if not options["symmetric"] and options["starts"] > 0:
            draw(found, options, show)
    return found


def draw(found: list[OrbitSearch], options: dict[str, Any], show: ShowProgress) -> None:
    """Add what runs from random initial states end on at the single frequency asked for."""
    here = found[0]
    basins = find_basins(
        here.case,
        here.orbits,
        options["starts"],
        seed=options["seed"],
        progress=lambda done, total: show("random starts", done, total),
    )
    orbits = tuple(drop_repeated([*here.orbits, *basins.orbits]))
    found[0] = replace(here, orbits=orbits, basins=basins)


def around(
    case: Case, options: dict[str, Any], show: ShowProgress, found: list[OrbitSearch]
) -> None:
    """Add the orbits at the single frequency asked for to ``found``, even after Ctrl-C; its neighbours are where branches begin."""
    at = options["at"]
    groups = list[OrbitSearch]()
    low = max(options["start"], at - RANGE)
    high = min(options["stop"], at + RANGE)
    try:
        groups += searched(
            case,
            np.union1d(np.linspace(low, high, AROUND), [at]),
            options["symmetric"],
            show,
            settle=False,
        )
    finally:
        found += [group for group in groups if abs(group.case.omega_ratio - at) < 1e-12]


def along(case: Case, options: dict[str, Any], show: ShowProgress) -> Iterator[ResponseCurve]:
    """Yield the branches of the symmetric orbits at one frequency over another parameter, each once."""
    name = PARAMETER_NAMES[options["along"]]
    known = list[Array]()
    at = case.changed(omega=options["at"] * case.omega)
    low, high = options["over"]
    for orbit in closed_form_orbits(at).orbits:
        if any(lies_on(places, orbit.solution) for places in known):
            continue
        branch = orbit_branch(
            orbit.solution,
            name,
            (low, high),
            progress=lambda points, _value: show(f"branch {len(known) + 1}, points", points, 0),
        )
        known.append(list_places(branch))
        yield orbit_curve(branch, 1.0)


def _renamed(plain: Any, key: str) -> Any:
    """Return a curve's plain form with its parameter by name in place of the frequency; its orbits have both."""
    if isinstance(plain, list):
        return [_renamed(value, key) for value in plain]
    if not isinstance(plain, dict):
        return plain
    return {
        key if name == "omega_ratio" else name: value if name == "orbits" else _renamed(value, key)
        for name, value in plain.items()
    }


def along_text(found: list[ResponseCurve], name: str) -> str:
    """Return a line for each branch over a parameter."""
    rows = []
    for number, curve in enumerate(found, 1):
        places = ", ".join(
            f"{mark.kind} {mark.omega_ratio:.6g}"
            + ("" if mark.criticality is None else f" ({mark.criticality})")
            for mark in sorted(curve.located, key=lambda mark: mark.omega_ratio)
        )
        peak = (
            ""
            if curve.peak is None
            else f"{1e3 * curve.peak.tip_max:.4f} at {curve.peak.omega_ratio:.5g}"
        )
        ends = f"{curve.omega_ratio.min():.5g} to {curve.omega_ratio.max():.5g}"
        stable = "" if curve.stable is None else f"{100 * curve.stable.mean():.0f}"
        rows.append((str(number), str(len(curve.tip_max)), ends, peak, stable, places))
    return markdown(("branch", "points", name, "peak, mm", "stable, %", "located"), rows)


def two_parameters(
    case: Case, options: dict[str, Any], show: ShowProgress, complete: list[bool]
) -> Iterator[dict[str, Any]]:
    """Yield the plain forms of the curves of bifurcations through the branches over the frequency, over that and a second parameter."""
    first = case.omega
    name = PARAMETER_NAMES[options["second"]]
    limits = (options["start"] * first, options["stop"] * first)

    def show_points(what: str, points: int, _value: float) -> None:
        show(f"{what}, points", points, 0)

    with stop_on_interrupt(complete):
        branches = list(orbit_branches(case, *limits, progress=show_points))
        branches += (
            ()
            if options["symmetric"]
            else [
                found for found in descendants(branches, limits) if isinstance(found, OrbitBranch)
            ]
        )
        if any(branch.branch.ended == INTERRUPTED for branch in branches):
            raise KeyboardInterrupt
        for curve in bifurcation_curves(
            branches,
            [CURVES[kind] for kind in options["curve"]],
            name,
            options["over"],
            limits,
            show_points,
        ):
            complete[0] &= curve.branch.ended != INTERRUPTED
            yield curve.to_plain()


class FoundOrbits(NamedTuple):
    """What a call prints, its ``files`` by their paths as `write_files` takes them, and whether the work came to its end."""

    text: str
    files: dict[Any, object]
    complete: bool


def orbit_files(options: dict[str, Any], plain: list[dict[str, Any]]) -> dict[Any, object]:
    """Return the files of orbits, folds, births or mergers in their plain forms."""
    return {options["json"]: plain, options["csv"]: (ORBIT_COLUMNS, orbit_rows(plain))}


def branch_files(
    options: dict[str, Any], plain: list[dict[str, Any]], key: str
) -> dict[Any, object]:
    """Return the files of branches in their plain forms; ``key``: name of their parameter."""
    return {options["json"]: plain, options["csv"]: (ORBIT_COLUMNS, branch_rows(plain, key))}


def bifurcations(case: Case, options: dict[str, Any]) -> FoundOrbits:
    """Return the curves of bifurcations over two parameters."""
    complete, (key, words, scale) = [True], UNITS[options["second"]]
    with stages_bar("orbits", leave=False) as show:
        curves = list(two_parameters(case, options, show, complete))
    force = "" if options["second"] == "force" else f", {case.force:g} N"
    files = {
        options["json"]: curves,
        options["csv"]: (ORBIT_COLUMNS, bifurcation_rows(curves, key)),
        options["plot"]: lambda path: report.save_curves(
            path, curves, f"{case.scene}{force}", words, scale
        ),
    }
    return FoundOrbits(report.curve_text(curves, words, scale), files, complete[0])


def check(options: dict[str, Any]) -> None:
    """Raise BadInput or ParameterError, before any work is done, if options do not go together or a file cannot be written.

    The range's usual ends go with a single frequency beyond them.
    """
    if options["at"] is not None and positive("--at", options["at"]):
        if not is_option_set("start"):
            options["start"] = min(options["start"], max(options["at"] - RANGE, options["at"] / 2))
        if not is_option_set("stop"):
            options["stop"] = max(options["stop"], options["at"] + RANGE)
    if options["folds"] and options["thresholds"]:
        raise BadInput("--folds does not go with --thresholds: the JSON file has one list")
    if options["curve"]:
        if (
            options["second"] is None
            or options["over"] is None
            or any(options[name] for name in ("along", "at", "folds", "thresholds"))
        ):
            raise BadInput(
                "--curve goes with --with, a second parameter, and --over, its range, and not with --along, --at, --folds or --thresholds"
            )
        if options["second"] == "friction-limit" and not options["over"][0] > 0:
            allowed = (
                "friction limits above 0, as without friction the order of events is another one"
            )
            raise BadInput(f"--over = {options['over']} is not allowed: {allowed}")
    elif options["second"] is not None or options["plot"] is not None:
        raise BadInput(
            "--with and --plot go with --curve: they are about curves over two parameters"
        )
    elif (options["along"] is None) != (options["over"] is None) or (
        options["along"] is not None and options["at"] is None
    ):
        raise BadInput(
            "--along, --over and --at go together: a parameter, the range it is followed over, and the frequency"
        )
    if options["over"] is not None:
        low, high = options["over"]
        require(low < high, "--over", options["over"], "two numbers, the lower one first")
    if options["at"] is not None and (options["folds"] or options["thresholds"]):
        raise BadInput(
            "--at does not go with --folds or --thresholds: they are sought from --from to --to"
        )
    if not 0 < options["start"] < options["stop"]:
        raise BadInput(
            f"--from = {options['start']} is not allowed: a ratio above 0 and below --to = {options['stop']}"
        )
    if options["at"] is not None and not options["start"] <= options["at"] <= options["stop"]:
        raise BadInput(
            f"--at = {options['at']} is not allowed: a ratio from --from = {options['start']} to --to = {options['stop']}"
        )
    options["points"] = count("points", options["points"], 2)
    options["starts"] = count("starts", options["starts"], 0)
    options["seed"] = count("seed", options["seed"], 0)
    check_targets(options, ".json", ".gz")


def case_of(options: dict[str, Any]) -> Case:
    """Return structure and absorber at the first resonance; on a structure from a file force or gap, the one not given, is by the design rule."""
    refuse_with_structure(options["structure"], "modes", "damping")
    if options["scene"] is None:
        model = model_of(
            options["structure"], modes=options["modes"], damping_ratio=options["damping"]
        )
    else:
        structure, device = read_device(
            options["scene"],
            "structure",
            "modes",
            "damping",
            "mass_ratio",
            "gap",
            "restitution",
            "friction_limit",
        )
        model = model_with_absorber_at(structure)
        walls = rigid_walls(device)
        options |= {
            "mass_ratio": device.mass_ratio,
            "gap": walls.gap,
            "restitution": walls.restitution,
        }
        options["friction_limit"] = 0.0 if device.friction is None else device.friction.limit
    force = options["force"]
    gap = options["gap"]
    ratio = positive("mass_ratio", options["mass_ratio"])
    if gap is None:
        gap = (
            RigidWalls.gap
            if options["structure"] is None or force is None
            else design_gap(model, ratio * model.beam_mass, force)
        )
    if force is None:
        force = (
            FORCE
            if options["structure"] is None and options["scene"] is None
            else design_force(model, ratio * model.beam_mass, positive("gap", gap))
        )
    return Case(
        model,
        float(model.omega[0]),
        force,
        gap,
        options["restitution"],
        options["friction_limit"],
        ratio,
    )


def hybrid_case_of(options: dict[str, Any]) -> HybridCase | None:
    """Return the case of a scene with several absorbers or with springs, at the frequency asked for; None for any other scene.

    Raises BadInput for options that only other scenes have.
    """
    if options["scene"] is None or options["structure"] is not None:
        return None  # `case_of` refuses both together
    scene = to_scene(read_plain(options["scene"]), options["scene"].parent)
    absorber = scene.absorber
    soft = isinstance(absorber, SlidingAbsorber) and (
        isinstance(absorber.walls, CompliantWalls)
        or isinstance(absorber.friction, ElasticCoulombFriction)
    )
    if not soft and not isinstance(absorber, SeveralAbsorbers):
        return None
    what = "several absorbers or springs"
    for name in (*OPTIONS_OF_FILE, "symmetric", "folds", "thresholds"):
        if is_option_set(name):
            option = name.replace("_", "-")
            raise BadInput(f"--{option} does not go with a scene of {what}")
    if options["at"] is None or options["curve"]:
        raise BadInput(f"--at is required for a scene of {what}, without --curve")
    if options["along"] not in (None, "force", "frequency"):
        raise BadInput(f"--along = {options['along']}: force or frequency for a scene of {what}")
    force = FORCE if options["force"] is None else options["force"]
    return HybridCase(scene, options["at"] * float(scene.model.omega[0]), force)


def hybrid_orbits(case: HybridCase, options: dict[str, Any]) -> FoundOrbits:
    """Return the orbits that runs come to in a scene with several absorbers or springs, or their branches."""
    complete = [True]
    results: list[HybridOrbit | NoHybridOrbit] = []
    branches: list[HybridBranch] = []
    with stages_bar("orbits", leave=False) as show, stop_on_interrupt(complete):
        for result in find_hybrid_orbits(case, options["starts"], options["seed"]):
            results.append(result)
            show("runs", len(results), 0)
        for orbit in results if options["along"] else ():
            if isinstance(orbit, HybridOrbit) and not any(
                is_on_branch(orbit, branch) for branch in branches
            ):
                branches.append(follow_hybrid_branch(orbit, options, show))
    orbits = [result for result in results if isinstance(result, HybridOrbit)]
    refused = [result.reason for result in results if isinstance(result, NoHybridOrbit)]
    notes = report.reasons(refused, "runs lead to")
    if not options["along"]:
        stable = sum(orbit.stable for orbit in orbits)
        lines = [
            report.hybrid_table(orbits),
            "",
            f"{len(orbits)} orbits, {stable} of them stable.",
            *notes,
        ]
        plain = [plain_hybrid_orbit(orbit) for orbit in orbits]
        return FoundOrbits("\n".join(lines), orbit_files(options, plain), complete[0])
    over_force = options["along"] == "force"
    key = "force_N" if over_force else "omega_ratio"
    reference = 1.0 if over_force else float(case.scene.model.omega[0])
    curves = [branch.curve(reference) for branch in branches]
    plain = [
        {"omega_ratio": options["at"], **_renamed(curve.to_plain(), key)}
        if over_force
        else curve.to_plain()
        for curve in curves
    ]
    ends = [f"Branch {number}: {curve.message}." for number, curve in enumerate(curves, 1)]
    text = "\n".join([along_text(curves, key), "", *ends, *notes])
    return FoundOrbits(text, branch_files(options, plain, key), complete[0])


def follow_hybrid_branch(
    orbit: HybridOrbit, options: dict[str, Any], show: ShowProgress
) -> HybridBranch:
    """Return the branch through an orbit over the parameter and range asked for."""
    low, high = options["over"]
    name = "force"
    if options["along"] == "frequency":
        name = "omega"
        first = float(orbit.case.scene.model.omega[0])
        low, high = (low * first, high * first)
    return hybrid_branch(
        orbit, name, (low, high), progress=lambda points, _: show("points of a branch", points, 0)
    )


def is_on_branch(orbit: HybridOrbit, branch: HybridBranch) -> bool:
    """Return whether an orbit is the start of a branch, its mirror image included, or lies next to one of its points."""
    name = branch.branch.parameter
    value = float(getattr(orbit.case, name))
    crossings = np.flatnonzero(
        (branch.parameters[:-1] - value) * (branch.parameters[1:] - value) <= 0
    )
    for k in crossings:
        ends = [
            orbit_at(
                branch.conditions[j], name, branch.branch.points[j], float(branch.parameters[j])
            )
            for j in (k, k + 1)
        ]
        levels = [end.tip_rms for end in ends if isinstance(end, HybridOrbit)]
        close = 0.01 * orbit.tip_rms
        if levels and min(levels) - close <= orbit.tip_rms <= max(levels) + close:
            same = branch.conditions[k].period_multiple == orbit.period_multiple
            return same and branch.conditions[k].symmetric == orbit.symmetric
    return False


def run(options: dict[str, Any]) -> FoundOrbits:
    """Do what the options ask for."""
    check(options)
    hybrid = hybrid_case_of(options)
    if hybrid is not None:
        return hybrid_orbits(hybrid, options)
    if options["along"] == "frequency":
        raise BadInput(
            "--along frequency is for scenes of several absorbers or springs; others have --from and --to"
        )
    case = case_of(options)
    if options["curve"]:
        low, high = options["over"]
        name = PARAMETER_NAMES[options["second"]]
        own = getattr(case, name)
        for limit in (low, high):
            case.changed(**{name: limit})  # raises where it is not allowed
        require(
            low <= own <= high,
            "--over",
            options["over"],
            f"a range around {own:g}, where the curves begin",
        )
    with validation_alongside(case):
        return asked_for(case, options)


def asked_for(case: Case, options: dict[str, Any]) -> FoundOrbits:
    """Return folds, thresholds or orbits, as `run`."""
    low = options["start"]
    high = options["stop"]
    if options["curve"]:
        return bifurcations(case, options)
    if options["thresholds"]:
        levels = find_thresholds(case, low, high)
        plain = [
            {
                "kind": level.kind,
                "force_N": level.force,
                "omega_ratio": level.omega_ratio,
                "tip_max_m": level.orbit.motion.tip_max,
                "orbit": plain_orbit(level.orbit),
            }
            for level in levels
            if isinstance(level.orbit, Orbit)
        ]
        return FoundOrbits(report.threshold_text(levels), orbit_files(options, plain), True)
    if options["folds"]:
        located = find_folds(case, low, high)
        pairs = [(fold, fold.orbit) for fold in located if isinstance(fold.orbit, Orbit)]
        plain = [
            {
                "kind": FOLD,
                "omega_ratio": fold.omega_ratio,
                "force_N": fold.force,
                "tip_max_m": orbit.motion.tip_max,
                "orbit": plain_orbit(orbit),
            }
            for fold, orbit in pairs
        ]
        return FoundOrbits(report.fold_text(located), orbit_files(options, plain), True)
    if options["along"] is not None:
        with stages_bar("orbits", leave=False) as show:
            curves = list(along(case, options, show))
        key = UNITS[options["along"]][0]
        plain = [
            {"omega_ratio": options["at"], **_renamed(curve.to_plain(), key)} for curve in curves
        ]
        return FoundOrbits(along_text(curves, key), branch_files(options, plain, key), True)
    complete = [True]
    with stages_bar("orbits", leave=False) as show:
        found = listed(case, options, show, complete)
    orbits = [orbit for group in found for orbit in group.orbits]
    notes = report.refusals(
        [orbit for group in found for orbit in group.refused], "solutions or runs are"
    )
    stable = sum(orbit.stability.stable for orbit in orbits)
    lines = [
        report.orbit_table(found),
        "",
        f"{len(orbits)} orbits, {stable} of them stable.",
        *report.basin_lines(found),
        *notes,
    ]
    plain = [
        {
            **plain_orbit(orbit),
            "basin": None if group.basins is None else group.basins.to_plain(orbit),
        }
        for group in found
        for orbit in group.orbits
    ]
    return FoundOrbits("\n".join(lines), orbit_files(options, plain), complete[0])


case_options = stack_options(
    (
        structure_option,
        scene_option,
        click.option(
            "--modes", type=int, default=Beam.modes, show_default=True, help="Number of modes kept."
        ),
        click.option(
            "--damping",
            type=float,
            default=Beam.damping_ratio,
            show_default=True,
            help="Modal damping ratio, the same for all modes.",
        ),
        click.option(
            "--mass-ratio",
            type=float,
            default=DEFAULT_MASS_RATIO,
            show_default=True,
            help="Absorber mass over beam mass.",
        ),
        click.option("--gap", type=float, help=GAP_HELP),
        click.option(
            "--restitution",
            type=float,
            default=RigidWalls.restitution,
            show_default=True,
            help="Coefficient of restitution, 0 to 1.",
        ),
        click.option(
            "--friction-limit",
            type=float,
            default=0.0,
            show_default=True,
            help="Friction limit in N; 0: no friction.",
        ),
        click.option("--force", type=float, help=FORCE_HELP),
        click.option(
            "--from",
            "start",
            type=float,
            default=FROM,
            show_default=True,
            help="First frequency over that of the first resonance.",
        ),
        click.option(
            "--to",
            "stop",
            type=float,
            default=TO,
            show_default=True,
            help="Last frequency over that of the first resonance.",
        ),
    )
)


@command()
@case_options
@click.option(
    "--at",
    type=float,
    help="One frequency only; also what runs beside its orbits settle to, of any period up to eight of the force's.",
)
@click.option(
    "--along",
    type=click.Choice(BRANCH_PARAMETERS),
    help="With --at: the symmetric orbits' branches over this parameter; frequency: for scenes of several absorbers or springs.",
)
@click.option(
    "--curve",
    type=click.Choice(list(CURVES)),
    multiple=True,
    help="Its curve over two parameters; repeatable. `periodic curves` has the same with options of its own.",
)
@click.option(
    "--with",
    "second",
    type=click.Choice(list(PARAMETER_NAMES)),
    help="With --curve: the parameter beside the frequency.",
)
@click.option(
    "--over",
    type=float,
    nargs=2,
    metavar="LOW HIGH",
    help="Range of the parameter of --along or --with, SI units; frequencies over the first resonance's.",
)
@click.option(
    "--points",
    type=int,
    default=POINTS,
    show_default=True,
    help="Frequencies listed from the first to the last.",
)
@click.option(
    "--starts",
    type=int,
    default=DEFAULT_RUNS,
    show_default=True,
    help="Runs from random initial states at each frequency; 0: none.",
)
@click.option(
    "--seed", type=int, default=0, show_default=True, help="Of the random initial states."
)
@click.option("--symmetric", is_flag=True, help="Symmetric orbits only, which is quicker.")
@click.option(
    "--folds", is_flag=True, help="The folds of the branches at this force instead of orbits."
)
@click.option(
    "--thresholds",
    is_flag=True,
    help="The forces at which isolas are born and merge instead of orbits.",
)
@file_option(
    "--csv",
    "Write a row for each orbit, or point of a branch or curve (docs/frequency_domain.md#files).",
)
@file_option("--plot", "With --curve: draw it: .png, .pdf or .svg.")
@json_option("Write the list, in SI units.")
def main(**options: Any) -> None:
    """List exact periodic orbits of the impact absorber under a harmonic force, each confirmed by the exact method.

    It is on the paper's beam, or on another structure.

    Symmetric orbits with one impact a wall are found in closed form, with all reversals of friction, and along their branches. What leaves these
    where the symmetry breaks and periods double is followed too, and runs from random states add what they end on.

    Multipliers of symmetric orbits are those of half a period: +1 is a fold, -1 breaks the symmetry. Columns slow and fast: the largest of the pair
    that lives as long as the beam's vibration, and of all others. Held: friction or a wall holds the absorber for a while.

    With a --scene of two to four absorbers, or whose walls or friction are springs, orbits are those that runs from rest and from random states come
    to, of any kind; --along force or frequency follows their branches.

    --curve follows folds, broken symmetry, doubled periods or tori, from where branches have them, over the frequency and a second parameter.
    """
    with plain_errors():
        text, files, complete = run(options)
        click.echo(text)
        name_files(write_files(files))
    end_early(complete, "what was finished is shown.")
