"""The best force of an impact absorber over mass ratio and restitution, beyond the paper.

The best force is the force with the lowest level relative to the structure without absorber. It is
compared with the design force f*. The paper has only one mass ratio.
"""

from functools import partial
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from impact_env import Beam, CurveCase, RigidWalls, Scene, impact_absorber, modal_model
from impact_env.drive import PAPER_LIMITS
from optimisation.bounds import design_force, near_range, reach
from studies.paper.claim import (
    MUCH,
    Claim,
    format_interval,
    format_range,
    judge_interval,
    make_claim,
)
from studies.paper.frame import (
    REFERENCE,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_legends,
    draw_line,
    make_panels,
    measure_groups,
    shorten_table,
)
from studies.study import CsvTable, Json, not_none

LABEL = "optimum"


def _of_mass(mass: float, settings: PaperSettings, size: Size) -> Json:
    """Return the design force and the results of each restitution for a mass ratio.

    A row in ``rows`` has the best force in N, the relative level there, both with bands, and the
    relative levels over the forces (median, and first member).
    """
    model = modal_model(Beam())
    kilograms = mass * model.beam_mass
    gap = RigidWalls.gap
    rule = design_force(model, kilograms, gap)
    # the paper's range, extended downwards for a mass that lowers the resonance further
    limits = (min(PAPER_LIMITS[0], 0.97 * near_range(model, kilograms)[0]), PAPER_LIMITS[1])
    forces = rule * np.array(size.factors)
    scenes = [
        Scene(model),
        *(Scene(model, impact_absorber(gap, e, mass_ratio=mass)) for e in size.restitutions),
    ]
    without, *curves = settings.curves(
        f"{LABEL}: mass {mass:g}",
        [CurveCase(scene, forces, limits=limits) for scene in scenes],
        size.members,
    )
    rows = []
    for e, curve in zip(size.restitutions, curves, strict=True):
        best = not_none(curve.optimum(without))
        relative = curve.relative_to(without)
        at_best = {
            "best_n": best.force,
            "best_band_n": list(best.force_band),
            "level": best.relative,
            "level_band": list(best.relative_band),
        }
        rows.append(
            {
                "restitution": e,
                **at_best,
                "relative": np.median(relative, axis=1).tolist(),
                "nominal": relative[:, 0].tolist(),
            }
        )
    return {
        "mass": mass,
        "rule_n": rule,
        "reach": reach(model, kilograms),
        "forces_n": forces.tolist(),
        "rows": rows,
    }


def read_rows(values: Json) -> list[Json]:
    """Return a row for each mass ratio and restitution, from the results by mass ratio.

    ``ratio``: best force over the design force, with its band. ``at_rule``: relative level at the
    design force. ``nominal_best``: best force over the design force, and relative level there, of
    the first member.
    """
    result = []
    for group in values.values():
        over = np.array(group["forces_n"]) / group["rule_n"]
        for row in group["rows"]:
            ratio = [x / group["rule_n"] for x in (row["best_n"], *row["best_band_n"])]
            at_rule = float(np.exp(np.interp(0, np.log(over), np.log(row["relative"]))))
            single = int(np.argmin(row["nominal"]))
            nominal = [over[single], row["nominal"][single]]
            result.append(
                {**group, **row, "nominal_best": nominal, "ratio": ratio, "at_rule": at_rule}
            )
    return result


def _table(values: Json) -> CsvTable:
    """Return the table of best forces and levels, a row for each mass ratio and restitution."""
    header = (
        "mass ratio, %",
        "restitution",
        "rule's force, N",
        "best force, N",
        "best over rule's",
        "level there, %",
        "at the rule's, %",
    )
    body = [
        (
            f"{100 * row['mass']:g}",
            f"{row['restitution']:g}",
            f"{row['rule_n']:.3g}",
            f"{row['best_n']:.3g}",
            format_interval(*row["ratio"]),
            format_interval(row["level"], *row["level_band"], form="{:.1f}", factor=100),
            f"{100 * row['at_rule']:.1f}",
        )
        for row in read_rows(values)
    ]
    return CsvTable(f"{LABEL}_best", header, body)


def _summary(rows: list[Json]) -> str:
    """Return a text on the ratio of best force to design force, by mass ratio.

    It ends with the exponents of the power laws by which the two forces grow with the mass.
    """
    masses, restitutions = (sorted({row[name] for row in rows}) for name in ("mass", "restitution"))
    text = [
        (
            f"{format_range([row['ratio'][0] for row in rows if row['mass'] == mass], '{:.2f}')} "
            f"at {100 * mass:g} %"
        )
        for mass in masses
    ]
    powers = [
        _power([row for row in rows if row["restitution"] == e], "best_n") for e in restitutions
    ]
    return (
        f"Best force over the rule's, all restitutions: {', '.join(text)}. The rule's force "
        "grows with the mass to the power "
        f"{_power(rows, 'rule_n'):.2f}, the best one to {format_range(powers, '{:.2f}')}."
    )


