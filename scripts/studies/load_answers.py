"""Answers about loads on two structures: both resonances at once, random loads, gravity, shocks, and what a start does."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive, linear_sweep
from impact_env.ensemble import Lane, draw_members, drives_of, each_lane, run_lanes
from impact_env.loads import AnyDrive, Force, Loads, Tone, Tones
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Absorber, RigidWalls, SlidingAbsorber, friction_law, impact_absorber
from impact_env.scene import InitialState, Scene
from impact_env.shared_mass import impact_absorbers
from optimisation.bounds import design_gap
from optimisation.friction_rule import scaled_friction
from optimisation.machine import sources
from optimisation.report.markdown import markdown
from optimisation.signals import band_levels
from studies.load_spectra import (
    CASES,
    GAP,
    MASS_RATIO,
    MODES,
    RESTITUTION,
    VARIANTS,
    WIDTHS,
    Case,
    Settings,
    band_text,
    random_rows,
    random_text,
    shock_rows,
    shock_text,
)
from studies.study import Json, Measured, Part, Saver, Steps, Study, rows_by_case

Array = NDArray[np.float64]
LIMITS = (0.92, 1.04)  # of the sweeps, times a resonance
SHARES = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.35, 0.5, 0.75, 1.0)
REMEDIED = (0.2, 0.5, 1.0)  # shares at which remedies are tried
SEARCHED = 3  # members by which the best of a remedy is chosen; others judge it
GAP_FACTORS = tuple(np.geomspace(0.5, 8.0, 9).tolist())
FEW_FACTORS = (1.0, 2.0, 4.0)  # gaps at which friction and restitution are tried
FRICTIONS = (0.5, 1.0, 2.0, 4.0, 8.0)  # times the paper's by the scaling law
RESTITUTIONS = (0.2, 0.45, 0.9, 1.0)
ASIDE = (0.5, 0.7, 1.0, 1.4, 2.0)  # of a place's own gap by the rule
WEIGHTS = (0.0, 0.05, 0.15, 0.5)  # g over gap times the first frequency squared
FACTORS = tuple(np.geomspace(0.1, 3.2, 11).tolist())  # of the design force
DIRECTIONS = {"up": (0.9, 1.06), "down": (1.06, 0.9)}


def orders(case: Case, share: float) -> Loads:
    """Return both forces as orders of one schedule, the higher one times a share."""
    omega = case.model.omega
    tones = Tone(case.forces[0], order=1.0), Tone(share * case.forces[1], order=float(omega[1] / omega[0]))
    return Loads((Tones(tones, schedule=linear_sweep(float(omega[0]), *LIMITS)),))


Variant = tuple[str, Scene]


def _found(scene: Scene, drives: Sequence[AnyDrive]) -> Array:
    """Return the levels in both bands under each drive, (drives, 2)."""
    found = each_lane([Lane(scene, drive) for drive in drives], band_levels)
    if None in found:
        raise KeyboardInterrupt
    return np.array(found, dtype=np.float64)


def _row(case: Case, group: str, variant: Variant, share: float, drives: Sequence[AnyDrive]) -> Json:
    """Return what is left of the level in either band; without absorber the motion is linear, and the same for all members but for phases."""
    free = _found(Scene(case.model), drives[:1])[0]
    ratio = np.round(_found(variant[1], drives) / free, 4)
    own = {"structure": case.name, "group": group, "variant": variant[0], "share": share}
    higher = ratio[:, 1].tolist() if share > 0 else None
    return own | {"free_over_gap": (free / GAP).tolist(), "lower": ratio[:, 0].tolist(), "higher": higher}


def both_rows(case: Case, group: str, settings: Settings) -> list[Json]:
    """Return what is left for each variant of a group: of a remedy at few members, and of the best one, ``judged`` out of so many, at others."""
    variants, rows = GROUPS[group](case)[:: 4 if settings.quick else 1], []
    members = draw_members(SEARCHED + settings.members, 0)
    for share in SHARES if group == "share" else REMEDIED:
        drives = drives_of(members, orders(case, share))
        if group != "share":
            tried = [_row(case, group, variant, share, drives[:SEARCHED]) for variant in variants]
            best = min(range(len(tried)), key=lambda k: _cost(tried[k]))
            rows += [*tried, _row(case, group, variants[best], share, drives[SEARCHED:]) | {"judged": len(tried)}]
        else:
            rows.append(_row(case, group, variants[0], share, drives[SEARCHED:]) | {"judged": 1})
    return rows


def _impact(gap: float = GAP, restitution: float = RESTITUTION, friction: float | None = None) -> Absorber:
    return impact_absorber(gap, restitution, friction, MASS_RATIO)


def _with_gaps(model: ModalModel, gaps: Sequence[float], word: str = "", **options: float) -> list[Variant]:
    return [(f"{word}gap {1e3 * gap:.2g} mm", Scene(model, _impact(gap, **options))) for gap in gaps]


def _shares(case: Case) -> list[Variant]:
    return _with_gaps(case.model, [GAP])


def _gaps(case: Case) -> list[Variant]:
    return _with_gaps(case.model, [factor * GAP for factor in GAP_FACTORS])


def _frictions(case: Case) -> list[Variant]:
    found = []
    for factor in FRICTIONS:
        limit = factor * scaled_friction(case.model, case.mass, GAP)
        found += _with_gaps(case.model, [few * GAP for few in FEW_FACTORS], f"friction {limit:.2g} N, ", friction=limit)
    return found


def _restitutions(case: Case) -> list[Variant]:
    gaps = [few * GAP for few in FEW_FACTORS]
    return [one for e in RESTITUTIONS for one in _with_gaps(case.model, gaps, f"restitution {e:g}, ", restitution=e)]


def _places(case: Case) -> list[Variant]:
    """Return absorbers from the second mode's node to where the absorber was."""
    found = []
    for place in np.linspace(case.node, case.beam.absorber_position, 5)[:-1]:
        gap = design_gap(case.at(place), case.mass, case.forces[0], 1)
        found += _with_gaps(case.at(place), [factor * gap for factor in ASIDE], f"at {place:.3f}, ")
    return found


