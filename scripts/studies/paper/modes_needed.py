"""Number of modes that the second resonance needs, beyond the paper.

The paper uses ten modes, chosen by their effect at the first resonance.
"""

from functools import partial

import numpy as np
from matplotlib.figure import Figure

from impact_env import Beam, CurveCase, beam_scene, impact_absorber
from optimisation.files import markdown
from studies.paper.claim import (
    SAME,
    Claim,
    compute_bands,
    find_extent,
    format_interval,
    make_claim,
)
from studies.paper.frame import (
    NAME,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_legends,
    draw_line,
    make_panels,
    measure_groups,
)
from studies.study import Json

LABEL = "modes_needed"
# of the paper's best absorber
FRICTION = 0.1
RESTITUTION = 0.7
OPTIMUM = {1: 3.5, 2: 35.0}  # N, the paper's
NAMES = {1: "first", 2: "second"}
PAPER_MODES = 10


def _of_modes(modes: int, settings: PaperSettings, size: Size) -> Json:
    beam = Beam(modes=modes)
    absorber = impact_absorber(restitution=RESTITUTION, friction_limit=FRICTION)
    scenes = beam_scene(beam), beam_scene(beam, absorber)
    cases = [
        CurveCase(scene, np.array(forces), r)
        for r, forces in ((1, size.first), (2, size.second))
        for scene in scenes
    ]
    curves = settings.curves(f"{LABEL}: {modes} modes", cases, size.members)
    result = {}
    for r, without, curve in zip(OPTIMUM, curves[0::2], curves[1::2], strict=True):
        relative = curve.relative_to(without)
        edges = dict(
            zip(("low", "relative", "high"), compute_bands(relative).tolist(), strict=True)
        )
        result[str(r)] = {
            "forces_n": curve.forces.tolist(),
            **edges,
            "nominal": relative[:, 0].tolist(),
        }
    return result


Row = list[float]


def read_rows(values: Json) -> dict[tuple[int, int, float], Row]:
    """Return the relative level by number of modes, resonance and force in N.

    Each row has median, 5 and 95 % and the nominal run.
    """
    return {
        (int(modes), int(resonance), force): row
        for modes, group in values.items()
        for resonance, result in group.items()
        for force, *row in zip(
            *(result[name] for name in ("forces_n", "relative", "low", "high", "nominal")),
            strict=True,
        )
    }


def _describe(values: Json) -> str:
    rows = read_rows(values)
    columns = [
        (r, force) for r in OPTIMUM for force in find_forces(values, r) if force >= OPTIMUM[r]
    ]
    header = ("modes", *(f"{NAMES[r]}, {force:g} N" for r, force in columns))
    cells = [
        (f"{n}", *(_cell(rows[n, r, force]) for r, force in columns)) for n in map(int, values)
    ]
    text = (
        "Level in % of no absorber with as many modes, median (5 to 95 %), from the paper's best "
        f"force on; below: `{NAME}/{LABEL}.json.gz`."
    )
    return f"{text}\n\n{markdown(header, cells)}"


def _cell(row: Row) -> str:
    return format_interval(*row[:3], form="{:.1f}", factor=100)


def _claims(values: Json) -> list[Claim]:
    """Judge whether ten modes suffice at the first resonance.

    The medians at all forces are compared with those for the largest number of modes that was
    computed.
    """
    rows = read_rows(values)
    most = max(map(int, values))
    off = _off(values, PAPER_MODES, 1)
    force = max(off, key=lambda f: abs(off[f]))
    apart = _apart(rows[PAPER_MODES, 1, force], rows[most, 1, force])
    cells = "; ".join(
        (
            f"{_cell(rows[PAPER_MODES, 1, f])} with {PAPER_MODES}, {_cell(rows[most, 1, f])} with "
            f"{most} at {f:g} N"
        )
        for f in dict.fromkeys((OPTIMUM[1], force))
    )
    return [
        make_claim(
            LABEL,
            "modes_needed_first",
            find_extent(list(off.values())),
            (-SAME, SAME),
            cells=cells,
            ten=PAPER_MODES,
            most=most,
            force=force,
            least=100 * min(off.values()),
            greatest=max(off.values()),
            bands="are apart" if apart else "overlap",
        )
    ]


