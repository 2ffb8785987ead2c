"""Frequency responses at a medium and a high force (paper, section 3.1, its figure high_low): exact orbits, and harmonic balance beside them."""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from impact_env.curve import CurveCase
from impact_env.drive import Drive, constant_frequency
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import tip_response
from impact_env.methods import Exact, Method, Moreau
from impact_env.parameters import Beam, impact_absorber
from impact_env.periodic.case import case_of
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.harmonic_balance import PAPER_DAMPER
from impact_env.periodic.isolas import thresholds
from impact_env.periodic.residence import Approach, hold
from impact_env.periodic.stationary import Stationary, stationary
from impact_env.response import Record
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import simulate
from optimisation.page import markdown
from studies.paper import high_low_claims
from studies.paper.branches import HARMONICS, balance, draw, responses
from studies.paper.claim import between
from studies.paper.curve import Chaos
from studies.paper.frame import PaperFigure, Settings, has, in_turn
from studies.paper.style import FAINT, MM, legend_below, panels
from studies.study import Json, Steps

LABEL = "high_low"
MODES, FRICTION, FORCES = 3, 0.01, {"medium": 1.5, "high": 3.0}  # N: limit of friction, and the paper's two forces
LOW, HIGH, FAR = 0.9, 1.06, 1.2  # frequencies over the first resonance; the inset reaches farther
PLACES = {"high branch": (3.0, 0.955), "at resonance, 1.5 N": (1.5, 1.0), "at resonance, 3 N": (3.0, 1.0)}  # N, ratio
SETTLE, WINDOW = 1000.0, 200  # pseudo periods, periods of the force


def scene() -> Scene:
    """Return the paper's beam and absorber of this figure."""
    return beam_scene(Beam(modes=MODES), impact_absorber(friction_limit=FRICTION))


class Sizes(NamedTuple):
    """Harmonics, forces (N) over which the best is looked for, members, periods of a Lyapunov exponent, and runs from random states."""

    harmonics: tuple[int, ...]
    forces: list[float]
    members: int
    periods: int
    starts: int


def _isola(harmonics: int, damper: float) -> Json:
    """Peak and outer folds of the isola at the medium force by harmonic balance, None where it finds no closed curve."""
    closed = [curve for curve in balance(scene(), FORCES["medium"], LOW, 0.98, harmonics, damper) if curve["closed"]]
    return {"harmonics": harmonics, "damper": damper, "peak": None, "folds": []} | (
        {name: closed[0][name] for name in ("peak", "folds")} if closed else {}
    )


def _levels_of_isolas() -> list[Json]:
    case = case_of(scene(), FORCES["medium"], LOW * scene().model.resonance_omega(1))
    found = thresholds(case, LOW, 0.99)
    return [{"kind": one.kind, "force_n": one.force, "omega_ratio": one.omega_ratio} for one in found if not isinstance(one.orbit, NoOrbit)]


@dataclass(frozen=True)
class Rhythm:
    """Impacts, and visits to a wall, in each of the last `WINDOW` periods of a lane at a constant frequency; a visit ends with one to the other."""

    method: Method

    def __call__(self, lane: Lane) -> tuple[float, float]:
        """Return both of a lane."""
        schedule = lane.drive.schedule
        response = simulate(lane.scene, lane.drive, self.method, record=Record(events=True))
        assert response.impacts is not None
        since = schedule.times[-1] - WINDOW * 2 * np.pi / schedule.omegas[-1]
        walls = np.sign(response.impacts.impulse[response.impacts.time > since])
        return len(walls) / WINDOW, np.count_nonzero(np.diff(walls)) / WINDOW


def _window(lane: Lane) -> Stationary:
    return stationary(lane.scene, lane.drive, WINDOW)


