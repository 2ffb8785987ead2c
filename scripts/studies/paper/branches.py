"""Periodic responses over the frequency as plain values.

They are exact orbits, harmonic balance as in the paper, and the two linear curves.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from impact_env.periodic.harmonic_balance import PAPER_DAMPER, WEIGHT, harmonic_balance
from impact_env.periodic.overview import balance_curves, exact_curves, linear_curves
from impact_env.periodic.response_curve import ResponseCurve
from impact_env.scene import Scene
from studies.paper.frame import FAINT, MM, REFERENCE, STUCK, STYLES, draw_signal
from studies.study import Json

HARMONICS = 20  # the paper's
POINTS = 400  # of a curve that are kept


def compute_responses(scene: Scene, force: float, low: float, high: float) -> Json:
    """Return all curves at a force (N) between two frequency ratios.

    The ratios are those to the first resonance. Displacements of the tip are in m, and None stands
    where there is no orbit.
    """
    reference = scene.model.resonance_omega(1)
    linear = linear_curves(scene, force, reference, low, high)
    return {
        "force_n": force,
        "exact": [_plain(curve) for curve in exact_curves(scene, force, reference, low, high)],
        "balance": compute_balance(scene, force, low, high),
        "linear": {
            name: [_digits(x) for x in getattr(linear, name)[::2]]
            for name in ("omega_ratio", "alone", "stuck")
        },
        "stuck_peak": float(linear.omega_ratio[np.argmax(linear.stuck)]),
    }


def compute_balance(
    scene: Scene,
    force: float,
    low: float,
    high: float,
    harmonics: int = HARMONICS,
    damper: float = PAPER_DAMPER,
) -> list[Json]:
    """Return the curves of harmonic balance; ``damper`` in N s/m between absorber and ground."""
    reference = scene.model.resonance_omega(1)
    model = harmonic_balance(
        scene, low * reference, force, harmonics, WEIGHT, grounded_damper=damper
    )
    return [_plain(curve) for curve in balance_curves(model, reference, low, high)]


def _plain(curve: ResponseCurve) -> Json:
    """Return a curve for the file, with 7 digits and a limited number of points.

    Of long curves every second point or fewer are written. ``kind`` is 2 for stable points, 1 for
    those that are stable except for fast multipliers, and 0 for unstable ones.
    """
    every = slice(None, None, 1 + len(curve.omega_ratio) // POINTS)
    plain: Json = {
        "closed": curve.closed,
        "folds": [[fold.omega_ratio, fold.tip_max] for fold in curve.folds],
    }
    plain["peak"] = None if curve.peak is None else [curve.peak.omega_ratio, curve.peak.tip_max]
    plain |= {
        name: [_digits(x) for x in getattr(curve, name)[every]]
        for name in ("omega_ratio", "tip_max")
    }
    if curve.stable is not None and curve.slowly_stable is not None:
        plain["kind"] = [
            int(s) + int(t)
            for s, t in zip(curve.stable[every], curve.slowly_stable[every], strict=True)
        ]
    return plain


def _digits(value: float) -> float | None:
    return float(f"{value:.7g}") if np.isfinite(value) else None


# of an exact orbit: unstable slowly, unstable by fast multipliers only, stable; its style and label
KINDS = (
    (STYLES[1].colour, (0, (1.5, 1.2)), 1.4, "exact, unstable"),
    (STYLES[0].colour, (0, (5, 1.2)), 1.8, "exact, fast multipliers unstable"),
    (STYLES[0].colour, "-", 2.6, "exact, stable"),
)


def draw_linear(axes: Axes, ratio: Any, linear: Json, width: float) -> None:
    """Draw the responses without absorber and with a stuck one, in mm."""
    for name, style, label in (
        ("alone", REFERENCE, "no absorber"),
        ("stuck", STUCK, "absorber stuck"),
    ):
        draw_signal(axes, ratio, MM * np.array(linear[name]), style, label, width)


def draw_responses(axes: Axes, part: Json) -> None:
    """Draw the result of `compute_responses`, with heights in mm.

    Adjacent pieces of different stability share the point between them.
    """
    draw_linear(axes, part["linear"]["omega_ratio"], part["linear"], 0.9)
    for number, curve in enumerate(part["balance"]):
        label = None if number else "harmonic balance, 20 harmonics"
        axes.plot(
            curve["omega_ratio"],
            MM * np.array(curve["tip_max"], dtype=float),
            color=FAINT,
            lw=1.0,
            label=label,
        )
    visible: set[int] = set()
    folds = [fold for curve in part["exact"] for fold in curve["folds"]]
    for curve in part["exact"]:
        x = np.array(curve["omega_ratio"])
        y = MM * np.array(curve["tip_max"], dtype=float)
        kinds = np.array(curve["kind"])
        ends = np.flatnonzero(kinds[1:] != kinds[:-1]) + 1
        for begin, end in zip([0, *ends], [*ends, len(kinds)], strict=True):
            kind = int(kinds[begin])
            inside = slice(begin, min(int(end) + 1, len(kinds)))
            colour, dashes, width, label = KINDS[kind]
            axes.plot(
                x[inside],
                y[inside],
                color=colour,
                ls=dashes,
                lw=width,
                label=None if kind in visible else label,
            )
            visible.add(kind)
    if folds:
        ratio, height = np.array(folds).T
        style: dict[str, Any] = {"ms": 3.5, "mfc": "white", "mec": "black", "mew": 0.7, "zorder": 5}
        axes.plot(ratio, MM * height, "o", label="fold (saddle node)", **style)