def _halves(case: Case) -> list[Variant]:
    """Return two absorbers of half the mass: side by side, and one at the second mode's node with one where the absorber was."""
    own, found = case.beam.absorber_position, []
    wide = design_gap(case.at(case.node), case.mass / 2, case.forces[0], 1)
    narrow = design_gap(case.model, case.mass / 2, case.forces[1], 2)
    pairs = [((own, own), (first * GAP, second * GAP)) for first, second in combinations(GAP_FACTORS[::2], 2)]
    pairs += [((case.node, own), (first * wide, second * narrow)) for first in ASIDE[1:4] for second in ASIDE]
    for places, gaps in pairs:
        label = "side by side" if places[0] == places[1] else f"at {places[0]:.3f} and {places[1]:g}"
        absorber = impact_absorbers(gaps=gaps, positions=places, mass_ratio=MASS_RATIO, shares=(0.5, 0.5), restitution=RESTITUTION)
        text = f"two halves {label}, gaps {1e3 * gaps[0]:.2g} and {1e3 * gaps[1]:.2g} mm"
        found.append((text, Scene(case.at(*places), absorber)))
    return found


def _modes(case: Case) -> list[Variant]:
    return _with_gaps(modal_model(replace(case.beam, modes=2 * MODES)), [few * GAP for few in FEW_FACTORS], f"{2 * MODES} modes, ")


GROUPS: dict[str, Callable[[Case], list[Variant]]] = {
    "share": _shares,
    "gap": _gaps,
    "friction": _frictions,
    "restitution": _restitutions,
    "place": _places,
    "halves": _halves,
    "modes": _modes,
}


