"""What makes the modulation less obvious with many modes: the energy that impacts take from the resonant mode for good. Beyond the paper.

An impact changes the velocity of each mode by its share of one impulse. What the off-resonant modes get of it is mostly gone before the next impact,
so that for the resonant mode alone the impact is a lossy one. With G_n = 1/m_a + sum of phi_i^2 over n modes the impulse is (1 + e) gamma/G_n; the
same impulse comes from a beam of one mode with the restitution

    e_1 = (1 + e) G_1/G_n - 1.

So n modes without losses should be modulated as one mode with e_1 is: that is tested here. Below 0 the absorber stays behind the tip and is struck
again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
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
from optimisation.report.markdown import markdown
from studies.paper.claim import Claim, Verdict
from studies.paper.frame import figure_part, has, in_turn
from studies.paper.settings import Settings
from studies.paper.watched import Chaos
from studies.study import Json, Measured, Saver, Steps

LABEL = "modulation"
FORCE = 1.5  # N, the paper's for the strongly modulated response
MODES, QUICK_MODES = (1, 2, 3, 4, 5, 7, 10, 11, 12, 13, 14, 15, 20, 30), (1, 3, 10, 20)
RESTITUTIONS, QUICK_RESTITUTIONS = (
    tuple(np.unique([*np.linspace(0, 1, 11), *np.linspace(0.02, 0.18, 9)]).round(2).tolist()),
    (0.0, 0.25, 0.5, 0.75, 1.0),
)
SETTLE = 200  # pseudo periods before the window
PERIODS = (1000, 300)  # of the window, in full and quick
MEMBERS = (8, 3)
ENDS = (0.05, 0.95)  # quantiles of the periods' peaks that the depth is taken between: a largest peak would grow with the window

BEGUN, ABOVE = (1, 3, 10), (1.01, 1.03, 1.1, 1.3)  # modes, and forces over that at which the first impacts come
MOST_FOLLOWED = 14  # modes up to which a tangent vector is followed
FAST = 4  # modes from which on most of what an impact scatters is gone before the next
RECORD = Record(level=False, events=True, series=True, energy=True)


def parameters(settings: Settings) -> Json:
    """Return what the numbers depend on."""
    return {
        "force": FORCE,
        "modes": settings.size(MODES, QUICK_MODES),
        "restitutions": settings.size(RESTITUTIONS, QUICK_RESTITUTIONS),
        "settle": SETTLE,
        "periods": settings.size(*PERIODS),
        "members": settings.size(*MEMBERS),
        "ends": ENDS,
    }


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


def measure(settings: Settings, known: Json) -> Steps:
    """Yield what many modes do without losses, what one mode does with the equivalent restitution, and one mode over the restitution."""
    many = [beam_scene(Beam(modes=n), impact_absorber()) for n in settings.size(MODES, QUICK_MODES)]
    equivalents = [max(equivalent_restitution(scene), 0.0) for scene in many]
    one = settings.size(RESTITUTIONS, QUICK_RESTITUTIONS)
    groups = {
        "modes": partial(_rows, settings, many, equivalents),
        "equivalent": partial(_rows, settings, [_one_mode(e) for e in equivalents], equivalents),
        "one mode": partial(_rows, settings, [_one_mode(e) for e in one], list(one)),
        "exponents": partial(_exponents, settings, [scene for scene in many if scene.model.modes <= MOST_FOLLOWED]),
        "begins": partial(_begins, settings, [scene for scene in many if scene.model.modes in BEGUN]),
    }
    return in_turn(groups, known)


def _exponents(settings: Settings, scenes: list[Scene]) -> list[Json]:
    """Return the largest Lyapunov exponent of each scene's response, from the paper's own phase."""
    lanes = [Lane(scene, Drive(FORCE, constant_frequency(scene.model.resonance_omega(1), 1.0, SETTLE))) for scene in scenes]
    found = settings.each(f"{LABEL}: exponents", lanes, Chaos(settings.size(*PERIODS)))
    return [{"modes": scene.model.modes, "exponent": list(exponent)} for scene, exponent in zip(scenes, found, strict=True)]


def _begins(settings: Settings, scenes: list[Scene]) -> list[Json]:
    """Return the largest exponent at forces just above that at which the free tip fills the gap, by numbers of modes."""
    lanes, rows = [], list[Json]()
    for scene in scenes:
        omega = scene.model.resonance_omega(1)
        least = RigidWalls.gap / float(np.abs(tip_response(scene.model, None, np.array([omega])))[0])
        for share in ABOVE:
            lanes.append(Lane(scene, Drive(share * least, constant_frequency(omega, 1.0, SETTLE))))
            rows.append({"modes": scene.model.modes, "over": share, "force_n": share * least})
    found = settings.each(f"{LABEL}: begins", lanes, Chaos(settings.size(*PERIODS) // 2))
    return [{**row, "exponent": list(exponent)} for row, exponent in zip(rows, found, strict=True)]


def _one_mode(restitution: float) -> Scene:
    return beam_scene(Beam(modes=1), impact_absorber(restitution=restitution))


def _rows(settings: Settings, scenes: list[Scene], restitutions: list[float]) -> list[Json]:
    """Return a row for each scene: medians and 5 and 95 % of its members, and the nominal member."""
    members = draw_members(settings.size(*MEMBERS), settings.seed)
    lanes = []
    for scene in scenes:
        schedule = constant_frequency(scene.model.resonance_omega(1), 1.0, SETTLE)
        lanes += [Lane(scene, drive) for drive in members.drives(FORCE, schedule)]
    found = settings.each(LABEL, lanes, Exchange(settings.size(*PERIODS)))
    rows = []
    for k, (scene, restitution) in enumerate(zip(scenes, restitutions, strict=True)):
        own = found[k * len(members) : (k + 1) * len(members)]
        values = {name: [float(x) for x in np.quantile([one[name] for one in own], (0.5, *ENDS))] + [own[0][name]] for name in own[0]}
        rows.append({"modes": scene.model.modes, "restitution": restitution, **values})
    return rows


def _words(values: Json) -> str:
    header = (
        "modes",
        "$e_1$",
        "depth",
        "one mode with $e_1$",
        "taken from mode 1, %",
        "one mode with $e_1$",
        "absorber's energy, %",
        "impacts a period",
        "largest exponent a period (95 %)",
    )
    body = []
    exponents = {row["modes"]: "{:.2f} ({:.2f} to {:.2f})".format(*row["exponent"]) for row in values.get("exponents", ())}
    for row, other in zip(values.get("modes", ()), values.get("equivalent", ()), strict=False):
        cells = (_interval(row["depth"]), _interval(other["depth"]), _interval(row["taken"], 100, 0), _interval(other["taken"], 100, 0))
        body.append(
            (
                f"{row['modes']}",
                f"{row['restitution']:.2f}",
                *cells,
                _interval(row["absorber"], 100, 0),
                _interval(row["impacts"]),
                exponents.get(row["modes"], ""),
            )
        )
    text = markdown(header, body)
    blocks = [text, *([_answer(values)] if has(values, "modes", "equivalent") else []), *([_begun(values)] if has(values, "begins") else [])]
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


def _answer(values: Json) -> str:
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


def answer(measured: Measured) -> str:
    """Say in a line what makes the modulation less obvious, and where that falls short."""
    pairs = list(zip(measured.values["modes"], measured.values["equivalent"], strict=True))
    row, other = max(pairs, key=lambda pair: abs(pair[0]["depth"][0] - pair[1]["depth"][0]))
    return (
        f"What makes the modulation less obvious: energy that impacts scatter for good; one mode with a restitution that takes as much has nearly "
        f"the same depth, except at {row['modes']} modes, {row['depth'][0]:.2f} against {other['depth'][0]:.2f}."
    )


def figures(measured: Measured) -> Mapping[str, Saver]:
    """Return what draws the figure, once there is something to compare."""
    from studies.paper.figures import modulation as drawn  # matplotlib is slow to import

    ready = has(measured.values, "modes", "equivalent", "one mode")
    return {LABEL: lambda path: drawn.save(Path(path), measured.values)} if ready else {}


def claims(measured: Measured) -> list[Claim]:
    """Return the paper's statement on the modulation, of which it leaves the reason open."""
    rows = measured.values["modes"]
    few, many = rows[0], rows[-1]
    said = f"depth {_interval(few['depth'])} at {few['modes']} mode, {_interval(many['depth'])} at {many['modes']}"
    holds = many["depth"][2] < few["depth"][1]
    why = "" if holds else "The bands of the members overlap."
    return [
        Claim(
            "modulation_fades",
            "the modulation becomes less obvious as modes are added",
            "4.2",
            said,
            Verdict.HOLDS if holds else Verdict.NOT,
            LABEL,
            why,
        )
    ]


PART = figure_part(LABEL, "what makes the modulation less obvious", measure, _words, figures)
