"""Effect of impact absorbers under loads other than one force.

The loads are forces at both resonances at once, random forces, gravity, shocks and other starts.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from operator import itemgetter
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env import (
    Drive,
    InitialState,
    ModalModel,
    Scene,
    impact_absorbers,
    linear_sweep,
    modal_model,
)
from impact_env.drive import Excitation
from impact_env.ensemble import Lane, draw_members, drives_of, each_lane, run_lanes
from impact_env.loads import Loads, Tone, Tones
from impact_env.parameters import RigidWalls, SlidingAbsorber, friction_law, impact_absorber
from optimisation.absorber_rules import scaled_friction
from optimisation.bounds import design_gap
from optimisation.cli.common import command
from optimisation.files import DOCS, markdown, publication_folder
from optimisation.signals import band_levels
from studies import load_spectra as spectra
from studies.load_spectra import (
    CASES,
    GAP,
    MASS_RATIO,
    RESTITUTION,
    LoadCase,
    SpectrumSettings,
    band_text,
)
from studies.study import (
    Array,
    Json,
    Measurement,
    OutputPaths,
    Part,
    Saver,
    Study,
    add_sources,
    make_rows_part,
    run,
)

LIMITS = (0.92, 1.04)  # of the sweeps, times a resonance
SHARES = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.35, 0.5, 0.75, 1.0)
REMEDIED = (0.2, 0.5, 1.0)  # shares at which remedies are tried
SEARCHED = 3  # members by which the best of a remedy is chosen; others judge it
GAP_FACTORS = tuple(np.geomspace(0.5, 8.0, 9).tolist())
FEW_GAPS = (1.0 * GAP, 2.0 * GAP, 4.0 * GAP)  # at which friction and restitution are tried
FRICTIONS = (0.5, 1.0, 2.0, 4.0, 8.0)  # times the paper's by the scaling law
RESTITUTIONS = (0.2, 0.45, 0.9, 1.0)
ASIDE = (0.5, 0.7, 1.0, 1.4, 2.0)  # of a place's own gap by the rule
WEIGHTS = (0.0, 0.05, 0.15, 0.5)  # g over gap times the first frequency squared
FACTORS = tuple(np.geomspace(0.1, 3.2, 11).tolist())  # of the design force
DIRECTIONS = {
    "ratio": (0.9, 1.06),
    "down": (1.06, 0.9),
}  # of sweeps, by the name of what they leave


def orders(case: LoadCase, share: float) -> Loads:
    """Return both forces as orders of one schedule, the higher one times a share."""
    omega = case.model.omega
    tones = (
        Tone(case.forces[0], order=1.0),
        Tone(share * case.forces[1], order=float(omega[1] / omega[0])),
    )
    return Loads((Tones(tones, schedule=linear_sweep(float(omega[0]), *LIMITS)),))


Variant = tuple[str, Scene]


def _measure_levels(scene: Scene, drives: Sequence[Excitation]) -> Array:
    """Return the levels in both bands under each drive, (drives, 2)."""
    result = each_lane([Lane(scene, drive) for drive in drives], band_levels)
    if None in result:
        raise KeyboardInterrupt
    return np.array(result, dtype=np.float64)


def _row(
    case: LoadCase, group: str, variant: Variant, share: float, drives: Sequence[Excitation]
) -> Json:
    """Return the relative level in both frequency bands.

    Without absorber the motion is linear and equal for all members except for phases, so one member
    suffices.
    """
    free = _measure_levels(Scene(case.model), drives[:1])[0]
    ratio = np.round(_measure_levels(variant[1], drives) / free, 4)
    own = {"structure": case.name, "group": group, "variant": variant[0], "share": share}
    higher = ratio[:, 1].tolist() if share > 0 else None
    return own | {
        "free_over_gap": (free / GAP).tolist(),
        "lower": ratio[:, 0].tolist(),
        "higher": higher,
    }


def both_rows(case: LoadCase, group: str, settings: SpectrumSettings) -> list[Json]:
    """Return the relative level of each variant of a group.

    Of a group of remedies, each variant has a few members. The best one runs again with other
    members, and its row has the number of variants tried as ``judged``.
    """
    variants = GROUPS[group](case)[:: 4 if settings.quick else 1]
    rows = []
    members = draw_members(SEARCHED + settings.members, 0)
    for share in SHARES if group == "share" else REMEDIED:
        drives = drives_of(members, orders(case, share))
        if group != "share":
            tried = [_row(case, group, variant, share, drives[:SEARCHED]) for variant in variants]
            best = min(range(len(tried)), key=lambda k: _cost(tried[k]))
            rows += [
                *tried,
                _row(case, group, variants[best], share, drives[SEARCHED:])
                | {"judged": len(tried)},
            ]
        else:
            rows.append(_row(case, group, variants[0], share, drives[SEARCHED:]) | {"judged": 1})
    return rows


def _with_gaps(
    model: ModalModel,
    gaps: Sequence[float],
    word: str = "",
    restitution: float = RESTITUTION,
    friction: float | None = None,
) -> list[Variant]:
    return [
        (
            f"{word}gap {1e3 * gap:.2g} mm",
            Scene(model, impact_absorber(gap, restitution, friction, MASS_RATIO)),
        )
        for gap in gaps
    ]


def _frictions(case: LoadCase) -> list[Variant]:
    result = []
    for factor in FRICTIONS:
        limit = factor * scaled_friction(case.model, case.mass, GAP)
        result += _with_gaps(case.model, FEW_GAPS, f"friction {limit:.2g} N, ", friction=limit)
    return result


def _places(case: LoadCase) -> list[Variant]:
    """Return absorbers from the second mode's node to where the absorber was."""
    result = []
    for place in np.linspace(case.node, case.beam.absorber_position, 5)[:-1]:
        gap = design_gap(case.at(place), case.mass, case.forces[0], 1)
        result += _with_gaps(
            case.at(place), [factor * gap for factor in ASIDE], f"at {place:.3f}, "
        )
    return result


