"""Frequency responses at a medium and a high force (paper, section 3.1, figure high_low).

Exact orbits are compared with harmonic balance.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from impact_env import (
    Beam,
    CurveCase,
    Record,
    Scene,
    beam_scene,
    impact_absorber,
    modal_model,
    simulate,
)
from impact_env.ensemble import Lane, draw_members
from impact_env.methods import Exact, Method, Moreau
from impact_env.periodic.case import case_of
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.harmonic_balance import PAPER_DAMPER
from impact_env.periodic.isolas import find_thresholds
from impact_env.periodic.residence import Approach, hold
from impact_env.periodic.stationary import ResponseKind, Stationary, classify_run
from optimisation.files import markdown
from studies.paper.branches import HARMONICS, compute_balance, compute_responses, draw_responses
from studies.paper.claim import (
    INFINITY,
    OFTEN,
    Claim,
    Interval,
    find_extent,
    format_interval,
    format_range,
    make_claim,
)
from studies.paper.curve import compute_exponent
from studies.paper.frame import (
    FAINT,
    MM,
    SMALL,
    PaperFigure,
    PaperSettings,
    Size,
    draw_legend_below,
    make_panels,
    measure_groups,
)
from studies.study import Json, Steps

LABEL = "high_low"
# N: limit of friction, and the paper's two forces
MODES = 3
FRICTION = 0.01
FORCES = {"medium": 1.5, "high": 3.0}
GAP = 1e-3  # m
# frequencies over the first resonance; the inset reaches farther
LOW = 0.9
HIGH = 1.06
FAR = 1.2
PLACES = {
    "high branch": (3.0, 0.955),
    "at resonance, 1.5 N": (1.5, 1.0),
    "at resonance, 3 N": (3.0, 1.0),
}  # N, ratio
# pseudo periods, periods of the force
SETTLING_PERIODS = 1000.0
WINDOW = 200


def make_scene() -> Scene:
    """Return the paper's beam and absorber of this figure."""
    return beam_scene(Beam(modes=MODES), impact_absorber(friction_limit=FRICTION))


def _isola(harmonics: int, damper: float) -> Json:
    """Compute peak and outer folds of the isola at the medium force by harmonic balance.

    The peak is None if harmonic balance finds no closed curve.
    """
    result: Json = {"peak": None, "folds": []}
    for curve in compute_balance(make_scene(), FORCES["medium"], LOW, 0.98, harmonics, damper):
        if curve["closed"]:
            result = {name: curve[name] for name in result}
            break
    return {"harmonics": harmonics, "damper": damper, **result}


def _levels_of_isolas() -> list[Json]:
    case = case_of(make_scene(), FORCES["medium"], LOW * make_scene().model.resonance_omega(1))
    result = find_thresholds(case, LOW, 0.99)
    return [
        {"kind": one.kind, "force_n": one.force, "omega_ratio": one.omega_ratio}
        for one in result
        if not isinstance(one.orbit, NoOrbit)
    ]


def measure_rhythm(lane: Lane, method: Method) -> tuple[float, float]:
    """Return impacts and visits to a wall per period at a constant frequency.

    They are counted in the last `WINDOW` periods. A visit ends with an impact on the other wall.
    """
    schedule = lane.drive.schedule
    impacts = simulate(lane.scene, lane.drive, method, record=Record(events=True)).recorded.impacts
    since = schedule.times[-1] - WINDOW * 2 * np.pi / schedule.omegas[-1]
    walls = np.sign(impacts.impulse[impacts.time > since])
    return len(walls) / WINDOW, np.count_nonzero(np.diff(walls)) / WINDOW


def _window(lane: Lane) -> Stationary:
    return classify_run(lane.scene, lane.drive, WINDOW)


def _stationary(settings: PaperSettings, size: Size) -> Json:
    """Return kinds, impacts a period, depths and peaks of all members at each of the places."""
    own = make_scene()
    result = {}
    approach = Approach(own.model.resonance_omega(1), 1.0)
    phases = draw_members(size.members, settings.seed, "phase").phases
    for name, (force, ratio) in PLACES.items():
        lanes = [
            Lane(own, hold(approach, force, ratio, SETTLING_PERIODS, float(phase)))
            for phase in phases
        ]
        results = settings.each(f"{LABEL}: {name}", lanes, _window)
        result[name] = {
            "force_n": force,
            "omega_ratio": ratio,
            "kinds": [one.classification.kind.value for one in results],
            "impacts_per_period": [one.classification.impacts_per_period for one in results],
            "depth": [one.classification.depth for one in results],
            "peak_median_m": [float(np.median(one.peaks)) for one in results],
        }
        for method in (Exact(), Moreau()):
            result[name][f"rhythm {type(method).__name__}"] = settings.each(
                f"{LABEL}: impacts", lanes, partial(measure_rhythm, method=method), method
            )
    return result


