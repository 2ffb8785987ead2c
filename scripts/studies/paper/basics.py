"""What the paper states of beam, tuned absorber, sweeps, window, step, scaling and its damper: most of it follows from the linear structure alone."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.stats
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.controlled import ControlledRuns
from impact_env.curve import BAND, CurveCase, quantiles
from impact_env.drive import PAPER_LIMITS, PAPER_RATE, Drive, linear_sweep
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import natural_frequencies, poles, tip_response
from impact_env.level import HALF_WINDOW_PERIODS, response_level
from impact_env.methods import PAPER_STEPS, Exact, Method, Moreau
from impact_env.modes import modal_model
from impact_env.parameters import Beam, RigidWalls, StuckAbsorber, TunedAbsorber, impact_absorber
from impact_env.periodic.harmonic_balance import PAPER_DAMPER
from impact_env.periodic.residence import Approach, passage
from impact_env.response import DEFAULT_SAMPLES, Record
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from optimisation.bounds import design_force
from optimisation.extremes import sweep_ratio
from optimisation.page import markdown
from optimisation.tuned import PAPER, den_hartog, highest_amplitude, minimax, paper_rule, peak, peaks
from studies.paper import basics_claims, high_low, jump
from studies.paper.frame import PaperFigure, Settings, has, in_turn
from studies.paper.style import LOOKS, MM, REFERENCE, legends, line, panels
from studies.study import Json, Steps

Array = NDArray[np.float64]
GAP = RigidWalls.gap
ENTRY_FORCES = (3.5, 5.0, 10.0, 20.0)  # N, at which the first impact of a sweep is looked for
FIRST = 12  # impacts after which rounding has not yet grown
PIECES, SAMPLES = 4, 32  # a pseudo period of a run with the damper that the paper's harmonic balance has between absorber and ground (section 2.5)
DAMPERS = {"without": 0.0, "with": PAPER_DAMPER}  # N s/m
METHODS: dict[str, Method] = {"exact": Exact(), "paper's step": Moreau()}
SERIES = Record(level=False, events=True, series=True, energy=True)


class Sizes(NamedTuple):
    """Members, forces in N, and runs with the damper to ground."""

    members: int
    forces: tuple[float, ...]
    damped: int


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    groups: dict[str, Callable[[], object]] = {
        "beam": beam_numbers,
        "tuned": tuned_numbers,
        "linear": linear_numbers,
        "entry": _entry,
        "window": partial(_window, settings, size),
        "step": partial(_step, settings, size),
        "scaling": _scaling,
        "damper": partial(_damped, settings, size.damped),
    }
    return in_turn(groups, known)


def beam_numbers() -> Json:
    """Return frequencies, masses, the force's node, the static stiffness of all modes, and what a mode keeps after half a period."""
    beam = Beam()
    model, whole = modal_model(beam), modal_model(Beam(modes=beam.freedoms))
    ratios = model.omega / model.omega[0]
    stuck = float(natural_frequencies(model, StuckAbsorber())[0] / model.omega[0])
    damped = poles(model, None)
    edges = linear_sweep(1.0, 0.9935, 1.0065, PAPER_RATE)
    return {
        "omega_1": float(model.omega[0]),
        "ratios": ratios.tolist(),
        "absorber_kg": impact_absorber().mass_ratio * beam.mass,
        "beam_kg": beam.mass,
        "node": beam.force_position * beam.elements,
        "stiffness": beam.static_tip_stiffness,
        "stiffness_of_modes": float(1 / np.sum((whole.tip_shape / whole.omega) ** 2)),
        "stuck_ratio": stuck,
        "span_periods": edges.periods,
        "left_after_half_period": np.exp(-2 * model.damping_ratio * np.pi * ratios).tolist(),
        "lost_in_own_period": (1 - np.exp(4 * np.pi * damped.real / damped.imag)).tolist(),
    }


