"""Where the best operating point goes with mass ratio and restitution, against the design rule: beyond the paper, which keeps the mass."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from impact_env.curve import CurveCase, PerformanceCurve
from impact_env.modes import modal_model
from impact_env.parameters import Beam, RigidWalls, impact_absorber
from impact_env.scene import Scene
from optimisation.bounds import design_force, reach
from optimisation.gap_check import sweep_limits
from studies.paper.claim import Claim, Verdict, judged
from studies.paper.frame import figure_part, in_turn, shortened
from studies.paper.settings import Settings
from studies.paper.tolerances import MUCH
from studies.study import Json, Measured, Saver, Steps, Table

LABEL = "optimum"
MASSES, QUICK_MASSES = (0.005, 0.01, 0.02, 0.03, 0.05), (0.01, 0.02, 0.05)
RESTITUTIONS, QUICK_RESTITUTIONS = (0.3, 0.5, 0.7, 0.85, 1.0), (0.5, 1.0)
FACTORS, QUICK_FACTORS = np.geomspace(0.4, 1.75, 21), np.geomspace(0.5, 1.5, 6)  # of the rule's force: 8 and 25 % apart
MEMBERS = (10, 3)


def parameters(settings: Settings) -> Json:
    """Return what the numbers depend on."""
    return {
        "masses": settings.size(MASSES, QUICK_MASSES),
        "restitutions": settings.size(RESTITUTIONS, QUICK_RESTITUTIONS),
        "factors": settings.size(FACTORS, QUICK_FACTORS).tolist(),
        "members": settings.size(*MEMBERS),
    }


def measure(settings: Settings, known: Json) -> Steps:
    """Yield, mass by mass, the relative levels over the force for each restitution, and the best force of each member."""
    return in_turn({f"mass {mass:g}": partial(_of_mass, mass, settings) for mass in settings.size(MASSES, QUICK_MASSES)}, known)


def _of_mass(mass: float, settings: Settings) -> Json:
    model = modal_model(Beam())
    kilograms, gap = mass * model.beam_mass, RigidWalls.gap
    rule, limits = design_force(model, kilograms, gap), sweep_limits(model, kilograms)
    restitutions = settings.size(RESTITUTIONS, QUICK_RESTITUTIONS)
    forces = rule * settings.size(FACTORS, QUICK_FACTORS)
    scenes = [Scene(model), *(Scene(model, impact_absorber(gap, e, mass_ratio=mass)) for e in restitutions)]
    without, *curves = settings.curves(
        f"{LABEL}: mass {mass:g}", [CurveCase(scene, forces, limits=limits) for scene in scenes], settings.size(*MEMBERS)
    )
    rows = [_row(e, curve, without) for e, curve in zip(restitutions, curves, strict=True)]
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


def _words(values: Json) -> str:
    return f"{shortened(_table(values))}\n\n{_summary(rows_of(values))}"


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


def answer(measured: Measured) -> str:
    """Say in a line where the best force goes."""
    rows = rows_of(measured.values)
    light, heavy = ([row["ratio"][0] for row in rows if row["mass"] == pick(row["mass"] for row in rows)] for pick in (min, max))
    return (
        f"Where the best operating point goes: with the mass as the design rule says, {min(light):.2f} to {max(light):.2f} times its force for the "
        f"lightest and {min(heavy):.2f} to {max(heavy):.2f} times for the heaviest absorber; restitution moves that of light ones only."
    )


def _power(rows: list[Json], name: str) -> float:
    """Return the slope of a force over the mass in logarithms, by least squares."""
    return float(np.polyfit(np.log([row["mass"] for row in rows]), np.log([row[name] for row in rows]), 1)[0])


def figures(measured: Measured) -> Mapping[str, Saver]:
    """Return what draws the figure."""
    from studies.paper.figures import optimum as drawn  # matplotlib is slow to import

    return {LABEL: lambda path: drawn.save(Path(path), measured.values)}


def claims(measured: Measured) -> list[Claim]:
    """Return what the paper takes as known of the mass, and what it says of restitution at the optimum."""
    rows = rows_of(measured.values)
    heaviest = max(row["restitution"] for row in rows)
    by_mass = [(row["mass"], row["level"], row["level_band"]) for row in rows if row["restitution"] == heaviest]
    falls = all(after[1] < before[1] for before, after in pairwise(by_mass))
    lightest = by_mass[0]
    said = ", ".join(f"{100 * mass:g} %: {100 * level:.0f} ({100 * low:.0f} to {100 * high:.0f})" for mass, level, (low, high) in by_mass)
    return [
        Claim(
            "optimum_mass",
            "a heavier absorber is the more effective (known, and left out of the study)",
            "2",
            f"level at the best force in % of no absorber, e = {heaviest:g}, by mass ratio: {said}",
            Verdict.HOLDS if falls else Verdict.NOT,
            LABEL,
            "" if falls else "The level at the best force does not fall from each mass to the next.",
        ),
        Claim(
            "optimum_light",
            "an absorber of less than 1 % without losses at its contact reduces the level considerably",
            "1",
            f"{100 * lightest[0]:g} %, e = {heaviest:g}: {100 * lightest[1]:.0f} ({100 * lightest[2][0]:.0f} to {100 * lightest[2][1]:.0f}) % of no "
            "absorber at its best force",
            judged(lightest[2][0], lightest[2][1], 0.0, MUCH),
            LABEL,
            "Members differ.",
        ),
    ]


PART = figure_part(LABEL, "where the best operating point goes with mass and restitution", measure, _words, figures, lambda values: (_table(values),))