def _exponents(settings: PaperSettings, size: Size) -> Json:
    """Return the largest Lyapunov exponent at each of the places, from the paper's own phase."""
    own = make_scene()
    approach = Approach(own.model.resonance_omega(1), 1.0)
    lanes = [
        Lane(own, hold(approach, force, ratio, SETTLING_PERIODS))
        for force, ratio in PLACES.values()
    ]
    return dict(
        zip(
            PLACES,
            settings.each(
                f"{LABEL}: exponents", lanes, partial(compute_exponent, periods=size.periods)
            ),
            strict=True,
        )
    )


def _levels(settings: PaperSettings, size: Size) -> Json:
    """Return levels over the force, relative to no absorber."""
    cases = [
        CurveCase(each, np.array(size.forces))
        for each in (make_scene(), Scene(make_scene().model, None))
    ]
    curve, reference = settings.curves(f"{LABEL}: levels", cases, size.members)
    return {"force_n": list(size.forces), "relative": curve.relative_to(reference).tolist()}


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    groups: dict[str, Any] = {
        name: partial(compute_responses, make_scene(), force, LOW, FAR)
        for name, force in FORCES.items()
    }
    groups |= {
        "isolas": _levels_of_isolas,
        "harmonics": lambda: [_isola(h, PAPER_DAMPER) for h in size.harmonics],
        "no_damper": partial(_isola, HARMONICS, 0.0),
        "stationary": partial(_stationary, settings, size),
        "levels": partial(_levels, settings, size),
        "exponents": partial(_exponents, settings, size),
    }
    return measure_groups(groups, earlier)


def _describe(values: Json) -> str:
    lines = []
    for name in FORCES:
        for method, label in (("exact", "exact orbits"), ("balance", "harmonic balance")):
            for curve in (curve for curve in values[name][method] if curve["peak"] is not None):
                at, peak = curve["peak"]
                form = "closed" if curve["closed"] else "open"
                folds = ", ".join(f"{ratio:.5f}" for ratio, _ in curve["folds"])
                lines.append(
                    (
                        f"{values[name]['force_n']:g}",
                        label,
                        form,
                        f"{1e3 * peak:.3f}",
                        f"{at:.4f}",
                        folds,
                    )
                )
    rows = []
    for name, result in values["stationary"].items():
        kinds = ", ".join(
            f"{kind} {result['kinds'].count(kind)}" for kind in dict.fromkeys(result["kinds"])
        )
        exact, stepped = (np.array(result[f"rhythm {method}"]).T for method in ("Exact", "Moreau"))
        counts = [
            format_range(values, "{:.2f}") for values in (*exact, stepped[0], result["depth"])
        ]
        exponent = format_interval(*values["exponents"][name], form="{:.3f}")
        rows.append(
            (name, f"{result['force_n']:g}", f"{result['omega_ratio']:g}", kinds, *counts, exponent)
        )
    columns = (
        "impacts a period",
        "visits to a wall",
        "impacts at the paper's step",
        "modulation depth",
        "largest exponent a period (95 %)",
    )
    text = markdown(("force, N", "method", "curve", "peak, mm", "at", "folds"), lines)
    thresholds = describe_thresholds(values)
    return f"{thresholds[0].upper()}{thresholds[1:]}.\n\n{text}\n\n" + markdown(
        ("stationary", "force, N", "frequency ratio", "members", *columns), rows
    )


# the paper's names of the curves, and where they stand: frequency ratio and displacement in mm
NAMED = {
    "medium": {
        "a": (0.99, 1.78),
        "b": (0.9705, 1.91),
        "c": (0.9405, 0.6),
        "d": (0.915, 0.29),
        "e": (0.936, 1.41),
        "f": (1.007, 0.55),
    },
    "high": {
        "a": (0.99, 3.55),
        "b": (0.972, 3.75),
        "c": (0.937, 0.13),
        "d": (0.93, 0.65),
        "e": (0.942, 2.75),
        "f": (1.0, 0.36),
    },
}