def tuned_numbers() -> Json:
    """Return the tunings of the LTVA with their peaks over no absorber, the paper's at the second resonance, and an undamped one at its frequency."""
    model = modal_model(Beam())
    free = peak(model, None)[0]
    found = {}
    tunings = {"paper": PAPER, "modal mass of one": paper_rule(model), "Den Hartog": den_hartog(model), "smallest peak": minimax(model)}
    for name, absorber in tunings.items():
        heights = [height / free for height, _ in peaks(model, absorber)]
        swept = highest_amplitude(model, absorber, 1, *PAPER_LIMITS)[0] / free
        own = {"relative": max(heights), "at": peak(model, absorber)[1], "peaks": heights, "within_limits": swept}
        found[name] = {"stiffness": absorber.stiffness, "damping": absorber.damping, **own}
    mass = PAPER.mass_ratio * model.beam_mass
    undamped = TunedAbsorber(PAPER.mass_ratio, PAPER.stiffness, 0.0)
    tuned_to = float(np.sqrt(PAPER.stiffness / mass))
    second = [highest_amplitude(model, absorber, 2, *PAPER_LIMITS)[0] for absorber in (PAPER, None)]
    return {
        "tunings": found,
        "second_relative": second[0] / second[1],
        "undamped_relative": float(np.abs(tip_response(model, undamped, tuned_to)) / np.abs(tip_response(model, None, tuned_to))),
    }


def linear_numbers() -> Json:
    """Return what sweeps show of the stationary response, what a stuck absorber changes, and at which forces the linear response fills the gap."""
    model = modal_model(Beam())
    low, high = PAPER_LIMITS
    found: Json = {"sweep_ratio": {}, "stuck_over_none": {}, "gap_force_n": {}, "gap_force_at_limits_n": {}, "design_force_n": {}}
    for resonance in (1, 2):
        name, omega = str(resonance), model.resonance_omega(resonance)
        found["sweep_ratio"][name] = sweep_ratio(model, PAPER_RATE, resonance)
        levels = [max(_level(Scene(model, absorber), resonance, ends) for ends in ((low, high), (high, low))) for absorber in (StuckAbsorber(), None)]
        found["stuck_over_none"][name] = levels[0] / levels[1]
        found["gap_force_n"][name] = GAP / highest_amplitude(model, None, resonance, low, high)[0]
        found["gap_force_at_limits_n"][name] = [float(GAP / np.abs(tip_response(model, None, ratio * omega))) for ratio in (low, high)]
        found["design_force_n"][name] = design_force(model, PAPER.mass_ratio * model.beam_mass, GAP, resonance)
    return found


def _level(scene: Scene, resonance: int, ends: tuple[float, float], force: float = 1.0) -> float:
    level = simulate(scene, Drive(force, linear_sweep(scene.model.resonance_omega(resonance), *ends))).level
    assert level is not None
    return level.value


def _entry() -> list[Json]:
    """Return at which frequency the first impact of a sweep comes, by force, up and down: ten modes, no losses in contact."""
    scene, rows = beam_scene(Beam(), impact_absorber()), []
    for force in ENTRY_FORCES:
        ratios = []
        for ends in (PAPER_LIMITS, PAPER_LIMITS[::-1]):
            schedule = linear_sweep(scene.model.resonance_omega(1), *ends)
            impacts = simulate(scene, Drive(force, schedule), record=Record(events=True)).impacts
            assert impacts is not None
            ratios.append(float(schedule.omega_at(float(impacts.time[0])) / schedule.reference))
        rows.append({"force": force, "limits": list(PAPER_LIMITS), "up": ratios[0], "down": ratios[1]})
    return rows


def both_windows(lane: Lane) -> tuple[float, float]:
    """Return the level in m of a lane with the paper's window and with one twice as long."""
    record = SERIES if lane.scene.absorber is not None else Record(level=False, series=True)
    history = simulate(lane.scene, lane.drive, record=record).history
    assert history is not None
    tip = history.tip_displacement
    one, two = (response_level(tip, DEFAULT_SAMPLES, k * HALF_WINDOW_PERIODS)[0] for k in (1, 2))
    return one, two


