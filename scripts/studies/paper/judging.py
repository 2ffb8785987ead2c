"""How a claim is read from members' values: what they allow, and what is written of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from impact_env.curve import BAND, quantiles
from studies.paper.claim import Claim, Verdict, judged
from studies.paper.words import spread

INFINITY = float("inf")


def verdict(low: float, high: float, least: float, most: float, at_step: float | None = None) -> Verdict:
    """Return what an interval says of a statement that allows least..most; ``at_step``: the value of the paper's own run, with its step."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return Verdict.NOT
    found = judged(low, high, least, most)
    return Verdict.STEP if found is Verdict.NOT and at_step is not None and least <= at_step <= most else found


def interval(values: ArrayLike, form: str = "{:.2f}", unit: str = "") -> str:
    """Return median and 5 to 95 % of values in words."""
    return spread(values, form, unit=unit)


def claim(
    figure: str,
    name: str,
    statement: str,
    section: str,
    values: ArrayLike,
    allowed: tuple[float, float],
    why: str,
    *,
    about: str = "",
    form: str = "{:.2f}",
    unit: str = "",
    at_step: float | None = None,
    definitional: bool = False,
) -> Claim:
    """Return a claim on a number: ``values`` of the members, judged by their 5 to 95 %. ``about`` says what the number is.

    ``at_step``: the number by the paper's scheme and step, in one run.
    """
    low, high = (float(x) for x in quantiles(np.asarray(values, dtype=float).ravel(), BAND))
    said = f"{about}{interval(values, form, unit)}" + ("" if at_step is None else f"; {form.format(at_step)}{unit} at the paper's step")
    return Claim(f"{figure}_{name}", statement, section, said, verdict(low, high, *allowed, at_step), figure, why, definitional)
