"""The paper's statements on the linear structure and on the method.

They concern beam, tuned absorber, sweeps, window, step, scaling and the damper. Most of them follow
from the linear structure alone.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import bootstrap, norm

from impact_env import (
    Beam,
    RigidWalls,
    Scene,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
    impact_absorber,
    modal_model,
    simulate,
)
from impact_env.controlled import ControlledRuns
from impact_env.curve import BAND, CurveCase, quantiles
from impact_env.drive import PAPER_LIMITS, PAPER_RATE, Drive, linear_sweep
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import natural_frequencies, poles, tip_response
from impact_env.level import HALF_WINDOW_PERIODS, response_level
from impact_env.methods import PAPER_STEPS, Exact, Method, Moreau
from impact_env.periodic.harmonic_balance import PAPER_DAMPER
from impact_env.periodic.residence import Approach, passage_schedule
from impact_env.results import DEFAULT_SAMPLES, Record
from optimisation.bounds import design_force
from optimisation.files import markdown
from optimisation.sweep_range import sweep_ratio
from optimisation.tuned import (
    PAPER,
    den_hartog,
    highest_amplitude,
    minimax,
    paper_rule,
    peak,
    peaks,
)
from studies.paper import high_low, jump
from studies.paper.claim import (
    SAME,
    Claim,
    ClaimVerdict,
    find_extent,
    format_interval,
    judge_cases,
    judge_interval,
    make_claim,
    range_within,
)
from studies.paper.curve import FULL_RECORD, compute_level_value, make_both_sweeps
from studies.paper.frame import (
    MM,
    REFERENCE,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_legends,
    draw_line,
    draw_signal,
    make_panels,
    measure_groups,
)
from studies.study import Array, Json, Steps, not_none

GAP = RigidWalls.gap
FIRST = 12  # impacts after which rounding has not yet grown
# a pseudo period of a run with the damper that the paper's harmonic balance has between absorber
# and ground (section 2.5)
PIECES = 4
SAMPLES = 32
DAMPERS = {"without": 0.0, "with": PAPER_DAMPER}  # N s/m
METHODS: dict[str, Method] = {"exact": Exact(), "paper's step": Moreau()}


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    groups: dict[str, Callable[[], object]] = {
        "beam": compute_beam_numbers,
        "tuned": compute_tuned_numbers,
        "linear": compute_linear_numbers,
        "window": partial(_window, settings, size),
        "step": partial(_step, settings, size),
        "scaling": _scaling,
        "damper": lambda: {
            "jumps": _damped_jumps(settings, size.damped),
            "levels": _damped_levels(settings, size.damped // 4),
        },
    }
    return measure_groups(groups, earlier)


def compute_beam_numbers() -> Json:
    """Return numbers of the beam and of its modes.

    They are frequencies, masses, the node where the force acts, the static stiffness of all modes,
    and the share of a mode's energy that is left after half a period.
    """
    beam = Beam()
    model = modal_model(beam)
    whole = modal_model(Beam(modes=beam.freedoms))
    damped = poles(modal_model(beam), None)
    ratios = model.omega / model.omega[0]
    return {
        "omega_1": float(model.omega[0]),
        "ratios": ratios.tolist(),
        "absorber_kg": impact_absorber().mass_ratio * beam.mass,
        "beam_kg": beam.mass,
        "node": beam.force_position * beam.elements,
        "stiffness": beam.static_tip_stiffness,
        "stiffness_of_modes": float(1 / np.sum((whole.tip_shape / whole.omega) ** 2)),
        "stuck_ratio": float(natural_frequencies(model, StuckAbsorber())[0] / model.omega[0]),
        "span_periods": linear_sweep(1.0, 0.9935, 1.0065, PAPER_RATE).periods,
        "left_after_half_period": np.exp(-2 * model.damping_ratio * np.pi * ratios).tolist(),
        "lost_in_own_period": (1 - np.exp(4 * np.pi * damped.real / damped.imag)).tolist(),
    }


def compute_tuned_numbers() -> Json:
    """Return the tunings of the LTVA with their peaks relative to no absorber.

    The paper's tuning at the second resonance, and an undamped absorber at its own frequency, are
    also given.
    """
    model = modal_model(Beam())
    free = peak(model, None)[0]
    result = {}
    tunings = {
        "paper": PAPER,
        "modal mass of one": paper_rule(model),
        "Den Hartog": den_hartog(model),
        "smallest peak": minimax(model),
    }
    for name, absorber in tunings.items():
        heights = [height / free for height, _ in peaks(model, absorber)]
        swept = highest_amplitude(model, absorber, 1, *PAPER_LIMITS)[0] / free
        own = {
            "relative": max(heights),
            "at": peak(model, absorber)[1],
            "peaks": heights,
            "within_limits": swept,
        }
        result[name] = {"stiffness": absorber.stiffness, "damping": absorber.damping, **own}
    undamped = TunedAbsorber(PAPER.mass_ratio, PAPER.stiffness, 0.0)
    tuned_to = float(np.sqrt(PAPER.stiffness / (PAPER.mass_ratio * model.beam_mass)))
    second = [highest_amplitude(model, absorber, 2, *PAPER_LIMITS)[0] for absorber in (PAPER, None)]
    still, free_tip = (
        np.abs(tip_response(model, absorber, tuned_to)) for absorber in (undamped, None)
    )
    return {
        "tunings": result,
        "second_relative": second[0] / second[1],
        "undamped_relative": float(still / free_tip),
    }


def compute_linear_numbers() -> Json:
    """Return ratios of levels in linear response, and the forces that fill the gap.

    The ratios are those of swept over stationary levels, and of the levels with a stuck absorber
    over those without one. The forces are those at which the linear response equals the gap.
    """
    model = modal_model(Beam())
    low, high = PAPER_LIMITS
    result: Json = {
        "sweep_ratio": {},
        "stuck_over_none": {},
        "gap_force_n": {},
        "gap_force_at_limits_n": {},
        "design_force_n": {},
    }
    for resonance in (1, 2):
        name = str(resonance)
        omega = model.resonance_omega(resonance)
        scenes = (Scene(model, StuckAbsorber()), Scene(model, None))
        stuck, none = (
            max(
                compute_level_value(Lane(scene, Drive(1.0, sweep)))
                for sweep in make_both_sweeps(scene, resonance)
            )
            for scene in scenes
        )
        result["sweep_ratio"][name] = sweep_ratio(model, PAPER_RATE, resonance)
        result["stuck_over_none"][name] = stuck / none
        result["gap_force_n"][name] = GAP / highest_amplitude(model, None, resonance, low, high)[0]
        result["gap_force_at_limits_n"][name] = [
            float(GAP / np.abs(tip_response(model, None, ratio * omega))) for ratio in (low, high)
        ]
        result["design_force_n"][name] = design_force(
            model, PAPER.mass_ratio * model.beam_mass, GAP, resonance
        )
    return result


def compute_both_levels(lane: Lane) -> tuple[float, float]:
    """Return the level in m of a lane with the paper's window and with one twice as long."""
    record = FULL_RECORD if lane.scene.absorber is not None else Record(level=False, series=True)
    tip = simulate(lane.scene, lane.drive, record=record).recorded.history.tip_displacement
    one, two = (response_level(tip, DEFAULT_SAMPLES, k * HALF_WINDOW_PERIODS)[0] for k in (1, 2))
    return one, two