def _window(settings: Settings, size: Sizes) -> list[Json]:
    """Return levels over no absorber with both windows, for one, three and ten modes without losses in contact."""
    forces, members = size.forces, draw_members(size.members, settings.seed)
    scenes = [beam_scene(Beam(modes=n), absorber) for n in (1, 3, 10) for absorber in (impact_absorber(), None)]
    lanes = []
    for scene in scenes:
        sweeps = [linear_sweep(scene.model.resonance_omega(1), *ends) for ends in (PAPER_LIMITS, PAPER_LIMITS[::-1])]
        drives = [members.drives(force, schedule) for force in forces for schedule in sweeps]
        lanes += [Lane(scene, drive) for per_member in drives for drive in per_member]
    found = np.array(settings.each("basics: window", lanes, both_windows)).reshape(3, 2, len(forces), 2, len(members), 2).max(axis=3)
    rows = []
    for k, modes in enumerate((1, 3, 10)):
        for f, force in enumerate(forces):
            absorber, without = found[k, 0, f], found[k, 1, f]
            middle = np.median(absorber / without, axis=0)
            rows.append({"modes": modes, "force": force, "relative": middle.tolist(), "shrinks": float(np.median(absorber[:, 1] / absorber[:, 0]))})
    return rows


def _step(settings: Settings, size: Sizes) -> list[Json]:
    """Return levels by the Moreau scheme at the paper's step beside the exact ones."""
    forces = np.array(size.forces)
    cases = {
        "3 modes, e = 1, 0.01 N": beam_scene(Beam(modes=3), impact_absorber(friction_limit=0.01)),
        "10 modes, e = 0.7, 0.1 N": beam_scene(Beam(), impact_absorber(restitution=0.7, friction_limit=0.1)),
    }
    curves = [CurveCase(scene, forces) for scene in cases.values()]
    by = {"exact": None, "moreau": Moreau(PAPER_STEPS)}
    levels = {name: settings.curves(f"basics: {name}", curves, size.members, method) for name, method in by.items()}
    rows = []
    for k, name in enumerate(cases):
        for f, force in enumerate(forces.tolist()):
            bands = {method: quantiles(found[k].combined[f], (0.5, *BAND)).tolist() for method, found in levels.items()}
            rows.append({"case": name, "force": force, **bands})
    return rows


def _scaling() -> Json:
    """Return how far runs with gap, friction and force times a factor are from the run scaled.

    With 2, which moves no digit, the level of a whole sweep with friction; with 3 the times of the first impacts, before rounding has grown.
    """
    sweeps = []
    for factor in (1.0, 2.0):
        scene = beam_scene(Beam(), impact_absorber(factor * GAP, 0.7, factor * 0.1))
        sweeps.append(_level(scene, 1, PAPER_LIMITS, factor * 3.5) / factor)
    times = []
    for factor in (1.0, 3.0):
        scene = beam_scene(Beam(), impact_absorber(factor * GAP, 0.7))
        schedule = linear_sweep(scene.model.resonance_omega(1), *PAPER_LIMITS)
        impacts = simulate(scene, Drive(factor * 3.5, schedule), record=Record(events=True)).impacts
        assert impacts is not None
        times.append(impacts.time[:FIRST])
    return {"level_by_2": sweeps[1] / sweeps[0] - 1, "times_by_3": float(np.max(np.abs(times[1] / times[0] - 1))), "impacts": FIRST}


