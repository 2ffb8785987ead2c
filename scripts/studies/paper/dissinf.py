"""The figure `dissinf`: friction and restitution with ten modes.

It has performance curves and sweeps down at 5 N.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env import Moreau, Scene, beam_scene
from impact_env.curve import BAND, quantiles
from impact_env.ensemble import draw_members
from impact_env.parameters import Absorber, Beam, RigidWalls, friction_damper, impact_absorber
from optimisation.files import markdown
from studies.paper import curve as performance
from studies.paper.claim import (
    LITTLE,
    MUCH,
    SAME,
    Claim,
    ClaimVerdict,
    Interval,
    format_spread,
    judge_cases,
    judge_interval,
    make_claim,
    range_within,
)
from studies.paper.curve import LevelCurve
from studies.paper.frame import (
    MM,
    REFERENCE,
    STYLES,
    LineStyle,
    PaperFigure,
    PaperSettings,
    Size,
    draw_line,
    draw_signal,
    make_panels,
    measure_groups,
)
from studies.study import Array, Json, Steps

LABEL = "dissinf"
LIMITS = (0.1, 0.5, 1.0)  # N; the paper's own ones but for 0.1 N are not in its text
RESTITUTION = 0.7
# N: force and friction limit of the sweeps
SWEPT = 5.0
SWEPT_LIMIT = 0.5
NONE = "no absorber"
CONSERVATIVE = "muN = 0, e = 1"
DISSIPATIVE = f"muN = {LIMITS[0]:g} N, e = {RESTITUTION:g}"
SCATTERING = "scattering"
FRICTION = "friction"
BOTH = "friction and scattering"
ALL = "friction, scattering and e = 0.7"
# N: well inside of the ranges without friction, whose border is the paper's 3.5 N
PRIMARY = (1.0, 3.0)
SECONDARY = (4.0, 8.0)
APART_TOL = 1e-3  # of a level: curves that differ by less are one
ENVELOPE_PERIODS = 8  # pseudo periods of an envelope


def name_impacting(limit: float) -> str:
    """Return the name of the absorber with friction and conservative impacts."""
    return f"muN = {limit:g} N, e = 1"


def name_sliding(limit: float) -> str:
    """Return the name of the pure damper."""
    return f"damper, muN = {limit:g} N"


STEPPED = (CONSERVATIVE, name_impacting(LIMITS[0]), DISSIPATIVE)  # also run at the paper's step


def _scenes() -> dict[str, Scene]:
    absorbers: dict[str, Absorber | None] = {NONE: None, CONSERVATIVE: impact_absorber()}
    absorbers |= {name_impacting(limit): impact_absorber(friction_limit=limit) for limit in LIMITS}
    absorbers |= {name_sliding(limit): friction_damper(limit) for limit in LIMITS}
    absorbers[DISSIPATIVE] = impact_absorber(restitution=RESTITUTION, friction_limit=LIMITS[0])
    return {name: beam_scene(Beam(), absorber) for name, absorber in absorbers.items()}


def make_swept_scenes() -> dict[str, Scene]:
    """Return the scenes of the sweeps: what there is beside the first mode's own damping."""
    absorbers = {
        FRICTION: friction_damper(SWEPT_LIMIT),
        SCATTERING: impact_absorber(),
        BOTH: impact_absorber(friction_limit=SWEPT_LIMIT),
        ALL: impact_absorber(restitution=RESTITUTION, friction_limit=SWEPT_LIMIT),
    }
    return {name: beam_scene(Beam(), absorber) for name, absorber in absorbers.items()}


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    scenes = _scenes()
    groups: dict[str, Callable[[], object]] = {
        name: partial(_curve, settings, name, size.forces, size.members) for name in scenes
    }
    groups |= {
        f"step, {name}": partial(_curve, settings, name, size.forces, 1, Moreau())
        for name in STEPPED
    }
    groups |= {
        f"sweep, {name}": partial(_sweep, settings, scene, size.swept)
        for name, scene in make_swept_scenes().items()
    }
    return measure_groups(groups, earlier)


def _curve(
    settings: PaperSettings,
    name: str,
    forces: tuple[float, ...],
    members: int,
    method: Moreau | None = None,
) -> Json:
    return performance.compute_curves(
        settings, f"{LABEL}, {name}", {name: _scenes()[name]}, forces, members, method
    )[name]