def _answer(values: Json) -> str:
    """Return a sentence on how the best force changes with mass ratio and restitution."""
    rows = read_rows(values)
    masses = [group["mass"] for group in values.values()]
    light, heavy = (
        format_range([row["ratio"][0] for row in rows if row["mass"] == pick(masses)], "{:.2f}")
        for pick in (min, max)
    )
    return (
        f"Where the best operating point goes: with the mass as the design rule says, {light} "
        f"times its force for the lightest and {heavy} times for "
        "the heaviest absorber; restitution moves that of light ones only."
    )


def _power(rows: list[Json], name: str) -> float:
    """Return the exponent of the power law of a force (``name``) over the mass ratio.

    It is fitted to the logarithms by least squares.
    """
    return float(
        np.polyfit(np.log([row["mass"] for row in rows]), np.log([row[name] for row in rows]), 1)[0]
    )


def _claims(values: Json) -> list[Claim]:
    """Return the verdicts on the level at the best force, for the largest restitution.

    The claims are that the relative level falls with the mass ratio, and that it is below `MUCH`
    for the lightest absorber.
    """
    rows = read_rows(values)
    e = max(row["restitution"] for row in rows)
    own = [row for row in rows if row["restitution"] == e]
    falls = all(after["level"] < before["level"] for before, after in pairwise(own))
    light = own[0]
    low, high = light["level_band"]
    levels = {
        row["mass"]: format_interval(row["level"], *row["level_band"], form="{:.0f}", factor=100)
        for row in own
    }
    return [
        make_claim(
            LABEL,
            "optimum_mass",
            falls,
            e=e,
            each=", ".join(f"{100 * mass:g} %: {level}" for mass, level in levels.items()),
        ),
        make_claim(
            LABEL,
            "optimum_light",
            judge_interval(low, high, 0.0, MUCH),
            e=e,
            mass=light["mass"],
            level=levels[light["mass"]],
        ),
    ]


def _draw(values: Json) -> Figure:
    """Draw the best force over the design force, and the relative level there, over the mass ratio.

    Each restitution has a line.
    """
    figure, axes = make_panels(1, 2, 3.0)
    force, level = axes[0]
    rows = read_rows(values)
    for e, style in zip(sorted({row["restitution"] for row in rows}), STYLES, strict=False):
        own = [row for row in rows if row["restitution"] == e]
        mass = [100 * row["mass"] for row in own]
        single = np.array([row["nominal_best"] for row in own]).T
        middle, low, high = np.array([row["ratio"] for row in own]).T
        draw_line(force, mass, middle, style, f"$e$ = {e:g}", band=(low, high), nominal=single[0])
        middle, low, high = 100 * np.array([(row["level"], *row["level_band"]) for row in own]).T
        draw_line(level, mass, middle, style, band=(low, high), nominal=100 * single[1])
    force.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=1, label="design rule")
    force.set(xlabel="mass ratio in %", ylabel="best force over the rule's", ylim=(0, None))
    level.set(xlabel="mass ratio in %", ylabel="level there in % of no absorber", ylim=(0, None))
    draw_legends([force])
    return figure


FIGURE = PaperFigure(
    LABEL,
    "where the best operating point goes with mass and restitution",
    draw=_draw,
    claims=_claims,
    describe=lambda values: f"{shorten_table(_table(values))}\n\n{_summary(read_rows(values))}",
    answer=_answer,
    tables=lambda values: (_table(values),),
    measure=lambda settings, size, earlier: measure_groups(
        {f"mass {mass:g}": partial(_of_mass, mass, settings, size) for mass in size.masses}, earlier
    ),
    sizes=(  # ``factors``: forces over the design force
        Size(
            masses=(0.005, 0.01, 0.02, 0.03, 0.05),
            restitutions=(0.3, 0.5, 0.7, 0.85, 1.0),
            factors=np.geomspace(0.4, 1.75, 21).tolist(),
            members=10,
        ),
        Size(
            masses=(0.01, 0.02, 0.05),
            restitutions=(0.5, 1.0),
            factors=np.geomspace(0.5, 1.5, 6).tolist(),
            members=3,
        ),
    ),
)