def _heavy(case: Case, weight: float, friction: float) -> SlidingAbsorber:
    """Return an absorber with a weight, a share of gap times the first frequency squared, and so many times the paper's friction."""
    limit = friction * scaled_friction(case.model, case.mass, GAP)
    gravity = weight * GAP * float(case.model.omega[0]) ** 2
    return SlidingAbsorber(MASS_RATIO, RigidWalls(GAP, RESTITUTION), friction_law(limit), gravity)


def _ratios(case: Case, absorber: Absorber | None, force: float, start: str | InitialState, members: int) -> Json:
    """Return the members' levels over that without absorber, of sweeps up (``ratio``) and down under a force in N."""
    ratios = {}
    for name, limits in DIRECTIONS.items():
        loads = Loads((Force(Drive(force, linear_sweep(float(case.model.omega[0]), *limits))),))
        drives = drives_of(draw_members(members, 0), replace(loads, start=start))
        found = run_lanes([Lane(Scene(case.model), loads), *(Lane(Scene(case.model, absorber), drive) for drive in drives)])
        if not found.complete:
            raise KeyboardInterrupt
        ratios["ratio" if name == "up" else name] = (found.level[1:] / found.level[0]).tolist()
    return ratios


def gravity_rows(case: Case, weight: float, settings: Settings) -> list[Json]:
    """Return levels over the force, without friction and with it, for an absorber that begins on its lower wall."""
    rows = []
    for friction in (0.0, 1.0):
        for factor in FACTORS[:: 4 if settings.quick else 1]:
            absorber = _heavy(case, weight, friction)
            start = "lower-wall" if weight > 0 else "middle"
            force = factor * case.forces[0]
            row = {
                "structure": case.name,
                "weight": weight,
                "gravity_m_s2": absorber.gravity,
                "friction": friction,
                "factor": factor,
                "force_n": force,
            }
            rows.append(row | _ratios(case, absorber, force, start, settings.members))
    return rows


def _state(case: Case, start: str) -> str | InitialState:
    """Return a start: bouncing, the absorber crosses its cavity in half a period."""
    return InitialState(absorber_velocity=2 * GAP * float(case.model.omega[0]) / np.pi) if start == "bouncing" else start


STARTS = ("middle", "lower-wall", "bouncing")
WALLS = ((1.0, 0.0), (RESTITUTION, 0.0), (RESTITUTION, 1.0))  # restitution, and friction over the paper's by the scaling law


def start_rows(case: Case, start: str, settings: Settings) -> list[Json]:
    """Return levels over the force from a start."""
    rows = []
    for restitution, friction in WALLS:
        limit = friction * scaled_friction(case.model, case.mass, GAP)
        for factor in FACTORS[:: 4 if settings.quick else 1]:
            absorber = impact_absorber(GAP, restitution, limit, MASS_RATIO)
            row = {"structure": case.name, "start": start, "restitution": restitution, "friction": friction, "factor": factor}
            rows.append(row | _ratios(case, absorber, factor * case.forces[0], _state(case, start), settings.members))
    return rows


def _of(rows: Sequence[Json], **given: object) -> list[Json]:
    """Return the rows with these values."""
    return [row for row in rows if all(row[name] == value for name, value in given.items())]


def _cost(row: Json) -> tuple[float, float]:
    """Return the larger of both medians, in whole percent, and their sum."""
    medians = float(np.median(row["lower"])), float(np.median(row["higher"]))
    return round(max(medians), 2), sum(medians)


