"""Exact periodic orbits with their stability, folds, births and mergers of isolas."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import click
import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls, count, positive, require
from impact_env.periodic.basins import DEFAULT_RUNS, find_basins
from impact_env.periodic.bifurcation_curves import CURVE_KINDS, bifurcation_curves
from impact_env.periodic.branch import INTERRUPTED
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
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
from impact_env.periodic.response_curve import ResponseCurve, orbit_curve
from impact_env.periodic.survey import (
    OrbitSearch,
    attractors,
    closed_form_orbits,
    drop_repeated,
    orbits_over,
)
from impact_env.periodic.validation import validation_alongside
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
from optimisation.gap_check import rigid_walls
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
ALONG = ("force", "gap", "restitution", "friction-limit")
CURVES = [kind.replace(" ", "-") for kind in CURVE_KINDS]
UNITS = {  # of each of these: its name in files, in figures, and the figure's unit
    "force": ("force_N", "force in N", 1.0),
    "gap": ("gap_m", "gap in mm", 1e3),
    "restitution": ("restitution", "restitution", 1.0),
    "friction-limit": ("friction_limit_N", "friction limit in N", 1.0),
}
Told = Callable[[str, int, int], None]
Array = NDArray[np.float64]


def searched(
    case: Case,
    ratios: Array,
    symmetric: bool,
    told: Told,
    settle: bool = True,
    starts: int = DEFAULT_RUNS,
    seed: int = 0,
) -> Iterator[OrbitSearch]:
    """Yield the orbits at each ratio (M,): the symmetric ones only, or also what leaves their branches and, with ``settle``, what runs end on."""
    if symmetric:
        return orbits_over(case, ratios, lambda done, total: told("frequencies", done, total))
    return all_orbits_over(
        case, ratios, told, settle=settle and starts > 0, starts=starts, seed=seed
    )


def listed(
    case: Case, given: dict[str, Any], told: Told, complete: list[bool]
) -> list[OrbitSearch]:
    """Orbits at the frequencies asked for. At a single one branches come from its neighbourhood, and runs add what they settle to."""
    found: list[OrbitSearch] = []
    with stop_on_interrupt(complete):
        if given["at"] is None:
            found += searched(
                case,
                np.linspace(given["start"], given["stop"], given["points"]),
                given["symmetric"],
                told,
                starts=given["starts"],
                seed=given["seed"],
            )
            return found
        around(case, given, told, found)
        here = found[0]
        for settled in () if given["symmetric"] else attractors(here.case, here.orbits):
            if isinstance(settled, NoOrbit):
                found[0] = replace(found[0], refused=(*found[0].refused, settled))
            else:
                found[0] = replace(
                    found[0], orbits=tuple(drop_repeated([*found[0].orbits, settled]))
                )
        if not given["symmetric"] and given["starts"] > 0:
            draw(found, given, told)
    return found


def draw(found: list[OrbitSearch], given: dict[str, Any], told: Told) -> None:
    """Add what runs from random initial states end on at the single frequency asked for."""
    here = found[0]
    basins = find_basins(
        here.case,
        here.orbits,
        given["starts"],
        seed=given["seed"],
        progress=lambda done, total: told("random starts", done, total),
    )
    orbits = tuple(drop_repeated([*here.orbits, *basins.orbits]))
    found[0] = replace(here, orbits=orbits, basins=basins)


def around(case: Case, given: dict[str, Any], told: Told, found: list[OrbitSearch]) -> None:
    """Add the orbits at the single frequency asked for to ``found``, even after Ctrl-C; its neighbours are where branches begin."""
    at = given["at"]
    groups = list[OrbitSearch]()
    low = max(given["start"], at - RANGE)
    high = min(given["stop"], at + RANGE)
    try:
        groups += searched(
            case,
            np.union1d(np.linspace(low, high, AROUND), [at]),
            given["symmetric"],
            told,
            settle=False,
        )
    finally:
        found += [group for group in groups if abs(group.case.omega_ratio - at) < 1e-12]


def along(case: Case, given: dict[str, Any], told: Told) -> Iterator[ResponseCurve]:
    """Yield the branches of the symmetric orbits at one frequency over another parameter, each once."""
    name = given["along"].replace("-", "_")
    known = list[Array]()
    at = case.changed(omega=given["at"] * case.omega)
    low, high = given["over"]
    for orbit in closed_form_orbits(at).orbits:
        if any(lies_on(places, orbit.solution) for places in known):
            continue
        branch = orbit_branch(
            orbit.solution,
            name,
            (low, high),
            progress=lambda points, _value: told(f"branch {len(known) + 1}, points", points, 0),
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
    case: Case, given: dict[str, Any], told: Told, complete: list[bool]
) -> Iterator[dict[str, Any]]:
    """Yield the plain forms of the curves of bifurcations through the branches over the frequency, over that and a second parameter."""
    first = case.omega
    name = given["second"].replace("-", "_")
    limits = (given["start"] * first, given["stop"] * first)

    def show(what: str, points: int, _value: float) -> None:
        told(f"{what}, points", points, 0)

    with stop_on_interrupt(complete):
        branches = list(orbit_branches(case, *limits, progress=show))
        branches += (
            ()
            if given["symmetric"]
            else [
                found for found in descendants(branches, limits) if isinstance(found, OrbitBranch)
            ]
        )
        if any(branch.branch.ended == INTERRUPTED for branch in branches):
            raise KeyboardInterrupt
        for curve in bifurcation_curves(
            branches,
            [kind.replace("-", " ") for kind in given["curve"]],
            name,
            given["over"],
            limits,
            show,
        ):
            complete[0] &= curve.branch.ended != INTERRUPTED
            yield curve.to_plain()


class FoundOrbits(NamedTuple):
    """What a call prints, its ``files`` by their paths as `write_files` takes them, and whether the work came to its end."""

    text: str
    files: dict[Any, object]
    complete: bool


def bifurcations(case: Case, given: dict[str, Any]) -> FoundOrbits:
    """Return the curves of bifurcations over two parameters."""
    complete, (key, words, scale) = [True], UNITS[given["second"]]
    with stages_bar("orbits", leave=False) as told:
        curves = list(two_parameters(case, given, told, complete))
    force = "" if given["second"] == "force" else f", {case.force:g} N"
    rows = (
        [key if name == "value" else name for name in report.CURVE_COLUMNS],
        report.curve_rows(curves),
    )
    files = {
        given["json"]: curves,
        given["csv"]: rows,
        given["plot"]: lambda path: report.save_curves(
            path, curves, f"{case.scene}{force}", words, scale
        ),
    }
    return FoundOrbits(report.curve_text(curves, words, scale), files, complete[0])


def check(given: dict[str, Any]) -> None:
    """Raise BadInput or ParameterError, before any work is done, if options do not go together or a file cannot be written.

    The range's usual ends go with a single frequency beyond them.
    """
    if given["at"] is not None and positive("--at", given["at"]):
        if not is_option_set("start"):
            given["start"] = min(given["start"], max(given["at"] - RANGE, given["at"] / 2))
        if not is_option_set("stop"):
            given["stop"] = max(given["stop"], given["at"] + RANGE)
    if given["folds"] and given["thresholds"]:
        raise BadInput("--folds does not go with --thresholds: the JSON file has one list")
    if given["curve"]:
        if (
            given["second"] is None
            or given["over"] is None
            or any(given[name] for name in ("along", "at", "folds", "thresholds"))
        ):
            raise BadInput(
                "--curve goes with --with, a second parameter, and --over, its range, and not with --along, --at, --folds or --thresholds"
            )
        if given["second"] == "friction-limit" and not given["over"][0] > 0:
            allowed = (
                "friction limits above 0, as without friction the order of events is another one"
            )
            raise BadInput(f"--over = {given['over']} is not allowed: {allowed}")
    elif given["second"] is not None or given["csv"] is not None or given["plot"] is not None:
        raise BadInput(
            "--with, --csv and --plot go with --curve: they are about curves over two parameters"
        )
    elif (given["along"] is None) != (given["over"] is None) or (
        given["along"] is not None and given["at"] is None
    ):
        raise BadInput(
            "--along, --over and --at go together: a parameter, the range it is followed over, and the frequency"
        )
    if given["over"] is not None:
        low, high = given["over"]
        require(low < high, "--over", given["over"], "two numbers, the lower one first")
    if given["at"] is not None and (given["folds"] or given["thresholds"]):
        raise BadInput(
            "--at does not go with --folds or --thresholds: they are sought from --from to --to"
        )
    if not 0 < given["start"] < given["stop"]:
        raise BadInput(
            f"--from = {given['start']} is not allowed: a ratio above 0 and below --to = {given['stop']}"
        )
    if given["at"] is not None and not given["start"] <= given["at"] <= given["stop"]:
        raise BadInput(
            f"--at = {given['at']} is not allowed: a ratio from --from = {given['start']} to --to = {given['stop']}"
        )
    given["points"] = count("points", given["points"], 2)
    given["starts"] = count("starts", given["starts"], 0)
    given["seed"] = count("seed", given["seed"], 0)
    check_targets(given, ".json", ".gz")


def case_of(given: dict[str, Any]) -> Case:
    """Return structure and absorber at the first resonance; on a structure from a file force or gap, the one not given, is by the design rule."""
    refuse_with_structure(given["structure"], "modes", "damping")
    if given["scene"] is None:
        model = model_of(given["structure"], modes=given["modes"], damping_ratio=given["damping"])
    else:
        structure, device = read_device(
            given["scene"],
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
        given |= {
            "mass_ratio": device.mass_ratio,
            "gap": walls.gap,
            "restitution": walls.restitution,
        }
        given["friction_limit"] = 0.0 if device.friction is None else device.friction.limit
    force = given["force"]
    gap = given["gap"]
    ratio = positive("mass_ratio", given["mass_ratio"])
    if gap is None:
        gap = (
            RigidWalls.gap
            if given["structure"] is None or force is None
            else design_gap(model, ratio * model.beam_mass, force)
        )
    if force is None:
        force = (
            FORCE
            if given["structure"] is None and given["scene"] is None
            else design_force(model, ratio * model.beam_mass, positive("gap", gap))
        )
    return Case(
        model,
        float(model.omega[0]),
        force,
        gap,
        given["restitution"],
        given["friction_limit"],
        ratio,
    )


def run(given: dict[str, Any]) -> FoundOrbits:
    """Do what the options ask for."""
    check(given)
    case = case_of(given)
    if given["curve"]:
        (low, high), own = given["over"], getattr(case, given["second"].replace("-", "_"))
        require(
            low <= own <= high,
            "--over",
            given["over"],
            f"a range around {own:g}, where the curves begin",
        )
    with validation_alongside(case):
        return asked_for(case, given)


def asked_for(case: Case, given: dict[str, Any]) -> FoundOrbits:
    """Return folds, thresholds or orbits, as `run`."""
    low = given["start"]
    high = given["stop"]
    if given["curve"]:
        return bifurcations(case, given)
    if given["thresholds"]:
        levels = find_thresholds(case, low, high)
        confirmed = [level for level in levels if isinstance(level.orbit, Orbit)]
        plain = [
            {"kind": level.kind, "force_N": level.force, "omega_ratio": level.omega_ratio}
            for level in confirmed
        ]
        return FoundOrbits(report.threshold_text(levels), {given["json"]: plain}, True)
    if given["folds"]:
        located = find_folds(case, low, high)
        pairs = [(fold, fold.orbit) for fold in located if isinstance(fold.orbit, Orbit)]
        plain = [
            {
                "omega_ratio": fold.omega_ratio,
                "force_N": fold.force,
                "tip_max_m": orbit.motion.tip_max,
            }
            for fold, orbit in pairs
        ]
        return FoundOrbits(report.fold_text(located), {given["json"]: plain}, True)
    if given["along"] is not None:
        with stages_bar("orbits", leave=False) as told:
            curves = list(along(case, given, told))
        key = UNITS[given["along"]][0]
        plain = [
            {"omega_ratio": given["at"], **_renamed(curve.to_plain(), key)} for curve in curves
        ]
        return FoundOrbits(along_text(curves, key), {given["json"]: plain}, True)
    complete = [True]
    with stages_bar("orbits", leave=False) as told:
        found = listed(case, given, told, complete)
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
    return FoundOrbits("\n".join(lines), {given["json"]: plain}, complete[0])


@command()
@structure_option
@scene_option
@click.option(
    "--modes", type=int, default=Beam.modes, show_default=True, help="Number of modes kept."
)
@click.option(
    "--damping",
    type=float,
    default=Beam.damping_ratio,
    show_default=True,
    help="Modal damping ratio, the same for all modes.",
)
@click.option(
    "--mass-ratio",
    type=float,
    default=DEFAULT_MASS_RATIO,
    show_default=True,
    help="Absorber mass over beam mass.",
)
@click.option("--gap", type=float, help=GAP_HELP)
@click.option(
    "--restitution",
    type=float,
    default=RigidWalls.restitution,
    show_default=True,
    help="Coefficient of restitution, 0 to 1.",
)
@click.option(
    "--friction-limit",
    type=float,
    default=0.0,
    show_default=True,
    help="Friction limit in N; 0: no friction.",
)
@click.option("--force", type=float, help=FORCE_HELP)
@click.option(
    "--from",
    "start",
    type=float,
    default=FROM,
    show_default=True,
    help="First frequency over that of the first resonance.",
)
@click.option(
    "--to",
    "stop",
    type=float,
    default=TO,
    show_default=True,
    help="Last frequency over that of the first resonance.",
)
@click.option(
    "--at",
    type=float,
    help="One frequency only; also what runs beside its orbits settle to, of any period up to eight of the force's.",
)
@click.option(
    "--along",
    type=click.Choice(ALONG),
    help="With --at: the symmetric orbits' branches over this parameter.",
)
@click.option(
    "--curve",
    type=click.Choice(CURVES),
    multiple=True,
    help="Its curve over two parameters; repeatable.",
)
@click.option(
    "--with",
    "second",
    type=click.Choice(ALONG),
    help="With --curve: the parameter beside the frequency.",
)
@click.option(
    "--over",
    type=float,
    nargs=2,
    metavar="LOW HIGH",
    help="Range of the parameter of --along or --with, SI units.",
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
@file_option("--csv", "With --curve: write a row for each point.")
@file_option("--plot", "With --curve: draw it: .png, .pdf or .svg.")
@json_option("Write the list, in SI units.")
def main(**given: Any) -> None:
    """List exact periodic orbits of the impact absorber under a harmonic force, each confirmed by the exact method.

    It is on the paper's beam, or on another structure.

    Symmetric orbits with one impact a wall are found in closed form, with all reversals of friction, and along their branches. What leaves these
    where the symmetry breaks and XX
    Multipliers of symmetric orbits are those of half a period: +1 is a fold, -1 breaks the symmetry. Columns slow and fast: the largest of the pair
    that lives as long as the beam's vibration, and of all others. Held: friction or a wall holds the absorber for a while.

    --curve follows folds, broken symmetry, doubled periods or tori, from where branches have them, over the frequency and a second parameter.
    """
    with plain_errors():
        text, files, complete = run(given)
        click.echo(text)
        name_files(write_files(files))
    end_early(complete, "what was finished is shown.")
