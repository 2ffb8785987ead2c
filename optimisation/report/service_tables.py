"""A winner in service as JSON values and as a text to read."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from optimisation.measures import ACCELERATION, FRICTION_HEAT, IMPACT_POWER, IMPACT_RATE, IMPACT_RMS, IMPACT_SPEED, STROKE
from optimisation.service import BEAM_TOLERANCES, QUANTILES, TOLERANCES, Service
from optimisation.units import parts_of

Json = dict[str, object]
WORDS = {
    IMPACT_SPEED: ("largest impact speed", "m/s", 1.0),
    IMPACT_RMS: ("RMS impact speed", "m/s", 1.0),
    IMPACT_RATE: ("impacts", "1/s", 1.0),
    IMPACT_POWER: ("power lost in impacts (wear)", "mW", 1e3),
    FRICTION_HEAT: ("friction heat", "mW", 1e3),
    STROKE: ("stroke from the middle", "mm", 1e3),
    ACCELERATION: ("largest acceleration of the structure", "m/s^2", 1.0),
}


def _numbers(values: NDArray[np.float64]) -> list[float | None]:
    return [float(x) if math.isfinite(x) else None for x in values]


def _range_of(name: str) -> str:
    """Return a tolerance in words."""
    kind, size = (BEAM_TOLERANCES | TOLERANCES)[name if name in BEAM_TOLERANCES else parts_of(name)[0]]
    return {"share": f"-+{100 * size:g} %", "factor": f"over and times {size:g}", "difference": f"-+{size:g}"}[kind]


def service_summary(found: Service) -> Json:
    """Return the service of a design as JSON values, condition by condition, in SI units."""
    rows = []
    for c, condition in enumerate(found.conditions):
        rows.append(
            {
                "resonance": condition.resonance,
                "force_n": condition.force,
                "watched_5_50_95_percent": {name: _numbers(values[:, c]) for name, values in found.watched.items()},
                "forces_that_it_halves_n": _numbers(found.forces[:, c]),
                "level_m": float(found.level[c]),
                "level_with_one_number_off_m": {name: _numbers(values[:, c]) for name, values in found.single.items()},
                "level_with_all_off_m": {f"{100 * q:g} %": x for q, x in zip(QUANTILES, _numbers(found.joint[:, c]), strict=True)},
                "lasting_level_m": _numbers(found.lasting[c : c + 1])[0],
            }
        )
    return {"tolerances": {name: _range_of(name) for name in found.single}, "conditions": rows}


def borne_pairs(watched: dict[str, NDArray[np.float64]], c: int) -> Iterator[tuple[str, str]]:
    """Yield what a design bears under a condition, by its index (`Service.watched`): name, and median with band in words."""
    for name, values in watched.items():
        word, unit, scale = WORDS[name]
        low, middle, high = (f"{scale * x:.3g}" for x in values[:, c])
        yield word, f"{middle} {unit} ({low} to {high})"


def service_pairs(found: Service, c: int) -> Iterator[tuple[str, str]]:
    """Yield what is known under a condition, by its index: name, and value in words."""
    yield from borne_pairs(found.watched, c)
    low, high = found.forces[:, c]
    yield "halves the level at least from", "no force: not at this one" if math.isnan(low) else f"{low:.3g} to {high:.3g} N"
    for name, values in found.single.items():
        small, large = (f"{100 * (x / found.level[c] - 1):+.0f} %" for x in values[:, c])
        yield f"{name.replace('_', ' ')} off by {_range_of(name)}: level", f"{small} and {large}"
    parts = ", ".join(f"{1e3 * x:.3g} mm in {100 * q:g} %" for q, x in zip(QUANTILES, found.joint[:, c], strict=True))
    yield "all of them off at once: at most", f"{parts} of the cases"
    over = found.lasting[c] / found.level[c]
    yield "a lasting vibration at the worst frequency:", f"{1e3 * found.lasting[c]:.3g} mm, {over:.2f} of the sweep's level"


def service_lines(found: Service) -> Iterator[str]:
    """Yield the lines of a text, condition by condition."""
    for c, condition in enumerate(found.conditions):
        yield f"  in service at resonance {condition.resonance}, {condition.force:g} N:"
        yield from (f"    {name} {value}" for name, value in service_pairs(found, c))
