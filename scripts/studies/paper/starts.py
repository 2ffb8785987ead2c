"""The level from random starts, beyond the paper.

The absorber starts anywhere in its cavity, and the force at any frequency.

The paper begins each sweep at one frequency with the absorber in the middle, and calls that
conservative.
"""

from functools import partial

import numpy as np
from matplotlib.figure import Figure

from impact_env import Beam, InitialState, RigidWalls, Scene, beam_scene, impact_absorber, simulate
from impact_env.drive import PAPER_LIMITS, Drive, linear_sweep
from impact_env.ensemble import Lane, draw_members
from studies.paper.claim import (
    SAME,
    Claim,
    ClaimVerdict,
    compute_bands,
    format_interval,
    format_range,
    make_claim,
)
from studies.paper.frame import (
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_band,
    draw_legends,
    make_panels,
    measure_groups,
    shorten_table,
)
from studies.study import Array, CsvTable, Json

LABEL = "starts"
CHOICES = ("paper's", "position", "frequency", "both")  # what is drawn at random


def make_scenes() -> dict[str, Scene]:
    """Return the absorbers by name.

    They are the paper's best, one without losses, and the paper's case of one mode whose level is
    that of the first impacts.
    """
    return {
        "10 modes, e = 0.7, 0.1 N": beam_scene(
            Beam(), impact_absorber(restitution=0.7, friction_limit=0.1)
        ),
        "10 modes, e = 1": beam_scene(Beam(), impact_absorber()),
        "1 mode, e = 0.75": beam_scene(Beam(modes=1), impact_absorber(restitution=0.75)),
    }


def compute_level_from(lane: Lane) -> float:
    """Return the response level in m of a lane with a state of its own."""
    return simulate(lane.scene, lane.drive, initial=lane.initial).recorded.level.value


def _of_scene(scene: Scene, settings: PaperSettings, size: Size) -> Json:
    """Return all levels from random starts.

    Positions are uniform in the cavity, and the first frequencies of sweeps uniform from the
    paper's limits to the resonance.
    """
    forces = size.forces
    number = size.members
    members = draw_members(number, settings.seed)
    generator = np.random.default_rng([settings.seed, 15])
    low, high = PAPER_LIMITS
    place = generator.uniform(-1, 1, number)
    first_up = generator.uniform(low, 1.0, number)
    first_down = generator.uniform(1.0, high, number)
    lanes = []
    for choice in CHOICES:
        places = RigidWalls.gap * place if choice in ("position", "both") else np.zeros(number)
        first = (
            np.column_stack([first_up, first_down])
            if choice in ("frequency", "both")
            else np.tile([low, high], (number, 1))
        )
        for force in forces:
            for m in range(number):
                for start, stop in zip(first[m].tolist(), (high, low), strict=True):
                    schedule = linear_sweep(scene.model.resonance_omega(1), start, stop)
                    drive = Drive(
                        force * float(members.factors[m]), schedule, float(members.phases[m])
                    )
                    lanes.append(
                        Lane(
                            scene,
                            drive,
                            initial=InitialState(absorber_displacement=float(places[m])),
                        )
                    )
    levels = (
        np.array(settings.each(LABEL, lanes, compute_level_from))
        .reshape(len(CHOICES), len(forces), number, 2)
        .max(axis=-1)
    )
    return {"forces_n": list(forces), "levels_m": dict(zip(CHOICES, levels.tolist(), strict=True))}


def read_relative(group: Json, choice: str) -> Array:
    """Return the levels of a choice over the median of the paper's choice, (F, M)."""
    paper = np.median(np.array(group["levels_m"][CHOICES[0]]), axis=1)
    return np.asarray(np.array(group["levels_m"][choice]) / paper[:, None])


def _table(values: Json) -> CsvTable:
    rows = []
    for name, group in values.items():
        result = [compute_bands(read_relative(group, choice))[[1, 0, 2]].T for choice in CHOICES]
        rows += [
            (name, f"{force:g}", *(format_interval(*own[k]) for own in result))
            for k, force in enumerate(group["forces_n"])
        ]
    return CsvTable(f"{LABEL}_levels", ("absorber", "force, N", *CHOICES), rows)


