"""Speed and accuracy of periodic orbits.

Closed form, maps, Newton's method, branches, folds and multipliers are measured on one core,
without compilation.
"""

import statistics
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import click
import numpy as np

from impact_env import Beam, modal_model
from impact_env.kernels.periodic.closed_form import fill_closed_forms
from impact_env.periodic.balance_branches import BALANCE_STEPS, frequency_problem, start_of_orbit
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import Steps, follow_both_ways
from impact_env.periodic.folds import find_fold
from impact_env.periodic.green import NoOrbit, read_unknowns, solve
from impact_env.periodic.harmonic_balance import harmonic_balance
from impact_env.periodic.motion import motion_of, stability_of
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.orbit_branches import OrbitBranch, orbit_branch
from impact_env.periodic.schedule import EventSchedule, flying_schedule
from impact_env.periodic.shooting import shoot
from impact_env.periodic.survey import attractors, closed_form_orbits, orbit_of_simulation
from impact_env.periodic.symmetric import (
    LEAST_GRID_POINTS,
    closed_folds,
    closed_form,
    find_level_places,
    map_frequencies,
    symmetric_schedule,
)
from impact_env.periodic.validation import CHATTER_BAR, RESIDUAL_BAR, iterate_map
from optimisation.cli.common import command
from optimisation.executors import Bar
from optimisation.files import markdown
from studies.study import Json, OutputPaths, Study, add_table_options, make_table_study, run
from studies.timing import time_call

NAME = "benchmark_periodic"
REPEATS = 21
QUICK_REPEATS = 3
BRANCH_POINTS = 200
BALANCE_POINTS = 250
MOVED = 1e-3  # rad, units of impulse: how far from the orbit Newton's method begins
FINE_STEPS = Steps(first=0.005, least=1e-8, most=0.02, points=BRANCH_POINTS)
T = TypeVar("T")
DIFFERENCE = 2e-7  # of each coordinate's unit, by which a run is disturbed


def line(what: str, bar: float | None, median: float, unit: str, each: Sequence[float]) -> Json:
    """Return a line of the table: name, bar, median and all repeats in their order.

    ``bar`` is the value not to be exceeded (None: no such value). Bar, median and repeats are in
    ``unit``.
    """
    return {"what": what, "bar": bar, "median": median, "unit": unit, "each": list(each)}


def timed(
    what: str,
    bar: float | None,
    unit: str,
    repeats: int,
    work: Callable[[], object],
    parts: float = 1.0,
) -> Json:
    """Time ``work``, which contains ``parts`` of the measured quantity.

    The first call compiles and is not counted.
    """
    work()
    each = [
        {"s": 1.0, "ms": 1e3, "us": 1e6}[unit] / parts * time_call(work) for _ in range(repeats)
    ]
    return line(what, bar, statistics.median(each), unit, each)


def case_at(
    modes: int, ratio: float, force: float, restitution: float = 1.0, friction: float = 0.0
) -> Case:
    """Return the paper's beam and absorber at a relative frequency and a force.

    ``ratio`` is the frequency over that of the first resonance, ``force`` is in N.
    """
    model = modal_model(Beam(modes=modes))
    return Case(
        model,
        ratio * float(model.omega[0]),
        force,
        restitution=restitution,
        friction_limit=friction,
    )


def first_orbit(case: Case) -> Orbit:
    """Return the orbit of the larger impulse."""
    return closed_form_orbits(case).orbits[0]


def require_orbit(result: T | NoOrbit) -> T:
    """Return the orbit; raises ClickException with the reason if there is none."""
    if isinstance(result, NoOrbit):
        raise click.ClickException(result.reason)
    return result


