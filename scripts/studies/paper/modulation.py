"""What makes the modulation less obvious with many modes: the energy that impacts take from the resonant mode for good. Beyond the paper.

An impact changes the velocity of each mode by its share of one impulse. What the off-resonant modes get of it is mostly gone before the next impact,
so that for the resonant mode alone the impact is a lossy one. With G_n = 1/m_a + sum of phi_i^2 over n modes the impulse is (1 + e) gamma/G_n; the
same impulse comes from a beam of one mode with the restitution

    e_1 = (1 + e) G_1/G_n - 1.

So n modes without losses should be modulated as one mode with e_1 is: that is tested here. Below 0 the absorber stays behind the tip and is struck
again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.drive import Drive, constant_frequency
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import tip_response
from impact_env.parameters import Beam, RigidWalls, impact_absorber
from impact_env.periodic.case import start_from
from impact_env.periodic.stationary import window_of
from impact_env.response import Record
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from studies.paper.claim import Claim, Verdict
from studies.paper.curve import Chaos
from studies.paper.frame import PaperFigure, Settings, has, in_turn, shortened
from studies.paper.style import LOOKS, legends, line, panels
from studies.study import Json, Steps, Table

LABEL = "modulation"
FORCE = 1.5  # N, the paper's for the strongly modulated response
SETTLE = 200  # pseudo periods before the window
ENDS = (0.05, 0.95)  # quantiles of the periods' peaks that the depth is taken between: a largest peak would grow with the window

BEGUN, ABOVE = (1, 3, 10), (1.01, 1.03, 1.1, 1.3)  # modes, and forces over that at which the first impacts come
MOST_FOLLOWED = 14  # modes up to which a tangent vector is followed
FAST = 4  # modes from which on most of what an impact scatters is gone before the next
RECORD = Record(level=False, events=True, series=True, energy=True)


def equivalent_restitution(scene: Scene, restitution: float = 1.0) -> float:
    """Return e_1 of the module's head for a scene with an absorber; below 0 the absorber is struck again at once."""
    assert scene.absorber_mass is not None
    compliances = 1 / scene.absorber_mass + np.cumsum(scene.model.tip_shape**2)
    return float((1 + restitution) * compliances[0] / compliances[-1] - 1)


@dataclass(frozen=True)
class Exchange:
    """Measures a lane's window of ``periods`` after its own run, at the frequency and phase it ended with."""

    periods: int

    def __call__(self, lane: Lane) -> dict[str, float]:
        """Return depth of the modulation, level, impacts a period, and what becomes of the energy."""
        scene, settled = lane.scene, lane.drive
        end = simulate(scene, settled, record=Record(events=True)).end_state
        omega = float(settled.schedule.omegas[-1])
        phase = settled.phase + float(settled.schedule.phase_at(float(settled.schedule.times[-1])))
        drive = Drive(settled.amplitude, constant_frequency(omega, 1.0, self.periods), phase)
        response = simulate(scene, drive, initial=start_from(scene, end), record=RECORD)
        assert response.history is not None
        assert response.energy is not None
        energy, loss = mechanical_energy(scene, response.history), response.energy
        lost = float(np.sum(loss.modal_loss)) + loss.impact_loss
        return {
            "depth": depth(window_of(scene, response, omega).peaks),
            "rms_m": float(np.sqrt(np.mean(response.history.tip_displacement**2))),
            "impacts": response.impact_count / self.periods,
            "absorber": float(np.mean(energy.absorber_share)),
            "absorber_most": float(np.quantile(energy.absorber_share, ENDS[1])),
            "taken": (lost - float(loss.modal_loss[0])) / lost,
            "a_period": (lost - float(loss.modal_loss[0])) / self.periods / float(np.mean(energy.modal[:, 0])),
        }


def depth(peaks: NDArray[np.float64]) -> float:
    """Return (a - b)/(a + b) with the 95 and 5 % quantiles a and b of the periods' largest |q_tip|, (M,)."""
    low, high = np.quantile(peaks, ENDS)
    return float((high - low) / (high + low))