def _halves(case: LoadCase) -> list[Variant]:
    """Return pairs of absorbers of half the mass.

    In one kind of pair both are at the same place. In the other, one is at the second mode's node
    and one at the place of the original absorber.
    """
    own = case.beam.absorber_position
    result = []
    wide = design_gap(case.at(case.node), case.mass / 2, case.forces[0], 1)
    narrow = design_gap(case.model, case.mass / 2, case.forces[1], 2)
    pairs = [
        ((own, own), (first * GAP, second * GAP))
        for first, second in combinations(GAP_FACTORS[::2], 2)
    ]
    pairs += [
        ((case.node, own), (first * wide, second * narrow))
        for first in ASIDE[1:4]
        for second in ASIDE
    ]
    for places, gaps in pairs:
        label = (
            "side by side" if places[0] == places[1] else f"at {places[0]:.3f} and {places[1]:g}"
        )
        absorber = impact_absorbers(
            gaps=gaps,
            positions=places,
            mass_ratio=MASS_RATIO,
            shares=(0.5, 0.5),
            restitution=RESTITUTION,
        )
        text = f"two halves {label}, gaps {1e3 * gaps[0]:.2g} and {1e3 * gaps[1]:.2g} mm"
        result.append((text, Scene(case.at(*places), absorber)))
    return result


GROUPS: dict[str, Callable[[LoadCase], list[Variant]]] = {
    "share": lambda case: _with_gaps(case.model, [GAP]),
    "gap": lambda case: _with_gaps(case.model, [factor * GAP for factor in GAP_FACTORS]),
    "friction": _frictions,
    "restitution": lambda case: [
        one
        for e in RESTITUTIONS
        for one in _with_gaps(case.model, FEW_GAPS, f"restitution {e:g}, ", restitution=e)
    ],
    "place": _places,
    "halves": _halves,
    "modes": lambda case: _with_gaps(
        modal_model(replace(case.beam, modes=2 * spectra.MODES)),
        FEW_GAPS,
        f"{2 * spectra.MODES} modes, ",
    ),
}


def _ratios(
    case: LoadCase,
    absorber: SlidingAbsorber,
    start: str | InitialState,
    settings: SpectrumSettings,
    row: Json,
) -> list[Json]:
    """Return the members' relative levels for each factor of the design force.

    Levels are relative to those without absorber, for sweeps up (``ratio``) and ``down``.
    """
    rows = []
    for factor in FACTORS[:: 4 if settings.quick else 1]:
        ratios = {}
        for name, limits in DIRECTIONS.items():
            loads = Loads(
                (
                    Drive(
                        factor * case.forces[0],
                        linear_sweep(float(case.model.omega[0]), *limits),
                    ),
                )
            )
            drives = drives_of(draw_members(settings.members, 0), replace(loads, start=start))
            result = run_lanes(
                [
                    Lane(Scene(case.model), loads),
                    *(Lane(Scene(case.model, absorber), drive) for drive in drives),
                ]
            )
            if not result.complete:
                raise KeyboardInterrupt
            ratios[name] = (result.level[1:] / result.level[0]).tolist()
        rows.append({"structure": case.name, **row, "factor": factor, **ratios})
    return rows


