"""Where the best operating point goes with mass ratio and restitution, against the design rule: beyond the paper, which keeps the mass."""

from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from impact_env.curve import CurveCase, PerformanceCurve
from impact_env.modes import modal_model
from impact_env.parameters import Beam, RigidWalls, impact_absorber
from impact_env.scene import Scene
from optimisation.bounds import design_force, reach
from optimisation.gap_check import sweep_limits
from studies.paper.claim import MUCH, Claim, Verdict, judged
from studies.paper.frame import PaperFigure, Settings, in_turn, shortened
from studies.paper.style import LOOKS, REFERENCE, legends, line, panels
from studies.study import Json, Table

LABEL = "optimum"


class Sizes(NamedTuple):
    """Mass ratios, restitutions, forces over the rule's, and members."""

    masses: tuple[float, ...]
    restitutions: tuple[float, ...]
    factors: list[float]
    members: int


def _of_mass(mass: float, settings: Settings, size: Sizes) -> Json:
    model = modal_model(Beam())
    kilograms, gap = mass * model.beam_mass, RigidWalls.gap
    rule, limits = design_force(model, kilograms, gap), sweep_limits(model, kilograms)
    forces = rule * np.array(size.factors)
    scenes = [Scene(model), *(Scene(model, impact_absorber(gap, e, mass_ratio=mass)) for e in size.restitutions)]
    cases = [CurveCase(scene, forces, limits=limits) for scene in scenes]
    without, *curves = settings.curves(f"{LABEL}: mass {mass:g}", cases, size.members)
    rows = [_row(e, curve, without) for e, curve in zip(size.restitutions, curves, strict=True)]
    return {"mass": mass, "rule_n": rule, "reach": reach(model, kilograms), "forces_n": forces.tolist(), "rows": rows}


def _row(restitution: float, curve: PerformanceCurve, without: PerformanceCurve) -> Json:
    best, relative = curve.optimum(without), curve.relative_to(without)
    assert best is not None
    return {
        "restitution": restitution,
        "best_n": best.force,
        "best_band_n": list(best.force_band),
        "level": best.relative,
        "level_band": list(best.relative_band),
        "relative": np.median(relative, axis=1).tolist(),
        "nominal": relative[:, 0].tolist(),
    }


def rows_of(values: Json) -> list[Json]:
    """Return a row for each mass and restitution, with the best force over the rule's."""
    found = []
    for group in values.values():
        for row in group["rows"]:
            ratio = [x / group["rule_n"] for x in (row["best_n"], *row["best_band_n"])]
            at_rule = float(np.exp(np.interp(0, np.log(np.array(group["forces_n"]) / group["rule_n"]), np.log(row["relative"]))))
            single = int(np.argmin(row["nominal"]))
            nominal = [group["forces_n"][single] / group["rule_n"], row["nominal"][single]]  # best force over the rule's, and the level there
            own = {"mass": group["mass"], "reach": group["reach"], "rule_n": group["rule_n"]}
            found.append({**row, **own, "nominal_best": nominal, "ratio": ratio, "at_rule": at_rule})
    return found


def _table(values: Json) -> Table:
    header = ("mass ratio, %", "restitution", "rule's force, N", "best force, N", "best over rule's", "level there, %", "at the rule's, %")
    body = [
        (
            f"{100 * row['mass']:g}",
            f"{row['restitution']:g}",
            f"{row['rule_n']:.3g}",
            f"{row['best_n']:.3g}",
            f"{row['ratio'][0]:.2f} ({row['ratio'][1]:.2f} to {row['ratio'][2]:.2f})",
            f"{100 * row['level']:.1f} ({100 * row['level_band'][0]:.1f} to {100 * row['level_band'][1]:.1f})",
            f"{100 * row['at_rule']:.1f}",
        )
        for row in rows_of(values)
    ]
    return Table(f"{LABEL}_best", header, body)


def _summary(rows: list[Json]) -> str:
    """Say how far the best force lies from the rule's by mass ratio, and with which power of the mass both grow."""
    masses = sorted({row["mass"] for row in rows})
    said = []
    for mass in masses:
        own = [row["ratio"][0] for row in rows if row["mass"] == mass]
        said.append(f"{min(own):.2f} to {max(own):.2f} at {100 * mass:g} %")
    text = f"Best force over the rule's, all restitutions: {', '.join(said)}."
    if len(masses) > 1:
        powers = [_power([row for row in rows if row["restitution"] == e], "best_n") for e in sorted({row["restitution"] for row in rows})]
        best = f"{min(powers):.2f} to {max(powers):.2f}"
        text += f" The rule's force grows with the mass to the power {_power(rows, 'rule_n'):.2f}, the best one to {best}."
    return text


