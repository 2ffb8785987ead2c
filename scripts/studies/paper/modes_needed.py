"""How many modes the second resonance needs: beyond the paper, which keeps ten of them by what they do at the first."""

from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from impact_env.curve import BAND, CurveCase, quantiles
from impact_env.parameters import Beam, impact_absorber
from impact_env.scene import beam_scene
from optimisation.page import markdown
from studies.paper.claim import SAME, Claim, Verdict
from studies.paper.frame import NAME, PaperFigure, Settings, in_turn
from studies.paper.style import LOOKS, legends, line, panels
from studies.study import Json

LABEL = "modes_needed"
FRICTION, RESTITUTION = 0.1, 0.7  # of the paper's best absorber
OPTIMUM = {1: 3.5, 2: 35.0}  # N, the paper's
NAMES = {1: "first", 2: "second"}
PAPER_MODES = 10


class Sizes(NamedTuple):
    """Forces in N at each resonance, numbers of modes, and members."""

    first: tuple[float, ...]
    second: tuple[float, ...]
    modes: tuple[int, ...]
    members: int


def _of_modes(modes: int, settings: Settings, size: Sizes) -> Json:
    beam, absorber = Beam(modes=modes), impact_absorber(restitution=RESTITUTION, friction_limit=FRICTION)
    scenes = beam_scene(beam), beam_scene(beam, absorber)
    cases = [CurveCase(scene, np.array(forces), r) for r, forces in ((1, size.first), (2, size.second)) for scene in scenes]
    curves = settings.curves(f"{LABEL}: {modes} modes", cases, size.members)
    found = {}
    for r, without, curve in zip(OPTIMUM, curves[0::2], curves[1::2], strict=True):
        relative = curve.relative_to(without)
        bands = dict(zip(("low", "relative", "high"), quantiles(relative, (BAND[0], 0.5, BAND[1])).tolist(), strict=True))
        found[str(r)] = {"forces_n": curve.forces.tolist(), **bands, "nominal": relative[:, 0].tolist()}
    return found


def at(values: Json, modes: int, resonance: int, force: float | None = None) -> tuple[float, float, float, float]:
    """Return median, 5 and 95 % and the nominal run of the relative level at a force in N, by default the paper's optimum."""
    found = values[str(modes)][str(resonance)]
    k = found["forces_n"].index(OPTIMUM[resonance] if force is None else force)
    return found["relative"][k], found["low"][k], found["high"][k], found["nominal"][k]


def _words(values: Json) -> str:
    forces = {r: [force for force in forces_of(values, r) if force >= OPTIMUM[r]] for r in OPTIMUM}
    header = ("modes", *(f"{name}, {force:g} N" for r, name in NAMES.items() for force in forces[r]))
    rows = [(f"{n}", *(_cell(values, n, r, force) for r in OPTIMUM for force in forces[r])) for n in map(int, values)]
    text = f"Level in % of no absorber with as many modes, median (5 to 95 %), from the paper's best force on; below: `{NAME}/{LABEL}.json.gz`."
    return f"{text}\n\n{markdown(header, rows)}"


def _cell(values: Json, modes: int, resonance: int, force: float | None) -> str:
    middle, low, high, _ = (100 * x for x in at(values, modes, resonance, force))
    return f"{middle:.1f} ({low:.1f} to {high:.1f})"


def _claims(values: Json) -> list[Claim]:
    """Return what ten modes are worth at either resonance, against the most modes that were computed."""
    return [_enough(values, r, max(map(int, values)), NAMES[r], section) for r, section in ((1, "4.2"), (2, "6"))]


def _enough(values: Json, resonance: int, most: int, name: str, section: str) -> Claim:
    """Judge by the force at which ten modes are farthest from the most."""
    off = dict(zip(forces_of(values, resonance), _off(values, PAPER_MODES, resonance), strict=True))
    force = max(off, key=lambda f: abs(off[f]))
    apart = _apart(values, PAPER_MODES, resonance, force)
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


def _off(values: Json, modes: int, resonance: int) -> list[float]:
    """Return how far the level is from that with the most modes, at each force."""
    most = max(map(int, values))
    return [at(values, modes, resonance, force)[0] / at(values, most, resonance, force)[0] - 1 for force in forces_of(values, resonance)]


def _apart(values: Json, modes: int, resonance: int, force: float) -> bool:
    """Return whether the members' band lies beside that with the most modes."""
    own, many = at(values, modes, resonance, force), at(values, max(map(int, values)), resonance, force)
    return own[1] > many[2] or many[1] > own[2]


def _answer(values: Json) -> str:
    """Say in a line from how many modes on all bands overlap those with the most, and how far ten modes are."""
    modes, ten = sorted(map(int, values)), []
    few = max((n for n in modes if any(_apart(values, n, r, force) for r in OPTIMUM for force in forces_of(values, r))), default=0)
    for resonance, name in NAMES.items():
        off = [100 * x for x in _off(values, PAPER_MODES, resonance)]
        ten.append(f"{min(off):+.0f} to {max(off):+.0f} % at the {name}")
    return (
        f"How many modes the second resonance needs: more than {few}; with {min(n for n in modes if n > few)} and more the bands overlap those with "
        f"{modes[-1]} at every force, at the first too. {PAPER_MODES} are off by {' and '.join(ten)} resonance."
    )


def forces_of(values: Json, resonance: int) -> list[float]:
    """Return the forces in N of a resonance."""
    return list(next(iter(values.values()))[str(resonance)]["forces_n"])


def _draw(values: Json) -> Figure:
    """Draw the relative level over the number of modes: the paper's best force at each resonance, and the second one's other forces."""
    figure, axes = panels(1, 2, 3.0)
    own, forces = axes[0]
    modes = list(map(int, values))
    for resonance, look in ((1, LOOKS[1]), (2, LOOKS[0])):
        middle, low, high, nominal = 100 * np.array([at(values, n, resonance) for n in modes]).T
        line(own, modes, middle, look, f"{NAMES[resonance]} resonance, {OPTIMUM[resonance]:g} N", band=(low, high), nominal=nominal)
    for force, look in zip(forces_of(values, 2), LOOKS, strict=False):
        middle, low, high, nominal = 100 * np.array([at(values, n, 2, force) for n in modes]).T
        line(forces, modes, middle, look, f"{force:g} N", band=(low, high), nominal=nominal)
    for panel in (own, forces):
        panel.set(xlabel="modes $N_m$", ylabel="level in % of no absorber", ylim=(0, None), xticks=modes)
    forces.set_title("second resonance")
    legends(axes)
    return figure


FIGURE = PaperFigure(
    LABEL, "how many modes the second resonance needs", words=_words, draw=_draw, claims=_claims, answer=_answer,
    measure=lambda settings, size, known: in_turn({str(n): partial(_of_modes, n, settings, size) for n in size.modes}, known),
    sizes=(
        Sizes((1.5, 2.5, 3.5, 5.0), (20.0, 25.0, 30.0, 35.0, 40.0), (5, 7, 10, 15, 20, 30), 16),
        Sizes((3.5,), (35.0,), (5, 10, 20), 3),
    ),
)  # fmt: skip
