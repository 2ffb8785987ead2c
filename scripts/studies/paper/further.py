"""Statements of the paper that need further runs.

They concern limits of the sweeps, the high branch, basins, perturbations, folds and sliding.

The parameters are those of the paper's figures in which the statements stand (high_low: three
modes, jump: two modes).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import binomtest

from impact_env import (
    Beam,
    Drive,
    InitialState,
    Record,
    Scene,
    beam_scene,
    constant_frequency,
    impact_absorber,
    linear_sweep,
    simulate,
)
from impact_env.drive import PAPER_LIMITS
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import tip_response
from impact_env.periodic.orbit import unpack_orbits
from impact_env.periodic.overview import exact_curves
from impact_env.periodic.stationary import ResponseKind, classify_run
from optimisation.files import markdown
from studies.paper import high_low, jump
from studies.paper.claim import (
    LITTLE,
    MAJORITY,
    MUCH,
    SAME,
    Claim,
    ClaimVerdict,
    format_range,
    format_spread,
    judge_cases,
    judge_interval,
    make_claim,
    range_within,
)
from studies.paper.curve import make_both_sweeps
from studies.paper.frame import (
    MM,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_band,
    draw_line,
    draw_unit_level,
    make_panels,
    measure_groups,
)
from studies.study import Array, Json, Steps, not_none

LABEL = "further"
GAP = high_low.GAP
WINDOW_PERIODS = 200  # periods of the force by which a run is classified
HIGH_PEAK = 1.05 * GAP  # m: in the high response at 1.5 N the largest displacements exceed the gap
LIMIT_SHARE = 0.005  # of the resonance: a first impact so close to a sweep's start belongs to it
BRANCH_FORCE = 3.0  # N
BRANCH_STEP = 0.005  # of the resonance: width of the stretches along the high branch
# periods of the force before and after a blow
BEFORE_BLOW = 500
AFTER_BLOW = 300.0
FOLD_TOL = 1e-6  # of a critical Floquet multiplier, which is one at a saddle node
SLIP_TOL = 1e-9  # of the largest relative velocity: below it the absorber sticks


# The measuring step.


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    groups: dict[str, Callable[[], object]] = {
        "limits": partial(measure_first_impacts, size.forces),
        "branch": partial(_branch, settings, size),
        "orbits": partial(_orbits, size),
        "folds": partial(_folds, size),
        "basin": partial(_basins, settings, size),
        "blows": partial(_blows, settings, size),
        "sliding": _sliding,
    }
    return measure_groups(groups, earlier)


def measure_first_impacts(forces: tuple[float, ...]) -> list[Json]:
    """Return the frequency ratio of the first impact of sweeps up and down.

    The model has ten modes and no losses in contact.
    """
    scene = beam_scene(Beam(), impact_absorber())
    rows: list[Json] = []
    for force in forces:
        row: Json = {"force_n": force}
        for name, sweep, start in zip(
            ("up", "down"), make_both_sweeps(scene), PAPER_LIMITS, strict=True
        ):
            response = simulate(scene, Drive(force, sweep), record=Record(events=True))
            times = response.recorded.impacts.time
            at = float(sweep.omega_at(times[0]) / sweep.reference) if len(times) else None
            row[name] = {"start": start, "first_impact": at}
        rows.append(row)
    return rows


def measure_peaks(lane: Lane) -> Array:
    """Return frequency ratio and largest |q_tip| of each pseudo period of a sweep.

    The displacements are in m, and the result has the shape (2, periods).
    """
    schedule = lane.drive.schedule
    history = simulate(
        lane.scene, lane.drive, record=Record(level=False, series=True)
    ).recorded.history
    first = np.flatnonzero(np.diff(np.floor(history.time / schedule.pseudo_period), prepend=-1))
    ratio = np.asarray(schedule.omega_at(history.time[first])) / schedule.reference
    return np.stack([ratio, np.maximum.reduceat(np.abs(history.tip_displacement), first)])


def _branch(settings: PaperSettings, size: Size) -> Json:
    """Return the largest displacements of sweeps and of orbits along the high branch.

    For sweeps it is the median of the periods' largest displacement in each frequency interval,
    (intervals, members).
    """
    scene = jump.make_scene()
    reference = scene.model.resonance_omega(1)
    curves = exact_curves(scene, BRANCH_FORCE, reference, *PAPER_LIMITS)
    high = max(curves, key=lambda curve: not_none(curve.peak).tip_max)
    upper = high.tip_max > 1.2 * GAP
    low_end, high_end = (float(edge(high.omega_ratio[upper])) for edge in (np.min, np.max))
    edges = np.arange(
        np.ceil(low_end / BRANCH_STEP) * BRANCH_STEP, high_end - 1e-9, BRANCH_STEP
    )  # stretches that lie on the branch
    middles = 0.5 * (edges[1:] + edges[:-1])
    order = np.argsort(high.omega_ratio[upper])
    orbit = np.interp(middles, high.omega_ratio[upper][order], high.tip_max[upper][order])
    schedule = linear_sweep(reference, PAPER_LIMITS[1], PAPER_LIMITS[0], 100 / jump.RATE)
    drives = draw_members(size.members, settings.seed).drives(BRANCH_FORCE, schedule)
    rows = []
    for ratio, peaks in settings.each(
        f"{LABEL}: branch", [Lane(scene, drive) for drive in drives], measure_peaks
    ):
        place = np.digitize(ratio, edges)
        rows.append([float(np.median(peaks[place == k])) for k in range(1, len(edges))])
    return {
        "omega_ratio": middles.tolist(),
        "orbit_m": orbit.tolist(),
        "sweep_m": np.array(rows).T.tolist(),
    }


def count_impacts_from(scene: Scene, force: float, orbit: Json, periods: int = 2) -> float:
    """Return the impacts per period of a simulated run that starts on an orbit.

    The orbit is an entry of `unpack_orbits`.
    """
    start = orbit["start"]
    state = InitialState(
        np.array(start["modal_displacement"]),
        np.array(start["modal_velocity"]),
        start["absorber_displacement_m"],
        start["absorber_velocity_m_s"],
    )
    drive = Drive(force, constant_frequency(orbit["omega_rad_s"], 1.0, periods), start["phase_rad"])
    response = simulate(scene, drive, initial=state, record=Record(events=True))
    return response.impact_count / periods


def _orbits(size: Size) -> Json:
    """Return impacts a period of runs that begin on the orbits of the high branch at 3 N."""
    scene = high_low.make_scene()
    reference = scene.model.resonance_omega(1)
    curves = exact_curves(scene, BRANCH_FORCE, reference, high_low.LOW, high_low.HIGH)
    high = max(curves, key=lambda curve: not_none(curve.peak).tip_max)
    upper = [one for one in unpack_orbits(not_none(high.orbits)) if one["tip_max_m"] > 1.2 * GAP]
    chosen = upper[:: max(1, len(upper) // size.orbits)]
    return {
        "omega_ratio": [one["omega_ratio"] for one in chosen],
        "impacts": [count_impacts_from(scene, BRANCH_FORCE, one) for one in chosen],
    }


def _folds(size: Size) -> list[Json]:
    """Return the critical Floquet multipliers at each fold of exact orbits at both forces.

    They are those over half a period.
    """
    scene = high_low.make_scene()
    reference = scene.model.resonance_omega(1)
    rows = []
    for force in size.fold_forces:
        for curve in exact_curves(scene, force, reference, high_low.LOW, high_low.FAR):
            rows += [
                {
                    "force_n": force,
                    "omega_ratio": fold.omega_ratio,
                    "tip_m": fold.tip_max,
                    "multipliers": [[m.real, m.imag] for m in fold.multipliers],
                }
                for fold in curve.folds
            ]
    return rows


def _draw_states(scene: Scene, omega: float, number: int, seed: int) -> list[tuple[Any, float]]:
    """Return random initial states and phases of the force.

    The first mode lies in the ellipse of its own resonance without absorber at the medium force,
    evenly; the absorber anywhere in its cavity.
    """
    most = (
        high_low.FORCES["medium"]
        * float(np.abs(tip_response(scene.model, None, np.array([omega])))[0])
        / abs(scene.model.tip_shape[0])
    )
    generator = np.random.default_rng([seed, 29])
    shape = np.eye(scene.model.modes)[0]
    result = []
    for area, angle, place, phase in generator.uniform(
        (0, 0, -1, 0), (1, 2 * np.pi, 1, 2 * np.pi), (number, 4)
    ):
        q = shape * most * np.sqrt(area) * np.cos(angle)
        v = shape * most * np.sqrt(area) * omega * np.sin(angle)
        tip = float(scene.model.tip_shape @ q)
        speed = float(scene.model.tip_shape @ v)
        result.append((InitialState(q, v, tip + GAP * float(place), speed), float(phase)))
    return result


def classify_from(lane: Lane) -> tuple[str, float]:
    """Return kind and size of the stationary motion of a lane with its own initial state.

    The size is the median of the periods' largest |q_tip| in m.
    """
    result = classify_run(lane.scene, lane.drive, WINDOW_PERIODS, initial=lane.initial)
    return result.classification.kind.value, float(np.median(result.peaks))


def _basins(settings: PaperSettings, size: Size) -> list[Json]:
    """Return how many runs from random states reach each kind of motion.

    They are counted at frequencies with competing motions and at the resonance.
    """
    scene = high_low.make_scene()
    omega = scene.model.resonance_omega(1)
    states = _draw_states(scene, omega, size.starts, settings.seed)
    rows = []
    for ratio in size.basin_ratios:
        lanes = [
            Lane(
                scene,
                Drive(
                    high_low.FORCES["medium"],
                    constant_frequency(ratio * omega, 1.0, size.settling),
                    phase,
                ),
                initial=state,
            )
            for state, phase in states
        ]
        result = settings.each(f"{LABEL}: basin at {ratio:g}", lanes, classify_from)
        kinds = [name_motion(kind, peak) for kind, peak in result]
        rows.append({"omega_ratio": ratio, "kinds": {kind: kinds.count(kind) for kind in MOTIONS}})
    return rows


SLIDING = "sliding without impacts"
HIGH = "high response"
MODULATED = "strongly modulated"
OTHER = "other motion with impacts"
MOTIONS = (MODULATED, SLIDING, HIGH, OTHER)


def name_motion(kind: str, peak: float) -> str:
    """Return the name of a motion, one of `MOTIONS`.

    It follows from the kind of response and the median of its periods' largest |q_tip| in m.
    """
    if kind == ResponseKind.LINEAR.value:
        return SLIDING
    if kind == ResponseKind.MODULATED.value:
        return MODULATED
    return HIGH if peak > HIGH_PEAK else OTHER


def make_blow(scene: Scene, ratio: float, phase: float, size: float, carried: bool) -> Lane:
    """Return the lane of a sliding response after a blow.

    The response is that at the medium force, and the blow acts at a ``phase`` (rad) of the force.

    The blow adds ``size`` times the first mode's velocity amplitude to its velocity. ``carried``:
    the absorber's velocity changes with the tip's.
    """
    omega = ratio * scene.model.resonance_omega(1)
    force = high_low.FORCES["medium"]
    settling = constant_frequency(omega, 1.0, BEFORE_BLOW + phase / (2 * np.pi))
    steady = simulate(scene, Drive(force, settling), record=Record(events=True)).final_state
    q = np.asarray(steady.modal_displacement)
    v = np.asarray(steady.modal_velocity)
    added = np.zeros(scene.model.modes)
    added[0] = size * float(np.hypot(q[0], v[0] / omega)) * omega
    push = float(scene.model.tip_shape @ added) if carried else 0.0
    place = float(np.asarray(steady.absorber_displacement))
    speed = float(np.asarray(steady.absorber_velocity))
    state = InitialState(q, v + added, place, speed + push)
    drive = Drive(force, constant_frequency(omega, 1.0, AFTER_BLOW), phase)
    return Lane(scene, drive, initial=state)


def _blows(settings: PaperSettings, size: Size) -> list[Json]:
    """Return how many runs have impacts in the end after a blow.

    Rows are for numbers of modes, the bodies that are struck, frequencies and sizes of the blow.
    """
    phases = 2 * np.pi * np.arange(size.phases) / size.phases
    rows = []
    for scene in (jump.make_scene(), high_low.make_scene()):
        for struck, carried in (("beam", False), ("beam and absorber", True)):
            for ratio in size.blow_ratios:
                for blow in size.blows:
                    lanes = [
                        make_blow(scene, ratio, float(phase), blow, carried) for phase in phases
                    ]
                    result = settings.each(f"{LABEL}: blows", lanes, classify_from)
                    impacting = sum(name_motion(kind, peak) != SLIDING for kind, peak in result)
                    rows.append(
                        {
                            "modes": scene.model.modes,
                            "struck": struck,
                            "omega_ratio": ratio,
                            "blow": blow,
                            "runs": len(lanes),
                            "impacting": impacting,
                        }
                    )
    return rows


def _sliding() -> Json:
    """Return how long the absorber slides before the first impact of a sweep.

    The sweep is that up at 1.5 N. The result is the share of the time before the first impact, and
    the frequency ratio of this impact.
    """
    scene = high_low.make_scene()
    omega = scene.model.resonance_omega(1)
    drive = Drive(high_low.FORCES["medium"], make_both_sweeps(scene)[0])
    response = simulate(scene, drive, record=Record(level=False, events=True, series=True))
    history = response.recorded.history
    first = float(response.recorded.impacts.time[0])
    before = history.time < first
    relative = np.abs(history.absorber_velocity - history.tip_velocity)[before]
    acceleration = high_low.FRICTION / not_none(scene.absorber_mass)
    return {
        "share": float(np.mean(relative > SLIP_TOL * relative.max())),
        "first_impact_ratio": float(drive.schedule.omega_at(first) / omega),
        "slip_tip_m": acceleration / omega**2,
        "gap_m": GAP,
    }


# What the page says.


def _describe(values: Json) -> str:
    limits = [
        (
            f"{row['force_n']:g}",
            *(_format_ratio(row[way]["first_impact"]) for way in ("up", "down")),
        )
        for row in values["limits"]
    ]
    branch = values["branch"]
    ratios = np.array(branch["sweep_m"]) / np.array(branch["orbit_m"])[:, None]
    along = [
        (f"{ratio:.4f}", f"{MM * height:.3f}", format_spread(row))
        for ratio, height, row in zip(branch["omega_ratio"], branch["orbit_m"], ratios, strict=True)
    ]
    basins = [
        (f"{row['omega_ratio']:g}", *(f"{row['kinds'][kind]}" for kind in MOTIONS))
        for row in values["basin"]
    ]
    sizes = list(dict.fromkeys(row["blow"] for row in values["blows"]))
    blows = [
        (
            f"{modes} modes, {struck} struck, {ratio:g}",
            *(f"{row['impacting']} of {row['runs']}" for row in rows),
        )
        for (modes, struck, ratio), rows in _group_blows(values).items()
    ]
    tables = [
        markdown(("force, N", "first impact, sweep up", "sweep down"), limits),
        markdown(
            (
                "frequency ratio, 3 N",
                "highest orbit, mm",
                "largest displacement in a period over it",
            ),
            along,
        ),
        markdown(("frequency ratio, 1.5 N, random starts", *MOTIONS), basins),
        markdown(
            (
                "runs with impacts after a blow (over the velocity amplitude)",
                *(f"{size:g}" for size in sizes),
            ),
            blows,
        ),
    ]
    return "\n\n".join(tables)


def _format_ratio(ratio: float | None) -> str:
    return "none" if ratio is None else f"{ratio:.4f}"


def _group_blows(values: Json) -> dict[tuple[int, str, float], list[Json]]:
    groups: dict[tuple[int, str, float], list[Json]] = {}
    for row in values["blows"]:
        groups.setdefault((row["modes"], row["struck"], row["omega_ratio"]), []).append(row)
    return groups


judge = partial(make_claim, LABEL)


def _claims(values: Json) -> list[Claim]:
    """Return the statements that these runs decide."""
    branch = values["branch"]
    ratios = np.array(branch["sweep_m"]) / np.array(branch["orbit_m"])[:, None]
    orbits = values["orbits"]
    middles = np.median(ratios, axis=1)
    return [
        _judge_limits(values["limits"]),
        judge(
            "branch",
            ratios.ravel(),
            least=branch["omega_ratio"][0],
            most=branch["omega_ratio"][-1],
            low=format_range(middles, "{:.2f}"),
        ),
        judge("orbits", orbits["impacts"], number=len(orbits["impacts"])),
        _judge_folds(values["folds"]),
        _judge_basins(values["basin"]),
        _judge_blows(values),
        _judge_sliding(values["sliding"]),
    ]


def _judge_limits(rows: list[Json]) -> Claim:
    """Judge each sweep by whether its first impact is apart from its start."""
    cases = []
    early = []
    for row in rows:
        for way in ("up", "down"):
            at = row[way]["first_impact"]
            apart = at is None or abs(at - row[way]["start"]) > LIMIT_SHARE
            cases.append(ClaimVerdict.HOLDS if apart else ClaimVerdict.NOT)
            if not apart:
                early.append(row["force_n"])
    scene = beam_scene(Beam(), None)
    omega = scene.model.resonance_omega(1)
    stationary = min(
        GAP / float(np.abs(tip_response(scene.model, None, ratio * omega)))
        for ratio in PAPER_LIMITS
    )
    linear = [row["force_n"] for row in rows if row["force_n"] < min(early, default=np.inf)]
    return judge(
        "limits",
        judge_cases(cases),
        stationary=stationary,
        linear=max(linear, default=0.0),
        early=min(early, default=0.0),
        near=LIMIT_SHARE,
        apart=cases.count(ClaimVerdict.HOLDS),
        number=len(cases),
    )


def _judge_folds(rows: list[Json]) -> Claim:
    """Judge each turning point by its multipliers.

    The statement holds if only one multiplier is critical and it is close to 1.
    """
    cases = []
    distances = []
    for row in rows:
        distances += [abs(complex(*multiplier) - 1) for multiplier in row["multipliers"]]
        single = len(row["multipliers"]) == 1
        saddle_node = single and distances[-1] < FOLD_TOL
        cases.append(ClaimVerdict.HOLDS if saddle_node else ClaimVerdict.NOT)
    return judge(
        "folds",
        judge_cases(cases),
        number=len(rows),
        off=max(distances, default=np.nan),
        where=", ".join(f"{row['omega_ratio']:.5f} at {row['force_n']:g} N" for row in rows),
    )


def _judge_basins(rows: list[Json]) -> Claim:
    """Judge the share of modulated runs where the sliding response competes.

    At each such frequency the interval of the share is compared with the statement.
    """
    below_resonance = [row for row in rows if row["omega_ratio"] < 1]
    cases = []
    texts = []
    for row in below_resonance:
        runs = sum(row["kinds"].values())
        ended = row["kinds"][MODULATED]
        wilson = binomtest(ended, runs).proportion_ci(method="wilson")
        cases.append(judge_interval(wilson.low, wilson.high, MAJORITY, 1.0))
        texts.append(f"{ended} of {runs} at {row['omega_ratio']:g}")
    return judge("basin", judge_cases(cases), each=", ".join(texts))


def _judge_blows(values: Json) -> Claim:
    """Judge each case by the smallest blow that triggers impacts.

    The statement holds if this blow is larger than a slight one.
    """
    least = {
        case: min((row["blow"] for row in rows if row["impacting"]), default=np.inf)
        for case, rows in _group_blows(values).items()
    }
    cases = [ClaimVerdict.HOLDS if blow > LITTLE else ClaimVerdict.NOT for blow in least.values()]
    by_struck = {
        struck: min(blow for (_, own, _), blow in least.items() if own == struck)
        for _, struck, _ in least
    }
    return judge(
        "perturbation",
        judge_cases(cases),
        beam=by_struck["beam"],
        both=by_struck["beam and absorber"],
    )


def _judge_sliding(own: Json) -> Claim:
    begin = own["slip_tip_m"] / own["gap_m"]
    cases = [
        judge_interval(own["share"], own["share"], MAJORITY, 1.0),
        judge_interval(begin, begin, 0.0, MUCH),
    ]
    return judge(
        "mainly sliding",
        judge_cases(cases),
        share=own["share"],
        begin=begin,
        at=own["first_impact_ratio"],
    )


# The drawing step.


def _draw(values: Json) -> Figure:
    """Draw first impacts, the high branch and the blows.

    The panels show first impacts over the force, sweeps over the orbits of the high branch, and the
    share of runs with impacts over the size of a blow.
    """
    figure, grid = make_panels(1, 3, 2.9)
    _draw_limits(grid[0, 0], values["limits"])
    _draw_branch(grid[0, 1], values["branch"])
    _draw_blows(grid[0, 2], values)
    return figure


def _draw_limits(axes: Axes, rows: list[Json]) -> None:
    forces = [row["force_n"] for row in rows]
    for way, style in (("up", STYLES[0]), ("down", STYLES[1])):
        at = [row[way]["first_impact"] for row in rows]
        draw_line(axes, forces, np.array(at, dtype=float), style, f"sweep {way}")
        axes.axhline(rows[0][way]["start"], color=style.colour, ls=":", lw=0.9)
    axes.set(
        xlabel="amplitude of the force in N",
        ylabel=r"first impact at $\Omega/\omega_1$",
        ylim=(0.88, 1.08),
    )
    axes.legend(loc="center right")


def _draw_branch(axes: Axes, branch: Json) -> None:
    ratios = np.array(branch["sweep_m"]) / np.array(branch["orbit_m"])[:, None]
    draw_band(axes, branch["omega_ratio"], ratios, STYLES[0])
    draw_unit_level(axes)
    axes.axhspan(*range_within(SAME), color="0.85", lw=0, zorder=0, label="5 % either way")
    axes.set(
        xlabel=r"frequency $\Omega/\omega_1$, 3 N, down",
        ylabel="largest displacement over the orbit's",
        ylim=(0.7, 1.25),
    )
    axes.legend(loc="upper left")


def _draw_blows(axes: Axes, values: Json) -> None:
    ratio = max(row["omega_ratio"] for row in values["blows"])
    drawn = {case: rows for case, rows in _group_blows(values).items() if case[2] == ratio}
    for style, ((modes, struck, _), rows) in zip(STYLES, drawn.items(), strict=False):
        share = [row["impacting"] / row["runs"] for row in rows]
        label = f"{'both' if 'absorber' in struck else 'beam'}, {modes} modes"
        draw_line(axes, [row["blow"] for row in rows], share, style, label)
    axes.axvline(LITTLE, color="0.55", lw=0.8, ls=":")
    axes.set(
        xscale="log",
        xticks=(0.1, 1),
        xticklabels=("0.1", "1"),
        ylim=(-0.03, 1.75),
        yticks=(0, 0.5, 1),
        xlabel="blow over the velocity amplitude",
        ylabel=f"share with impacts at {ratio:g}",
    )
    axes.legend(loc="upper left", title="struck:")


FIGURE = PaperFigure(
    LABEL,
    "limits of the sweeps, the high branch, and blows beside the isola",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=_claims,
    # random starts and their pseudo periods before the window; blows over the velocity amplitude,
    # each at so many phases
    sizes=(
        Size(
            forces=(1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 7.0, 10.0),
            members=16,
            orbits=24,
            fold_forces=(1.5, 3.0),
            basin_ratios=(0.96, 0.97, 0.98, 1.0),
            starts=100,
            settling=300.0,
            blow_ratios=(0.94, 0.95),
            blows=(0.05, 0.1, 0.15, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0),
            phases=16,
        ),
        Size(
            forces=(1.5, 3.0, 5.0),
            members=2,
            orbits=3,
            fold_forces=(1.5,),
            basin_ratios=(0.97, 1.0),
            starts=4,
            settling=100.0,
            blow_ratios=(0.95,),
            blows=(0.1, 1.0, 3.0),
            phases=2,
        ),
    ),
)