def _window(settings: PaperSettings, size: Size) -> list[Json]:
    """Return levels over those without absorber with both windows.

    They are for one, three and ten modes without losses in contact.
    """
    forces = size.forces
    members = draw_members(size.members, settings.seed)
    numbers = (1, 3, 10)
    scenes = [
        beam_scene(Beam(modes=n), absorber)
        for n in numbers
        for absorber in (impact_absorber(), None)
    ]
    lanes = [
        Lane(scene, drive)
        for scene in scenes
        for force in forces
        for sweep in make_both_sweeps(scene)
        for drive in members.drives(force, sweep)
    ]
    result = (
        np.array(settings.each("basics: window", lanes, compute_both_levels))
        .reshape(3, 2, len(forces), 2, len(members), 2)
        .max(axis=3)
    )
    rows = []
    for modes, (own, without) in zip(numbers, result, strict=True):
        for force, absorber, none in zip(forces, own, without, strict=True):
            shrinks = float(np.median(absorber[:, 1] / absorber[:, 0]))
            rows.append(
                {
                    "modes": modes,
                    "force": force,
                    "relative": np.median(absorber / none, axis=0).tolist(),
                    "shrinks": shrinks,
                }
            )
    return rows


def _step(settings: PaperSettings, size: Size) -> list[Json]:
    """Return levels by the Moreau scheme at the paper's step beside the exact ones."""
    cases = {
        "1 mode, e = 0.75": beam_scene(Beam(modes=1), impact_absorber(restitution=0.75)),
        "3 modes, e = 1, 0.01 N": beam_scene(Beam(modes=3), impact_absorber(friction_limit=0.01)),
        "10 modes, e = 0.7, 0.1 N": beam_scene(
            Beam(), impact_absorber(restitution=0.7, friction_limit=0.1)
        ),
    }
    curves = [CurveCase(scene, np.array(size.forces)) for scene in cases.values()]
    by = {"exact": None, "moreau": Moreau(PAPER_STEPS)}
    levels = {
        name: settings.curves(f"basics: {name}", curves, size.members, method)
        for name, method in by.items()
    }
    return [
        {"case": name, "force": force}
        | {
            by: quantiles(result[k].combined[f], (0.5, *BAND)).tolist()
            for by, result in levels.items()
        }
        for k, name in enumerate(cases)
        for f, force in enumerate(size.forces)
    ]