def _sweep(settings: PaperSettings, scene: Scene, members: int) -> Json:
    """Return the envelope of |q_tip| in m of the sweeps down, and each member's largest value.

    The envelope is over frequency ratios.
    """
    drives = draw_members(members, settings.seed).drives(
        SWEPT, performance.make_both_sweeps(scene)[1]
    )
    own, rows = performance.compute_envelopes(
        settings, f"{LABEL}, sweeps", scene, drives, ENVELOPE_PERIODS
    )
    return own | {"largest": np.max(rows, axis=1).tolist()}


def find_first_impacts(own: LevelCurve) -> Array:
    """Return each member's lowest force in N with an impact, (M,); infinite if there is none."""
    result = own.impacts > 0
    return np.where(result.any(axis=0), own.forces[np.argmax(result, axis=0)], np.inf)


def find_forces_at(own: LevelCurve, level: float) -> Array:
    """Return the highest force in N at which each member's curve rises through a level, (M,).

    The ``level`` is in m. Between forces the curve is interpolated on logarithmic axes.

    NaN where it does not.
    """
    x = np.log(own.forces)
    y = np.log(own.level / level)
    result = np.full(y.shape[1], np.nan)
    for m, row in enumerate(y.T):
        rising = np.flatnonzero((row[:-1] < 0) & (row[1:] >= 0))
        if len(rising):
            k = int(rising[-1])
            result[m] = np.exp(x[k] - row[k] * (x[k + 1] - x[k]) / (row[k + 1] - row[k]))
    return result


def _describe(values: Json) -> str:
    none = performance.read_curve(values[NONE])
    rows = []
    at = none.nearest(SWEPT)
    for name in _scenes():
        if name != NONE:
            own = performance.read_curve(values[name])
            first = float(np.median(find_first_impacts(own)))
            rows.append(
                (
                    name,
                    f"{first:.2f}" if np.isfinite(first) else "none",
                    *performance.describe_best(own, none),
                    format_spread(own.relative(none)[at]),
                )
            )
    header = (
        "",
        "first impacts from, N",
        "best force, N",
        "over no absorber there",
        f"at {SWEPT:g} N",
    )
    lines = [
        (name, format_spread(1e3 * np.array(values[f"sweep, {name}"]["largest"])))
        for name in make_swept_scenes()
    ]
    swept = markdown(
        (f"down at {SWEPT:g} N, muN = {SWEPT_LIMIT:g} N", "largest displacement, mm"), lines
    )
    return (
        f"Ten modes, {none.level.shape[1]} members, {len(none.forces)} "
        f"forces.\n\n{markdown(header, rows)}\n\n{swept}"
    )


def _within(own: LevelCurve, other: LevelCurve, span: tuple[float, float]) -> Array:
    """Return level over another curve's at the forces of a span in N, by member, as one row."""
    inside = (own.forces >= span[0]) & (own.forces <= span[1])
    return (own.level[inside] / other.level[inside]).ravel()


def _dampers(values: Json) -> list[Claim]:
    read = {name: performance.read_curve(values[name]) for name in _scenes()}
    none = read[NONE]
    small = LIMITS[0]
    large = LIMITS[-1]
    relative = {limit: read[name_sliding(limit)].relative(none) for limit in LIMITS}
    ends = np.concatenate([relative[large][0], relative[small][-1]])
    least = np.concatenate([np.min(one, axis=0) for one in relative.values()])
    best = np.array(
        [performance.find_best_forces(read[name_sliding(limit)], none) for limit in LIMITS]
    )
    first = np.array(
        [find_first_impacts(read[name]) for name in (CONSERVATIVE, *map(name_impacting, LIMITS))]
    )
    forces, begins = (", ".join(f"{np.median(row):.2g}" for row in rows) for rows in (best, first))
    judge = partial(make_claim, LABEL, small=small, large=large)
    return [
        judge("dissinf_damper_ends", ends, low=none.forces[0], high=none.forces[-1]),
        judge("dissinf_damper_best", least),
        judge("dissinf_damper_moves", (best[1:] / best[:-1]).ravel(), forces=forces),
        judge("dissinf_first_impacts", (first[1:] / first[:-1]).ravel(), forces=begins),
        _judge_departure(read),
        judge(
            "dissinf_damper_before",
            best[0] / performance.find_best_forces(read[name_impacting(small)], none),
        ),
    ]


