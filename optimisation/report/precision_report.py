"""Manufacturing tolerances of a device, and its sensitivity, as lines, card and JSON.

The sensitivity says on which parameters of the device its level depends.
"""

import numpy as np

from impact_env.parameters import SlidingAbsorber
from optimisation.files import number, numbers
from optimisation.insight import BOX_DIFFERENCES, BOX_UNITS, Sensitivity
from optimisation.report.report import Row
from optimisation.tolerances import (
    FRICTION,
    GAP,
    NOMINAL_RUNS,
    RESTITUTION,
    SURE,
    WIDEST_TOLERANCES,
    Tolerances,
)

Json = dict[str, object]
SHARE_TOL = 1e-9  # of a half width: rounding


def _nominal(name: str, absorber: SlidingAbsorber) -> float:
    """Return the nominal gap in m or friction limit in N of an absorber between rigid walls."""
    if name == GAP:
        assert absorber.walls is not None
        return absorber.walls.gap
    assert absorber.friction is not None
    return absorber.friction.limit


def half_width(name: str, width: float, absorber: SlidingAbsorber) -> str:
    """Return a tolerance in words, with its unit and as a share."""
    more = " or more" if width >= WIDEST_TOLERANCES[name] * (1 - SHARE_TOL) else ""
    if name == RESTITUTION:
        return f"±{width:.2g}{more}"
    value = width * _nominal(name, absorber)
    size = f"{1e3 * value:.2g} mm" if name == GAP else f"{value:.2g} N"
    return f"±{size} (±{100 * width:.2g} %){more}"


def tolerance_lines(tolerances: Tolerances, absorber: SlidingAbsorber) -> list[str]:
    """Return the answer in words."""
    what = f"a level below {1e3 * tolerances.limit:.4g} mm with {100 * SURE:.0f} %"
    if tolerances.nominal < SURE:
        below = round(tolerances.nominal * NOMINAL_RUNS)
        return [
            (
                f"Tolerances for {what}: none are small enough; of {NOMINAL_RUNS} runs of the "
                f"exact device {below} stay below."
            )
        ]
    alone = _listed(tolerances.alone, absorber)
    one, every = tolerances.draws
    lines = [f"Tolerances for {what}, one at a time, estimated from {one} draws each: {alone}."]
    if tolerances.checked == 0:
        return [*lines, f"All together, from {every} draws: none are small enough."]
    low, high = (100 * end for end in tolerances.interval)
    lines.append(
        f"All together, from {every} draws: {_listed(tolerances.together, absorber)}; "
        f"of {tolerances.checked} fresh draws {tolerances.below} stay below "
        f"({100 * tolerances.below / tolerances.checked:.0f} %, 95 % interval {low:.0f} to "
        f"{high:.0f} %)."
    )
    return lines


def _listed(widths: dict[str, float], absorber: SlidingAbsorber) -> str:
    return ", ".join(f"{name} {half_width(name, x, absorber)}" for name, x in widths.items())


def tolerance_rows(tolerances: Tolerances, absorber: SlidingAbsorber) -> tuple[Row, ...]:
    """Return the rows of a card."""
    if tolerances.nominal < SURE:
        return (
            Row("exact device, share of runs below the limit", 100 * tolerances.nominal, "%"),
            Row("tolerances", "none are small enough"),
        )
    rows = [
        Row(f"{name}, all together", half_width(name, x, absorber))
        for name, x in tolerances.together.items()
    ]
    rows += [
        Row(f"{name} alone", half_width(name, x, absorber)) for name, x in tolerances.alone.items()
    ]
    low, high = (100 * end for end in tolerances.interval)
    checked = f"{tolerances.below} of {tolerances.checked} ({low:.0f} to {high:.0f} %)"
    rows.append(
        Row(
            "fresh draws below the limit",
            checked if tolerances.checked else "none are small enough",
        )
    )
    return tuple(rows)


def tolerance_data(tolerances: Tolerances, absorber: SlidingAbsorber) -> Json:
    """Return the answer as JSON values: half widths in SI units."""

    def si(widths: dict[str, float]) -> Json:
        names = {
            GAP: "gap_m",
            RESTITUTION: "restitution",
            FRICTION: "friction_limit_n",
        }
        return {
            names[name]: x if name == RESTITUTION else x * _nominal(name, absorber)
            for name, x in widths.items()
        }

    low, high = tolerances.interval
    return {
        "limit_level_m": tolerances.limit,
        "probability": SURE,
        "together": si(tolerances.together),
        "alone": si(tolerances.alone),
        "widest": si({name: WIDEST_TOLERANCES[name] for name in tolerances.alone}),
        "exact_device_below": tolerances.nominal,
        "draws": tolerances.checked,
        "draws_below": tolerances.below,
        "probability_low": number(low),
        "probability_high": number(high),
        "sweeps": tolerances.runs,
    }


def _box(sensitivity: Sensitivity, k: int) -> str:
    """Return the half width of a variable's box in words."""
    name = sensitivity.names[k]
    half = (sensitivity.high[k] - sensitivity.low[k]) / 2
    if name in BOX_DIFFERENCES:
        return f"{name} ±{half:.2g}"
    return f"{name} ±{100 * half / ((sensitivity.high[k] + sensitivity.low[k]) / 2):.2g} %"


def _total(sensitivity: Sensitivity, k: int, words: str = "") -> str:
    """Return a variable's total index with its interval."""
    low, high = sensitivity.total_band[k]
    return f"{sensitivity.total[k]:.2f}{words} ({low:.2f} to {high:.2f})"


def sensitivity_lines(sensitivity: Sensitivity) -> list[str]:
    """Return the shares of a level's variance in words, the largest first."""
    order = np.argsort(-sensitivity.total, kind="stable").tolist()
    words = [
        f"{_box(sensitivity, k)}: {sensitivity.first[k]:.2f}, {_total(sensitivity, k)}"
        for k in order
    ]
    return [
        (
            "Sobol shares of the level's variance, alone and with the others (95 % interval): "
            f"{'; '.join(words)}."
        ),
        (
            f"  Standard deviation {1e3 * sensitivity.spread:.4g} mm, of "
            f"{sensitivity.designs} devices; "
            "what runs differ by chance is in the second number only."
        ),
    ]


def sensitivity_rows(sensitivity: Sensitivity) -> tuple[Row, ...]:
    """Return the rows of a card."""
    rows = [
        Row(
            _box(sensitivity, k),
            f"{sensitivity.first[k]:.2f} alone, {_total(sensitivity, k, ' with the others')}",
        )
        for k in range(len(sensitivity.names))
    ]
    return (*rows, Row("standard deviation of the level", 1e3 * sensitivity.spread, "mm"))


def sensitivity_data(sensitivity: Sensitivity) -> Json:
    """Return the shares as JSON values."""
    return {
        "level_standard_deviation_m": number(sensitivity.spread),
        "devices": sensitivity.designs,
        "variables": {
            name: {
                "low": float(sensitivity.low[k]),
                "high": float(sensitivity.high[k]),
                "unit": BOX_UNITS.get(name, ""),
                "first": number(sensitivity.first[k]),
                "first_95_percent": numbers(sensitivity.first_band[k]),
                "total": number(sensitivity.total[k]),
                "total_95_percent": numbers(sensitivity.total_band[k]),
            }
            for k, name in enumerate(sensitivity.names)
        },
    }
