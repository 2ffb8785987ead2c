"""Two designs compared by noisy values: the ratio of their quantiles, with an interval.

Runs part after some impacts, so the same members (phases, roundings) of two designs have nothing in
common: the correlation of their levels was measured as -0.17. Pairing them buys nothing, and the
interval resamples each design's members on its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import require

Array = NDArray[np.float64]
COVERED = 0.95
PREDICTED = 0.9  # share of fresh runs in a prediction interval, 5 to 95 %
RESAMPLES = 2000


@dataclass(frozen=True)
class Gain:
    """Ratio of two designs' values, with its 95 % bootstrap interval.

    ``ratio``, ``low`` and ``high`` are NaN if the second value is 0, or if a run broke down.
    """

    ratio: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.ratio:.3f} ({self.low:.3f} to {self.high:.3f})"


def _members(name: str, values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=np.float64)
    require(array.ndim == 1 and array.size > 0, name, array.shape, "a row of one value or more")
    return array


@dataclass(frozen=True)
class Prediction:
    """Predictive distribution of a fresh run's value.

    Its logarithm follows Student's distribution around ``centre`` with a ``scale`` and
    ``freedoms``.
    """

    centre: float
    scale: float
    freedoms: int

    def interval(self, share: float = PREDICTED) -> tuple[float, float]:
        """Return the two values between which a fresh run lies with a probability of ``share``."""
        half = float(scipy.stats.t.ppf((1 + share) / 2, self.freedoms)) * self.scale
        return float(np.exp(self.centre - half)), float(np.exp(self.centre + half))

    def probability_below(self, limit: float) -> float:
        """Return the probability that a fresh run's value is at most ``limit``, above 0."""
        require(limit > 0, "limit", limit, "above 0")
        if self.scale == 0:
            return float(np.log(limit) >= self.centre)
        return float(scipy.stats.t.cdf((np.log(limit) - self.centre) / self.scale, self.freedoms))


def predict(values: ArrayLike, groups: Sequence[ArrayLike]) -> Prediction | None:
    """Return the prediction of a fresh run of a design from its own ``values`` (M,).

    The spread is pooled over all designs that were run.

    ``groups`` has the values of each of these designs, those of this one among them. Their
    logarithms have means of their own and one spread in common; for M values the mean's own
    uncertainty adds 1/M. None where no design ran twice.
    """
    own = np.log(_members("values", values))
    rows = [np.log(_members("groups", group)) for group in groups]
    freedoms = sum(row.size - 1 for row in rows)
    if freedoms == 0:
        return None
    square = sum(float(np.sum((row - row.mean()) ** 2)) for row in rows) / freedoms
    scale = float(np.sqrt(square * (1 + 1 / own.size)))
    return Prediction(float(own.mean()), scale, freedoms)


OWN_MEMBERS = 8  # of a row, from which its own spread is used and its neighbours' are not
UNKNOWN = (float("nan"), float("nan"))


def prediction_interval(values: ArrayLike, alike: Sequence[ArrayLike] = ()) -> tuple[float, float]:
    """Return the ends of the interval that holds `PREDICTED` (90 %) of fresh runs.

    They follow from a design's ``values`` (M,), of which NaN are ignored.

    With fewer than `OWN_MEMBERS` values the spread is pooled with that of ``alike``, rows of
    designs that have nearly the same one. Values follow a log-normal distribution; where one of
    them is 0 or below a normal one, cut at 0 where none is below it. NaN where the spread is not
    known, as of one value alone.
    """
    own = np.asarray(values, dtype=np.float64)
    own = own[np.isfinite(own)]
    if own.size == 0:
        return UNKNOWN
    groups = [own]
    if own.size < OWN_MEMBERS:
        others = (np.asarray(row, dtype=np.float64) for row in alike)
        groups += [row[np.isfinite(row)] for row in others]
        groups = [row for row in groups if row.size > 0]
    if all(np.all(row > 0) for row in groups):
        prediction = predict(own, groups)
        return UNKNOWN if prediction is None else prediction.interval()
    least = min(float(row.min()) for row in groups)
    freedoms = sum(row.size - 1 for row in groups)
    if freedoms == 0:
        return UNKNOWN
    square = sum(float(np.sum((row - row.mean()) ** 2)) for row in groups) / freedoms
    factor = float(scipy.stats.t.ppf((1 + PREDICTED) / 2, freedoms))
    half = factor * float(np.sqrt(square * (1 + 1 / own.size)))
    low = float(own.mean()) - half
    return (max(low, 0.0) if least >= 0 else low), float(own.mean()) + half


def prediction_band(rows: ArrayLike, near: int = 1) -> Array:
    """Return `prediction_interval` of each row of values (F, M), as low and high ends (2, F).

    The rows belong to neighbouring designs or forces.

    Rows of few members share their spread with ``near`` rows to either side.
    """
    values = np.asarray(rows, dtype=np.float64)
    require(values.ndim == 2, "rows", values.shape, "a row of members for each design")
    ends = [
        prediction_interval(row, [*values[max(k - near, 0) : k], *values[k + 1 : k + 1 + near]])
        for k, row in enumerate(values)
    ]
    return np.array(ends).reshape(-1, 2).T