def _judge_departure(read: dict[str, LevelCurve]) -> Claim:
    """Judge whether the curve with impacts leaves that of friction alone at the first impacts.

    Each friction limit is a case.
    """
    cases = []
    before = []
    texts = []
    for limit in LIMITS:
        own = read[name_impacting(limit)]
        off = np.abs(np.median(own.level / read[name_sliding(limit)].level, axis=1) - 1)
        first = float(np.median(find_first_impacts(own)))
        at = float(off[own.nearest(first)])
        before.append(float(np.max(off[own.forces < first])))
        apart = before[-1] < APART_TOL < at
        cases.append(ClaimVerdict.HOLDS if apart else ClaimVerdict.NOT)
        texts.append(f"{at:.1%} at {first:.2f} N ({limit:g} N)")
    return make_claim(
        LABEL,
        "dissinf_departs",
        judge_cases(cases),
        before=max(before),
        each=", ".join(texts),
    )


def _judge_shapes(values: Json) -> Claim:
    """Judge whether absorber and damper have a linear range, a minimum and a rise after it."""
    none = performance.read_curve(values[NONE])
    cases = []
    texts = []
    for name, own_name in (("absorber", DISSIPATIVE), ("damper", name_sliding(SWEPT_LIMIT))):
        relative = np.median(performance.read_curve(values[own_name]).relative(none), axis=1)
        first, best, last = (float(x) for x in (relative[0], np.min(relative), relative[-1]))
        cases += [
            judge_interval(first, first, *range_within(SAME)),
            judge_interval(best, best, 0.0, MUCH),
            judge_interval(best / last, best / last, 0.0, MUCH),
        ]
        texts.append(f"{first:.2f}, {best:.2f}, {last:.2f} ({name})")
    return make_claim(LABEL, "dissinf_similar", judge_cases(cases), each="; ".join(texts))


def _absorbers(values: Json) -> list[Claim]:
    read = {name: performance.read_curve(values[name]) for name in _scenes()}
    step = {name: performance.read_curve(values[f"step, {name}"]) for name in STEPPED}
    few = name_impacting(LIMITS[0])
    many = name_impacting(LIMITS[-1])
    (ended, begun), (end, begin) = (
        (find_forces_at(read[name], RigidWalls.gap), find_first_impacts(read[name]))
        for name in (CONSERVATIVE, few)
    )
    first, last = (f"{low:g} to {high:g} N" for low, high in (PRIMARY, SECONDARY))
    every = (PRIMARY[0], SECONDARY[1])
    text_values = Json(first=first, last=last, small=LIMITS[0], large=LIMITS[-1])
    larger = ", ".join(
        (
            f"{format_spread(_within(read[name_impacting(limit)], read[CONSERVATIVE], every))} "
            f"with {limit:g} N"
        )
        for limit in LIMITS[1:]
    )

    def over(
        name: str,
        one: str,
        other: str,
        span: tuple[float, float],
        stepped: bool = True,
        **more: Any,
    ) -> Claim:
        """Judge the level of one curve over another within a span of forces."""
        at_step = float(np.median(_within(step[one], step[other], span))) if stepped else None
        return make_claim(
            LABEL,
            f"dissinf_{name}",
            _within(read[one], read[other], span),
            at_step=at_step,
            **text_values | more,
        )

    medians = Json(
        begin=np.median(begin), begun=np.median(begun), end=np.median(end), ended=np.median(ended)
    )
    return [
        over("small_primary", few, CONSERVATIVE, PRIMARY),
        make_claim(LABEL, "dissinf_shifted", end / np.median(ended), **medians),
        over("large_primary", many, CONSERVATIVE, PRIMARY, stepped=False),
        over(
            "large_secondary",
            many,
            CONSERVATIVE,
            SECONDARY,
            stepped=False,
            late=np.median(find_first_impacts(read[many])),
        ),
        over("restitution_secondary", DISSIPATIVE, few, SECONDARY),
        over("restitution_primary", DISSIPATIVE, few, PRIMARY),
        over("robust", few, CONSERVATIVE, every, low=every[0], high=every[1], larger=larger),
        _neither(read),
    ]


def _neither(read: dict[str, LevelCurve]) -> Claim:
    """Judge what friction does to the best level, by the least favourable of its limits."""
    best = [
        np.min(read[name].relative(read[NONE]), axis=0)
        for name in (CONSERVATIVE, *map(name_impacting, LIMITS))
    ]
    over = [row / np.median(best[0]) for row in best[1:]]
    low, high = (
        float(each(quantiles(row, BAND)[k] for row in over)) for k, each in ((0, min), (1, max))
    )
    each = ", ".join(
        f"{format_spread(row)} at {limit:g} N" for row, limit in zip(over, LIMITS, strict=True)
    )
    return make_claim(
        LABEL,
        "dissinf_neither",
        Interval(float(np.median(np.concatenate(over))), low, high),
        range_within(LITTLE),
        each=each,
        small=LIMITS[0],
    )