def _describe(values: Json) -> str:
    blocks = [
        (
            "Level over the median of the paper's start, median (5 to 95 %) of the members; what "
            "is named is drawn at random."
        )
    ]
    blocks.append(shorten_table(_table(values)))
    for choice in CHOICES[1:]:
        ratios = _ratios(values, choice, 1)
        top = max(_ratios(values, choice, 2))
        text = " to ".join("{:.2f} ({}, {:g} N)".format(*x) for x in (min(ratios), max(ratios)))
        blocks.append(
            f"Random {choice}: medians {text} times the paper's, 95 % quantiles up to "
            f"{top[0]:.2f} ({top[1]}, {top[2]:g} N)."
        )
    return "\n\n".join(blocks)


def _claims(values: Json) -> list[Claim]:
    """Return whether the centred start is the conservative one."""
    ratios = _ratios(values, "position", 1)
    worst, *_ = max(ratios)
    top, name, force = max(_ratios(values, "position", 2))
    middles = " to ".join("{:.2f} ({}, {:g} N)".format(*one) for one in (min(ratios), max(ratios)))
    verdict = (
        ClaimVerdict.HOLDS
        if max(worst, top) < 1 + SAME
        else ClaimVerdict.SPREAD
        if worst < 1 + SAME
        else ClaimVerdict.NOT
    )
    return [
        make_claim(
            LABEL, "starts_position", verdict, middles=middles, top=top, name=name, force=force
        )
    ]


def _answer(values: Json) -> str:
    """Return a line on the level from random starts."""
    text = format_range([ratio for ratio, *_ in _ratios(values, "both", 1)], "{:.2f}")
    return (
        f"Random starts: place and frequency at random give {text} times the median level of the "
        "paper's start."
    )


def _ratios(values: Json, choice: str, quantile: int) -> list[tuple[float, str, float]]:
    """Return a quantile relative to that of the paper's start, with absorber and force in N.

    ``quantile`` is 0, 1 or 2 of `compute_bands`.
    """
    result = []
    for name, group in values.items():
        own, paper = (
            compute_bands(read_relative(group, each))[quantile] for each in (choice, CHOICES[0])
        )
        result += [
            (float(x), name, force) for x, force in zip(own / paper, group["forces_n"], strict=True)
        ]
    return result


def _draw(values: Json) -> Figure:
    """Draw the level relative to that of the paper's start, over the force.

    Each absorber has a panel.
    """
    figure, axes = make_panels(1, len(values), 2.9, sharey=True)
    for panel, (absorber, group) in zip(axes[0], values.items(), strict=True):
        forces = group["forces_n"]
        for choice, style in zip(CHOICES, STYLES, strict=False):
            paper = choice == CHOICES[0]  # whose first member is the paper's run: others are drawn
            draw_band(
                panel,
                forces,
                read_relative(group, choice),
                style,
                f"{choice} start" if paper else f"random: {choice}",
                nominal=paper,
            )
        panel.set(xscale="log", xlabel="force in N")
        visible = [
            x for k, x in enumerate(forces) if x >= 1.4 * forces[k - 1] or k % 2 == 0
        ]  # others would overlap
        panel.set_xticks(forces, [f"{x:g}" if x in visible else "" for x in forces])
        panel.minorticks_off()
        panel.set_title(absorber, loc="right")
    axes[0, 0].set(ylabel="level over the paper's start", ylim=(0, None))
    draw_legends([axes[0, 0]])
    return figure


FIGURE = PaperFigure(
    LABEL,
    "random starts",
    describe=_describe,
    draw=_draw,
    claims=_claims,
    answer=_answer,
    measure=lambda settings, size, earlier: measure_groups(
        {name: partial(_of_scene, scene, settings, size) for name, scene in make_scenes().items()},
        earlier,
    ),
    tables=lambda values: (_table(values),),
    sizes=(
        Size(forces=(0.6, 0.8, 1.0, 1.5, 2.5, 3.5, 5.0, 10.0), members=16),
        Size(forces=(0.8, 1.5, 3.5, 5.0), members=4),
    ),
)