def squares(scene: Scene, drives: Sequence[Drive], damper: float, method: Method, threads: int | None = None, pieces: int = PIECES) -> Array:
    """Return the mean square of the tip displacement in m^2 in each piece of each run, (pieces, runs); ``damper`` to ground in N s/m.

    The runs have one schedule. At the end of each piece the absorber's velocity shrinks as the damper would have it in that time.
    """
    schedule, mass = drives[0].schedule, scene.absorber_mass
    assert mass is not None
    runs = ControlledRuns(scene, len(drives), schedule.reference, 1 / pieces, method, samples_per_period=SAMPLES, threads=threads)
    runs.orders["force"], runs.orders["phase"] = np.array([(drive.amplitude, drive.phase) for drive in drives]).T
    edges: Array = runs.duration * np.arange(int(schedule.times[-1] / runs.duration * (1 + 1e-9)) + 1.0)
    omega = np.asarray(schedule.omega_at(edges))
    found = np.empty((len(omega) - 1, len(drives)))
    for k in range(len(found)):
        runs.orders["omega_start"], runs.orders["omega_stop"] = omega[k : k + 2]
        runs.orders["fresh"] = True  # a piece begins at the state as it is left here
        runs.advance()
        runs.state[:, -1] *= np.exp(-damper * runs.duration / mass)
        found[k] = runs.reports["mean_square"]
    runs.close()
    return found


def levels(scene: Scene, drives: Sequence[Drive], damper: float, method: Method, threads: int | None = None) -> Array:
    """Return the largest RMS of the tip displacement in m over as many pseudo periods as the level's window has, (runs,)."""
    window = 2 * HALF_WINDOW_PERIODS * PIECES
    total = np.cumsum(squares(scene, drives, damper, method, threads), axis=0)
    return np.asarray(np.sqrt(np.max(total[window:] - total[:-window], axis=0) / window))


def _damped_jumps(settings: Settings, runs: int) -> list[Json]:
    """Return how many sweeps down come to the high branch (the figure jump) without and with the damper."""
    own, rows = jump.scene(), []
    phases = draw_members(runs, settings.seed, "phase").phases.tolist()
    for name, method in METHODS.items():
        for slowness in (jump.RATE, 2 * jump.RATE):
            approach = Approach(own.model.resonance_omega(1), jump.OVER.start)
            drives = [passage(approach, jump.FORCES["medium"], jump.OVER.start, jump.OVER.last, slowness, phase) for phase in phases]
            reached = {key: int(np.sum(levels(own, drives, c, method, settings.threads) > jump.HIGH_LEVEL)) for key, c in DAMPERS.items()}
            rows.append({"method": name, "periods_per_percent": slowness, "runs": runs, **reached})
    return rows


def _damped_levels(settings: Settings, runs: int) -> list[Json]:
    """Return the median level of sweeps over three modes (the figure high_low) without and with the damper, and the 95 % interval of their ratio."""
    own, members, rows = high_low.scene(), draw_members(runs, settings.seed), []
    for force in high_low.FORCES.values():
        sweeps = [linear_sweep(own.model.resonance_omega(1), *ends) for ends in (PAPER_LIMITS, PAPER_LIMITS[::-1])]
        found = {
            key: np.max([levels(own, members.drives(force, sweep), c, METHODS["exact"], settings.threads) for sweep in sweeps], axis=0)
            for key, c in DAMPERS.items()
        }
        ratio = scipy.stats.bootstrap(
            (found["with"], found["without"]), lambda a, b, axis: np.median(a, axis) / np.median(b, axis), method="percentile", rng=settings.seed
        ).confidence_interval
        rows.append({"force_n": force, "low": float(ratio.low), "high": float(ratio.high)} | {key: float(np.median(x)) for key, x in found.items()})
    return rows