def _off(values: Json, modes: int, resonance: int) -> dict[float, float]:
    """Return how far the level is from that with the most modes, by force."""
    rows = read_rows(values)
    most = max(map(int, values))
    return {
        force: rows[modes, resonance, force][0] / rows[most, resonance, force][0] - 1
        for force in find_forces(values, resonance)
    }


def _apart(one: Row, other: Row) -> bool:
    """Return whether the bands of two rows do not overlap."""
    return one[1] > other[2] or other[1] > one[2]


def _answer(values: Json) -> str:
    """Return a line with the number of modes that suffices and the error of ten modes.

    From this number of modes on, all bands overlap those with the most modes.
    """
    modes = sorted(map(int, values))
    rows = read_rows(values)
    few = max(
        (n for n, r, force in rows if _apart(rows[n, r, force], rows[modes[-1], r, force])),
        default=0,
    )
    off = {
        name: [100 * x for x in _off(values, PAPER_MODES, r).values()] for r, name in NAMES.items()
    }
    ten = " and ".join(
        f"{min(own):+.0f} to {max(own):+.0f} % at the {name}" for name, own in off.items()
    )
    return (
        f"How many modes the second resonance needs: more than {few}; with "
        f"{min(n for n in modes if n > few)} and more the bands overlap those with "
        f"{modes[-1]} at every force, at the first too. {PAPER_MODES} are off by {ten} resonance."
    )


def find_forces(values: Json, resonance: int) -> list[float]:
    """Return the forces in N of a resonance."""
    return list(next(iter(values.values()))[str(resonance)]["forces_n"])


def _draw(values: Json) -> Figure:
    """Draw the relative level over the number of modes.

    One panel has the paper's best force at each resonance, the other the further forces at the
    second resonance.
    """
    figure, axes = make_panels(1, 2, 3.0)
    own, forces = axes[0]
    modes = list(map(int, values))
    rows = read_rows(values)
    drawn = [
        (own, r, OPTIMUM[r], style, f"{NAMES[r]} resonance, {OPTIMUM[r]:g} N")
        for r, style in ((1, STYLES[5]), (2, STYLES[find_forces(values, 2).index(OPTIMUM[2])]))
    ]
    drawn += [
        (forces, 2, force, style, f"{force:g} N")
        for force, style in zip(find_forces(values, 2), STYLES, strict=False)
    ]
    for panel, resonance, force, style, label in drawn:
        middle, low, high, nominal = 100 * np.array([rows[n, resonance, force] for n in modes]).T
        draw_line(panel, modes, middle, style, label, band=(low, high), nominal=nominal)
    for panel in axes[0]:
        panel.set(
            xlabel="modes $N_m$", ylabel="level in % of no absorber", ylim=(0, None), xticks=modes
        )
    forces.set_title("second resonance")
    draw_legends(axes)
    return figure


FIGURE = PaperFigure(
    LABEL,
    "how many modes the second resonance needs",
    describe=_describe,
    draw=_draw,
    claims=_claims,
    answer=_answer,
    measure=lambda settings, size, earlier: measure_groups(
        {str(n): partial(_of_modes, n, settings, size) for n in size.modes}, earlier
    ),
    sizes=(  # forces in N at the first and at the second resonance
        Size(
            first=(1.5, 2.5, 3.5, 5.0),
            second=(20.0, 25.0, 30.0, 35.0, 40.0),
            modes=(5, 7, 10, 15, 20, 30),
            members=16,
        ),
        Size(first=(3.5,), second=(35.0,), modes=(5, 10, 20), members=3),
    ),
)