def _scaling() -> Json:
    """Return how far runs with gap, friction and force times a factor are from the run scaled.

    With 2, which moves no digit, the level of a whole sweep with friction; with 3 the times of the
    first impacts, before rounding has grown.
    """

    def run(factor: float, friction: float | None) -> Lane:
        scene = beam_scene(Beam(), impact_absorber(factor * GAP, 0.7, friction))
        return Lane(scene, Drive(factor * 3.5, make_both_sweeps(scene)[0]))

    one, two = (compute_level_value(run(factor, factor * 0.1)) / factor for factor in (1.0, 2.0))
    lanes = [run(factor, None) for factor in (1.0, 3.0)]
    first, other = (
        simulate(lane.scene, lane.drive, record=Record(events=True)).recorded.impacts.time[:FIRST]
        for lane in lanes
    )
    return {
        "level_by_2": two / one - 1,
        "times_by_3": float(np.max(np.abs(other / first - 1))),
        "impacts": FIRST,
    }


def simulate_mean_squares(
    scene: Scene,
    drives: Sequence[Drive],
    damper: float,
    method: Method,
    threads: int | None = None,
    pieces: int = PIECES,
) -> Array:
    """Return the mean square of the tip displacement (pieces, runs) in m^2.

    Each piece of each run has its value. ``damper`` is that between absorber and ground in N s/m.

    The runs have one schedule. At the end of each piece the absorber's velocity shrinks as the
    damper would have it in that time.
    """
    schedule = drives[0].schedule
    runs = ControlledRuns(
        scene,
        len(drives),
        schedule.reference,
        1 / pieces,
        method,
        samples_per_period=SAMPLES,
        threads=threads,
    )
    runs.orders["force"], runs.orders["phase"] = np.array(
        [(drive.amplitude, drive.phase) for drive in drives]
    ).T
    edges: Array = runs.duration * np.arange(
        int(schedule.times[-1] / runs.duration * (1 + 1e-9)) + 1.0
    )
    omega = np.asarray(schedule.omega_at(edges))
    result = np.empty((len(omega) - 1, len(drives)))
    for k in range(len(result)):
        runs.orders["omega_start"], runs.orders["omega_stop"] = omega[k : k + 2]
        runs.orders["fresh"] = True  # a piece begins at the state as it is left here
        runs.advance()
        runs.state[:, -1] *= np.exp(-damper * runs.duration / not_none(scene.absorber_mass))
        result[k] = runs.reports["mean_square"]
    runs.close()
    return result


def compute_damped_levels(
    scene: Scene, drives: Sequence[Drive], damper: float, method: Method, threads: int | None = None
) -> Array:
    """Return the largest RMS of the tip displacement in m, (runs,).

    It is taken over as many pseudo periods as the level's window has.
    """
    window = 2 * HALF_WINDOW_PERIODS * PIECES
    total = np.cumsum(simulate_mean_squares(scene, drives, damper, method, threads), axis=0)
    return np.asarray(np.sqrt(np.max(total[window:] - total[:-window], axis=0) / window))