class Sizes(NamedTuple):
    """Numbers of modes, restitutions of one mode, pseudo periods of the window, and members."""

    modes: tuple[int, ...]
    restitutions: tuple[float, ...]
    periods: int
    members: int


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    many = [beam_scene(Beam(modes=n), impact_absorber()) for n in size.modes]
    equivalents = [max(equivalent_restitution(scene), 0.0) for scene in many]
    same, one = (
        [beam_scene(Beam(modes=1), impact_absorber(restitution=e)) for e in restitutions] for restitutions in (equivalents, size.restitutions)
    )
    groups = {
        "modes": partial(_rows, settings, size, many, equivalents),
        "equivalent": partial(_rows, settings, size, same, equivalents),
        "one mode": partial(_rows, settings, size, one, size.restitutions),
        "exponents": partial(_exponents, settings, size, [scene for scene in many if scene.model.modes <= MOST_FOLLOWED]),
        "begins": partial(_begins, settings, size, [scene for scene in many if scene.model.modes in BEGUN]),
    }
    return in_turn(groups, known)


def _exponents(settings: Settings, size: Sizes, scenes: list[Scene]) -> list[Json]:
    """Return the largest Lyapunov exponent of each scene's response, from the paper's own phase."""
    lanes = [Lane(scene, Drive(FORCE, constant_frequency(scene.model.resonance_omega(1), 1.0, SETTLE))) for scene in scenes]
    found = settings.each(f"{LABEL}: exponents", lanes, Chaos(size.periods))
    return [{"modes": scene.model.modes, "exponent": list(exponent)} for scene, exponent in zip(scenes, found, strict=True)]


