"""How precisely a device must be made, and which of its numbers its level depends on: as lines, rows of a card and JSON."""

import numpy as np

from impact_env.parameters import SlidingAbsorber
from optimisation.files import number, numbers
from optimisation.report.card import Row
from optimisation.sobol import BOX_DIFFERENCES, BOX_UNITS, Sensitivity
from optimisation.tolerances import NOMINAL_RUNS, SURE, WIDEST_TOLERANCES, Tolerances
from optimisation.uncertain import FRICTION, GAP, RESTITUTION

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


def tolerance_lines(found: Tolerances, absorber: SlidingAbsorber) -> list[str]:
    """Return the answer in words."""
    what = f"a level below {1e3 * found.limit:.4g} mm with {100 * SURE:.0f} %"
    if found.nominal < SURE:
        below = round(found.nominal * NOMINAL_RUNS)
        return [
            f"Tolerances for {what}: none are small enough; of {NOMINAL_RUNS} runs of the exact device {below} stay below."
        ]
    alone = _listed(found.alone, absorber)
    lines = [f"Tolerances for {what}, one at a time: {alone}."]
    if found.checked == 0:
        return [*lines, "All together: none are small enough."]
    low, high = (100 * end for end in found.interval)
    lines.append(
        f"All together: {_listed(found.together, absorber)}; of {found.checked} fresh draws {found.below} stay below "
        f"({100 * found.below / found.checked:.0f} %, 95 % interval {low:.0f} to {high:.0f} %)."
    )
    return lines


def _listed(widths: dict[str, float], absorber: SlidingAbsorber) -> str:
    return ", ".join(f"{name} {half_width(name, x, absorber)}" for name, x in widths.items())


def tolerance_rows(found: Tolerances, absorber: SlidingAbsorber) -> tuple[Row, ...]:
    """Return the rows of a card."""
    if found.nominal < SURE:
        return (
            Row("exact device, share of runs below the limit", 100 * found.nominal, "%"),
            Row("tolerances", "none are small enough"),
        )
    rows = [
        Row(f"{name}, all together", half_width(name, x, absorber))
        for name, x in found.together.items()
    ]
    rows += [Row(f"{name} alone", half_width(name, x, absorber)) for name, x in found.alone.items()]
    low, high = (100 * end for end in found.interval)
    checked = f"{found.below} of {found.checked} ({low:.0f} to {high:.0f} %)"
    rows.append(
        Row("fresh draws below the limit", checked if found.checked else "none are small enough")
    )
    return tuple(rows)


def tolerance_data(found: Tolerances, absorber: SlidingAbsorber) -> Json:
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

    low, high = found.interval
    return {
        "limit_level_m": found.limit,
        "probability": SURE,
        "together": si(found.together),
        "alone": si(found.alone),
        "widest": si({name: WIDEST_TOLERANCES[name] for name in found.alone}),
        "exact_device_below": found.nominal,
        "draws": found.checked,
        "draws_below": found.below,
        "probability_low": number(low),
        "probability_high": number(high),
        "sweeps": found.runs,
    }


def _box(found: Sensitivity, k: int) -> str:
    """Return the half width of a variable's box in words."""
    name = found.names[k]
    half = (found.high[k] - found.low[k]) / 2
    if name in BOX_DIFFERENCES:
        return f"{name} ±{half:.2g}"
    return f"{name} ±{100 * half / ((found.high[k] + found.low[k]) / 2):.2g} %"


def sensitivity_lines(found: Sensitivity) -> list[str]:
    """Return the shares of a level's variance in words, the largest first."""
    order = np.argsort(-found.total, kind="stable").tolist()
    words = [
        f"{_box(found, k)}: {found.first[k]:.2f}, {found.total[k]:.2f} ({found.total_band[k, 0]:.2f} to {found.total_band[k, 1]:.2f})"
        for k in order
    ]
    return [
        f"Sobol shares of the level's variance, alone and with the others (95 % interval): {'; '.join(words)}.",
        f"  Standard deviation {1e3 * found.spread:.4g} mm, of {found.designs} devices; what runs differ by chance is in the second number only.",
    ]


def sensitivity_rows(found: Sensitivity) -> tuple[Row, ...]:
    """Return the rows of a card."""
    rows = [
        Row(
            _box(found, k),
            f"{found.first[k]:.2f} alone, {found.total[k]:.2f} with the others ({found.total_band[k, 0]:.2f} to {found.total_band[k, 1]:.2f})",
        )
        for k in range(len(found.names))
    ]
    return (*rows, Row("standard deviation of the level", 1e3 * found.spread, "mm"))


def sensitivity_data(found: Sensitivity) -> Json:
    """Return the shares as JSON values."""
    return {
        "level_standard_deviation_m": number(found.spread),
        "devices": found.designs,
        "variables": {
            name: {
                "low": float(found.low[k]),
                "high": float(found.high[k]),
                "unit": BOX_UNITS.get(name, ""),
                "first": number(found.first[k]),
                "first_95_percent": numbers(found.first_band[k]),
                "total": number(found.total[k]),
                "total_95_percent": numbers(found.total_band[k]),
            }
            for k, name in enumerate(found.names)
        },
    }
