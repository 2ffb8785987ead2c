"""Amount of computation, and scenes of the work-precision diagrams with their initial states.

The initial states are taken from a running motion, so that errors and times are those of impacts.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env import InitialState, Record, Scene, beam_scene, simulate
from impact_env.drive import PAPER_RATE, Drive, FrequencySchedule, linear_sweep
from impact_env.laws import SceneKind
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.parameters import (
    Absorber,
    Beam,
    CompliantWalls,
    SlidingAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)
from optimisation.checkpoint import sources
from studies.study import Array, Measurement

MODES = (1, 3, 10, 30)
START = 0.95  # of the first resonance
# pseudo periods from rest until the first case of a scene starts, and between two of them
RUN_IN = 40.0
APART = 6.3
STATIC = Beam().static_tip_stiffness
BARE = Record(level=False)
RECORD = Record(
    level=False, events=True, series=True, energy=True
)  # one set of observers, so that each kernel is compiled once


@dataclass(frozen=True)
class SceneGroup:
    """A scene for any number of modes, at a force in N."""

    name: str
    absorber: Callable[[], Absorber | None]
    force: float


KINDS = (
    SceneGroup("no absorber", lambda: None, 5.0),
    SceneGroup("tuned absorber (LTVA)", TunedAbsorber, 5.0),
    SceneGroup("friction damper", friction_damper, 3.5),
    SceneGroup("impact, e = 1", impact_absorber, 5.0),
    SceneGroup("impact, e = 0.7", lambda: impact_absorber(restitution=0.7), 5.0),
    SceneGroup(
        "impact, e = 0.7, with friction",
        lambda: impact_absorber(restitution=0.7, friction_limit=0.1),
        3.5,
    ),
    SceneGroup("compliant walls, soft", lambda: SlidingAbsorber(walls=CompliantWalls(STATIC)), 5.0),
    SceneGroup(
        "compliant walls, stiff", lambda: SlidingAbsorber(walls=CompliantWalls(1e4 * STATIC)), 5.0
    ),
)


def kind_named(name: str) -> SceneGroup:
    """Return the kind of this name."""
    return next(kind for kind in KINDS if kind.name == name)


@dataclass(frozen=True, eq=False)
class AccuracyCase:
    """A scene with initial conditions taken from a running motion.

    ``omega`` (rad/s) and ``phase`` (rad) are those of the force at the start.
    """

    kind: SceneGroup
    scene: Scene
    initial: InitialState
    omega: float
    phase: float

    @property
    def modes(self) -> int:
        """Number of modes."""
        return self.scene.model.modes

    @property
    def period(self) -> float:
        """A pseudo period in s."""
        return self.scene.model.pseudo_period()

    @property
    def weights(self) -> Array:
        """Weights of the squares of a state's components in the energy norm.

        The absorber's position is weighted as if a spring gave the absorber the first resonance
        frequency.
        """
        omega = self.scene.model.omega
        mass = self.scene.absorber_mass or 0.0
        return np.concatenate([omega**2, [mass * omega[0] ** 2], np.ones(self.modes), [mass]])

    def drive(self, periods: float) -> Drive:
        """Return the drive that continues from the start for ``periods`` pseudo periods.

        It sweeps at the paper's rate.
        """
        reference = self.scene.model.resonance_omega(1)
        rise = periods * PAPER_RATE / 1e4 * reference
        schedule = FrequencySchedule(
            np.array([0.0, periods * self.period]),
            np.array([self.omega, self.omega + rise]),
            reference,
        )
        return Drive(self.kind.force, schedule, self.phase)

    def methods(self, steps: tuple[int, ...]) -> list[Method]:
        """Return the methods that can compute the scene.

        ``steps`` are numbers of steps per period of the highest mode, and per contact.
        """
        compliant = isinstance(self.scene.absorber, SlidingAbsorber) and isinstance(
            self.scene.absorber.walls, CompliantWalls
        )
        result: list[Method] = [Exact()]
        if not compliant:
            result += [Moreau(count) for count in steps]
        if compliant or self.scene.kind is SceneKind.LINEAR:
            result += [RungeKutta(count, count) for count in steps]
        return result


def method_name(method: Method, scene: Scene) -> str:
    """Return a method's name in tables and figures."""
    if isinstance(method, Exact):
        return "closed form" if scene.kind is SceneKind.LINEAR else "Exact"
    return type(method).__name__ if isinstance(method, Moreau) else "Runge-Kutta"


