"""How the level changes when nobody chose the start: the absorber anywhere in its cavity, the force beginning at any frequency. Beyond the paper.

The paper begins each sweep at one frequency with the absorber in the middle, and calls that conservative.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.curve import BAND, quantiles
from impact_env.drive import PAPER_LIMITS, Drive, linear_sweep
from impact_env.ensemble import Lane, draw_members
from impact_env.parameters import Beam, RigidWalls, impact_absorber
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import simulate
from studies.paper.claim import SAME, Claim, Verdict
from studies.paper.frame import PaperFigure, Settings, in_turn, shortened
from studies.paper.style import LOOKS, legends, line, panels
from studies.study import Json, Table

LABEL = "starts"
CHOICES = ("paper's", "position", "frequency", "both")  # what is drawn at random
Array = NDArray[np.float64]


def scenes() -> dict[str, Scene]:
    """Return the absorbers, by name: the paper's best, one without losses, and its case of one mode whose level is that of the first impacts."""
    return {
        "10 modes, e = 0.7, 0.1 N": beam_scene(Beam(), impact_absorber(restitution=0.7, friction_limit=0.1)),
        "10 modes, e = 1": beam_scene(Beam(), impact_absorber()),
        "1 mode, e = 0.75": beam_scene(Beam(modes=1), impact_absorber(restitution=0.75)),
    }


@dataclass(frozen=True, eq=False)
class Start(Lane):
    """A lane that begins with the absorber beside the middle of its cavity: ``displacement`` in m."""

    displacement: float


class Sizes(NamedTuple):
    """Forces in N, and members."""

    forces: tuple[float, ...]
    members: int


def level_from(lane: Lane) -> float:
    """Return the response level in m of a `Start`."""
    assert isinstance(lane, Start)
    level = simulate(lane.scene, lane.drive, initial=InitialState(absorber_displacement=lane.displacement)).level
    assert level is not None
    return level.value


def _of_scene(scene: Scene, settings: Settings, size: Sizes) -> Json:
    """Return all levels: places are uniform in the cavity, first frequencies of sweeps uniform from the paper's limits to the resonance."""
    forces, number = size
    members, generator, (low, high) = draw_members(number, settings.seed), np.random.default_rng([settings.seed, 15]), PAPER_LIMITS
    place, first_up, first_down = generator.uniform(-1, 1, number), generator.uniform(low, 1.0, number), generator.uniform(1.0, high, number)
    lanes = []
    for choice in CHOICES:
        places = RigidWalls.gap * place if choice in ("position", "both") else np.zeros(number)
        first = np.column_stack([first_up, first_down]) if choice in ("frequency", "both") else np.tile([low, high], (number, 1))
        for force in forces:
            for m in range(number):
                for start, stop in ((first[m, 0], high), (first[m, 1], low)):
                    schedule = linear_sweep(scene.model.resonance_omega(1), float(start), stop)
                    drive = Drive(force * float(members.factors[m]), schedule, float(members.phases[m]))
                    lanes.append(Start(scene, drive, float(places[m])))
    levels = np.array(settings.each(LABEL, lanes, level_from)).reshape(len(CHOICES), len(forces), number, 2).max(axis=-1)
    return {"forces_n": list(forces), "levels_m": dict(zip(CHOICES, levels.tolist(), strict=True))}


def relative(group: Json, choice: str) -> Array:
    """Return the levels of a choice over the median of the paper's choice, (F, M)."""
    paper = np.median(np.array(group["levels_m"][CHOICES[0]]), axis=1)
    return np.asarray(np.array(group["levels_m"][choice]) / paper[:, None])


def bands(group: Json, choice: str) -> Array:
    """Return 5, 50 and 95 % of `relative` over the members, (3, F)."""
    return quantiles(relative(group, choice), (BAND[0], 0.5, BAND[1]))


def _table(values: Json) -> Table:
    header = ("absorber", "force, N", *CHOICES)
    rows = []
    for name, group in values.items():
        found = {choice: bands(group, choice) for choice in CHOICES}
        for k, force in enumerate(group["forces_n"]):
            cells = [f"{found[choice][1, k]:.2f} ({found[choice][0, k]:.2f} to {found[choice][2, k]:.2f})" for choice in CHOICES]
            rows.append((name, f"{force:g}", *cells))
    return Table(f"{LABEL}_levels", header, rows)