def _sliding(
    case: LoadCase, restitution: float, friction: float, gravity: float = 0.0
) -> SlidingAbsorber:
    """Return an absorber with so many times the paper's friction by the scaling law."""
    limit = friction * scaled_friction(case.model, case.mass, GAP)
    return SlidingAbsorber(MASS_RATIO, RigidWalls(GAP, restitution), friction_law(limit), gravity)


def gravity_rows(case: LoadCase, weight: float, settings: SpectrumSettings) -> list[Json]:
    """Return levels over the force for an absorber that starts on its lower wall.

    The rows are for the absorber without and with friction.

    ``weight``: gravity as a share of gap times the first frequency squared.
    """
    gravity = weight * GAP * float(case.model.omega[0]) ** 2
    start = "lower-wall" if weight > 0 else "middle"
    rows = list[Json]()
    for friction in (0.0, 1.0):
        row = {"weight": weight, "gravity_m_s2": gravity, "friction": friction}
        rows += _ratios(case, _sliding(case, RESTITUTION, friction, gravity), start, settings, row)
    return [row | {"force_n": row["factor"] * case.forces[0]} for row in rows]


STARTS = ("middle", "lower-wall", "bouncing")
WALLS = (
    (1.0, 0.0),
    (RESTITUTION, 0.0),
    (RESTITUTION, 1.0),
)  # restitution, and friction over the paper's by the scaling law


def start_rows(case: LoadCase, start: str, settings: SpectrumSettings) -> list[Json]:
    """Return levels over the force for one kind of initial conditions.

    With "bouncing" the absorber crosses its cavity in half a period.
    """
    state = (
        InitialState(absorber_velocity=2 * GAP * float(case.model.omega[0]) / np.pi)
        if start == "bouncing"
        else start
    )
    rows = []
    for restitution, friction in WALLS:
        row = {"start": start, "restitution": restitution, "friction": friction}
        rows += _ratios(case, _sliding(case, restitution, friction), state, settings, row)
    return rows


def _of(rows: Sequence[Json], **settings: object) -> list[Json]:
    """Return the rows with these values."""
    return [row for row in rows if all(row[name] == value for name, value in settings.items())]


def _cost(row: Json) -> tuple[float, float]:
    """Return the larger of both medians, in whole percent, and their sum."""
    medians = float(np.median(row["lower"])), float(np.median(row["higher"]))
    return round(max(medians), 2), sum(medians)


def both_text(rows: Sequence[Json]) -> str:
    """Return a table over the share of the higher force, and one of the best remedies.

    The second table has the best variant of each remedy at some shares. The best has the smallest
    value of the larger of the two relative levels.
    """
    shares = [
        (
            row["structure"],
            f"{row['share']:g}",
            f"{row['free_over_gap'][1]:.2f}",
            band_text(row["lower"]),
            band_text(row["higher"]),
        )
        for row in _of(rows, group="share")
    ]
    remedies = []
    for structure in CASES:
        for share in REMEDIED:
            for best in (
                row for row in _of(rows, structure=structure, share=share) if "judged" in row
            ):
                words = (
                    f"{best['variant']}, best of {best['judged']}"
                    if best["group"] != "share"
                    else f"as it is, {best['variant']}"
                )
                remedies.append(
                    (
                        structure,
                        f"{share:g}",
                        words,
                        band_text(best["lower"]),
                        band_text(best["higher"]),
                    )
                )
    first = markdown(
        (
            "structure",
            "share of the higher force",
            "free level there / gap",
            "lower band",
            "higher band",
        ),
        shares,
    )
    return (
        first
        + "\n\n"
        + markdown(("structure", "share", "remedy", "lower band", "higher band"), remedies)
    )