@lru_cache(maxsize=256)
def case(kind: SceneGroup, modes: int, number: int = 0) -> AccuracyCase:
    """Return a case that starts where its absorber moves freely, after a run-in.

    The run-in uses the exact method. A larger ``number`` gives a later start.
    """
    scene = beam_scene(Beam(modes=modes), kind.absorber())
    reference = scene.model.resonance_omega(1)
    period = 2 * np.pi / reference
    for k in range(40):
        periods = RUN_IN + APART * number + 0.137 * k
        schedule = linear_sweep(reference, START, START + periods * PAPER_RATE / 1e4)
        state = simulate(scene, Drive(kind.force, schedule), record=BARE).end_state
        initial = InitialState(
            state[:modes], state[modes + 1 : 2 * modes + 1], float(state[modes]), float(state[-1])
        )
        if _moves_freely(scene, state):
            phase = float(np.mod(schedule.phase_at(periods * period), 2 * np.pi))
            return AccuracyCase(kind, scene, initial, float(schedule.omegas[-1]), phase)
    raise RuntimeError(f"{kind.name}, {modes} modes: the absorber is never found in free motion")


def _moves_freely(scene: Scene, state: np.ndarray) -> bool:
    absorber = scene.absorber
    n = scene.model.modes
    tip = scene.model.tip_shape
    if not isinstance(absorber, SlidingAbsorber):
        return True
    y = state[n] - tip @ state[:n]
    gamma = state[-1] - tip @ state[n + 1 : 2 * n + 1]
    slides = abs(gamma) > 1e-3 * abs(state[-1])
    inside = absorber.walls is None or abs(y) < 0.9 * absorber.walls.gap
    return bool(slides and inside)


Row = dict[str, Any]
Cases = Mapping[
    Any, Callable[[], list[Row]]
]  # functions that measure rows, by what tells these from others


@dataclass(frozen=True)
class AccuracySettings:
    """Amount of computation of the accuracy study.

    ``steps`` are per period of the highest mode. Sweep rates are in pseudo periods per 1 % of the
    resonance frequency.
    """

    modes: tuple[int, ...] = (1, 3, 10, 30)
    kinds: tuple[str, ...] = ()  # empty: all
    steps: tuple[int, ...] = (20, 40, 100, 200, 400, 1000, 2000, 4000, 10000, 20000)
    peers: bool = True
    scipy_tolerances: tuple[float, ...] = (1e-6, 1e-9, 1e-12)
    heyoka_tolerances: tuple[float, ...] = (1e-9, 1e-15)
    starts: int = 5  # places in the motion over whose errors the median is taken
    repeats: int = 5
    timed_seconds: float = 0.05  # wanted length of a timed run
    patience: float = (
        2.0  # no further repeat of a run once its repeats have taken this many seconds
    )
    sweep: tuple[float, float] = (0.92, 1.0)  # of the ensembles, times the first resonance
    sweep_steps: tuple[int, ...] = (20, 80, 320)
    truth_members: int = 64
    members: int = 32
    budget: float = 8.0  # seconds for the ensemble of one method
    band_members: int = 200
    band_phases: int = 20
    band_repeats: int = 10
    stretches: int = 200
    twins: int = 12
    jump_rates: tuple[float, ...] = (100.0, 200.0, 400.0, 725.0, 1450.0)
    jump_steps: tuple[int, ...] = (20, 60, 200)
    jump_members: int = 60
    cost_modes: tuple[int, ...] = (1, 2, 3, 5, 7, 10, 14, 20, 30, 40, 50, 60)
    cost_lanes: tuple[int, ...] = (1, 4, 16, 64, 256, 1024)
    cost_periods: tuple[int, ...] = (10, 100, 1000, 10_000, 100_000)
    seed: int = 0
    quick: bool = False

    def scenes_and_modes(self, names: Iterable[str]) -> list[tuple[str, int]]:
        """Yield each of the selected scenes with each number of modes."""
        return [
            (name, modes)
            for name in names
            if not self.kinds or name in self.kinds
            for modes in self.modes
        ]