def _stationary(settings: Settings, size: Sizes) -> Json:
    """Return kinds, impacts a period, depths and peaks of all members at each of the places."""
    own, result = scene(), {}
    approach = Approach(own.model.resonance_omega(1), 1.0)
    phases = draw_members(size.members, settings.seed, "phase").phases
    for name, (force, ratio) in PLACES.items():
        lanes = [Lane(own, hold(approach, force, ratio, SETTLE, float(phase))) for phase in phases]
        found = settings.each(f"{LABEL}: {name}", lanes, _window)
        result[name] = {
            "force_n": force,
            "omega_ratio": ratio,
            "kinds": [one.found.kind.value for one in found],
            "impacts_per_period": [one.found.impacts_per_period for one in found],
            "depth": [one.found.depth for one in found],
            "peak_median_m": [float(np.median(one.peaks)) for one in found],
        }
        for method in (Exact(), Moreau()):
            rhythms = settings.each(f"{LABEL}: impacts", lanes, Rhythm(method), method)
            result[name][f"rhythm {type(method).__name__}"] = [list(rhythm) for rhythm in rhythms]
    return result


@dataclass(frozen=True, eq=False)
class Started(Lane):
    """A lane that begins at a state of its own."""

    initial: InitialState


def _kind_from(lane: Lane) -> str:
    """Return the kind of what a `Started` lane settles to."""
    assert isinstance(lane, Started)
    return stationary(lane.scene, lane.drive, WINDOW, initial=lane.initial).found.kind.value


def _basin(settings: Settings, size: Sizes) -> Json:
    """Return how many of runs from random states settle to each kind at the resonance under the medium force.

    The first mode begins anywhere within the ellipse of its own resonance without absorber, the absorber anywhere in its cavity at the tip's speed.
    """
    own, number = scene(), size.starts
    omega, generator = own.model.resonance_omega(1), np.random.default_rng([settings.seed, 29])
    most = FORCES["medium"] * float(np.abs(tip_response(own.model, None, np.array([omega])))[0]) / abs(own.model.tip_shape[0])
    lanes = []
    for size, angle, place, phase in generator.uniform((0, 0, -1, 0), (1, 2 * np.pi, 1, 2 * np.pi), (number, 4)):
        q, v = (np.eye(MODES)[0] * most * np.sqrt(size) * x for x in (np.cos(angle), omega * np.sin(angle)))
        tip, speed = float(own.model.tip_shape @ q), float(own.model.tip_shape @ v)
        schedule = constant_frequency(omega, 1.0, SETTLE)
        lanes.append(Started(own, Drive(FORCES["medium"], schedule, float(phase)), InitialState(q, v, tip + 1e-3 * float(place), speed)))
    kinds = settings.each(f"{LABEL}: basin", lanes, _kind_from)
    return {kind: kinds.count(kind) for kind in sorted(set(kinds))}


def _exponents(settings: Settings, size: Sizes) -> Json:
    """Return the largest Lyapunov exponent at each of the places, from the paper's own phase."""
    own = scene()
    approach = Approach(own.model.resonance_omega(1), 1.0)
    lanes = [Lane(own, hold(approach, force, ratio, SETTLE)) for force, ratio in PLACES.values()]
    return dict(zip(PLACES, settings.each(f"{LABEL}: exponents", lanes, Chaos(size.periods)), strict=True))


def _levels(settings: Settings, size: Sizes) -> Json:
    """Return levels over the force, relative to no absorber."""
    force = np.array(size.forces)
    own = scene()
    alone = Scene(own.model, None)
    curve, reference = settings.curves(f"{LABEL}: levels", [CurveCase(own, force), CurveCase(alone, force)], size.members)
    return {"force_n": force.tolist(), "relative": curve.relative_to(reference).tolist()}


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    groups: dict[str, Any] = {name: partial(responses, scene(), force, LOW, FAR) for name, force in FORCES.items()}
    groups |= {
        "isolas": _levels_of_isolas,
        "harmonics": lambda: [_isola(h, PAPER_DAMPER) for h in size.harmonics],
        "no_damper": partial(_isola, HARMONICS, 0.0),
        "stationary": partial(_stationary, settings, size),
        "levels": partial(_levels, settings, size),
        "exponents": partial(_exponents, settings, size),
        "basin": partial(_basin, settings, size),
    }
    return in_turn(groups, known)