def newton(schedule: EventSchedule, orbit: Orbit, repeated: int = 1) -> Callable[[], object]:
    """Return a call of Newton's method from a start close to an orbit.

    The events of the orbit are listed once, or over ``repeated`` of its periods.
    """
    z = read_unknowns(orbit.solution)
    n = len(orbit.schedule.events)
    m = orbit.schedule.impacts
    phases = [z[:n] + k * orbit.schedule.turn for k in range(repeated)]
    z = np.concatenate([*phases, *[z[n : n + m]] * repeated, z[n + m :]])
    start = z + MOVED * np.cos(np.arange(len(z)))
    return lambda: require_orbit(solve(orbit.case, schedule, start))


def closed_form_line(modes: int, friction: float, repeats: int) -> Json:
    """Both branches of the closed form, for each frequency."""
    case = case_at(modes, 1.0, 3.0, 1.0, friction)
    count = 1000
    omegas = np.linspace(0.9, 1.06, count) * case.omega
    impulses_and_phases = np.empty((count, 4))
    return timed(
        f"closed form, both branches, {modes} modes",
        2.0,
        "us",
        repeats,
        lambda: fill_closed_forms(case.structure, case.point, omegas, impulses_and_phases),
        count,
    )


def map_line(modes: int, repeats: int) -> Json:
    """The map of the fold force with births and mergers."""
    case = case_at(modes, 1.0, 3.0, 1.0, 0.01)
    assert len(map_frequencies(case, 0.9, 1.06)) == LEAST_GRID_POINTS
    what = f"fold force at {LEAST_GRID_POINTS} frequencies, births and mergers, {modes} modes"
    return timed(what, 0.1, "s", repeats, lambda: find_level_places(case, 0.9, 1.06))


def frictionless_branch(repeats: int) -> Json:
    """200 points: events, motion and multipliers, each from the point before."""
    case = case_at(3, 0.9, 3.0)
    schedule = symmetric_schedule(False)
    first = float(case.model.omega[0])

    def work() -> None:
        z = read_unknowns(first_orbit(case_at(3, 1.0, 3.0)).solution)
        for ratio in np.linspace(1.0, 1.06, BRANCH_POINTS):
            solution = require_orbit(solve(case.changed(omega=float(ratio) * first), schedule, z))
            z = read_unknowns(solution)
            stability_of(motion_of(solution))

    return timed(
        f"frictionless, {BRANCH_POINTS} branch points with multipliers", 0.5, "s", repeats, work
    )


def branch_of(orbit: Orbit, reach: tuple[float, float]) -> OrbitBranch:
    """Return the branch of an orbit between two frequencies, with all checks at every point.

    ``reach`` has the two frequencies over that of the first resonance.
    """
    low, high = (ratio * float(orbit.case.model.omega[0]) for ratio in reach)
    return orbit_branch(orbit.solution, "omega", (low, high), FINE_STEPS)


def branch_line(
    what: str, bar: float, orbit: Orbit, reach: tuple[float, float], repeats: int
) -> Json:
    """Continuation through changes of the events' order, for 200 points."""
    points = len(branch_of(orbit, reach).schedules)
    return timed(what, bar, "s", repeats, lambda: branch_of(orbit, reach), points / BRANCH_POINTS)


def largest(what: str, bar: float, each: list[float]) -> Json:
    """Return the line of the largest of several."""
    return line(what, bar, max(each), "", each)


def residual_line(orbits: dict[str, Orbit], reach: tuple[float, float]) -> Json:
    """The largest residual of the exact method on all orbits.

    The orbits are those of the isola of the model with three modes, and the single ones.
    """
    branch = branch_of(orbits["isola"], reach)
    each = [
        orbit.residual for orbit in (*branch.orbits(), *orbits.values()) if isinstance(orbit, Orbit)
    ]
    return largest(f"largest residual by propagation, {len(each)} orbits", RESIDUAL_BAR, each)