FULL = AccuracySettings()
QUICK = AccuracySettings(
    quick=True,
    modes=(3, 10),
    kinds=(
        "no absorber",
        "impact, e = 1",
        "impact, e = 0.7, with friction",
        "compliant walls, stiff",
    ),
    steps=(20, 200, 2000),
    scipy_tolerances=(1e-9,),
    heyoka_tolerances=(1e-15,),
    starts=3,
    repeats=3,
    timed_seconds=0.02,
    patience=0.5,
    sweep_steps=(20, 80),
    truth_members=16,
    members=12,
    budget=1.5,
    band_members=20,
    band_phases=5,
    band_repeats=4,
    stretches=40,
    twins=4,
    jump_rates=(100.0, 200.0),
    jump_steps=(20, 60),
    jump_members=12,
    cost_modes=(1, 3, 10, 30),
    cost_lanes=(1, 16, 64),
    cost_periods=(10, 100, 1000),
)


# What tables and figures of the study share: looks, and numbers in words.


# Okabe and Ito's colours, and a marker as well
LOOKS = {
    "Exact": ("#0072B2", "o"),
    "closed form": ("#0072B2", "o"),
    "Moreau": ("#D55E00", "s"),
    "Runge-Kutta": ("#009E73", "^"),
    "SciPy": ("#CC79A7", "v"),
    "heyoka": ("#E69F00", "D"),
}
COLOURS = ("#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#777777")
MARKERS = "osD^vPX*"


def number(value: float | None, digits: int = 2) -> str:
    """Return a number as text with ``digits`` significant digits, an empty text for None."""
    return "" if value is None else f"{value:.{digits}g}"


MODES_ON_PAGE = 10  # a page shows these alone, where they were measured; figures and files have all


def select_page_rows(rows: list[Row]) -> list[Row]:
    """Return the rows that are on the page."""
    return [row for row in rows if row["modes"] == MODES_ON_PAGE] or rows


def named(row: Row) -> str:
    """Return a row's method with its setting."""
    if row["setting"] is None:
        return str(row["method"])
    return f"{row['method']}, {row['setting']:g}" + (
        " steps" if row["method"] in ("Moreau", "Runge-Kutta") else ""
    )


def made_with(measured: Measurement) -> str:
    """Return a sentence with the date, machine and versions of a measured part."""
    words = f"{sources(measured.conditions)} {measured.conditions['wall_s']:g} s."
    if measured.conditions["quick"]:
        words += " A quick look: few cases and runs."
    return words if measured.complete else words + " Stopped early: what was finished."


def plain(panel: Axes, ticks: list[float]) -> None:
    """Write the ticks of an axis as plain numbers."""
    panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.minorticks_off()


def choose_cells(
    rows: list[Row], chosen: Iterable[tuple[str, int]], most: int = 4
) -> list[tuple[str, int]]:
    """Return at most ``most`` pairs of scene and number of modes that the rows contain.

    They are the ``chosen`` pairs that occur in the rows, or, if none does, the first pairs of the
    rows.
    """
    known = unique((row["scene"], row["modes"]) for row in rows)
    return [cell for cell in chosen if cell in known][:most] or known[:most]


def panel_grid(cells: list[tuple[str, int]], share: bool = False) -> tuple[Figure, Any]:
    """Return a figure with two titled panels in a row, and the panels.

    Each scene with its number of modes has a panel.
    """
    rows = -(-len(cells) // 2)
    figure = Figure(figsize=(8.4, 1.6 + 2.6 * rows), layout="constrained")
    panels = figure.subplots(rows, 2, squeeze=False, sharex=share, sharey=share)
    for panel, (scene, count) in zip(panels.flat, cells, strict=False):
        panel.set_title(f"{scene}, {count} mode{'s' * (count > 1)}", fontsize=10)
    for panel in panels.flat[len(cells) :]:
        panel.remove()
    return figure, panels


def label_edges(panels: Any, below: str, left: str) -> None:
    """Label the panels of the last row below, and those of the first column on their left."""
    for panel in panels[-1]:
        panel.set_xlabel(below)
    for panel in panels[:, 0]:
        panel.set_ylabel(left)


def unique(values: Iterable[Any]) -> list[Any]:
    """Return the values without repetition, in the order in which they appear."""
    return list(dict.fromkeys(values))