def _damped_jumps(settings: PaperSettings, runs: int) -> list[Json]:
    """Return how many downward sweeps reach the high branch without and with the damper.

    The sweeps are those of the figure jump.
    """
    own = jump.make_scene()
    rows = []
    phases = draw_members(runs, settings.seed, "phase").phases.tolist()
    for name, method in METHODS.items():
        for slowness in (jump.RATE, 2 * jump.RATE):
            approach = Approach(own.model.resonance_omega(1), jump.OVER.start)
            drives = [
                passage_schedule(
                    approach,
                    jump.FORCES["medium"],
                    jump.OVER.start,
                    jump.OVER.last,
                    slowness,
                    phase,
                )
                for phase in phases
            ]
            reached = {
                key: int(
                    np.sum(
                        compute_damped_levels(own, drives, c, method, settings.threads)
                        > jump.HIGH_LEVEL
                    )
                )
                for key, c in DAMPERS.items()
            }
            rows.append({"method": name, "periods_per_percent": slowness, "runs": runs, **reached})
    return rows


def _damped_levels(settings: PaperSettings, runs: int) -> list[Json]:
    """Return median levels of sweeps without and with the damper.

    The 95 % interval of their ratio is also given. The scene is that of the figure high_low with
    three modes.
    """
    own = high_low.make_scene()
    members = draw_members(runs, settings.seed)
    rows = []
    for force in high_low.FORCES.values():
        drives = [members.drives(force, sweep) for sweep in make_both_sweeps(own)]
        result = {
            key: np.max(
                [
                    compute_damped_levels(own, each, c, METHODS["exact"], settings.threads)
                    for each in drives
                ],
                axis=0,
            )
            for key, c in DAMPERS.items()
        }
        ratio = bootstrap(
            (result["with"], result["without"]),
            lambda a, b, axis: np.median(a, axis) / np.median(b, axis),
            method="percentile",
            rng=settings.seed,
        ).confidence_interval
        rows.append(
            {"force_n": force, "low": float(ratio.low), "high": float(ratio.high)}
            | {key: float(np.median(x)) for key, x in result.items()}
        )
    return rows


def _describe(values: Json) -> str:
    tunings = values["tuned"]["tunings"].items()
    damper = values["damper"]
    tables: dict[tuple[str, ...], list[tuple[str, ...]]] = {
        ("tuned absorber (LTVA)", "$k$, N/m", "$c$, N s/m", "peak in % of no absorber"): [
            (name, f"{x['stiffness']:.1f}", f"{x['damping']:.3f}", f"{100 * x['relative']:.2f}")
            for name, x in tunings
        ],
        ("level in mm, median (5 to 95 %)", "exact", "Moreau, the paper's step"): [
            (
                f"{x['case']}, {x['force']:g} N",
                *(format_interval(*x[by], form="{:.3f}", factor=1e3) for by in ("exact", "moreau")),
            )
            for x in values["step"]
        ],
        (
            "modes, force",
            "±10 periods, % of no absorber",
            "±20 periods, %",
            "level ±20 over ±10, %",
        ): [
            (
                f"{x['modes']}, {x['force']:g} N",
                *(f"{100 * r:.1f}" for r in (*x["relative"], x["shrinks"])),
            )
            for x in values["window"]
        ],
        ("damper of 0.001 N s/m between absorber and ground", "without", "with it"): [
            *(
                (f"sweeps that jump, {name}", *(f"{row[key]} of {row['runs']}" for key in DAMPERS))
                for name, row in jumps(damper)
            ),
            *(
                (
                    f"level in mm, 3 modes, {row['force_n']:g} N",
                    *(f"{1e3 * row[key]:.3f}" for key in DAMPERS),
                )
                for row in damper["levels"]
            ),
        ],
    }
    return "\n\n".join(markdown(header, rows) for header, rows in tables.items())