def _draw(values: Json) -> Figure:
    """Draw the largest tip displacement over the frequency for both forces."""
    figure, axes = make_panels(1, 2, 3.6, "")
    for own, name in zip(axes.flat, FORCES, strict=True):
        part = values[name]
        draw_responses(own, part)
        own.set(
            xlim=(LOW, HIGH),
            ylim=(0, 1.25 * MM * max(curve["peak"][1] for curve in part["balance"])),
            xlabel=r"frequency $\Omega/\omega_1$",
        )
        own.set_title(f"{part['force_n']:g} N")
        own.axhline(1.0, color=FAINT, lw=0.5)
        for letter, (ratio, height) in NAMED[name].items():
            own.text(ratio, height, f"({letter})", ha="center", va="center", fontsize=SMALL)
    axes[0, 0].set_ylabel("largest tip displacement in mm")
    inset = axes[0, 1].inset_axes((0.75, 0.52, 0.24, 0.44))
    draw_responses(inset, values["high"])
    inset.set(xlim=(1.02, 1.19), ylim=(0, 1.2), xticks=(1.05, 1.15), yticks=(0.5, 1.0))
    inset.tick_params(labelsize=SMALL)
    draw_legend_below(figure, axes, 3)
    return figure


judge = partial(make_claim, LABEL)


def _claims(values: Json) -> list[Claim]:
    """Return the statements that this figure decides."""
    relative = np.array(values["levels"]["relative"])
    best = np.array(values["levels"]["force_n"])[np.argmin(relative, axis=0)]
    return [
        *_linear(values),
        *_branches(values),
        *_regimes(values),
        _method(values),
        judge("near the optimum", best, least=relative.min(axis=0)),
    ]


def _interpolated(part: Json, name: str, ratio: Any) -> Any:
    return np.interp(
        ratio, part["linear"]["omega_ratio"], np.array(part["linear"][name], dtype=float)
    )


def _linear(values: Json) -> list[Claim]:
    medium = values["medium"]
    omega = modal_model(Beam(modes=3)).omega
    ratio, height = _sliding(medium)
    off = np.abs(height / _interpolated(medium, "alone", ratio) - 1)
    return [
        judge("third frequency", float(omega[2] / omega[0])),
        judge("stuck resonance", medium["stuck_peak"]),
        judge("sliding follows linear", float(off.max()), median=float(np.median(off))),
        judge("sharp bends", height.max() / GAP, mm=1e3 * height.max()),
    ]


def _sliding(part: Json) -> tuple[Any, Any]:
    """Return frequency and height of the response without impacts below the resonance.

    It is computed by harmonic balance and ends where it turns at the gap.
    """
    for curve in part["balance"]:
        ratio = np.array(curve["omega_ratio"])
        height = np.array(curve["tip_max"], dtype=float)
        if not curve["closed"] and ratio.min() < 0.905:
            ratio, height = (ratio, height) if ratio[0] < ratio[-1] else (ratio[::-1], height[::-1])
            stop = int(np.argmax(height[ratio < 1.0])) + 1
            return ratio[:stop], height[:stop]
    raise ValueError("harmonic balance found no response without impacts")


def _counts(part: Json) -> list[int]:
    """Return the numbers of periodic responses of harmonic balance over the frequency.

    They are counted at 320 frequency ratios between 0.9 and 1.06.
    """
    grid = np.linspace(0.9003, 1.0597, 320)
    count = np.zeros(320, dtype=int)
    for curve in part["balance"]:
        ratio = np.array(
            curve["omega_ratio"] + (curve["omega_ratio"][:1] if curve["closed"] else [])
        )
        for low, high in zip(
            np.minimum(ratio[1:], ratio[:-1]), np.maximum(ratio[1:], ratio[:-1]), strict=True
        ):
            count += (low <= grid) & (grid < high)
    return count.tolist()


def find_threshold_forces(values: Json, kind: str) -> list[float]:
    """Return the forces in N of the isola's thresholds of a kind, "birth" or "merger"."""
    return [one["force_n"] for one in values["isolas"] if one["kind"] == kind]


def describe_thresholds(values: Json) -> str:
    """Return between which forces the isola exists."""
    centres, mergers = (find_threshold_forces(values, kind) for kind in ("birth", "merger"))
    if not centres or not mergers:
        return "no threshold"
    return (
        f"isola centre at {format_range(centres, '{:.3f}')} N, merger at "
        f"{format_range(mergers, '{:.3f}')} N"
    )


def _closed(part: Json, method: str) -> Json | None:
    return next((curve for curve in part[method] if curve["closed"]), None)


def _highest(part: Json) -> Json:
    return max(
        (curve for curve in part["exact"] if curve["peak"]), key=lambda curve: curve["peak"][1]
    )