def _answer(values: Json) -> str:
    """Say in a line where the best force goes."""
    rows = rows_of(values)
    light, heavy = ([row["ratio"][0] for row in rows if row["mass"] == pick(row["mass"] for row in rows)] for pick in (min, max))
    return (
        f"Where the best operating point goes: with the mass as the design rule says, {min(light):.2f} to {max(light):.2f} times its force for the "
        f"lightest and {min(heavy):.2f} to {max(heavy):.2f} times for the heaviest absorber; restitution moves that of light ones only."
    )


def _power(rows: list[Json], name: str) -> float:
    """Return the slope of a force over the mass in logarithms, by least squares."""
    return float(np.polyfit(np.log([row["mass"] for row in rows]), np.log([row[name] for row in rows]), 1)[0])


def _claims(values: Json) -> list[Claim]:
    """Return what the paper takes as known of the mass, and what it says of restitution at the optimum."""
    rows = rows_of(values)
    heaviest = max(row["restitution"] for row in rows)
    by_mass = [(row["mass"], row["level"], row["level_band"]) for row in rows if row["restitution"] == heaviest]
    falls = all(after[1] < before[1] for before, after in pairwise(by_mass))
    lightest = by_mass[0]
    said = ", ".join(f"{100 * mass:g} %: {100 * level:.0f} ({100 * low:.0f} to {100 * high:.0f})" for mass, level, (low, high) in by_mass)
    light = (
        f"{100 * lightest[0]:g} %, e = {heaviest:g}: {100 * lightest[1]:.0f} ({100 * lightest[2][0]:.0f} to {100 * lightest[2][1]:.0f}) % of no "
        "absorber at its best force"
    )
    return [
        Claim("optimum_mass", "a heavier absorber is the more effective (known, and left out of the study)", "2",
              f"level at the best force in % of no absorber, e = {heaviest:g}, by mass ratio: {said}", Verdict.HOLDS if falls else Verdict.NOT, LABEL,
              "" if falls else "The level at the best force does not fall from each mass to the next."),
        Claim("optimum_light", "an absorber of less than 1 % without losses at its contact reduces the level considerably", "1", light,
              judged(lightest[2][0], lightest[2][1], 0.0, MUCH), LABEL, "Members differ."),
    ]  # fmt: skip


def _draw(values: Json) -> Figure:
    """Draw the best force over the rule's, and the level there, over the mass ratio: a line for each restitution."""
    figure, axes = panels(1, 2, 3.0)
    force, level = axes[0]
    rows = rows_of(values)
    for e, look in zip(sorted({row["restitution"] for row in rows}), LOOKS, strict=False):
        own = [row for row in rows if row["restitution"] == e]
        mass, ratio = [100 * row["mass"] for row in own], np.array([row["ratio"] for row in own])
        single = np.array([row["nominal_best"] for row in own])
        line(force, mass, ratio[:, 0], look, f"$e$ = {e:g}", band=(ratio[:, 1], ratio[:, 2]), nominal=single[:, 0])
        band = 100 * np.array([row["level_band"] for row in own])
        line(level, mass, [100 * row["level"] for row in own], look, band=(band[:, 0], band[:, 1]), nominal=100 * single[:, 1])
    force.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=1, label="design rule")
    force.set(xlabel="mass ratio in %", ylabel="best force over the rule's", ylim=(0, None))
    level.set(xlabel="mass ratio in %", ylabel="level there in % of no absorber", ylim=(0, None))
    legends([force])
    return figure


FIGURE = PaperFigure(
    LABEL, "where the best operating point goes with mass and restitution", draw=_draw, claims=_claims,
    words=lambda values: f"{shortened(_table(values))}\n\n{_summary(rows_of(values))}",
    answer=_answer, tables=lambda values: (_table(values),),
    measure=lambda settings, size, known: in_turn({f"mass {mass:g}": partial(_of_mass, mass, settings, size) for mass in size.masses}, known),
    sizes=(
        Sizes((0.005, 0.01, 0.02, 0.03, 0.05), (0.3, 0.5, 0.7, 0.85, 1.0), np.geomspace(0.4, 1.75, 21).tolist(), 10),
        Sizes((0.01, 0.02, 0.05), (0.5, 1.0), np.geomspace(0.5, 1.5, 6).tolist(), 3),
    ),
)  # fmt: skip
