"""Bounds on forces, masses and rates: valid numbers that no study can use are refused with a reason, before anything runs."""

from collections.abc import Iterable

from impact_env.drive import MOST_PERIODS
from impact_env.parameters import number, positive, require

MOST_FORCE = 1e12  # N: far above what any structure bears, and far below where squares of displacements overflow
MOST_MASS = 1.0  # of the structure's: design rule, limit and tunings are those of an absorber, not of what it would hang on
LEAST_PERIODS = 5.0  # of a sweep: in fewer the response has not begun to build up


def usable_force(name: str, value: float) -> float:
    """Return a force in N; raises ParameterError unless it is above 0 and at most `MOST_FORCE`."""
    require(0 < number(value) <= MOST_FORCE, name, value, f"above 0 and at most {MOST_FORCE:g} N")
    return positive(name, value)


def usable_mass_ratio(name: str, value: float) -> float:
    """Return an absorber's mass over the structure's; raises ParameterError unless it is above 0 and at most `MOST_MASS`."""
    ratio = positive(name, value)
    require(ratio <= MOST_MASS, name, value, f"above 0 and at most {MOST_MASS:g}: an absorber no heavier than the structure")
    return ratio


def usable_rate(name: str, value: float, sweeps: Iterable[tuple[float, float]]) -> float:
    """Return a sweep rate in % per 100 pseudo periods; raises ParameterError if a sweep (low, high over omega_r) is over at once or never ends."""
    rate = positive(name, value)
    widths = [1e4 * abs(high - low) for low, high in sweeps]  # rate times the number of pseudo periods
    least, most = max(widths) / MOST_PERIODS, min(widths) / LEAST_PERIODS
    allowed = f"from {least:.3g} to {most:.4g} % per 100 pseudo periods, so that a sweep takes {LEAST_PERIODS:g} to {MOST_PERIODS:g} of them"
    require(least <= rate <= most, name, value, allowed)
    return rate