def _branches(values: Json) -> list[Claim]:
    medium = values["medium"]
    high = values["high"]
    counts = _counts(medium) + _counts(high)
    isola = _closed(medium, "exact")
    top = _highest(high)
    mergers = find_threshold_forces(values, "merger")
    outer = [fold[0] for fold in isola["folds"]] if isola else []
    alone = float(np.max(_interpolated(high, "alone", np.linspace(0.98, 1.02, 401))))
    return [
        judge(
            "number of responses", float(np.mean([1 <= n <= 3 for n in counts])), most=max(counts)
        ),
        judge(
            "isola",
            bool(outer and max(outer) < 1),
            isola=f"closed, from {min(outer):.5f} to {max(outer):.5f} of omega_1"
            if outer
            else "none",
        ),
        judge(
            "merger",
            any(1.5 < force < 3.0 for force in mergers),
            thresholds=describe_thresholds(values),
        ),
        judge("far fold", max((fold[0] for fold in top["folds"]), default=0.0)),
        judge("merely shifted", 1 - top["peak"][1] / alone, peak=top["peak"][0]),
    ]


def _near(curves: Sequence[Json], ratio: float, width: float = 0.002) -> list[tuple[float, int]]:
    """Return height and stability of the orbits next to a frequency."""
    return [
        (y, kind)
        for curve in curves
        for x, y, kind in zip(curve["omega_ratio"], curve["tip_max"], curve["kind"], strict=True)
        if y is not None and abs(x - ratio) < width
    ]


def _regimes(values: Json) -> list[Claim]:
    medium = values["medium"]
    high = values["high"]
    result = values["stationary"]
    here = _near(medium["exact"], 1.0) or _near(medium["exact"], 1.0, 0.01)
    unstable = sum(kind < 2 for _, kind in here)
    peaks = [_highest(part)["peak"][0] for part in (medium, high)]
    upper = [kind for y, kind in _near(high["exact"], 0.945, 0.02) if y > 1.2 * GAP]
    stable, slow = (float(np.mean([kind >= least for kind in upper])) for least in (2, 1))
    at = result["at resonance, 1.5 N"]
    top = result["high branch"]
    exponent = values["exponents"]["high branch"]
    impacts, visits = np.array(top["rhythm Exact"]).T
    modulated = float(np.mean([kind == ResponseKind.MODULATED.value for kind in at["kinds"]]))
    return [
        judge(
            "low at resonance",
            float(np.median([y for y, _ in here])) / float(_interpolated(medium, "alone", 1.0)),
        ),
        judge(
            "unstable at resonance",
            unstable == len(here) and modulated >= OFTEN,
            unstable=unstable,
            orbits=len(here),
            modulated=modulated,
            depth=at["depth"],
        ),
        judge("sustained", visits),
        judge(
            "two impacts",
            impacts,
            steps=np.array(top["rhythm Moreau"])[:, 0],
            stable=stable,
            slow=slow,
        ),
        judge("weakly modulated", top["depth"], depth=at["depth"]),
        judge("chaotic", Interval(*exponent), (0.0, INFINITY), exponent=exponent),
        judge(
            "lower frequency",
            find_extent(peaks),
            (0.0, 0.999),
            medium=peaks[0],
            high=peaks[1],
            stuck=medium["stuck_peak"],
        ),
    ]


def _method(values: Json) -> Claim:
    exact = _closed(values["medium"], "exact")
    rows = values["harmonics"]
    bare = values["no_damper"]
    error, *others = (
        row["peak"][1] / exact["peak"][1] - 1 if exact and row["peak"] else np.nan for row in rows
    )
    left, of_exact = (
        min((fold[0] for fold in one["folds"]), default=np.nan)
        for one in (rows[0], exact or {"folds": []})
    )
    more = "".join(
        f"; with {row['harmonics']} harmonics {100 * off:+.1f} %"
        for row, off in zip(rows[1:], others, strict=True)
    )
    change = (
        abs(rows[0]["peak"][1] / bare["peak"][1] - 1)
        if rows[0]["peak"] and bare["peak"]
        else np.nan
    )
    return judge(
        "twenty harmonics",
        abs(error),
        error=error,
        left=left,
        exact=of_exact,
        more=more,
        change=change,
    )


FIGURE = PaperFigure(
    LABEL,
    "frequency responses at a medium and a high force",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=_claims,
    sizes=(  # harmonics; forces among which the best is searched; periods of a Lyapunov exponent
        Size(
            harmonics=(HARMONICS, 40),
            forces=np.geomspace(0.9, 4.0, 12).round(3).tolist(),
            members=16,
            periods=2000,
        ),
        Size(
            harmonics=(HARMONICS,),
            forces=np.geomspace(0.9, 4.0, 4).round(3).tolist(),
            members=2,
            periods=200,
        ),
    ),
)
