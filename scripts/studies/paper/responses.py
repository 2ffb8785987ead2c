"""Periodic responses over the frequency as plain values: exact orbits, harmonic balance as the paper did it, and the two linear curves."""

from __future__ import annotations

import numpy as np

from impact_env.periodic.harmonic_balance import PAPER_DAMPER, WEIGHT, harmonic_balance
from impact_env.periodic.overview import balance_curves, exact_curves, linear_curves
from impact_env.periodic.response_curve import ResponseCurve
from impact_env.scene import Scene
from studies.study import Json

HARMONICS = 20  # the paper's
POINTS = 400  # of a curve that are kept


def responses(scene: Scene, force: float, low: float, high: float) -> Json:
    """Return all curves at a force (N) between two ratios of the first resonance; displacements of the tip in m, None where there is no orbit."""
    reference = scene.model.resonance_omega(1)
    linear = linear_curves(scene, force, reference, low, high)
    return {
        "force_n": force,
        "exact": [_plain(curve) for curve in exact_curves(scene, force, reference, low, high)],
        "balance": balance(scene, force, low, high),
        "linear": {name: [_digits(x) for x in getattr(linear, name)[::2]] for name in ("omega_ratio", "alone", "stuck")},
        "stuck_peak": float(linear.omega_ratio[np.argmax(linear.stuck)]),
    }


def balance(scene: Scene, force: float, low: float, high: float, harmonics: int = HARMONICS, damper: float = PAPER_DAMPER) -> list[Json]:
    """Return the curves of harmonic balance; ``damper`` in N s/m between absorber and ground."""
    reference = scene.model.resonance_omega(1)
    model = harmonic_balance(scene, low * reference, force, harmonics, WEIGHT, grounded_damper=damper)
    return [_plain(curve) for curve in balance_curves(model, reference, low, high)]


def _plain(curve: ResponseCurve) -> Json:
    """Return a curve for the file: 7 digits, of long ones every second point or fewer. ``kind``: 2 stable, 1 but for fast multipliers, 0 not."""
    every = slice(None, None, 1 + len(curve.omega_ratio) // POINTS)
    plain: Json = {"closed": curve.closed, "folds": [[fold.omega_ratio, fold.tip_max] for fold in curve.folds]}
    plain["peak"] = None if curve.peak is None else [curve.peak.omega_ratio, curve.peak.tip_max]
    plain |= {name: [_digits(x) for x in getattr(curve, name)[every]] for name in ("omega_ratio", "tip_max")}
    if curve.stable is not None and curve.slowly_stable is not None:
        plain["kind"] = [int(s) + int(t) for s, t in zip(curve.stable[every], curve.slowly_stable[every], strict=True)]
    return plain


def _digits(value: float) -> float | None:
    return float(f"{value:.7g}") if np.isfinite(value) else None
