"""Exact periodic orbits and their stability."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count, positive, require
from impact_env.parameters import (
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
)
from impact_env.periodic.basins import DEFAULT_RUNS, find_basins
from impact_env.periodic.bifurcation_curves import CURVE_KINDS, bifurcation_curves
from impact_env.periodic.branch import INTERRUPTED
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
from impact_env.plain import to_scene
from impact_env.plain_files import read_plain
from optimisation.absorber_rules import rigid_walls
from optimisation.bounds import design_force, design_gap
from optimisation.cli.common import (
    BadInput,
    check_targets,
    command,
    end_early,
    plain_errors,
    stop_on_interrupt,
    write_report,
)
from optimisation.cli.options import OptionSpec, name_parameter, option, switch
from optimisation.cli.scene_options import (
    DeviceOptions,
    is_option_set,
    mass_ratio_of,
    read_source_model,
    values_of,
)
from optimisation.executors import stages_bar
from optimisation.report.orbit_report import (
    CurveParameter,
    count_reasons,
    hybrid_table,
    make_branch_report,
    make_curve_report,
    make_fold_report,
    make_orbit_report,
    make_orbit_table_report,
    make_threshold_report,
)
from optimisation.report.report import Report

FORCE = 1.5  # N, the paper's moderate level of excitation
FORCE_TEXT = f"{FORCE}, with --structure or --scene by the design rule"
GAP_TEXT = f"{RigidWalls.gap}, with --structure and --force by the design rule"
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
CURVE_PARAMETERS = {
    "force": CurveParameter("force_N", "force in N"),
    "gap": CurveParameter("gap_m", "gap in mm", 1e3),
    "restitution": CurveParameter("restitution", "restitution"),
    "friction-limit": CurveParameter("friction_limit_N", "friction limit in N"),
    "mass-ratio": CurveParameter("mass_ratio", "mass ratio"),
    "damping": CurveParameter("damping_ratio", "damping ratio of the first mode"),
    "position": CurveParameter("absorber_position", "place of the absorber over the length"),
}
ShowProgress = Callable[[str, int, int], None]
Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CaseOptions(DeviceOptions):
    """Structure, absorber, force and range of frequencies; None: not given."""

    modes: int = option("modes", default=Beam.modes, usual=True)
    damping: float = option("damping", default=Beam.damping_ratio)
    mass_ratio: float = option("mass_ratio", usual=False)
    mass_kg: float | None = option("mass_kg")
    gap: float | None = option("gap", default=None, default_text=GAP_TEXT)
    restitution: float = option("restitution", usual=True)
    friction_limit: float = option("friction_limit", default=0.0)
    force: float | None = option("force", default_text=FORCE_TEXT)
    start: float = option("start", help="First frequency over the first resonance")
    stop: float = option("stop", help="Last frequency over the first resonance")

    @property
    def beam(self) -> Beam:
        """The beam that the options describe."""
        return Beam(modes=self.modes, damping_ratio=self.damping)


@dataclass(frozen=True, kw_only=True)
class OrbitOptions(CaseOptions):
    """Options of ``periodic orbits``; None: not given."""

    frequency: float | None = option(
        "frequency",
        help="One frequency only, over the first resonance",
        more="Lists also what runs settle to, of any period up to eight of the force's.",
    )
    over: tuple[str, float, float] | None = option(
        "over",
        help="Branches over a parameter, at --frequency; with --curve the second parameter",
        more=f"{', '.join(PARAMETER_NAMES)}; for scenes of several absorbers or springs force or "
        "frequency. SI units, frequencies over "
        "the first resonance.",
        type=click.Tuple([click.Choice(BRANCH_PARAMETERS), float, float]),
    )
    curve: tuple[str, ...] = option(
        OptionSpec(
            names=("--curve",),
            help="Curve of a bifurcation over two parameters; may be repeated",
            more=f"{', '.join(CURVES)}. `periodic curves` has the same with options of its own.",
            type=click.Choice(list(CURVES)),
            metavar="KIND",
            multiple=True,
        )
    )
    points: int = option("points", help="Number of frequencies", default=POINTS)
    starts: int = option("starts", default=DEFAULT_RUNS)
    seed: int = option("seed")
    symmetric: bool = option("symmetric", usual=True)
    folds: bool = option(
        switch(
            "--folds",
            "The folds of the branches at this force instead of orbits",
            more="`periodic folds` has the same.",
        )
    )
    thresholds: bool = option(
        switch(
            "--thresholds",
            "The forces at which isolas are born and merge instead of orbits",
            more="`periodic isola` has the same, with maps.",
        )
    )
    csv: Path | None = option(
        "csv", more="Of an orbit, branch or curve (docs/frequency_domain.md#files)."
    )
    plot: Path | None = option("plot", help="With --curve: draw it", usual=False)
    json: Path | None = option("json")

    @property
    def along(self) -> str | None:
        """Return the parameter over which branches are followed."""
        return None if self.over is None or self.curve else self.over[0]

    @property
    def parameter(self) -> str:
        """Return the parameter of --over."""
        assert self.over is not None
        return self.over[0]

    @property
    def limits(self) -> tuple[float, float]:
        """Return the range of the parameter of --over."""
        assert self.over is not None
        return self.over[1:]


def searched(
    case: Case,
    ratios: Array,
    symmetric: bool,
    show: ShowProgress,
    settle: bool = True,
    starts: int = DEFAULT_RUNS,
    seed: int = 0,
) -> Iterator[OrbitSearch]:
    """Yield the orbits at each ratio (M,) of the frequency.

    They are the symmetric orbits alone, or also the orbits that branch off from them. With
    ``settle`` the orbits on which runs end are added.
    """
    if symmetric:
        return orbits_over(case, ratios, lambda done, total: show("frequencies", done, total))
    return all_orbits_over(
        case, ratios, show, settle=settle and starts > 0, starts=starts, seed=seed
    )


def listed(
    case: Case, options: OrbitOptions, show: ShowProgress, complete: list[bool]
) -> list[OrbitSearch]:
    """Return the orbits at the requested frequencies.

    At a single frequency branches are taken from its neighbourhood, and the orbits on which runs
    end are added.
    """
    searches: list[OrbitSearch] = []
    with stop_on_interrupt(complete):
        if options.frequency is None:
            searches += searched(
                case,
                np.linspace(options.start, options.stop, options.points),
                options.symmetric,
                show,
                starts=options.starts,
                seed=options.seed,
            )
            return searches
        around(case, options, show, searches)
        here = searches[0]
        for settled in () if options.symmetric else attractors(here.case, here.orbits):
            if isinstance(settled, NoOrbit):
                searches[0] = replace(searches[0], refused=(*searches[0].refused, settled))
            else:
                searches[0] = replace(
                    searches[0], orbits=tuple(drop_repeated([*searches[0].orbits, settled]))
                )
        if not options.symmetric and options.starts > 0:
            draw(searches, options, show)
    return searches


def draw(searches: list[OrbitSearch], options: OrbitOptions, show: ShowProgress) -> None:
    """Add what runs from random initial states end on at the single frequency asked for."""
    here = searches[0]
    basins = find_basins(
        here.case,
        here.orbits,
        options.starts,
        seed=options.seed,
        progress=lambda done, total: show("random starts", done, total),
    )
    orbits = tuple(drop_repeated([*here.orbits, *basins.orbits]))
    searches[0] = replace(here, orbits=orbits, basins=basins)


def around(
    case: Case, options: OrbitOptions, show: ShowProgress, searches: list[OrbitSearch]
) -> None:
    """Add the orbits at the single requested frequency to ``searches``, even after Ctrl-C.

    The neighbouring frequencies are computed too, because branches begin there.
    """
    at = options.frequency
    assert at is not None
    groups = list[OrbitSearch]()
    low = max(options.start, at - RANGE)
    high = min(options.stop, at + RANGE)
    try:
        groups += searched(
            case,
            np.union1d(np.linspace(low, high, AROUND), [at]),
            options.symmetric,
            show,
            settle=False,
        )
    finally:
        searches += [group for group in groups if abs(group.case.omega_ratio - at) < 1e-12]


def along(case: Case, options: OrbitOptions, show: ShowProgress) -> Iterator[ResponseCurve]:
    """Yield the branches over another parameter of the symmetric orbits at one frequency.

    Each branch is yielded once.
    """
    name = PARAMETER_NAMES[options.parameter]
    known = list[Array]()
    assert options.frequency is not None
    at = case.changed(omega=options.frequency * case.omega)
    low, high = options.limits
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


def two_parameters(
    case: Case, options: OrbitOptions, show: ShowProgress, complete: list[bool]
) -> Iterator[dict[str, Any]]:
    """Yield the plain forms of curves of bifurcations over two parameters.

    The curves start at the bifurcations of the branches over the frequency. The parameters are the
    frequency and a second one.
    """
    first = case.omega
    name = PARAMETER_NAMES[options.parameter]
    limits = (options.start * first, options.stop * first)

    def show_points(what: str, points: int, _value: float) -> None:
        show(f"{what}, points", points, 0)

    with stop_on_interrupt(complete):
        branches = list(orbit_branches(case, *limits, progress=show_points))
        branches += (
            ()
            if options.symmetric
            else [
                searches
                for searches in descendants(branches, limits)
                if isinstance(searches, OrbitBranch)
            ]
        )
        if any(branch.branch.ended == INTERRUPTED for branch in branches):
            raise KeyboardInterrupt
        for curve in bifurcation_curves(
            branches,
            [CURVES[kind] for kind in options.curve],
            name,
            options.limits,
            limits,
            show_points,
        ):
            complete[0] &= curve.branch.ended != INTERRUPTED
            yield curve.to_plain()


class OrbitResults(NamedTuple):
    """What a call prints and writes, and whether the work came to its end."""

    report: Report
    complete: bool


def bifurcations(case: Case, options: OrbitOptions) -> OrbitResults:
    """Return the curves of bifurcations over two parameters."""
    complete = [True]
    parameter = CURVE_PARAMETERS[options.parameter]
    with stages_bar("orbits", leave=False) as show:
        curves = list(two_parameters(case, options, show, complete))
    force = "" if options.parameter == "force" else f", {case.force:g} N"
    report = make_curve_report(curves, f"{case.scene}{force}", parameter)
    return OrbitResults(report, complete[0])


def check(options: OrbitOptions) -> OrbitOptions:
    """Return the options with a range that holds the single frequency, if no range is given.

    Raises BadInput or ParameterError, before any work is done, if options do not go together or a
    file cannot be written.
    """
    at = options.frequency
    if at is not None and positive("--frequency", at):
        if not is_option_set("start"):
            options = replace(options, start=min(options.start, max(at - RANGE, at / 2)))
        if not is_option_set("stop"):
            options = replace(options, stop=max(options.stop, at + RANGE))
    if options.folds and options.thresholds:
        raise BadInput("--folds does not go with --thresholds: the JSON file has one list")
    if options.curve:
        if options.over is None or at is not None or options.folds or options.thresholds:
            raise BadInput(
                "--curve goes with --over, a second parameter and its range, and not with "
                "--frequency, --folds or --thresholds"
            )
        if options.parameter == "frequency":
            raise BadInput("--over frequency does not go with --curve: it is the first parameter")
        if options.parameter == "friction-limit" and not options.limits[0] > 0:
            allowed = (
                "friction limits above 0, as without friction the order of events is another one"
            )
            raise BadInput(f"--over = {options.limits} is not allowed: {allowed}")
    elif options.plot is not None:
        raise BadInput("--plot goes with --curve: it draws curves over two parameters")
    elif options.over is not None and at is None:
        raise BadInput(
            "--over goes with --frequency: branches begin at its orbits; with --curve it is "
            "the second parameter"
        )
    if options.over is not None:
        low, high = options.limits
        require(low < high, "--over", options.limits, "two numbers, the lower one first")
    if at is not None and (options.folds or options.thresholds):
        raise BadInput(
            "--frequency does not go with --folds or --thresholds: they are sought from "
            "--from to --to"
        )
    if not 0 < options.start < options.stop:
        raise BadInput(
            f"--from = {options.start} is not allowed: a ratio above 0 and below --to = "
            f"{options.stop}"
        )
    if at is not None and not options.start <= at <= options.stop:
        raise BadInput(
            f"--frequency = {at} is not allowed: a ratio from --from = {options.start} to "
            f"--to = {options.stop}"
        )
    check_targets(vars(options), ".json", ".gz")
    return replace(
        options,
        points=count("points", options.points, 2),
        starts=count("starts", options.starts, 0),
        seed=count("seed", options.seed, 0),
    )


def case_of(options: CaseOptions) -> Case:
    """Return structure and absorber at the first resonance.

    On a structure from a file the design rule gives force or gap, whichever is not given.
    """
    gap = options.gap
    restitution = options.restitution
    friction_limit = options.friction_limit
    model, device = read_source_model(options)
    if device is None:
        ratio = mass_ratio_of(options.mass_ratio, options.mass_kg, model.beam_mass)
    else:
        ratio = device.mass_ratio
        gap = rigid_walls(device).gap
        restitution, friction_limit = values_of(device)
    force = options.force
    ratio = positive("mass_ratio", ratio)
    if gap is None:
        gap = (
            RigidWalls.gap
            if options.structure is None or force is None
            else design_gap(model, ratio * model.beam_mass, force)
        )
    if force is None:
        force = (
            FORCE
            if options.structure is None and options.scene is None
            else design_force(model, ratio * model.beam_mass, positive("gap", gap))
        )
    return Case(
        model,
        float(model.omega[0]),
        force,
        gap,
        restitution,
        friction_limit,
        ratio,
    )


def hybrid_case_of(options: OrbitOptions) -> HybridCase | None:
    """Return the case of a scene with several absorbers or springs at the given frequency.

    The result is None for any other scene.

    Raises BadInput for options that only other scenes have.
    """
    if options.scene is None or options.structure is not None:
        return None  # `case_of` refuses both together
    scene = to_scene(read_plain(options.scene), options.scene.parent)
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
    if options.curve or options.folds or options.thresholds:
        raise BadInput(
            f"curves and folds are of one absorber with rigid walls, not of {what}: periodic "
            "orbits --frequency finds orbits of these"
        )
    if options.frequency is None:
        raise BadInput(f"--frequency is required for a scene of {what}")
    if options.along not in (None, "force", "frequency"):
        raise BadInput(f"--over {options.along}: force or frequency for a scene of {what}")
    force = FORCE if options.force is None else options.force
    return HybridCase(scene, options.frequency * float(scene.model.omega[0]), force)


def hybrid_orbits(case: HybridCase, options: OrbitOptions) -> OrbitResults:
    """Return the orbits of a scene with several absorbers or springs, or their branches.

    The orbits are those that runs converge to.
    """
    complete = [True]
    results: list[HybridOrbit | NoHybridOrbit] = []
    branches: list[HybridBranch] = []
    with stages_bar("orbits", leave=False) as show, stop_on_interrupt(complete):
        for result in find_hybrid_orbits(case, options.starts, options.seed):
            results.append(result)
            show("runs", len(results), 0)
        for orbit in results if options.along else ():
            if isinstance(orbit, HybridOrbit) and not any(
                is_on_branch(orbit, branch) for branch in branches
            ):
                branches.append(follow_hybrid_branch(orbit, options, show))
    orbits = [result for result in results if isinstance(result, HybridOrbit)]
    refused = [result.reason for result in results if isinstance(result, NoHybridOrbit)]
    notes = count_reasons(refused, "runs lead to")
    if not options.along:
        stable = sum(orbit.stable for orbit in orbits)
        lines = [f"{len(orbits)} orbits, {stable} of them stable.", *notes]
        plain = [plain_hybrid_orbit(orbit) for orbit in orbits]
        report = make_orbit_table_report("Periodic orbits", [[hybrid_table(orbits)], lines], plain)
        return OrbitResults(report, complete[0])
    over_force = options.along == "force"
    key = "force_N" if over_force else "omega_ratio"
    reference = 1.0 if over_force else float(case.scene.model.omega[0])
    curves = [branch.curve(reference) for branch in branches]
    ends = [f"Branch {number}: {curve.message}." for number, curve in enumerate(curves, 1)]
    shared = {"omega_ratio": options.frequency} if over_force else {}
    report = make_branch_report(curves, key, shared, [*ends, *notes])
    return OrbitResults(report, complete[0])


def follow_hybrid_branch(
    orbit: HybridOrbit, options: OrbitOptions, show: ShowProgress
) -> HybridBranch:
    """Return the branch through an orbit over the parameter and range asked for."""
    low, high = options.limits
    name = "force"
    if options.along == "frequency":
        name = "omega"
        first = float(orbit.case.scene.model.omega[0])
        low, high = (low * first, high * first)
    return hybrid_branch(
        orbit, name, (low, high), progress=lambda points, _: show("points of a branch", points, 0)
    )


def is_on_branch(orbit: HybridOrbit, branch: HybridBranch) -> bool:
    """Return whether an orbit lies on a branch.

    It does if the branch has the same level, period and symmetry at the orbit's parameter value. A
    mirror image counts as the same orbit.
    """
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


def run(options: OrbitOptions) -> OrbitResults:
    """Do what the options ask for."""
    options = check(options)
    hybrid = hybrid_case_of(options)
    if hybrid is not None:
        return hybrid_orbits(hybrid, options)
    if options.along == "frequency":
        raise BadInput(
            "--over frequency is for scenes of several absorbers or springs; others have "
            "--from and --to"
        )
    case = case_of(options)
    if options.curve:
        low, high = options.limits
        name = PARAMETER_NAMES[options.parameter]
        own = getattr(case, name)
        for limit in (low, high):
            case.changed(**{name: limit})  # raises where it is not allowed
        require(
            low <= own <= high,
            "--over",
            options.limits,
            f"a range around {own:g}, where the curves begin",
        )
    with validation_alongside(case):
        return compute_results(case, options)


def compute_results(case: Case, options: OrbitOptions) -> OrbitResults:
    """Return folds, thresholds or orbits, as `run`."""
    low = options.start
    high = options.stop
    if options.curve:
        return bifurcations(case, options)
    if options.thresholds:
        return OrbitResults(make_threshold_report(find_thresholds(case, low, high)), True)
    if options.folds:
        return OrbitResults(make_fold_report(find_folds(case, low, high)), True)
    if options.along is not None:
        with stages_bar("orbits", leave=False) as show:
            curves = list(along(case, options, show))
        shared = {"omega_ratio": options.frequency}
        key = CURVE_PARAMETERS[options.parameter].key
        return OrbitResults(make_branch_report(curves, key, shared), True)
    complete = [True]
    with stages_bar("orbits", leave=False) as show:
        searches = listed(case, options, show, complete)
    return OrbitResults(make_orbit_report(searches), complete[0])


@command(
    OrbitOptions,
    examples=(
        "periodic orbits --modes 3 --frequency 0.95 --symmetric",
        "periodic orbits --modes 2 --frequency 0.95 --over force 1 6",
    ),
    rewrite=name_parameter,
)
def main(options: OrbitOptions) -> None:
    """List exact periodic orbits of the impact absorber under a harmonic force.

    The exact method confirms each orbit of the absorber.

    The structure is the paper's beam or another one.

    Symmetric orbits with one impact a wall are found in closed form, with all reversals of
    friction, and along their branches. What leaves these where the symmetry breaks and periods
    double is followed too, and runs from random states add what they end on.

    Multipliers of symmetric orbits are those of half a period: +1 is a fold, -1 breaks the
    symmetry. Columns slow and fast: the largest of the pair that lives as long as the beam's
    vibration, and of all others. Held: friction or a wall holds the absorber for a while.

    With a --scene of two to four absorbers, or whose walls or friction are springs, orbits are
    those that runs from rest and from random states come to, of any kind; --over force or frequency
    follows their branches.

    --curve follows folds, broken symmetry, doubled periods or tori, from where branches have them,
    over the frequency and the parameter of --over.
    """
    with plain_errors():
        report, complete = run(options)
        write_report(report, options)
    end_early(complete, "what was finished is shown.")