def _words(values: Json) -> str:
    text = "Level over the median of the paper's start, median (5 to 95 %) of the members; what is named is drawn at random."
    return "\n\n".join([text, shortened(_table(values)), *(_summary(values, choice) for choice in CHOICES[1:])])


def _summary(values: Json, choice: str) -> str:
    low, high = min(_ratios(values, choice, 1)), max(_ratios(values, choice, 1))
    said = " to ".join(f"{x:.2f} ({name}, {force:g} N)" for x, name, force in (low, high))
    top = max(_ratios(values, choice, 2))
    return f"Random {choice}: medians {said} times the paper's, 95 % quantiles up to {top[0]:.2f} ({top[1]}, {top[2]:g} N)."


def _claims(values: Json) -> list[Claim]:
    """Return whether the centred start is the conservative one."""
    worst, name, force = max(_ratios(values, "position", 1))
    top, top_name, top_force = max(_ratios(values, "position", 2))
    holds = max(worst, top) < 1 + SAME
    verdict = Verdict.HOLDS if holds else Verdict.SPREAD if worst < 1 + SAME else Verdict.NOT
    least, least_name, least_force = min(_ratios(values, "position", 1))
    middles = f"{least:.2f} ({least_name}, {least_force:g} N) to {worst:.2f} ({name}, {force:g} N)"
    said = f"level from a random place over that from the middle: medians {middles}, 95 % quantiles up to {top:.2f}"
    why = f"From a random place the 95 % quantile of the members is up to {top:.2f} times that from the middle ({top_name}, {top_force:g} N)."
    statement = "the absorber in the middle of its cavity is the conservative start"
    return [Claim("starts_position", statement, "3.3", said, verdict, LABEL, "" if holds else why)]


def _answer(values: Json) -> str:
    """Say in a line what a start that nobody chose does."""
    worst, best = (max(_ratios(values, "both", 1))[0], min(_ratios(values, "both", 1))[0])
    return f"Starts that nobody chose: place and frequency at random give {best:.2f} to {worst:.2f} times the median level of the paper's start."


def _ratios(values: Json, choice: str, quantile: int) -> list[tuple[float, str, float]]:
    """Return a quantile (0, 1, 2 of `bands`) over that of the paper's start, with absorber and force in N."""
    found = []
    for name, group in values.items():
        row = bands(group, choice)[quantile] / bands(group, CHOICES[0])[quantile]
        found += [(float(x), name, force) for x, force in zip(row, group["forces_n"], strict=True)]
    return found


def _draw(values: Json) -> Figure:
    """Draw the level over that of the paper's start, over the force, in a panel for each absorber."""
    figure, axes = panels(1, len(values), 2.9, sharey=True)
    for panel, (absorber, group) in zip(axes[0], values.items(), strict=True):
        for choice, look in zip(CHOICES, LOOKS, strict=False):
            low, middle, high = bands(group, choice)
            name = f"{choice} start" if choice == CHOICES[0] else f"random: {choice}"
            own = relative(group, choice)[:, 0] if choice == CHOICES[0] else None  # the paper's run: others are drawn
            line(panel, group["forces_n"], middle, look, name, band=(low, high), nominal=own)
        panel.set(xscale="log", xlabel="force in N")
        shown = [x for k, x in enumerate(group["forces_n"]) if x >= 1.4 * group["forces_n"][k - 1] or k % 2 == 0]  # others would overlap
        panel.set_xticks(group["forces_n"], [f"{x:g}" if x in shown else "" for x in group["forces_n"]])
        panel.minorticks_off()
        panel.set_title(absorber, loc="right")
    axes[0, 0].set(ylabel="level over the paper's start", ylim=(0, None))
    legends([axes[0, 0]])
    return figure


FIGURE = PaperFigure(
    LABEL, "starts that nobody chose", words=_words, draw=_draw, claims=_claims, answer=_answer,
    measure=lambda settings, size, known: in_turn({name: partial(_of_scene, scene, settings, size) for name, scene in scenes().items()}, known),
    tables=lambda values: (_table(values),), sizes=(Sizes((0.6, 0.8, 1.0, 1.5, 2.5, 3.5, 5.0, 10.0), 16), Sizes((0.8, 1.5, 3.5, 5.0), 4)),
)  # fmt: skip