def both_text(rows: Sequence[Json]) -> str:
    """Return a table over the share of the higher force, and the best of each remedy, with the least of the larger number, at some shares."""
    shares = [
        (row["structure"], f"{row['share']:g}", f"{row['free_over_gap'][1]:.2f}", band_text(row["lower"]), band_text(row["higher"]))
        for row in _of(rows, group="share")
    ]
    remedies = []
    for structure in CASES:
        for share in REMEDIED:
            for best in (row for row in _of(rows, structure=structure, share=share) if "judged" in row):
                words = f"{best['variant']}, best of {best['judged']}" if best["group"] != "share" else f"as it is, {best['variant']}"
                remedies.append((structure, f"{share:g}", words, band_text(best["lower"]), band_text(best["higher"])))
    first = markdown(("structure", "share of the higher force", "free level there / gap", "lower band", "higher band"), shares)
    return first + "\n\n" + markdown(("structure", "share", "remedy", "lower band", "higher band"), remedies)


def _over_force(rows: Sequence[Json], names: tuple[str, ...]) -> str:
    """Return a line for each series: the members' median at each factor of the design force, and where a sweep down differs most."""
    factors = sorted({row["factor"] for row in rows})
    series: dict[tuple[Any, ...], dict[float, tuple[float, float]]] = {}
    for row in rows:
        medians = float(np.median(row["ratio"])), float(np.median(row["down"]))
        series.setdefault(tuple(row[name] for name in ("structure", *names)), {})[row["factor"]] = medians
    lines = []
    for key, found in series.items():
        most = max(factors, key=lambda factor: abs(found[factor][1] - found[factor][0]))
        name = ", ".join(f"{part:g}" if isinstance(part, float) else str(part) for part in key)
        lines.append([name, *(f"{found[f][0]:.2f}" for f in factors), f"{found[most][1]:.2f} at {most:.2g}"])
    return markdown((", ".join(("structure", *names)), *(f"{factor:.2g}" for factor in factors), "down"), lines)


GRAVITY, START = ("weight", "friction"), ("start", "restitution", "friction")


def _each(rows_of: Callable[[Case, Any, Settings], list[Json]], name: str, values: Sequence[Any]) -> Callable[[Settings, Json], Steps]:
    """Return what measures the rows of each structure and value."""

    def measure(settings: Settings, known: Json) -> Steps:
        cases = {(case.name, value): partial(rows_of, case, value, settings) for case in CASES.values() for value in values}
        return rows_by_case(cases, lambda row: (row["structure"], row[name]), known)

    return measure


def _part(name: str, title: str, *, measure: Callable[[Settings, Json], Steps], steps: int, text: Callable[[Sequence[Json]], str]) -> Part[Settings]:
    def sections(found: Measured) -> dict[str, str]:
        return {name: f"{text(found.values['rows'])}\n\n{sources(found.conditions)}"}

    def figures(found: Measured) -> dict[str, Saver]:
        from studies.load_figures import FIGURES  # matplotlib is slow to import

        def save(path: Path) -> None:
            FIGURES[name](path, found.values["rows"])

        return {name: save}

    return Part(name, title, measure=measure, steps=lambda *_: 2 * steps, markers=(name,), sections=sections, figures=figures)


STUDY = Study(
    (
        _part("loads_both", "both resonances at once", measure=_each(both_rows, "group", list(GROUPS)), steps=len(GROUPS), text=both_text),
        _part(
            "loads_random",
            "random loads",
            measure=_each(random_rows, "number", list(range(len(VARIANTS)))),
            steps=len(VARIANTS),
            text=random_text,
        ),
        _part(
            "loads_gravity",
            "gravity along the absorber's motion",
            measure=_each(gravity_rows, "weight", WEIGHTS),
            steps=len(WEIGHTS),
            text=partial(_over_force, names=GRAVITY),
        ),
        _part("loads_shock", "shocks", measure=_each(shock_rows, "width", WIDTHS), steps=len(WIDTHS), text=shock_text),
        _part(
            "loads_start",
            "what a start does",
            measure=_each(start_rows, "start", STARTS),
            steps=len(STARTS),
            text=partial(_over_force, names=START),
        ),
    ),
    notes=lambda settings: settings._asdict(),
)