def _swept(values: Json) -> list[Claim]:
    largest = {name: np.array(values[f"sweep, {name}"]["largest"]) for name in make_swept_scenes()}
    alone = np.minimum(np.median(largest[SCATTERING]), np.median(largest[FRICTION]))
    return [
        make_claim(LABEL, "dissinf_added", largest[BOTH] / alone, swept=SWEPT),
        make_claim(
            LABEL, "dissinf_added_losses", largest[ALL] / np.median(largest[BOTH]), swept=SWEPT
        ),
    ]


def _draw(values: Json) -> Figure:
    """Draw the curves, and the sweeps below them."""
    figure, grid = make_panels(2, 1, 8.0)
    _curves(grid[0, 0], values)
    _sweeps(grid[1, 0], values)
    return figure


def _curves(axes: Axes, values: Json) -> None:
    """Draw the curves with impacts and those of friction alone.

    Both curves of a friction limit have one colour. The curves of friction alone are dashed.
    """
    read = {name: performance.read_curve(values[name]) for name in _scenes()}
    none = read[NONE]
    draw_line(axes, none.forces, MM * none.median, REFERENCE, NONE, marked=False)
    colours = [style.colour for style in STYLES[: len(LIMITS)]]
    impacting = {
        LineStyle(STYLES[5].colour, "-", "x"): (CONSERVATIVE, r"$\mu N$ = 0, $e$ = 1"),
        **{
            LineStyle(colour, "-", style.marker): (
                name_impacting(limit),
                rf"$\mu N$ = {limit:g} N, $e$ = 1",
            )
            for limit, colour, style in zip(LIMITS, colours, STYLES, strict=False)
        },
        LineStyle(STYLES[4].colour, "-", STYLES[4].marker): (
            DISSIPATIVE,
            rf"$\mu N$ = {LIMITS[0]:g} N, $e$ = {RESTITUTION:g}",
        ),
    }
    drawn = {}
    for style, (name, label) in impacting.items():
        drawn[style] = read[name]
        performance.draw_curve(axes, read[name], style, label)
    for limit, colour in zip(LIMITS, colours, strict=True):
        style = LineStyle(colour, (0, (4, 2)))
        own = read[name_sliding(limit)]
        drawn[style] = own
        first = limit == LIMITS[0]
        draw_signal(
            axes,
            own.forces,
            MM * own.median,
            style,
            "without impacts, same colour" if first else None,
            1.0,
        )
    performance.draw_inset(axes, (0.06, 0.58, 0.4, 0.34), none, drawn)
    performance.set_level_axes(axes, none, SECONDARY[1])
    axes.legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.12))


def _sweeps(axes: Axes, values: Json) -> None:
    for style, name in zip(STYLES, make_swept_scenes(), strict=False):
        own = values[f"sweep, {name}"]
        whole = {
            key: MM * np.array(own[key][:-1]) for key in ("low", "median", "high", "nominal")
        }  # but the last stretch, which is short
        band = (whole["low"], whole["high"])
        plain = LineStyle(style.colour, style.dashes)
        draw_line(
            axes,
            own["ratio"][:-1],
            whole["median"],
            plain,
            name,
            band=band,
            nominal=whole["nominal"],
        )
    axes.set(
        xlim=(0.9, 1.06),
        ylim=(0, None),
        xlabel="frequency over $\\omega_1$",
        ylabel=f"|tip displacement| in mm, down at {SWEPT:g} N",
    )
    axes.legend()


FIGURE = PaperFigure(
    LABEL,
    "friction and restitution",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=lambda values: [
        *_dampers(values),
        *_absorbers(values),
        *_swept(values),
        _judge_shapes(values),
    ],
    sizes=(  # swept: members of the sweeps
        Size(forces=performance.make_force_grid(0.1, 20.0, 28, (3.5, SWEPT)), members=12, swept=16),
        Size(forces=(0.1, 0.4, 0.8, 1.2, 2.0, 2.8, 3.5, 4.2, SWEPT, 8.0, 20.0), members=2, swept=2),
    ),
)
