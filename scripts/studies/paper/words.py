"""Numbers as the page and the claims say them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from impact_env.curve import BAND, quantiles


def spread(values: ArrayLike, form: str = "{:.3g}", factor: float = 1.0, unit: str = "") -> str:
    """Return median and 5 to 95 % of members, as "0.64 (0.55 to 0.71)", the median alone where all read the same; NaN is left out."""
    low, middle, high = (form.format(factor * float(x)) for x in quantiles(np.ravel(values), (BAND[0], 0.5, BAND[1])))
    return f"{middle}{unit}" if low == high else f"{middle}{unit} ({low} to {high})"


def between(values: ArrayLike, form: str = "{:.3g}", factor: float = 1.0) -> str:
    """Return least and largest value, as "0.55 to 0.71", or the value where both read the same."""
    row = np.ravel(np.asarray(values, dtype=float))
    low, high = (form.format(factor * float(x)) for x in (np.nanmin(row), np.nanmax(row)))
    return low if low == high else f"{low} to {high}"


def middle(values: ArrayLike) -> tuple[float, float]:
    """Return the 5 and the 95 % of members, for `claim.judged`; NaN is left out."""
    low, high = quantiles(np.ravel(values), BAND)
    return float(low), float(high)