def _begins(settings: Settings, size: Sizes, scenes: list[Scene]) -> list[Json]:
    """Return the largest exponent at forces just above that at which the free tip fills the gap, by numbers of modes."""
    lanes, rows = [], list[Json]()
    for scene in scenes:
        omega = scene.model.resonance_omega(1)
        least = RigidWalls.gap / float(np.abs(tip_response(scene.model, None, np.array([omega])))[0])
        for share in ABOVE:
            lanes.append(Lane(scene, Drive(share * least, constant_frequency(omega, 1.0, SETTLE))))
            rows.append({"modes": scene.model.modes, "over": share, "force_n": share * least})
    found = settings.each(f"{LABEL}: begins", lanes, Chaos(size.periods // 2))
    return [{**row, "exponent": list(exponent)} for row, exponent in zip(rows, found, strict=True)]


def _rows(settings: Settings, size: Sizes, scenes: list[Scene], restitutions: Sequence[float]) -> list[Json]:
    """Return a row for each scene: medians and 5 and 95 % of its members, and the nominal member."""
    members = draw_members(size.members, settings.seed)
    lanes = []
    for scene in scenes:
        schedule = constant_frequency(scene.model.resonance_omega(1), 1.0, SETTLE)
        lanes += [Lane(scene, drive) for drive in members.drives(FORCE, schedule)]
    found = settings.each(LABEL, lanes, Exchange(size.periods))
    rows = []
    for k, (scene, restitution) in enumerate(zip(scenes, restitutions, strict=True)):
        own = found[k * len(members) : (k + 1) * len(members)]
        values = {name: [float(x) for x in np.quantile([one[name] for one in own], (0.5, *ENDS))] + [own[0][name]] for name in own[0]}
        rows.append({"modes": scene.model.modes, "restitution": restitution, **values})
    return rows


def _table(values: Json) -> Table:
    """Return all numbers of modes beside one mode with the equivalent restitution."""
    header = (
        "modes", "$e_1$", "depth", "one mode with $e_1$", "taken from mode 1, %", "one mode with $e_1$", "absorber's energy, %", "impacts a period",
        "largest exponent a period (95 %)",
    )  # fmt: skip
    body = []
    exponents = {row["modes"]: "{:.2f} ({:.2f} to {:.2f})".format(*row["exponent"]) for row in values.get("exponents", ())}
    for row, other in zip(values.get("modes", ()), values.get("equivalent", ()), strict=False):
        cells = (_interval(row["depth"]), _interval(other["depth"]), _interval(row["taken"], 100, 0), _interval(other["taken"], 100, 0))
        last = (_interval(row["absorber"], 100, 0), _interval(row["impacts"]), exponents.get(row["modes"], ""))
        body.append((f"{row['modes']}", f"{row['restitution']:.2f}", *cells, *last))
    return Table(f"{LABEL}_modes", header, body)


def _words(values: Json) -> str:
    blocks = [
        shortened(_table(values)),
        *([_compared(values)] if has("modes", "equivalent")(values) else []),
        *([_begun(values)] if "begins" in values else []),
    ]
    return "\n\n".join(blocks)


def _begun(values: Json) -> str:
    """Say how the exponent begins above the first impacts."""
    said = []
    for modes in dict.fromkeys(row["modes"] for row in values["begins"]):
        own = [row for row in values["begins"] if row["modes"] == modes]
        said.append(f"{', '.join('{:.2f} ({:.2f} to {:.2f})'.format(*row['exponent']) for row in own)} with {modes} mode{'s' if modes > 1 else ''}")
    shares = ", ".join(f"{row['over']:g}" for row in own)
    return f"How it begins: at {shares} times the force at which the free tip fills the gap the largest exponent is {'; '.join(said)}."


def _interval(found: list[float], scale: float = 1.0, digits: int = 2) -> str:
    middle, low, high, _ = (f"{scale * x:.{digits}f}" for x in found)
    return f"{middle} ({low} to {high})"


def _compared(values: Json) -> str:
    """Say how far apart many modes and one mode with the equivalent restitution are, over all and where scattering is fast."""
    pairs = list(zip(values["modes"], values["equivalent"], strict=True))
    worst = max(pairs, key=lambda pair: abs(pair[0]["depth"][0] - pair[1]["depth"][0]))
    rest = [pair for pair in pairs if pair is not worst]
    row, other = worst
    first = (
        f"They differ most at {row['modes']} modes, whose $e_1$ is {other['restitution']:.3f}: the depths are {_interval(row['depth'])} and "
        f"{_interval(other['depth'])}, and one mode has {_interval(other['impacts'])} impacts a period."
    )
    found = [first]
    for few, words in ((1, "Else"), (FAST, f"and from {FAST} modes on")):
        some = [(row, other) for row, other in rest if row["modes"] >= few]
        depths, shares = (max(abs(row[name][0] - other[name][0]) for row, other in some) for name in ("depth", "taken"))
        level = max(abs(row["rms_m"][0] / other["rms_m"][0] - 1) for row, other in some)
        found.append(f"{words} the depths by {depths:.2f} at most, the shares taken by {100 * shares:.0f} points, the levels by {100 * level:.0f} %")
    return f"{found[0]} {found[1]}, {found[2]}."


def _answer(values: Json) -> str:
    """Say in a line what makes the modulation less obvious, and where that falls short."""
    pairs = list(zip(values["modes"], values["equivalent"], strict=True))
    row, other = max(pairs, key=lambda pair: abs(pair[0]["depth"][0] - pair[1]["depth"][0]))
    return (
        f"What makes the modulation less obvious: energy that impacts scatter for good; one mode with a restitution that takes as much has nearly "
        f"the same depth, except at {row['modes']} modes, {row['depth'][0]:.2f} against {other['depth'][0]:.2f}."
    )


def _claims(values: Json) -> list[Claim]:
    """Return the paper's statement on the modulation, of which it leaves the reason open."""
    rows = values["modes"]
    few, many = rows[0], rows[-1]
    said = f"depth {_interval(few['depth'])} at {few['modes']} mode, {_interval(many['depth'])} at {many['modes']}"
    holds = many["depth"][2] < few["depth"][1]
    why = "" if holds else "The bands of the members overlap."
    verdict = Verdict.HOLDS if holds else Verdict.NOT
    return [Claim("modulation_fades", "the modulation becomes less obvious as modes are added", "4.2", said, verdict, LABEL, why)]


NAMED = (1, 2, 3, 4, 5, 7, 10, 12)  # numbers of modes that stand beside their points


def _draw(values: Json) -> Figure:
    """Draw depth and energies over the number of modes, beside one mode with the equivalent restitution; and the depth over that."""
    figure, axes = panels(1, 3, 2.9)
    depth, energy, over = axes[0]
    many, other, one = values["modes"], values["equivalent"], values["one mode"]
    modes = [row["modes"] for row in many]
    for rows, look, label in ((many, LOOKS[0], "$N_m$ modes, $e$ = 1"), (other, LOOKS[1], "one mode, $e_1$")):
        low, high = _edges(rows, "depth")
        line(depth, modes, _middle(rows, "depth"), look, label, band=(low, high), nominal=[row["depth"][3] for row in rows])
    line(energy, modes, 100 * _middle(many, "taken"), LOOKS[0], "taken, $N_m$ modes")
    line(energy, modes, 100 * _middle(other, "taken"), LOOKS[1], "taken, one mode, $e_1$")
    line(energy, modes, 100 * _middle(many, "absorber"), LOOKS[2], "in the absorber")
    for panel in (depth, energy):
        panel.set(xscale="log", xlabel="modes $N_m$")
        panel.set_xticks(modes, [f"{n}" if n in (1, 2, 3, 5, 10, 20, 30) else "" for n in modes], minor=False)
        panel.minorticks_off()
    line(over, [row["restitution"] for row in one], _middle(one, "depth"), LOOKS[1], "one mode over $e$", band=_edges(one, "depth"))
    line(over, [row["restitution"] for row in many], _middle(many, "depth"), LOOKS[0], marked=False)
    over.lines[-1].set(ls="", marker=LOOKS[0].marker, label="$N_m$ modes at their $e_1$")
    for e in dict.fromkeys(row["restitution"] for row in many):
        own = [row for row in many if row["restitution"] == e]  # several that are set to 0
        last, height = own[-1]["modes"], max(row["depth"][0] for row in own)
        words, beside = (f"{own[0]['modes']} to {last}", (-6, 13)) if len(own) > 1 else (f"{last}" if last in NAMED else "", (3, -9))
        over.annotate(words, (e, height), xytext=beside, textcoords="offset points", fontsize=6.5, color="0.35")
    depth.set(ylabel="depth of the modulation", ylim=(0, 0.95))
    energy.set(ylabel="share in %", ylim=(0, 125), yticks=range(0, 101, 20))
    over.set(xlabel="restitution of one mode, $e_1$", ylabel="depth of the modulation", xlim=(None, 1.09), ylim=(0, None))
    depth.legend(loc="upper right")
    over.legend(loc="lower right", fontsize=6.5)
    legends(axes)
    return figure


def _middle(rows: list[Json], name: str) -> np.ndarray:
    return np.array([row[name][0] for row in rows])


def _edges(rows: list[Json], name: str) -> tuple[np.ndarray, np.ndarray]:
    return np.array([row[name][1] for row in rows]), np.array([row[name][2] for row in rows])


FIGURE = PaperFigure(
    LABEL, "what makes the modulation less obvious", measure=_measure, words=_words, draw=_draw, claims=_claims, answer=_answer,
    needs=has("modes", "equivalent", "one mode"), tables=lambda values: (_table(values),),
    sizes=(
        Sizes(
            (1, 2, 3, 4, 5, 7, 10, 11, 12, 13, 14, 15, 20, 30),
            tuple(np.unique([*np.linspace(0, 1, 11), *np.linspace(0.02, 0.18, 9)]).round(2).tolist()), 1000, 8,
        ),
        Sizes((1, 3, 10, 20), (0.0, 0.25, 0.5, 0.75, 1.0), 300, 3),
    ),
)  # fmt: skip