def _over_force(rows: Sequence[Json], names: tuple[str, ...]) -> str:
    """Return a line for each series, with the members' median at each factor of the force.

    Factors are relative to the design force. The line also has the factor at which a sweep down
    differs most.
    """
    factors = sorted({row["factor"] for row in rows})
    series: dict[tuple[Any, ...], dict[float, tuple[float, float]]] = {}
    for row in rows:
        medians = float(np.median(row["ratio"])), float(np.median(row["down"]))
        series.setdefault(tuple(row[name] for name in ("structure", *names)), {})[row["factor"]] = (
            medians
        )
    lines = []
    for key, result in series.items():
        most = max(factors, key=lambda factor: abs(result[factor][1] - result[factor][0]))
        name = ", ".join(f"{part:g}" if isinstance(part, float) else str(part) for part in key)
        lines.append(
            [
                name,
                *(f"{result[f][0]:.2f}" for f in factors),
                f"{result[most][1]:.2f} at {most:.2g}",
            ]
        )
    return markdown(
        (", ".join(("structure", *names)), *(f"{factor:.2g}" for factor in factors), "down"), lines
    )


# part: title, what measures its rows, the name and the values that tell them apart, and what puts
# them into words
PARTS: dict[
    str,
    tuple[
        str,
        Callable[[LoadCase, Any, SpectrumSettings], list[Json]],
        str,
        Sequence[Any],
        Callable[[Sequence[Json]], str],
    ],
] = {
    "loads_both": ("both resonances at once", both_rows, "group", tuple(GROUPS), both_text),
    "loads_random": (
        "random loads",
        spectra.random_rows,
        "number",
        range(len(spectra.VARIANTS)),
        spectra.random_text,
    ),
    "loads_gravity": (
        "gravity along the absorber's motion",
        gravity_rows,
        "weight",
        WEIGHTS,
        partial(_over_force, names=("weight", "friction")),
    ),
    "loads_shock": ("shocks", spectra.shock_rows, "width", spectra.WIDTHS, spectra.shock_text),
    "loads_start": (
        "what a start does",
        start_rows,
        "start",
        STARTS,
        partial(_over_force, names=("start", "restitution", "friction")),
    ),
}


def _part(name: str) -> Part[SpectrumSettings]:
    title, rows_of, group_by, values, words = PARTS[name]

    def cases(settings: SpectrumSettings) -> dict[tuple[str, Any], Callable[[], list[Json]]]:
        return {
            (case.name, value): partial(rows_of, case, value, settings)
            for case in CASES.values()
            for value in values
        }

    def figures(result: Measurement) -> dict[str, Saver]:
        from studies.load_figures import FIGURES  # matplotlib is slow to import

        return {name: lambda path: FIGURES[name](path, result.values["rows"])}

    return make_rows_part(
        name,
        title,
        cases,
        itemgetter("structure", group_by),
        add_sources(lambda result: words(result.values["rows"])),
        figures=figures,
    )


STUDY = Study(tuple(map(_part, PARTS)), notes=lambda settings: settings._asdict())


QUICK_OUT = Path("results/load_answers")
MEMBERS = 5
QUICK_MEMBERS = 2


@command()
@click.option(
    "--only",
    multiple=True,
    type=click.Choice([part.name for part in STUDY.parts]),
    help="Only this part; may be repeated.",
)
@click.option(
    "--members",
    type=click.IntRange(min=1),
    help=f"Runs for each point, other in phase and 1e-6 of force.  [default: {MEMBERS}]",
)
@click.option(
    "--quick",
    is_flag=True,
    help=(
        f"Every fourth point, {QUICK_MEMBERS} members unless given, into {QUICK_OUT} unless told "
        "otherwise."
    ),
)
@click.option(
    "--redraw",
    is_flag=True,
    help="Draw and tell again from the files in the folder; nothing is run.",
)
@click.option("--resume", is_flag=True, help="Go on from files of runs that were stopped.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder.  [default: docs, without a checkout {QUICK_OUT}]",
)
def main(
    only: tuple[str, ...],
    members: int | None,
    quick: bool,
    redraw: bool,
    resume: bool,
    out: Path | None,
) -> None:
    """Measure the reduction by impact absorbers on two beams, and write load_findings.md.

    The measures are level, RMS or decay time relative to those without absorber. The page is
    docs/load_findings.md.
    """
    folder = out or (QUICK_OUT if quick else publication_folder(DOCS, QUICK_OUT))
    settings = SpectrumSettings(members or (QUICK_MEMBERS if quick else MEMBERS), quick)
    run(
        STUDY,
        settings,
        OutputPaths(folder, folder / "load_findings.md", DOCS / "load_findings.md"),
        only=only,
        redraw=redraw,
        resume=resume,
    )