def _draw(values: Json) -> Figure:
    """Draw the tip amplitude over the frequency with each tuning, and the error of the step.

    The error is shown as levels at the paper's step over the exact ones.
    """
    figure, axes = make_panels(1, 2, 3.0)
    response, step = axes[0]
    model = modal_model(Beam())
    ratio = np.linspace(0.7, 1.3, 1201)
    draw_signal(
        response,
        ratio,
        MM * np.abs(tip_response(model, None, ratio * model.omega[0])),
        REFERENCE,
        "no absorber",
        1,
    )
    for name, style in {
        "paper": STYLES[1],
        "Den Hartog": STYLES[0],
        "smallest peak": STYLES[2],
    }.items():
        own = values["tuned"]["tunings"][name]
        absorber = TunedAbsorber(stiffness=own["stiffness"], damping=own["damping"])
        draw_line(
            response,
            ratio,
            MM * np.abs(tip_response(model, absorber, ratio * model.omega[0])),
            style,
            f"LTVA: {name}",
            marked=False,
        )
    response.set(
        xlabel="frequency over the first resonance",
        ylabel="tip amplitude in mm/N",
        ylim=(0, 0.25),
        xlim=(0.7, 1.3),
    )
    rows = values["step"]
    for shift, method, style, label in (
        (-0.12, "exact", STYLES[0], "exact"),
        (0.12, "moreau", STYLES[1], "Moreau, the paper's step"),
    ):
        middle, low, high = (
            100 * np.array([np.array(row[method]) / row["exact"][0] for row in rows]).T
        )
        at = np.arange(len(rows)) + shift
        errors = (middle - low, high - middle)
        step.errorbar(
            at,
            middle,
            yerr=errors,
            color=style.colour,
            ls="",
            marker=style.marker,
            lw=1.2,
            capsize=2.5,
            label=label,
        )
    step.set_xticks(
        range(len(rows)),
        [f"{row['case'].split()[0]}\n{row['force']:g}" for row in rows],
    )
    step.set(xlabel="modes, and force in N", ylabel="level in % of the exact median")
    step.margins(y=0.25)
    draw_legends(axes)
    return figure


judge = partial(make_claim, "basics")


def claims(values: Json) -> list[Claim]:
    """Return all claims of the part."""
    return [
        *_beam(values["beam"]),
        *_linear(values["linear"]),
        *_runs(values),
        _damper(values["damper"]),
        *_tuned(values["tuned"]),
    ]


def _beam(beam: Json) -> list[Claim]:
    second = beam["ratios"][1]
    lost = beam["lost_in_own_period"]
    off = beam["stiffness_of_modes"] / beam["stiffness"] - 1
    own = beam["absorber_kg"]
    whole = beam["beam_kg"]
    return [
        judge("basics_omega_2", [second], ratio=second),
        judge("basics_mass", [own / whole], own=1e3 * own, whole=1e3 * whole),
        judge("basics_node", [beam["node"]], **beam),
        judge("basics_stiffness", [off], off=off, **beam),
        judge(
            "basics_own_period",
            max(lost) - min(lost) < 1e-9,
            least=100 * min(lost),
            most=100 * max(lost),
            modes=len(lost),
        ),
        judge("basics_span", [beam["span_periods"]], **beam),
    ]


def _linear(linear: Json) -> list[Claim]:
    sweep, swept = linear["sweep_ratio"].values()
    stuck, second = linear["stuck_over_none"].values()
    off = max(abs(stuck - 1), abs(second - 1))
    return [
        judge("basics_rate", find_extent([sweep, swept]), one=sweep, two=swept),
        judge("basics_stuck_level", find_extent([stuck, second]), one=stuck, two=second, off=off),
    ]


def _runs(values: Json) -> list[Claim]:
    """Judge the window, the step and the scaling.

    For the step, each case is judged by how the bands of both methods compare. The verdict follows
    from all cases.
    """
    rows = values["window"]
    scaling = values["scaling"]
    change = [100 * (row["relative"][1] / row["relative"][0] - 1) for row in rows]
    one, two = (np.argsort([row["relative"][window] for row in rows]) for window in (0, 1))
    less = [100 * (1 - row["shrinks"]) for row in rows]
    order = "the same" if np.array_equal(one, two) else "another"
    window: Json = {
        "low": min(less),
        "high": max(less),
        "least": min(change),
        "most": max(change),
        "cases": len(rows),
        "order": order,
    }
    steps = values["step"]
    low, high = (100 * q for q in BAND)
    off = [100 * (row["moreau"][0] / row["exact"][0] - 1) for row in steps]
    cases = [
        judge_interval(
            row["moreau"][1],
            row["moreau"][2],
            (1 - SAME) * row["exact"][1],
            (1 + SAME) * row["exact"][2],
        )
        for row in steps
    ]
    level = abs(scaling["level_by_2"])
    times = scaling["times_by_3"]
    return [
        judge("basics_window", min(less) > 0 and max(map(abs, change)) < 100 * SAME, **window),
        judge(
            "basics_step",
            judge_cases(cases),
            least=min(off),
            most=max(off),
            largest=-min(off) / 100,
            low=low,
            high=high,
            **_counted(cases),
        ),
        judge(
            "basics_scaling",
            level < 1e-12 and times < 1e-6,
            level=level,
            times=times,
            impacts=scaling["impacts"],
        ),
    ]


