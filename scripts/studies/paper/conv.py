"""Compliant contact against rigid (paper, appendix A, its figure conv): walls over their stiffness, and friction over that of its spring."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from impact_env.curve import CurveCase, PerformanceCurve
from impact_env.methods import Exact, Method, RungeKutta
from impact_env.parameters import Absorber, Beam, CompliantWalls, SlidingAbsorber, friction_damper, impact_absorber
from impact_env.scene import Scene, beam_scene
from studies.paper.conv_claims import claims as claims
from studies.paper.frame import figure_part, has, in_turn, shortened
from studies.paper.settings import Settings
from studies.paper.words import spread
from studies.study import Json, Measured, Saver, Steps, Table

LABEL = "conv"
BEAM = Beam(modes=3)
FORCE, DAMPER = 4.0, 0.5  # N: the paper's force, and the limit of its friction damper
WALLS, FRICTION = "walls", "friction"
LOW, HIGH = 3.0, 300.0  # stiffnesses of the performance curves, over the beam's static stiffness
STEPPED = 1e4  # stiffest contact that the paper's own method is tried with: its step follows the contact's duration


def absorber(kind: str, stiffness: float | None) -> Absorber:
    """Return the impact absorber, frictionless and conservative, or the friction damper; ``stiffness`` over the beam's, None: rigid."""
    spring = None if stiffness is None else stiffness * BEAM.static_tip_stiffness
    if kind == FRICTION:
        return friction_damper(DAMPER, friction_stiffness=spring)
    rigid = impact_absorber()
    return rigid if spring is None else SlidingAbsorber(rigid.mass_ratio, CompliantWalls(spring))


def sizes(settings: Settings) -> tuple[int, int, int]:
    """Return the number of members, of stiffnesses and of forces."""
    return settings.size((24, 22, 24), (3, 8, 8))


def stiffnesses(settings: Settings) -> list[float]:
    """Return the stiffnesses over the beam's static one."""
    return np.geomspace(0.1, 1e5, sizes(settings)[1]).round(4).tolist()


def forces(settings: Settings, kind: str) -> list[float]:
    """Return the forces (N) of the performance curves, for the walls closer together where the curve is flat."""
    spaced = np.geomspace if kind == WALLS else np.linspace
    return np.asarray(spaced(0.5, 6.0, sizes(settings)[2])).round(3).tolist()


def parameters(settings: Settings) -> Json:
    """Return what the numbers depend on."""
    return {
        "beam": str(BEAM), "force": FORCE, "damper": DAMPER, "stiffnesses": [LOW, HIGH, STEPPED, *stiffnesses(settings)],
        "forces": [forces(settings, kind) for kind in (WALLS, FRICTION)], "members": sizes(settings)[0],
    }  # fmt: skip


def _scene(kind: str, stiffness: float | None) -> Scene:
    return beam_scene(BEAM, absorber(kind, stiffness))


def _kept(curve: PerformanceCurve) -> Json:
    """Return the levels of a curve in m, (forces, members), the paper's own run first."""
    return {"force_n": curve.forces.tolist(), "level_m": [[float(f"{x:.6g}") for x in row] for row in curve.combined]}


def _over_stiffness(settings: Settings, kind: str, method: Method) -> Json:
    """Return the levels at the paper's force for each stiffness, and those of the rigid law."""
    stepped = not isinstance(method, Exact)
    chosen = [k for k in stiffnesses(settings) if not stepped or k <= STEPPED]
    members = min(sizes(settings)[0], 4) if stepped else sizes(settings)[0]
    names: list[float | None] = [*chosen, *(() if stepped else (None,))]
    cases = [CurveCase(_scene(kind, stiffness), np.array([FORCE])) for stiffness in names]
    curves = settings.curves(f"{LABEL}: {kind}", cases, members, method)
    levels = [_kept(curve)["level_m"][0] for curve in curves]
    return {"stiffness": chosen, "level_m": levels[: len(chosen)], "rigid_m": None if stepped else levels[-1]}


def _curves(settings: Settings, kind: str) -> Json:
    """Return performance curves with rigid, stiff and soft contact, and without absorber."""
    force = np.array(forces(settings, kind))
    named = {"rigid": None, "low": LOW, "high": HIGH}
    cases = [CurveCase(_scene(kind, stiffness), force) for stiffness in named.values()] + [CurveCase(beam_scene(BEAM), force)]
    found = settings.curves(f"{LABEL}: curves, {kind}", cases, sizes(settings)[0])
    return dict(zip([*named, "none"], map(_kept, found), strict=True))


def _measure(settings: Settings, known: Json) -> Steps:
    groups: dict[str, Callable[[], Any]] = {}
    for kind in (WALLS, FRICTION):
        groups[kind] = partial(_over_stiffness, settings, kind, Exact())
        groups[f"{kind}, paper's method"] = partial(_over_stiffness, settings, kind, RungeKutta())
        groups[f"{kind}, curves"] = partial(_curves, settings, kind)
    return in_turn(groups, known)


def _table(values: Json) -> Table:
    """Return a row for each stiffness and one for rigid contact: levels of walls and of the damper, and those over rigid contact."""
    columns, rows = ["stiffness over 3EI/l^3"], [[f"{k:.3g}"] for k in values[WALLS]["stiffness"]] + [["rigid"]]
    for kind, said in ((WALLS, "walls, k_n"), (FRICTION, "friction, k_t")):
        columns += [f"{said}: level at {FORCE:g} N, mm", "over rigid"]
        for row, level in zip(rows, [*values[kind]["level_m"], values[kind]["rigid_m"]], strict=True):
            row += [spread(level, "{:.3f}", 1e3), _ratio(level, values[kind]["rigid_m"])]
    return Table(f"{LABEL}_stiffness", columns, rows)


def _long(values: Json) -> list[Table]:
    return [_table(values)] if has(values, WALLS, FRICTION) else []


def _words(values: Json) -> str:
    return "\n\n".join(map(shortened, _long(values)))


def _ratio(level: Sequence[float], rigid: Sequence[float]) -> str:
    return f"{np.median(level) / np.median(rigid):.3f}"


def _figures(measured: Measured) -> dict[str, Saver]:
    if not has(measured.values, *(f"{kind}{part}" for kind in (WALLS, FRICTION) for part in ("", ", paper's method", ", curves"))):
        return {}
    from studies.paper.figures import conv  # matplotlib is slow to import

    return {LABEL: lambda path: conv.save(path, measured.values, (LOW, HIGH))}


PART = figure_part(LABEL, "compliant contact", _measure, _words, _figures, _long)