def ratio_of_quantiles(first: ArrayLike, second: ArrayLike, quantile: float = 0.5) -> Gain:
    """Return the quantile of ``first`` (M,) over that of ``second`` (K,).

    Both are values of members. The default is the ratio of medians.

    The interval is a percentile bootstrap, of no width where either has one member only. Raises
    ParameterError for empty rows.
    """
    a = _members("first", first)
    b = _members("second", second)

    def ratio(x: Array, y: Array, axis: int = -1) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(
                np.quantile(x, quantile, axis=axis) / np.quantile(y, quantile, axis=axis)
            )

    middle = float(ratio(a, b))
    if not np.isfinite(middle):
        return Gain(*(float("nan"),) * 3)
    if min(a.size, b.size) < 2:
        return Gain(middle, middle, middle)
    options = {
        "n_resamples": RESAMPLES,
        "confidence_level": COVERED,
        "method": "percentile",
        "rng": np.random.default_rng(0),
    }
    interval = scipy.stats.bootstrap(
        (a, b), ratio, paired=False, vectorized=True, **options
    ).confidence_interval
    return Gain(middle, float(interval.low), float(interval.high))


def standard_error(values: ArrayLike, quantile: float = 0.5) -> float:
    """Return the bootstrap's standard error of a quantile of members (M,).

    It is NaN for one member.
    """
    row = _members("values", values)
    if row.size < 2 or not np.all(np.isfinite(row)):
        return float("nan")

    def value(x: Array, axis: int = -1) -> Array:
        return np.asarray(np.quantile(x, quantile, axis=axis))

    interval = scipy.stats.bootstrap(
        (row,),
        value,
        n_resamples=RESAMPLES,
        method="percentile",
        vectorized=True,
        rng=np.random.default_rng(0),
    )
    return float(interval.standard_error)


# Ensembles whose members take two branches of response: one design, force and structure, and two
# levels.
#
# A median of such members is a level that hardly any run has. So two log-normal branches of one
# width are fitted beside a single one, and are reported where they fit clearly better: by Schwarz's
# criterion, with a margin that single samples of 8 to 64 members pass in about one of a hundred.


MARGIN = 8.0  # of Schwarz's criterion (BIC) for two branches over one
# upper over lower level: what lies closer together is one level to anyone who builds an absorber
APART = 1.1
FEWEST = 2  # members that make a branch
MEMBERS = 8  # fewer tell nothing
_ROUNDS = 200
_WIDTH = 1e-6  # of a branch, relative: members that agree to all digits are no branch of no width


@dataclass(frozen=True)
class Branches:
    """Two branches of levels.

    ``levels``: (lower, upper), the medians of their members in the members' unit. ``shares``: their
    shares of the members.
    """

    levels: tuple[float, float]
    shares: tuple[float, float]

    def text(self, scale: float = 1.0, unit: str = "") -> str:
        """Return the branches in words, levels times ``scale``."""
        low, high = (
            f"{scale * level:.3g}{unit} ({100 * share:.0f} % of the members)"
            for level, share in zip(self.levels, self.shares, strict=True)
        )
        return f"two branches, {low} and {high}"


def _log_likelihood(x: Array, centres: Array, weights: Array, width: float) -> tuple[float, Array]:
    """Return the log-likelihood of rows (M,) under a mixture of two branches.

    The second result, (M, 2), is the probability of each branch for each member.
    """
    with np.errstate(divide="ignore"):
        terms = (
            np.log(weights)
            - 0.5 * ((x[:, None] - centres) / width) ** 2
            - np.log(width * np.sqrt(2 * np.pi))
        )
    total = np.logaddexp(terms[:, 0], terms[:, 1])
    return float(total.sum()), np.exp(terms - total[:, None])


def _fit(x: Array, cut: int) -> tuple[float, Array]:
    """Return the best log-likelihood of a mixture of two branches, and the probabilities.

    It is found by expectation maximisation. The start divides the sorted members after ``cut``.
    """
    chances = np.zeros((len(x), 2))
    chances[:cut, 0] = chances[cut:, 1] = 1.0
    best = -np.inf
    for _ in range(_ROUNDS):
        mass = chances.sum(axis=0)
        if mass.min() < 1e-9:
            break
        centres = (x @ chances) / mass
        width = max(float(np.sqrt(np.sum(chances * (x[:, None] - centres) ** 2) / len(x))), _WIDTH)
        value, chances = _log_likelihood(x, centres, mass / len(x), width)
        if value - best < 1e-9:
            break
        best = value
    return best, chances


def branches(members: ArrayLike) -> Branches | None:
    """Return the two branches of members' levels (M,), above 0, or None.

    The result is None if a single branch fits as well, if the two lie within a tenth of each other,
    or for fewer than 8 members.
    """
    levels = np.sort(np.asarray(members, dtype=np.float64))
    if (
        levels.ndim != 1
        or len(levels) < MEMBERS
        or not np.all(np.isfinite(levels))
        or levels[0] <= 0
    ):
        return None
    x = np.log(levels)
    n = len(levels)
    gaps = np.diff(x)
    starts = {int(k) + 1 for k in np.argsort(-gaps)[:4]} | {n // 4, n // 2, 3 * n // 4}
    value, chances = max((_fit(x, cut) for cut in sorted(starts)), key=lambda fit: fit[0])
    width = max(float(np.std(x)), _WIDTH)
    single = -0.5 * n * (1 + np.log(2 * np.pi * width**2))
    margin = 2 * (value - single) - 2 * np.log(n)  # two numbers more: another centre, and the share
    upper = chances[:, 1] > 0.5
    if margin < MARGIN or min(upper.sum(), n - upper.sum()) < FEWEST:
        return None
    low, high = (float(np.median(levels[part])) for part in (~upper, upper))
    if high < APART * low:
        return None
    return Branches((low, high), (float(1 - upper.mean()), float(upper.mean())))
