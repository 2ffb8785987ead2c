"""Impact absorbers that share one mass."""

import math
from collections.abc import Iterable

from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    MOST_ABSORBERS,
    RigidWalls,
    SeveralAbsorbers,
    count,
    impact_absorber,
    listed,
    positive,
    require,
)


def shared_masses(
    number: int, mass_ratio: float = DEFAULT_MASS_RATIO, shares: Iterable[float] | None = None
) -> tuple[float, ...]:
    """Return the mass ratio of each of several absorbers that share one: ``mass_ratio`` is that of all together, ``shares`` are equal by default."""
    number = count("number", number, 1, MOST_ABSORBERS)
    shares = (
        (1 / number,) * number
        if shares is None
        else tuple(positive("shares", x) for x in listed("shares", shares))
    )
    require(len(shares) == number, "shares", shares, f"one for each of the {number} absorbers")
    require(abs(math.fsum(shares) - 1) < 1e-9, "shares", shares, "numbers above 0 whose sum is 1")
    return tuple(positive("mass_ratio", mass_ratio) * share for share in shares)


def impact_absorbers(
    gaps: Iterable[float],
    positions: Iterable[float],
    restitution: float | Iterable[float] = RigidWalls.restitution,
    friction_limit: float | Iterable[float | None] | None = None,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    shares: Iterable[float] | None = None,
) -> SeveralAbsorbers:
    """Return impact absorbers with rigid contact that share one mass: ``mass_ratio`` all together, of which each has its share (default: equal ones).

    ``gaps`` in m and ``positions`` (shares of the beam's length): one each. ``restitution`` and ``friction_limit`` (N; 0 or None: none): one for
    all, or one each.
    """
    gaps = listed("gaps", gaps)
    positions = listed("positions", positions)
    n = len(gaps)
    restitutions = (
        listed("restitution", restitution)
        if isinstance(restitution, Iterable)
        else (restitution,) * n
    )
    limits = (
        listed("friction_limit", friction_limit)
        if isinstance(friction_limit, Iterable)
        else (friction_limit,) * n
    )
    for name, values in (
        ("positions", positions),
        ("restitution", restitutions),
        ("friction_limit", limits),
    ):
        require(len(values) == n, name, values, f"one for each of the {n} gaps")
    every = zip(gaps, restitutions, limits, shared_masses(n, mass_ratio, shares), strict=True)
    return SeveralAbsorbers(tuple(impact_absorber(*one) for one in every), positions)