def _damped(settings: Settings, runs: int) -> Json:
    """Return both: the jumps of so many sweeps, the levels of a quarter."""
    return {"jumps": _damped_jumps(settings, runs), "levels": _damped_levels(settings, runs // 4)}


def _words(values: Json) -> str:
    tables: list[tuple[Sequence[str], list[tuple[str, ...]]]] = []
    if "tuned" in values:
        header: tuple[str, ...] = ("tuned absorber (LTVA)", "$k$, N/m", "$c$, N s/m", "peak in % of no absorber")
        tunings = values["tuned"]["tunings"].items()
        tables.append((header, [(name, f"{x['stiffness']:.1f}", f"{x['damping']:.3f}", f"{100 * x['relative']:.2f}") for name, x in tunings]))
    if "step" in values:
        header = ("level in mm, median (5 to 95 %)", "exact", "Moreau, the paper's step")
        tables.append(
            (
                header,
                [
                    (f"{x['case']}, {x['force']:g} N", *("{:.3f} ({:.3f} to {:.3f})".format(*(1e3 * y for y in x[by])) for by in ("exact", "moreau")))
                    for x in values["step"]
                ],
            )
        )
    if "window" in values:
        header = ("modes, force", "±10 periods, % of no absorber", "±20 periods, %", "level ±20 over ±10, %")
        rows = [(f"{x['modes']}, {x['force']:g} N", *(f"{100 * r:.1f}" for r in (*x["relative"], x["shrinks"]))) for x in values["window"]]
        tables.append((header, rows))
    if "damper" in values:
        header, told = ("damper of 0.001 N s/m between absorber and ground", "without", "with it"), values["damper"]
        lines = [(f"sweeps that jump, {name}", [f"{row[key]} of {row['runs']}" for key in DAMPERS]) for name, row in basics_claims.jumps(told)]
        lines += [(f"level in mm, 3 modes, {row['force_n']:g} N", [f"{1e3 * row[key]:.3f}" for key in DAMPERS]) for row in told["levels"]]
        tables.append((header, [(name, *cells) for name, cells in lines]))
    return "\n\n".join(markdown(header, rows) for header, rows in tables)


def _draw(values: Json) -> Figure:
    """Draw the tip amplitude over the frequency with each tuning, and levels at the paper's step over the exact ones."""
    figure, axes = panels(1, 2, 3.0)
    response, step = axes[0]
    model, ratio = modal_model(Beam()), np.linspace(0.7, 1.3, 1201)
    shown = {"paper": LOOKS[1], "Den Hartog": LOOKS[0], "smallest peak": LOOKS[2]}
    free = MM * np.abs(tip_response(model, None, ratio * model.omega[0]))
    response.plot(ratio, free, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=1, label="no absorber")
    for name, look in shown.items():
        own = values["tuned"]["tunings"][name]
        absorber = TunedAbsorber(stiffness=own["stiffness"], damping=own["damping"])
        line(response, ratio, MM * np.abs(tip_response(model, absorber, ratio * model.omega[0])), look, f"LTVA: {name}", marked=False)
    response.set(xlabel="frequency over the first resonance", ylabel="tip amplitude in mm/N", ylim=(0, 0.25), xlim=(0.7, 1.3))
    rows = values["step"]
    for shift, method, look, label in ((-0.12, "exact", LOOKS[0], "exact"), (0.12, "moreau", LOOKS[1], "Moreau, the paper's step")):
        found = 100 * np.array([np.array(row[method]) / row["exact"][0] for row in rows])
        errors = (found[:, 0] - found[:, 1], found[:, 2] - found[:, 0])
        at = np.arange(len(rows)) + shift
        step.errorbar(at, found[:, 0], yerr=errors, color=look.colour, ls="", marker=look.marker, lw=1.2, capsize=2.5, label=label)
    step.set_xticks(range(len(rows)), [f"{row['case'].split(',')[0].removesuffix(' modes')}, {row['force']:g}" for row in rows])
    step.set(xlabel="modes, force in N", ylabel="level in % of the exact median")
    step.margins(y=0.25)
    legends(axes)
    return figure


FIGURE = PaperFigure(
    "basics", "beam, tuned absorber, sweeps, window, step and scaling", sizes=(Sizes(8, (1.5, 3.5, 5.0), 400), Sizes(3, (1.5, 3.5), 20)),
    measure=_measure, words=_words, draw=_draw, claims=basics_claims.of, needs=has("step"),
)  # fmt: skip