def _words(values: Json) -> str:
    lines = []
    for name in FORCES:
        for method, said in (("exact", "exact orbits"), ("balance", "harmonic balance")):
            for curve in values[name][method] if name in values else ():
                if curve["peak"] is not None:
                    at, peak = curve["peak"]
                    form = "closed" if curve["closed"] else "open"
                    folds = ", ".join(f"{ratio:.5f}" for ratio, _ in curve["folds"])
                    lines.append((f"{values[name]['force_n']:g}", said, form, f"{1e3 * peak:.3f}", f"{at:.4f}", folds))
    text = markdown(("force, N", "method", "curve", "peak, mm", "at", "folds"), lines)
    if "stationary" in values:
        rows = []
        for name, found in values["stationary"].items():
            kinds = ", ".join(f"{kind} {found['kinds'].count(kind)}" for kind in dict.fromkeys(found["kinds"]))
            exact, stepped = (np.array(found[f"rhythm {method}"]) for method in ("Exact", "Moreau"))
            counts = (between(exact[:, 0], "{:.2f}"), between(exact[:, 1], "{:.2f}"), between(stepped[:, 0], "{:.2f}"))
            exponent = "{:.3f} ({:.3f} to {:.3f})".format(*values["exponents"][name]) if "exponents" in values else ""
            rows.append((name, f"{found['force_n']:g}", f"{found['omega_ratio']:g}", kinds, *counts, between(found["depth"], "{:.2f}"), exponent))
        columns = ("impacts a period", "visits to a wall", "impacts at the paper's step", "modulation depth", "largest exponent a period (95 %)")
        text += "\n\n" + markdown(("stationary", "force, N", "frequency ratio", "members", *columns), rows)
    return text


RANGE = (0.9, 1.06)
NAMED = {  # the paper's names of the curves, and where they stand: frequency ratio and displacement in mm
    "medium": {"a": (0.99, 1.78), "b": (0.9705, 1.91), "c": (0.9405, 0.6), "d": (0.915, 0.29), "e": (0.936, 1.41), "f": (1.007, 0.55)},
    "high": {"a": (0.99, 3.55), "b": (0.972, 3.75), "c": (0.937, 0.13), "d": (0.93, 0.65), "e": (0.942, 2.75), "f": (1.0, 0.36)},
}


def _draw(values: Json) -> Figure:
    """Draw the largest tip displacement over the frequency for both forces."""
    figure, axes = panels(1, 2, 3.6, "")
    for own, name in zip(axes.flat, ("medium", "high"), strict=True):
        part = values[name]
        draw(own, part)
        own.set(xlim=RANGE, ylim=(0, 1.25 * MM * max(curve["peak"][1] for curve in part["balance"])), xlabel=r"frequency $\Omega/\omega_1$")
        own.set_title(f"{part['force_n']:g} N")
        own.axhline(1.0, color=FAINT, lw=0.5)
        for letter, (ratio, height) in NAMED[name].items():
            own.text(ratio, height, f"({letter})", ha="center", va="center", fontsize=7.5)
    axes[0, 0].set_ylabel("largest tip displacement in mm")
    inset = axes[0, 1].inset_axes((0.75, 0.52, 0.24, 0.44))
    draw(inset, values["high"])
    inset.set(xlim=(1.02, 1.19), ylim=(0, 1.2), xticks=(1.05, 1.1, 1.15), yticks=(0.5, 1.0))
    inset.tick_params(labelsize=6)
    legend_below(figure, axes, 3)
    return figure


FIGURE = PaperFigure(
    LABEL, "frequency responses at a medium and a high force", measure=_measure, words=_words, draw=_draw, claims=high_low_claims.claims,
    needs=has(*FORCES),
    sizes=(
        Sizes((HARMONICS, 40), np.round(np.geomspace(0.9, 4.0, 12), 3).tolist(), 16, 2000, 200),
        Sizes((HARMONICS,), np.round(np.geomspace(0.9, 4.0, 4), 3).tolist(), 2, 200, 4),
    ),
)  # fmt: skip