def balance_line(repeats: int) -> Json:
    """Time of harmonic balance for 250 points of a branch, as in the paper.

    It follows the isola of the model with three modes at 20 harmonics and locates the folds.
    """
    case = case_at(3, 0.95, 1.5, 1.0, 0.01)
    harmonics = 20
    first = float(case.model.omega[0])
    best = closed_form(case)[-1]
    balance = harmonic_balance(case.scene, case.omega, case.force, harmonics)
    z = balance.solved(start_of_orbit(balance, best.impulse, best.phase))
    work = partial(
        follow_both_ways,
        frequency_problem(balance, 0.85 * first, 1.0 * first),
        z,
        case.omega,
        BALANCE_STEPS,
    )
    what = f"harmonic balance, {harmonics} harmonics, {BALANCE_POINTS} branch points, 3 modes"
    return timed(what, 5.0, "s", repeats, work, len(work()) / BALANCE_POINTS)


def fold_line() -> Json:
    """Error of folds from Newton's method, against the discriminant of the closed form.

    Newton's method solves the conditions of the fold itself.
    """
    each = []
    for case in (case_at(3, 1.0, 1.5), case_at(1, 1.0, 1.5, 0.75)):
        for omega in closed_folds(case, 0.9, 1.06):
            at = case.changed(omega=omega, force=case.force * (1 + 1e-5))
            for branch in closed_form_orbits(at).orbits:
                fold = find_fold(branch.solution, "force")
                if not isinstance(fold, NoOrbit):
                    each.append(abs(fold.case.force / case.force - 1))
    return largest(f"folds against the closed form, {len(each)} folds", 1e-9, each)


def held_orbits() -> dict[str, Orbit]:
    """Return stationary orbits of runs in which the absorber is joined in part of the period.

    In one the joined phase is wall contact after complete chatter, in the other it is stick.
    """
    cases = {
        "chatter": (case_at(3, 0.9, 20.0, 0.1), 300.0),
        "stuck": (case_at(10, 0.9726, 3.5, 0.7, 0.1), 1000.0),
    }
    return {
        name: orbit
        for name, (case, settling) in cases.items()
        if isinstance(orbit := orbit_of_simulation(case, settling), Orbit)
    }


def shooting_line(what: str, orbit: Orbit, repeats: int) -> Json:
    """Time of shooting from a start close to an orbit.

    Each step of Newton's method follows the whole motion event by event.
    """
    phase, state = orbit.motion.mid_flight()
    start = state * (1 + 1e-5 * np.cos(np.arange(len(state))))
    schedule = orbit.schedule
    work = partial(shoot, orbit.case, phase, start, schedule.symmetric, schedule.period_multiple)
    return timed(what, None, "ms", repeats, lambda: require_orbit(work()))


def multiplier_line(orbits: dict[str, Orbit], bar: float = 1e-6) -> Json:
    """Error of multipliers against eigenvalues of the derivative of the exact method's map.

    The derivative is taken by differences of runs that are disturbed in each coordinate.
    """
    each = []
    for orbit in orbits.values():
        case = orbit.case
        n = orbit.case.model.modes
        unit = case.gap * np.concatenate(
            [case.omega / case.model.omega, [1.0], np.full(n, case.omega), [case.omega]]
        )
        start, state = orbit.motion.mid_flight()
        columns = []
        for k in range(len(state)):
            step = DIFFERENCE * unit[k] * np.eye(len(state))[k]
            columns.append(
                (
                    iterate_map(orbit.motion, start, state + step)
                    - iterate_map(orbit.motion, start, state - step)
                )
                / (2 * DIFFERENCE * unit)
            )
        truth = list(np.linalg.eigvals(np.array(columns).T))
        values = orbit.stability.multipliers
        for value in values:
            k = int(np.argmin(np.abs(np.array(truth) - value)))
            each.append(float(abs(truth.pop(k) - value) / max(1.0, abs(values[0]))))
    return largest(
        (
            f"multipliers against disturbed runs, {len(each)} of {len(orbits)} "
            f"orbits{', complete chatter' * (bar > 1e-6)}"
        ),
        bar,
        each,
    )