def _counted(cases: list[ClaimVerdict]) -> Json:
    return {
        "cases": len(cases),
        "inside": cases.count(ClaimVerdict.HOLDS),
        "beside": cases.count(ClaimVerdict.NOT),
    }


def jumps(damper: Json) -> list[tuple[str, Json]]:
    """Return the rows on sweeps with the damper to ground, and what they are of."""
    return [
        (f"{row['method']}, {row['periods_per_percent']:g} pseudo periods per 1 %", row)
        for row in damper["jumps"]
    ]


def difference(rows: Sequence[Json]) -> tuple[float, float, float]:
    """Return the increase of the share of runs by the damper, with its 95 % interval.

    It is the difference of the shares with and without damper, as the mean of all rows.
    """
    shares = np.array([[row[key] / row["runs"] for key in ("with", "without")] for row in rows])
    counts = np.array([[row["runs"]] for row in rows])
    middle = float(np.mean(shares[:, 0] - shares[:, 1]))
    bound = float(norm.ppf(0.975) * np.sqrt(np.sum(shares * (1 - shares) / counts)) / len(rows))
    return middle, middle - bound, middle + bound


def _damper(damper: Json) -> Claim:
    """Judge the change of the share of sweeps that jump, and of levels."""
    mean, low, high = difference(damper["jumps"])
    levels = damper["levels"]
    cases = [judge_interval(low, high, -SAME, SAME)] + [
        judge_interval(row["low"], row["high"], *range_within(SAME)) for row in levels
    ]
    each = ", ".join(
        f"{row['with'] / row['runs']:.3f} for {row['without'] / row['runs']:.3f} ({name})"
        for name, row in jumps(damper)
    )
    ratios = ", ".join(
        (
            f"{row['with'] / row['without']:.3f} ({row['low']:.3f} to {row['high']:.3f}) at "
            f"{row['force_n']:g} N"
        )
        for row in levels
    )
    return judge(
        "basics_damper",
        judge_cases(cases),
        mean=mean,
        low=low,
        high=high,
        each=each,
        ratios=ratios,
        **_counted(cases),
    )


def _tuned(tuned: Json) -> list[Claim]:
    paper, rule, own, best = (
        tuned["tunings"][name]
        for name in ("paper", "Den Hartog", "modal mass of one", "smallest peak")
    )
    off = max(abs(paper[name] / rule[name] - 1) for name in ("stiffness", "damping"))
    heights = paper["peaks"]
    peaks = ", ".join(f"{100 * height:.1f}" for height in paper["peaks"])
    level, least, low, lower = (
        100 * one[name] for name in ("relative", "within_limits") for one in (paper, best)
    )
    holds = off < SAME and max(heights) / min(heights) < 1 + SAME and level < least * (1 + SAME)
    second = tuned["second_relative"]
    undamped = tuned["undamped_relative"]
    return [
        judge(
            "basics_ltva",
            holds,
            rule=rule,
            own=own,
            peaks=peaks,
            level=level,
            least=least,
            low=low,
            lower=lower,
        ),
        judge("basics_ltva_second", [second], off=1 - second),
        judge("basics_undamped", [undamped], undamped=undamped),
    ]


FIGURE = PaperFigure(
    "basics",
    "beam, tuned absorber, sweeps, window, step and scaling",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=claims,
    sizes=(
        Size(members=8, forces=(1.5, 3.5, 5.0), damped=400),
        Size(members=3, forces=(1.5, 3.5), damped=20),
    ),  # damped: runs with the damper
)
