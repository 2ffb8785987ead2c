"""Speed of the exact method against the Moreau scheme at the paper's step: one core, one process, compilation apart."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import NamedTuple

from impact_env.drive import PAPER_RATE, Drive, linear_sweep
from impact_env.methods import PAPER_STEPS, Exact, Method, Moreau
from impact_env.parameters import Beam, impact_absorber
from impact_env.scene import Scene, beam_scene
from optimisation.progress import Bar
from optimisation.report.markdown import markdown
from optimisation.timing import Timed
from studies.one_table import table_study
from studies.study import Json, Measured

NAME = "benchmark"
START = 0.98  # of the first resonance; with the whole length the sweep ends at 1.06
WHOLE, QUICK = 800.0, 60.0  # pseudo periods
REPEATS, QUICK_REPEATS = 5, 1


class Settings(NamedTuple):
    """Pseudo periods of a run, and runs of each method."""

    periods: float
    repeats: int


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
        """What a table calls it."""
        friction = "" if self.friction_limit is None else f", muN = {self.friction_limit:g} N"
        return f"{self.modes} modes, {self.force:g} N, e = {self.restitution:g}{friction}"

    def scene(self) -> Scene:
        """Return the scene."""
        return beam_scene(Beam(modes=self.modes), impact_absorber(restitution=self.restitution, friction_limit=self.friction_limit))


CASES = (
    Case(3, 1.5, 1.0, None, 7.0),
    Case(10, 5.0, 1.0, None, 170.0),
    Case(30, 5.0, 1.0, None, 3000.0, moreau_periods=200.0),
    Case(10, 3.5, 0.7, 0.1, 185.0),
)


@dataclass(frozen=True)
class Times:
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
        """The exact method's median."""
        return statistics.median(self.exact_us_each)

    @property
    def moreau_us(self) -> float:
        """The Moreau scheme's median."""
        return statistics.median(self.moreau_us_each)

    @property
    def ratio(self) -> float:
        """How many times as fast the exact method is."""
        return self.moreau_us / self.exact_us

    @property
    def reference_ratio(self) -> float:
        """The same over the given time."""
        return self.case.reference_us / self.exact_us

    def values(self) -> dict[str, object]:
        """Return what the JSON file holds."""
        names = ("exact_us", "moreau_us", "ratio", "reference_ratio")
        return {"name": self.case.name, **asdict(self), **{name: getattr(self, name) for name in names}}


def measure(case: Case, periods: float, repeats: int, advance: Callable[[], object]) -> Times:
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
    impacts, events, evaluations = (count / periods for count in counts)
    return Times(case, periods, short, impacts, events, evaluations, tuple(times[0]), tuple(times[1]))


def table(cases: Sequence[Json]) -> str:
    """Return a line for each case."""
    header = ("case", "exact, us", "impacts", "events", "evaluations", "Moreau, us", "ratio", "reference Moreau, us", "ratio to it")
    rows = [
        (
            case["name"],
            f"{case['exact_us']:.3g}",
            f"{case['impacts_per_period']:.2f}",
            f"{case['events_per_period']:.1f}",
            f"{case['evaluations_per_period']:.0f}",
            f"{case['moreau_us']:.4g}",
            f"{case['ratio']:.1f}",
            f"{case['case']['reference_us']:g}",
            f"{case['reference_ratio']:.1f}",
        )
        for case in cases
    ]
    return markdown(header, rows)


def notes(cases: Sequence[Json], repeats: int) -> str:
    """Say how the times were taken."""
    periods = cases[0]["pseudo_periods"]
    return (
        f"All per pseudo period; median of {repeats} runs on one core, integration alone, compiled before. Sweep up from {START:g} times the first\n"
        f"resonance at {PAPER_RATE:g} % per 100 pseudo periods over {periods:g} of them. Events are impacts and reversals of the relative\n"
        f"velocity; an evaluation looks at eight times at once, or refines an event. The Moreau scheme has {PAPER_STEPS} steps per period of\n"
        "the highest mode and, with 30 modes, no more than the first 200 pseudo periods. The reference is a plain numba Moreau whose times\n"
        "are given, not measured here."
    )


def _measure(settings: Settings) -> Json:
    with Bar(total=settings.repeats * len(CASES), desc="timing", unit="repeat", leave=False) as bar:
        results = [measure(case, settings.periods, settings.repeats, bar.update) for case in CASES]
    return {"repeats": settings.repeats, "cases": [result.values() for result in results]}


def _said(measured: Measured) -> str:
    cases = measured.values["cases"]
    return f"{table(cases)}\n\n{notes(cases, measured.values['repeats'])}"


STUDY = table_study(NAME, "speed of the exact method", _measure, _said)