def measure(repeats: int) -> list[Json]:
    """Make all lines, one after the other."""
    losses = first_orbit(case_at(1, 0.93, 1.5, 0.75))
    sided = next(orbit for orbit in attractors(losses.case, [losses]) if isinstance(orbit, Orbit))
    isola = first_orbit(case_at(3, 0.9523, 1.5, 1.0, 0.01))
    many = first_orbit(case_at(10, 0.97, 3.5, 0.7, 0.1))
    free = first_orbit(case_at(3, 0.9523, 1.5))
    orbits = {"isola": isola, "many": many, "sided": sided, "losses": losses, "free": free}
    twice = flying_schedule(
        [int(wall) for wall in sided.schedule.order.wall] * 2, False, period_multiple=2
    )
    slow = max(repeats // 4, 3)
    held = held_orbits()
    jobs: list[Callable[[], Json]] = [
        lambda: closed_form_line(3, 0.01, repeats),
        lambda: closed_form_line(10, 0.1, repeats),
        lambda: map_line(3, repeats),
        lambda: map_line(10, repeats),
        lambda: timed(
            "frictionless orbit of 2 impacts by Newton, 3 modes",
            0.2,
            "ms",
            repeats,
            newton(free.schedule, free),
        ),
        lambda: timed(
            "frictionless orbit of 4 impacts by Newton, 1 mode",
            0.2,
            "ms",
            repeats,
            newton(twice, sided, 2),
        ),
        lambda: frictionless_branch(slow),
        lambda: timed(
            "orbit with friction by Newton, 3 modes, 4 reversals",
            0.1,
            "ms",
            repeats,
            newton(isola.schedule, isola),
        ),
        lambda: branch_line(
            f"{BRANCH_POINTS}-point branch with friction, 3 modes", 0.5, isola, (0.9, 1.0), slow
        ),
        lambda: timed(
            "orbit with friction by Newton, 10 modes, 48 reversals",
            2.0,
            "ms",
            repeats,
            newton(many.schedule, many),
        ),
        lambda: branch_line(
            f"{BRANCH_POINTS}-point branch with friction, 10 modes",
            5.0,
            many,
            (0.967, 0.9712),
            slow,
        ),
        lambda: shooting_line(
            "orbit with complete chatter by shooting, 3 modes, 26 impacts", held["chatter"], slow
        ),
        lambda: shooting_line(
            "orbit with a stuck phase by shooting, 10 modes, period 3, 158 reversals",
            held["stuck"],
            slow,
        ),
        lambda: balance_line(QUICK_REPEATS),
        lambda: residual_line(orbits, (0.9, 1.0)),
        lambda: largest(
            f"largest residual by propagation, {len(held)} orbits by shooting",
            CHATTER_BAR,
            [orbit.residual for orbit in held.values()],
        ),
        fold_line,
        lambda: multiplier_line(orbits),
        lambda: multiplier_line({"chatter": held["chatter"]}, 1e-4),
    ]
    return [job() for job in Bar(jobs, desc="measuring", leave=False)]


def number(value: float, unit: str) -> str:
    """Return a value as the table shows it."""
    return f"{value:.1e}" if unit == "" else f"{value:.3g} {unit}"


def table(lines: Sequence[Json]) -> str:
    """Return a line for each median; lines of accuracy have no unit."""
    rows = [(line["what"], number(line["median"], line["unit"])) for line in lines]
    return markdown(("what", "median"), rows)


STUDY: Study[int] = make_table_study(
    NAME,
    "speed and accuracy of periodic orbits",
    lambda repeats: {"lines": measure(repeats)},
    lambda measured: table(measured.values["lines"]),
)


@command()
@click.option("--quick", is_flag=True, help=f"{QUICK_REPEATS} repeats instead of {REPEATS}.")
@add_table_options(NAME, "docs/frequency_domain.md")
def main(quick: bool, place: OutputPaths) -> None:
    """Measure speed and accuracy of periodic orbits against their limits.

    Values are medians of repeats in one process, without compilation.
    """
    run(STUDY, QUICK_REPEATS if quick else REPEATS, place)
