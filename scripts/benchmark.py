"""Speed of the exact method against the Moreau scheme at the paper's step: one core, one process, compilation apart."""

from __future__ import annotations

import platform
import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import numba
from _command_line import check_target, plain_errors
from _table import markdown
from _timing import Timed
from tqdm import tqdm

from impact_env.drive import PAPER_RATE, Drive, linear_sweep
from impact_env.methods import PAPER_STEPS, Exact, Method, Moreau
from impact_env.parameters import Beam, impact_absorber
from impact_env.scene import Scene, beam_scene
from optimisation.files import write_json

START = 0.98  # of the first resonance; with the whole length the sweep ends at 1.06
WHOLE, QUICK = 800.0, 60.0  # pseudo periods
REPEATS, QUICK_REPEATS = 5, 1


@dataclass(frozen=True)
class Case:
    """One line of the benchmark; ``moreau_periods`` is what suffices to time a step that costs the same all along.

    ``reference_us`` is the given time per pseudo period in us of a plain numba Moreau at the same step on another machine: nothing measured here.
    """

    modes: int
    force: float
    restitution: float
    friction_limit: float | None
    reference_us: float
    moreau_periods: float = WHOLE

    @property
    def name(self) -> str:
        friction = "" if self.friction_limit is None else f", muN = {self.friction_limit:g} N"
        return f"{self.modes} modes, {self.force:g} N, e = {self.restitution:g}{friction}"

    def scene(self) -> Scene:
        return beam_scene(Beam(modes=self.modes), impact_absorber(restitution=self.restitution, friction_limit=self.friction_limit))


CASES = (
    Case(3, 1.5, 1.0, None, 7.0),
    Case(10, 5.0, 1.0, None, 170.0),
    Case(30, 5.0, 1.0, None, 3000.0, moreau_periods=200.0),
    Case(10, 3.5, 0.7, 0.1, 185.0),
)


@dataclass(frozen=True)
class Measured:
    """Times per pseudo period in us: medians, and all repeats in the order in which they were made."""

    case: Case
    pseudo_periods: float
    moreau_pseudo_periods: float
    impacts_per_period: float
    events_per_period: float
    evaluations_per_period: float
    exact_us_each: tuple[float, ...]
    moreau_us_each: tuple[float, ...]

    @property
    def exact_us(self) -> float:
        return statistics.median(self.exact_us_each)

    @property
    def moreau_us(self) -> float:
        return statistics.median(self.moreau_us_each)

    @property
    def ratio(self) -> float:
        return self.moreau_us / self.exact_us

    @property
    def reference_ratio(self) -> float:
        return self.case.reference_us / self.exact_us

    def values(self) -> dict[str, object]:
        """Return what the JSON file holds."""
        names = ("exact_us", "moreau_us", "ratio", "reference_ratio")
        return {"name": self.case.name, **asdict(self), **{name: getattr(self, name) for name in names}}


def measure(case: Case, periods: float, repeats: int, advance: Callable[[], object]) -> Measured:
    """Time both methods in turn, so that a machine that slows down meets both."""
    scene = case.scene()

    def prepared(method: Method, length: float) -> Timed:
        schedule = linear_sweep(scene.model.resonance_omega(1), START, START + length * PAPER_RATE / 1e4)
        return Timed(scene, Drive(case.force, schedule), method)

    short = min(periods, case.moreau_periods)
    exact, moreau = prepared(Exact(), periods), prepared(Moreau(), short)
    times: tuple[list[float], list[float]] = ([], [])
    counts = (0, 0, 0)
    for _ in range(repeats):
        response = exact.run()
        counts = (response.impact_count, response.steps, response.evaluations)
        times[0].append(1e6 * response.wall_time / periods)
        times[1].append(1e6 * moreau.run().wall_time / short)
        advance()
    return Measured(case, periods, short, *(count / periods for count in counts), tuple(times[0]), tuple(times[1]))


def table(results: Sequence[Measured]) -> str:
    header = ("case", "exact, us", "impacts", "events", "evaluations", "Moreau, us", "ratio", "reference Moreau, us", "ratio to it")
    rows = [
        (
            result.case.name,
            f"{result.exact_us:.3g}",
            f"{result.impacts_per_period:.2f}",
            f"{result.events_per_period:.1f}",
            f"{result.evaluations_per_period:.0f}",
            f"{result.moreau_us:.4g}",
            f"{result.ratio:.1f}",
            f"{result.case.reference_us:g}",
            f"{result.reference_ratio:.1f}",
        )
        for result in results
    ]
    return markdown(header, rows)


def notes(periods: float, repeats: int) -> str:
    return (
        f"All per pseudo period; median of {repeats} runs on one core, integration alone, compiled before. Sweep up from {START:g} times the first\n"
        f"resonance at {PAPER_RATE:g} % per 100 pseudo periods over {periods:g} of them. Events are impacts and reversals of the relative\n"
        f"velocity; an evaluation looks at eight times at once, or refines an event. The Moreau scheme has {PAPER_STEPS} steps per period of\n"
        "the highest mode and, with 30 modes, no more than the first 200 pseudo periods. The reference is a plain numba Moreau whose times\n"
        "are given, not measured here."
    )


def machine() -> dict[str, str]:
    return {"processor": numba.core.config.CPU_NAME or platform.processor() or platform.machine(), "numba": numba.__version__}


def run(periods: float, repeats: int) -> list[Measured]:
    with tqdm(total=repeats * len(CASES), desc="timing", unit="repeat", leave=False, disable=None) as bar:
        return [measure(case, periods, repeats, bar.update) for case in CASES]


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help=f"{QUICK_REPEATS} repeat of {QUICK:g} pseudo periods: a look, not a measurement.")
@click.option("--repeats", type=click.IntRange(min=1), help=f"Runs of each method, of which the median counts.  [default: {REPEATS}]")
@click.option("--json", "target", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write the results and every repeat.")
def main(quick: bool, repeats: int | None, target: Path | None) -> None:
    """Time the exact method and the Moreau scheme at the paper's step on the same sweeps, and print a table.

    Run it on an otherwise idle machine. The first call compiles the kernels, which is not part of the times.
    """
    check_target("--json", target)
    periods, repeats = QUICK if quick else WHOLE, repeats or (QUICK_REPEATS if quick else REPEATS)
    with plain_errors():
        results = run(periods, repeats)
    if target is not None:
        write_json(target, {"machine": machine(), "repeats": repeats, "cases": [result.values() for result in results]})
    click.echo(f"{table(results)}\n\n{notes(periods, repeats)}")


if __name__ == "__main__":
    main(prog_name="scripts/run benchmark")
