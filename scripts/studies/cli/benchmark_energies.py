"""Cost of the energy balance: run times with and without it.

Times are for one core and one process, without compilation.
"""

from collections.abc import Sequence
from typing import NamedTuple

import click

from impact_env import Exact, Record, beam_scene, impact_absorbers
from impact_env.drive import PAPER_RATE
from impact_env.parameters import (
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)
from optimisation.checkpoint import TimedRun
from optimisation.cli.common import command
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_table_options,
    format_table,
    make_table_study,
    run,
)
from studies.timing import (
    Advance,
    TimingSettings,
    make_sweep_up,
    measure_all_cases,
    summarise_times,
    time_in_turn,
)

NAME = "benchmark_energies"
START = 0.9  # of the first resonance; with the whole length the sweep ends at 1.06
# pseudo periods
WHOLE = 1600.0
QUICK = 40.0
REPEATS = 40
QUICK_REPEATS = 3
STIFFNESS = 1e6  # N/m, of compliant walls


class EnergyCase(NamedTuple):
    """One line of the benchmark: the force is in N."""

    name: str
    absorber: StuckAbsorber | TunedAbsorber | SlidingAbsorber | SeveralAbsorbers | None
    force: float = 3.5
    modes: int = 10


CASES = (
    EnergyCase("e = 0.7, muN = 0.1 N", impact_absorber(restitution=0.7, friction_limit=0.1)),
    EnergyCase("e = 0, muN = 0.05 N", impact_absorber(restitution=0.0, friction_limit=0.05)),
    EnergyCase("e = 1", impact_absorber(), 5.0),
    EnergyCase("e = 1, 30 modes", impact_absorber(), 5.0, modes=30),
    EnergyCase(
        "two absorbers, e = 0.7, muN = 0.05 N",
        impact_absorbers((1e-3, 1e-3), (0.8, 1.0), 0.7, 0.05),
    ),
    EnergyCase("compliant walls", SlidingAbsorber(walls=CompliantWalls(STIFFNESS)), 5.0),
    EnergyCase(
        "compliant walls, elastic friction",
        SlidingAbsorber(walls=CompliantWalls(STIFFNESS), friction=ElasticCoulombFriction(0.1, 1e5)),
    ),
    EnergyCase("friction damper, muN = 0.3 N", friction_damper(0.3)),
    EnergyCase("no absorber", None, 5.0),
    EnergyCase("stuck absorber", StuckAbsorber(0.05), 5.0),
    EnergyCase("tuned absorber", TunedAbsorber(), 5.0),
)


def measure(case: EnergyCase, settings: TimingSettings, advance: Advance) -> Json:
    """Time both: times per pseudo period in us, medians and all repeats."""
    scene = beam_scene(Beam(modes=case.modes), case.absorber)
    periods = settings.periods
    drive = make_sweep_up(scene, case.force, START, periods)
    recorded, bare = (
        TimedRun(scene, drive, Exact(), record=record) for record in (Record(energy=True), Record())
    )
    response = recorded.run()
    runs = {
        "energies": lambda: recorded.run().wall_time / periods,
        "bare": lambda: bare.run().wall_time / periods,
    }
    times = summarise_times(time_in_turn(runs, settings.repeats, advance))
    return {
        "name": case.name,
        "pseudo_periods": periods,
        "stretches_per_period": response.steps / periods,
        **times,
        "balance": response.recorded.energy.relative_error,
        "ratio": times["energies_us"] / times["bare_us"],
    }


def table(cases: Sequence[Json]) -> str:
    """Return a line for each case."""
    columns = {
        "scene": "{name}",
        "stretches": "{stretches_per_period:.1f}",
        "bare, us": "{bare_us:.3g}",
        "with energies, us": "{energies_us:.3g}",
        "ratio": "{ratio:.2f}",
        "balance": "{balance:.0e}",
    }
    return format_table(columns, cases)


def _summary(measured: Measurement) -> str:
    cases = measured.values["cases"]
    repeats = measured.values["repeats"]
    periods = cases[0]["pseudo_periods"]
    return (
        f"{table(cases)}\n\n"
        f"Per pseudo period; medians of {repeats} runs of either kind, in turn, on one core, "
        "integration alone, compiled before. Sweep up\n"
        f"from {START:g} times the first resonance at {PAPER_RATE:g} % per 100 pseudo periods "
        f"over {periods:g} of them, 10 modes unless said.\n"
        "Bare: only the level is observed. A stretch lies between two events or two windows "
        "of the force. Balance: what work, losses and\n"
        "stored energy leave, over the largest."
    )


STUDY: Study[TimingSettings] = make_table_study(
    NAME,
    "price of an energy account",
    lambda settings: measure_all_cases(CASES, settings, measure),
    _summary,
)


@command()
@click.option(
    "--quick",
    is_flag=True,
    help=f"{QUICK_REPEATS} repeats of {QUICK:g} pseudo periods: a look, not a measurement.",
)
@click.option(
    "--repeats",
    type=click.IntRange(min=1),
    help=f"Runs of either kind, of which the median counts.  [default: {REPEATS}]",
)
@add_table_options(NAME, "docs/method.md")
def main(quick: bool, repeats: int | None, place: OutputPaths) -> None:
    """Time scenes of all kinds without and with an account of energies, and print a table.

    Run it on an otherwise idle machine. The first call compiles the kernels, up to a quarter of a
    minute a scene, which is not part of the times.
    """
    settings = TimingSettings(
        QUICK if quick else WHOLE, repeats or (QUICK_REPEATS if quick else REPEATS)
    )
    run(STUDY, settings, place)
