"""Frequency responses at a medium and a high force (paper, section 3.1, its figure high_low): exact orbits, and harmonic balance beside them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from impact_env.curve import CurveCase
from impact_env.drive import Drive, constant_frequency
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import tip_response
from impact_env.methods import Exact, Method, Moreau
from impact_env.parameters import Beam, impact_absorber
from impact_env.periodic.case import case_of
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.harmonic_balance import PAPER_DAMPER, WEIGHT
from impact_env.periodic.isolas import thresholds
from impact_env.periodic.residence import Approach, hold
from impact_env.periodic.stationary import Stationary, stationary
from impact_env.response import Record
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import simulate
from optimisation.report.markdown import markdown
from studies.paper.frame import figure_part, has, in_turn
from studies.paper.high_low_claims import claims as claims
from studies.paper.responses import HARMONICS, balance, responses
from studies.paper.settings import Settings
from studies.paper.watched import Chaos
from studies.paper.words import between
from studies.study import Json, Measured, Saver, Steps

LABEL = "high_low"
MODES, FRICTION, FORCES = 3, 0.01, {"medium": 1.5, "high": 3.0}  # N: limit of friction, and the paper's two forces
LOW, HIGH, FAR = 0.9, 1.06, 1.2  # frequencies over the first resonance; the inset reaches farther
MORE = 40  # harmonics, beside the paper's
PLACES = {"high branch": (3.0, 0.955), "at resonance, 1.5 N": (1.5, 1.0), "at resonance, 3 N": (3.0, 1.0)}  # N, ratio
PERIODS = (2000, 200)  # of the force, for a Lyapunov exponent
SETTLE, WINDOW = 1000.0, 200  # pseudo periods, periods of the force


def scene() -> Scene:
    """Return the paper's beam and absorber of this figure."""
    return beam_scene(Beam(modes=MODES), impact_absorber(friction_limit=FRICTION))


def forces(settings: Settings) -> list[float]:
    """Return the forces (N) over which the best is looked for."""
    return np.round(np.geomspace(0.9, 4.0, settings.size(12, 4)), 3).tolist()


def parameters(settings: Settings) -> Json:
    """Return what the numbers depend on."""
    return {
        "scene": str(scene()), "forces": FORCES, "range": [LOW, HIGH, FAR], "harmonics": [HARMONICS, *settings.size((MORE,), ())], "weight": WEIGHT,
        "damper": PAPER_DAMPER, "places": PLACES, "stationary": [SETTLE, WINDOW, members(settings)], "levels": [forces(settings), members(settings)],
    }  # fmt: skip


def members(settings: Settings) -> int:
    """Return the number of members of levels and stationary responses."""
    return settings.size(16, 2)


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


def _stationary(settings: Settings) -> Json:
    """Return kinds, impacts a period, depths and peaks of all members at each of the places."""
    own, result = scene(), {}
    approach = Approach(own.model.resonance_omega(1), 1.0)
    phases = draw_members(members(settings), settings.seed, "phase").phases
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


def _basin(settings: Settings) -> Json:
    """Return how many of runs from random states settle to each kind at the resonance under the medium force.

    The first mode begins anywhere within the ellipse of its own resonance without absorber, the absorber anywhere in its cavity at the tip's speed.
    """
    own, number = scene(), settings.size(200, 4)
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


def _exponents(settings: Settings) -> Json:
    """Return the largest Lyapunov exponent at each of the places, from the paper's own phase."""
    own = scene()
    approach = Approach(own.model.resonance_omega(1), 1.0)
    lanes = [Lane(own, hold(approach, force, ratio, SETTLE)) for force, ratio in PLACES.values()]
    return dict(zip(PLACES, settings.each(f"{LABEL}: exponents", lanes, Chaos(settings.size(*PERIODS))), strict=True))


def _levels(settings: Settings) -> Json:
    """Return levels over the force, relative to no absorber."""
    force = np.array(forces(settings))
    own = scene()
    alone = Scene(own.model, None)
    curve, reference = settings.curves(f"{LABEL}: levels", [CurveCase(own, force), CurveCase(alone, force)], members(settings))
    return {"force_n": force.tolist(), "relative": curve.relative_to(reference).tolist()}


def _measure(settings: Settings, known: Json) -> Steps:
    groups: dict[str, Any] = {name: partial(responses, scene(), force, LOW, FAR) for name, force in FORCES.items()}
    groups["isolas"] = _levels_of_isolas
    groups["harmonics"] = lambda: [_isola(h, PAPER_DAMPER) for h in (HARMONICS, *settings.size((MORE,), ()))]
    groups["no_damper"] = partial(_isola, HARMONICS, 0.0)
    groups["stationary"] = partial(_stationary, settings)
    groups["levels"] = partial(_levels, settings)
    groups["exponents"] = partial(_exponents, settings)
    groups["basin"] = partial(_basin, settings)
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
    if has(values, "stationary"):
        rows = []
        for name, found in values["stationary"].items():
            kinds = ", ".join(f"{kind} {found['kinds'].count(kind)}" for kind in dict.fromkeys(found["kinds"]))
            exact, stepped = (np.array(found[f"rhythm {method}"]) for method in ("Exact", "Moreau"))
            counts = (between(exact[:, 0], "{:.2f}"), between(exact[:, 1], "{:.2f}"), between(stepped[:, 0], "{:.2f}"))
            rows.append(
                (
                    name,
                    f"{found['force_n']:g}",
                    f"{found['omega_ratio']:g}",
                    kinds,
                    *counts,
                    between(found["depth"], "{:.2f}"),
                    _exponent(values, name),
                )
            )
        columns = ("impacts a period", "visits to a wall", "impacts at the paper's step", "modulation depth", "largest exponent a period (95 %)")
        text += "\n\n" + markdown(("stationary", "force, N", "frequency ratio", "members", *columns), rows)
    return text


def _exponent(values: Json, name: str) -> str:
    return "{:.3f} ({:.3f} to {:.3f})".format(*values["exponents"][name]) if "exponents" in values else ""


def _figures(measured: Measured) -> dict[str, Saver]:
    if not has(measured.values, *FORCES):
        return {}
    from studies.paper.figures import high_low  # matplotlib is slow to import

    return {LABEL: lambda path: high_low.save(path, measured.values)}


PART = figure_part(
    LABEL,
    "frequency responses at a medium and a high force",
    _measure,
    _words,
    _figures,
)
