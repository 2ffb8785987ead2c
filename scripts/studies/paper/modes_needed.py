"""How many modes the second resonance needs: beyond the paper, which keeps ten of them by what they do at the first."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from impact_env.curve import BAND, CurveCase, PerformanceCurve, quantiles
from impact_env.parameters import Beam, impact_absorber
from impact_env.scene import beam_scene
from optimisation.report.markdown import markdown
from studies.paper.claim import Claim, Verdict
from studies.paper.frame import figure_part, in_turn
from studies.paper.settings import Settings
from studies.paper.tolerances import SAME
from studies.study import Json, Measured, Saver, Steps

LABEL = "modes_needed"
FRICTION, RESTITUTION = 0.1, 0.7  # of the paper's best absorber
FORCES = {1: ((1.5, 2.5, 3.5, 5.0), (3.5,)), 2: ((20.0, 25.0, 30.0, 35.0, 40.0), (35.0,))}  # N, in full and quick, by resonance
OPTIMUM = {1: 3.5, 2: 35.0}  # N, the paper's
MODES, QUICK_MODES = (5, 7, 10, 15, 20, 30), (5, 10, 20)
MEMBERS = (16, 3)
PAPER_MODES = 10


def parameters(settings: Settings) -> Json:
    """Return what the numbers depend on."""
    return {
        "absorber": [FRICTION, RESTITUTION],
        "forces": {str(r): settings.size(*both) for r, both in FORCES.items()},
        "modes": settings.size(MODES, QUICK_MODES),
        "members": settings.size(*MEMBERS),
    }


def measure(settings: Settings, known: Json) -> Steps:
    """Yield the relative levels at both resonances for each number of modes, one after the other."""
    groups = {str(n): partial(_of_modes, n, settings) for n in settings.size(MODES, QUICK_MODES)}
    return in_turn(groups, known)


def _of_modes(modes: int, settings: Settings) -> Json:
    beam, absorber = Beam(modes=modes), impact_absorber(restitution=RESTITUTION, friction_limit=FRICTION)
    scenes = beam_scene(beam), beam_scene(beam, absorber)
    cases = [CurveCase(scene, np.array(settings.size(*FORCES[r])), r) for r in FORCES for scene in scenes]
    curves = settings.curves(f"{LABEL}: {modes} modes", cases, settings.size(*MEMBERS))
    return {str(r): _levels(curve, without) for r, without, curve in zip(FORCES, curves[0::2], curves[1::2], strict=True)}


def _levels(curve: PerformanceCurve, without: PerformanceCurve) -> Json:
    relative = curve.relative_to(without)
    low, middle, high = quantiles(relative, (BAND[0], 0.5, BAND[1]))
    return {
        "forces_n": curve.forces.tolist(),
        "relative": middle.tolist(),
        "low": low.tolist(),
        "high": high.tolist(),
        "nominal": relative[:, 0].tolist(),
    }


def at(values: Json, modes: int, resonance: int, force: float | None = None) -> tuple[float, float, float, float]:
    """Return median, 5 and 95 % and the nominal run of the relative level at a force in N, by default the paper's optimum."""
    found = values[str(modes)][str(resonance)]
    k = found["forces_n"].index(OPTIMUM[resonance] if force is None else force)
    return found["relative"][k], found["low"][k], found["high"][k], found["nominal"][k]


def numbers(values: Json) -> list[int]:
    """Return the numbers of modes that there are."""
    return [int(name) for name in values]


def _words(values: Json) -> str:
    rows = [(f"{n}", *(_cell(values, n, r, force) for r in FORCES for force in forces_of(values, r))) for n in numbers(values)]
    header = ("modes", *(f"{name}, {force:g} N" for r, name in ((1, "first"), (2, "second")) for force in forces_of(values, r)))
    return "Level in % of no absorber with as many modes, median (5 to 95 %).\n\n" + markdown(header, rows)


def _cell(values: Json, modes: int, resonance: int, force: float | None) -> str:
    middle, low, high, _ = (100 * x for x in at(values, modes, resonance, force))
    return f"{middle:.1f} ({low:.1f} to {high:.1f})"


def figures(measured: Measured) -> Mapping[str, Saver]:
    """Return what draws the figure."""
    from studies.paper.figures import modes_needed as drawn  # matplotlib is slow to import

    return {LABEL: lambda path: drawn.save(Path(path), measured.values)}


def claims(measured: Measured) -> list[Claim]:
    """Return what ten modes are worth at either resonance, against the most modes that were computed."""
    values = measured.values
    most = max(numbers(values))
    words = {1: ("first", "4.2"), 2: ("second", "6")}
    return [_enough(values, r, most, *words[r]) for r in FORCES]


def _enough(values: Json, resonance: int, most: int, name: str, section: str) -> Claim:
    """Judge by the force at which ten modes are farthest from the most."""
    off = {force: at(values, PAPER_MODES, resonance, force)[0] / at(values, most, resonance, force)[0] - 1 for force in forces_of(values, resonance)}
    force = max(off, key=lambda f: abs(off[f]))
    ten, many = at(values, PAPER_MODES, resonance, force), at(values, most, resonance, force)
    apart = ten[1] > many[2] or many[1] > ten[2]
    verdict = Verdict.HOLDS if abs(off[force]) < SAME else Verdict.NOT if apart else Verdict.SPREAD
    shown = dict.fromkeys((OPTIMUM[resonance], force))
    cells = [
        f"{_cell(values, PAPER_MODES, resonance, f)} with {PAPER_MODES}, {_cell(values, most, resonance, f)} with {most} at {f:g} N" for f in shown
    ]
    why = (
        f"Medians with {PAPER_MODES} modes are {100 * min(off.values()):+.0f} to {100 * max(off.values()):+.0f} % from those with {most}, "
        f"and at {force:g} N the bands of the members {'are apart' if apart else 'overlap'}."
    )
    said = f"level in % of no absorber: {'; '.join(cells)}"
    return Claim(f"modes_needed_{name}", f"ten modes are enough at the {name} resonance", section, said, verdict, LABEL, why)


def answer(measured: Measured) -> str:
    """Say in a line how far ten modes are from the most."""
    values, said = measured.values, []
    most = max(numbers(values))
    for resonance, name in ((1, "first"), (2, "second")):
        off = [100 * (at(values, PAPER_MODES, resonance, f)[0] / at(values, most, resonance, f)[0] - 1) for f in forces_of(values, resonance)]
        said.append(f"{min(off):+.0f} to {max(off):+.0f} % at the {name}")
    return f"How many modes the second resonance needs: with {PAPER_MODES} the level is off that with {most} by {' and '.join(said)} resonance."


def forces_of(values: Json, resonance: int) -> list[float]:
    """Return the forces in N of a resonance."""
    return list(next(iter(values.values()))[str(resonance)]["forces_n"])


PART = figure_part(LABEL, "how many modes the second resonance needs", measure, _words, figures)
