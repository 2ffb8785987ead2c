"""Distributions of uncertain quantities, and the tolerances that a device may have.

`spreads` reads distributions, and `draw_lane` returns a run with drawn values. `find_tolerances`
finds the largest manufacturing tolerances of gap, restitution and friction with which a device's
level stays below a limit.

Each of d quantities is uniform within its tolerance to either side of its nominal value. The widest
tolerances that are tried define a box around the nominal device. Coordinates are deviations over
these half widths, from -1 to 1. The distance r of a draw (0 to 1) is the largest absolute
coordinate. A box scaled by s contains the draws with r <= s; for uniform draws in it, r has the
density d r^(d - 1)/s^d. Draws with r uniform in 0 to 1, and uniform on the surface of the box of
that scale, therefore serve all scales at once:

    P(level > limit | s) = d/s^d * integral from 0 to s of r^(d - 1) p(r) dr,

where p(r) is the probability of a level above the limit at distance r. It is assumed not to fall
with r, and found by isotonic regression of the draws. The tolerances belong to the largest s at
which the level stays below the limit with a probability of `SURE`. Each draw runs with an ensemble
member of its own, so the probability includes the effect of chaos.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import (
    ParameterError,
    count,
    describe_error,
    finite,
    instance,
    one_of,
    positive,
    require,
    row,
)
from impact_env.curve import CurveCase
from impact_env.drive import Drive, FrequencySchedule
from impact_env.ensemble import Executor, Lane, LaneProgress, Members, draw_members, run_lanes
from impact_env.parameters import Absorber, RigidWalls, SeveralAbsorbers, SlidingAbsorber
from impact_env.scene import Scene
from optimisation.calibration.posterior import Posterior

# Uncertain quantities: damping, frequency, force, gap, restitution and friction.
#
# ``uncertain=`` in Python and ``--uncertain`` of commands have the same values. ``{"gap": "5%"}``
# is a normal distribution around the nominal value with a standard deviation of 5 % of it,
# truncated at three standard deviations. ``{"gap": (0.9e-3, 1.1e-3)}`` is uniform, in SI units
# (frequency in Hz). ``("-3%", "5%")`` is uniform, relative to the nominal value. Draws of a
# calibration's posterior are joint: a member has one row of the posterior (`posterior_spreads`).

DAMPING = "damping"
FREQUENCY = "frequency"
FORCE = "force"
GAP = "gap"
RESTITUTION = "restitution"
FRICTION = "friction"
OF_ABSORBER = (GAP, RESTITUTION, FRICTION)
NAMES = (DAMPING, FREQUENCY, FORCE, *OF_ABSORBER)
CUT = 3.0  # standard deviations at which a normal distribution is truncated
MOST_SHARE = 1 / CUT  # largest relative standard deviation: no value is below 0
FORM = 'a standard deviation as "5%", or two numbers, the lower one first, in SI units or both in %'
UncertainInput = Mapping[str, str | Sequence[float | str]]


@dataclass(frozen=True)
class Distribution:
    """Distribution of the uncertain quantity ``name``.

    It is uniform from ``low`` to ``high`` in SI units (frequency in Hz). If ``relative``, the ends
    are deviations relative to the nominal value (-0.03: 3 % below it). If ``normal``, it is normal
    around the nominal value with the relative standard deviation ``high``, truncated at three of
    them.
    """

    name: str
    low: float
    high: float
    relative: bool
    normal: bool

    @property
    def column(self) -> str:
        """Key of the random number of `shares` from which a value is drawn: the quantity's name."""
        return self.name

    @property
    def words(self) -> str:
        """The name and the distribution, as the user gives them."""
        if self.normal:
            return f"{self.name} {100 * self.high:g}%"
        return (
            f"{self.name} {100 * self.low:g}% {100 * self.high:g}%"
            if self.relative
            else f"{self.name} {self.low:g} {self.high:g}"
        )

    def value_at(self, share: float, nominal: float) -> float:
        """Return the quantile at the probability ``share`` (0 to 1), in the quantity's unit.

        ``nominal``: nominal value of the quantity.
        """
        if self.normal:
            return nominal * (1 + self.high * float(scipy.stats.truncnorm.ppf(share, -CUT, CUT)))
        value = self.low + share * (self.high - self.low)
        return nominal * (1 + value) if self.relative else value


POSTERIOR = "posterior"
POSTERIOR_NAMES = {"friction_limit": FRICTION}  # in a calibration, and here


@dataclass(frozen=True)
class PosteriorDistribution(Distribution):
    """Draws of a quantity from a posterior: a column of the posterior's rows.

    An ensemble member takes all quantities from the same row, which preserves correlations.
    """

    values: tuple[float, ...] = ()

    @property
    def column(self) -> str:
        """Key of the random number of `shares`: the same for all quantities of a posterior."""
        return POSTERIOR

    @property
    def words(self) -> str:
        """The name, the median and the 90 % interval, in words."""
        low, median, high = np.quantile(self.values, (0.05, 0.5, 0.95))
        return f"{self.name} {median:.4g} ({low:.4g} to {high:.4g})"

    def value_at(self, share: float, nominal: float) -> float:  # noqa: ARG002 - of every distribution
        """Return the value in the row number ``share`` (0 to 1) times the number of rows."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]


def posterior_spreads(posterior: Posterior, absorber: Absorber) -> tuple[Distribution, ...]:
    """Return a posterior's distributions of restitution, friction, damping and frequency.

    They are for the design of a new device, so the gap of the measured device is left out. Friction
    is left out if the absorber has none.
    """
    parts = absorber.absorbers if isinstance(absorber, SeveralAbsorbers) else (absorber,)
    has_friction = all(getattr(part, "friction", None) is not None for part in parts)
    result = {}
    for own in posterior.names:
        name = POSTERIOR_NAMES.get(own, own)
        if name in NAMES and name != GAP and (name != FRICTION or has_friction):
            values = tuple(posterior.column(own).tolist())
            low = min(values)
            result[name] = PosteriorDistribution(name, low, max(values), False, False, values)
    return tuple(result[name] for name in NAMES if name in result)


def _number(path: str, word: float | str) -> tuple[float, bool]:
    """Return (number, True) for a value in %, divided by 100, otherwise (number, False).

    Raises ParameterError that names ``path``.
    """
    text = str(word).strip()
    try:
        value = finite(path, float(text.removesuffix("%")))
    except ValueError as error:
        raise ParameterError(f"{path} = {word!r} is not allowed: {FORM}") from error
    return (value / 100, True) if text.endswith("%") else (value, False)


def spreads(uncertain: UncertainInput) -> tuple[Distribution, ...]:
    """Return the distributions that ``uncertain`` defines (`FORM`), in the order of `NAMES`.

    Raises ParameterError for an unknown name, and for a value that is no distribution.
    """
    uncertain = instance("uncertain", uncertain, Mapping)
    distributions = {}
    for name, value in uncertain.items():
        name = one_of("uncertain", name, NAMES)
        path = f"uncertain {name}"
        words = [value] if isinstance(value, str) else list(value)
        require(len(words) in (1, 2), path, value, FORM)
        ends = [_number(path, word) for word in words]
        relative = ends[0][1]
        require(relative == ends[-1][1] and (relative or len(ends) == 2), path, value, FORM)
        low = ends[0][0]
        high = ends[-1][0]
        if len(ends) == 1:
            require(
                0 < high <= MOST_SHARE, path, value, f"above 0 and at most {100 * MOST_SHARE:.3g}%"
            )
        else:
            require(
                low < high and low >= (-1 if relative else 0),
                path,
                value,
                "from 0 on, or from -100%, the lower one first",
            )
        require(name != RESTITUTION or relative or high <= 1, path, value, "at most 1")
        distributions[name] = Distribution(name, low, high, relative, len(ends) == 1)
    return tuple(distributions[name] for name in NAMES if name in distributions)


def plain(every: Sequence[Distribution]) -> dict[str, list[str]]:
    """Return the words of each distribution, without its name, for JSON."""
    return {one.name: one.words.split()[1:] for one in every}


def require_parts(every: Sequence[Distribution], absorber: Absorber) -> None:
    """Raise ParameterError if an absorber lacks a part with an uncertain quantity.

    Gap and restitution need rigid walls. Friction needs a friction limit.
    """
    parts = absorber.absorbers if isinstance(absorber, SeveralAbsorbers) else (absorber,)
    for one in every:
        walls = all(
            isinstance(part, SlidingAbsorber) and isinstance(part.walls, RigidWalls)
            for part in parts
        )
        has = (
            all(isinstance(part, SlidingAbsorber) and part.friction is not None for part in parts)
            if one.name == FRICTION
            else walls
        )
        require(
            one.name not in OF_ABSORBER or has,
            f"uncertain {one.name}",
            one.words,
            "left out: this absorber has none",
        )


def shares(every: Sequence[Distribution], members: Members) -> list[dict[str, float]]:
    """Return random numbers (0 to 1) by the names of distributions, for each ensemble member.

    The numbers depend only on the member's phase and factor, so that all runs of a member have the
    same.
    """
    columns = []
    for phase, factor in zip(members.phases, members.factors, strict=True):
        own = np.random.default_rng(
            np.frombuffer(np.array([phase, factor]).tobytes(), dtype=np.uint32).tolist()
        )
        columns.append({name: float(own.uniform()) for name in (*NAMES, POSTERIOR)})
    return [{one.name: row[one.column] for one in every} for row in columns]


def draw_lane(
    lane: Lane,
    every: Sequence[Distribution],
    share: Mapping[str, float],
    resonance: int,
    force: float,
) -> Lane:
    """Return a lane whose uncertain quantities have drawn values.

    ``share`` has a random number (0 to 1) for each distribution, by name (`shares`). ``force`` is
    the nominal amplitude of the drive in N. Damping and frequency are set for the ``resonance``
    (counted from 1), and change by the same factor in all modes. The sweep scales with the
    frequency.

    Raises ParameterError if an uncertain damping, frequency or force is nominally 0, or if the
    drive is not a single swept force.
    """
    model = lane.scene.model
    nominal = {
        DAMPING: float(model.damping_ratio[resonance - 1]),
        FREQUENCY: model.resonance_omega(resonance) / (2 * np.pi),
        FORCE: force,
    }
    for one in every:
        require(
            nominal.get(one.name, 1.0) > 0,
            f"uncertain {one.name}",
            one.words,
            "left out: the number itself is 0",
        )
    factor = {
        one.name: one.value_at(share[one.name], nominal[one.name]) / nominal[one.name]
        for one in every
        if one.name in nominal
    }
    moved = on_another_structure(
        lane, *(factor.get(name, 1.0) for name in (DAMPING, FREQUENCY, FORCE))
    )
    absorber = lane.scene.absorber
    if isinstance(absorber, SeveralAbsorbers):
        absorber = replace(
            absorber, absorbers=tuple(_absorber(part, every, share) for part in absorber.absorbers)
        )
    elif isinstance(absorber, SlidingAbsorber):
        absorber = _absorber(absorber, every, share)
    return replace(moved, scene=Scene(moved.scene.model, absorber))


def on_another_structure(lane: Lane, damping: float, frequency: float, force: float = 1.0) -> Lane:
    """Return a lane with damping ratios, frequencies and force multiplied by factors.

    The sweep scales with the frequencies. Raises ParameterError unless the drive is a single swept
    force.
    """
    model = lane.scene.model
    drive = lane.drive
    if not isinstance(drive, Drive):
        allowed = "one force, whose sweep follows the structure's frequencies"
        raise describe_error("drive", drive, allowed)
    schedule = drive.schedule
    other = replace(
        model, omega=model.omega * frequency, damping_ratio=model.damping_ratio * damping
    )
    moved = FrequencySchedule(
        schedule.times / frequency, schedule.omegas * frequency, schedule.reference * frequency
    )
    return replace(
        lane,
        scene=Scene(other, lane.scene.absorber),
        drive=Drive(drive.amplitude * force, moved, drive.phase),
    )


def _absorber(
    absorber: SlidingAbsorber, every: Sequence[Distribution], share: Mapping[str, float]
) -> SlidingAbsorber:
    """Return an absorber whose gap, restitution and friction limit have drawn values."""
    walls = absorber.walls
    friction = absorber.friction
    for one in every:
        if one.name == GAP and walls is not None:
            walls = replace(walls, gap=one.value_at(share[GAP], walls.gap))
        elif one.name == RESTITUTION and isinstance(walls, RigidWalls):
            walls = replace(
                walls,
                restitution=float(
                    np.clip(one.value_at(share[RESTITUTION], walls.restitution), 0.0, 1.0)
                ),
            )
        elif one.name == FRICTION and friction is not None:
            limit = one.value_at(share[FRICTION], friction.limit)
            friction = replace(friction, limit=limit) if limit > 0 else None
    return replace(absorber, walls=walls, friction=friction)


Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
SURE = 0.95  # probability with which the level stays below the limit
# largest half widths that are tried: relative for gap and friction limit, absolute for restitution
WIDEST_TOLERANCES = {GAP: 0.3, RESTITUTION: 0.3, FRICTION: 0.8}
DRAWS_ALONE = 48
DRAWS_TOGETHER = 128
DRAWS_CHECKED = 64
NOMINAL_RUNS = 16
TOLERANCE_SEED = 77  # of members that no search and no other draw uses
SCALE_STEPS = 2000  # number of scales that are compared


@dataclass(frozen=True)
class Tolerances:
    """Tolerances with which a device's level is below ``limit`` (m) with a probability of `SURE`.

    A tolerance is a half width: relative for gap and friction limit, absolute for restitution. A
    value equal to `WIDEST_TOLERANCES` is the widest that was tried.

    Attributes
    ----------
    alone : dict of str to float
        Tolerance of each quantity while the others have their nominal values.
    together : dict of str to float
        Tolerances of all quantities at once: the values of ``alone`` times a common factor.
    nominal : float
        Share of `NOMINAL_RUNS` members with the nominal device whose level is below the limit. If
        it is below `SURE`, all tolerances are 0.
    checked, below : int
        Number of new draws within ``together``, and number of these below the limit. Both are 0 if
        the tolerances are 0.
    runs : int
        Number of all sweeps.
    draws : (int, int)
        Number of draws for each of ``alone``, and for ``together``.
    """

    limit: float
    alone: dict[str, float]
    together: dict[str, float]
    nominal: float
    checked: int
    below: int
    runs: int
    draws: tuple[int, int] = (DRAWS_ALONE, DRAWS_TOGETHER)

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of Wilson's 95 % interval of the probability of a level below the limit.

        It is the probability within ``together``, from the check's draws. The ends are NaN without
        a check.
        """
        if self.checked == 0:
            return math.nan, math.nan
        ends = scipy.stats.binomtest(self.below, self.checked).proportion_ci(0.95, "wilson")
        return float(ends.low), float(ends.high)


def exceedance(distances: ArrayLike, above: ArrayLike, dimension: int, scales: ArrayLike) -> Array:
    """Return the probability of a level above the limit, for draws in boxes of given scales.

    Parameters
    ----------
    distances : array_like
        Distances r (n,) of the draws from the nominal device, uniform in 0 to 1.
    above : array_like
        Whether each draw's level was above the limit, (n,).
    dimension : int
        Number d of quantities that are drawn.
    scales : array_like
        Scales (k,) above 0 and at most 1.

    Returns
    -------
    array
        P(level > limit | s) of the module's docstring, (k,).

    Examples
    --------
    >>> r = (np.arange(1000) + 0.5) / 1000
    >>> exceedance(r, r > 0.4, 1, [0.4, 0.8]).round(2)
    array([0. , 0.5])

    """
    r = row("distances", distances, "a row of numbers")
    order = np.argsort(r)
    flags = np.asarray(above, dtype=np.float64)[order]
    level = scipy.optimize.isotonic_regression(flags).x  # p(r), constant around each draw
    edges = np.concatenate([[0.0], (r[order][1:] + r[order][:-1]) / 2, [1.0]])
    scale = np.asarray(scales, dtype=np.float64)[:, None]
    inside = np.minimum(edges, scale) ** dimension
    return np.asarray(np.sum(level * np.diff(inside, axis=1), axis=1) / scale[:, 0] ** dimension)


def largest_scale(distances: ArrayLike, above: ArrayLike, dimension: int) -> float:
    """Return the largest scale (0 to 1) at which levels are below the limit often enough.

    At this scale and all smaller ones their probability is at least `SURE`. Arguments are those of
    `exceedance`.
    """
    scales = np.arange(1, SCALE_STEPS + 1) / SCALE_STEPS
    good = exceedance(distances, above, dimension, scales) <= 1 - SURE
    first_bad = int(np.argmin(good)) if not good.all() else SCALE_STEPS
    return float(scales[first_bad - 1]) if first_bad > 0 else 0.0


def surface_points(number: int, dimension: int, seed: int) -> tuple[Array, Array]:
    """Return distances r (n,) and points (n, d) with coordinates from -1 to 1.

    ``number`` is n, ``dimension`` d. A point's distance is its largest absolute coordinate.
    Distances are uniform in 0 to 1, points uniform on the surface of the cube of their distance (a
    Halton sequence).
    """
    sample = scipy.stats.qmc.Halton(dimension + 1, rng=np.random.default_rng(seed)).random(number)
    distances = np.maximum(sample[:, 0], 1e-9)
    points = 2 * sample[:, 1:] - 1
    # each point on a face of the cube (the largest coordinate and its sign), equally many on each
    generator = np.random.default_rng([seed, 1])
    faces = generator.permuted(np.arange(number) % (2 * dimension))
    points[np.arange(number), faces // 2] = np.where(faces % 2, 1.0, -1.0)
    return distances, distances[:, None] * points


def tolerances_of(absorber: SlidingAbsorber) -> dict[str, float]:
    """Return the largest half width to try for each quantity that an absorber has.

    These are the values of `WIDEST_TOLERANCES`. Raises ParameterError for an absorber without rigid
    walls.
    """
    absorber = instance("absorber", absorber, SlidingAbsorber)
    require(isinstance(absorber.walls, RigidWalls), "absorber", absorber, "one between rigid walls")
    return {
        name: width
        for name, width in WIDEST_TOLERANCES.items()
        if name != FRICTION or absorber.friction is not None
    }


def spread_of(name: str, width: float, absorber: SlidingAbsorber) -> Distribution:
    """Return the uniform distribution of a quantity within a half width of its nominal value.

    ``width`` is absolute for restitution, relative for gap and friction limit.
    """
    if name != RESTITUTION:
        return Distribution(name, -width, width, relative=True, normal=False)
    walls = absorber.walls
    assert isinstance(walls, RigidWalls)
    own = float(walls.restitution)
    return Distribution(name, own - width, own + width, relative=False, normal=False)


def find_tolerances(
    case: CurveCase,
    limit: float,
    uncertain: Sequence[Distribution] = (),
    *,
    draws: tuple[int, int, int] = (DRAWS_ALONE, DRAWS_TOGETHER, DRAWS_CHECKED),
    seed: int = TOLERANCE_SEED,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> Tolerances:
    """Return the largest tolerances with which an absorber's level stays below a limit.

    The level is the larger of the levels of a sweep up and one down. It stays below the limit with
    a probability of `SURE`.

    Parameters
    ----------
    case : CurveCase
        Scene with an impact absorber between rigid walls, resonance and sweeps. Only the first of
        the case's forces is used.
    limit : float
        Level in m.
    uncertain : sequence of Distribution
        Further uncertain quantities, drawn in all runs. Distributions of gap, restitution and
        friction are ignored.
    draws : tuple of int
        Number of draws of each quantity alone, of all together, and of the check.
    seed : int
        Seed of draws and members.
    progress, executor
        As in `impact_env.ensemble.run_lanes`.

    Returns
    -------
    Tolerances

    Raises
    ------
    ParameterError
        For an absorber without rigid walls, and for arguments out of range.
    KeyboardInterrupt
        If the runs are stopped.
    """
    absorber = case.scene.absorber
    if not isinstance(absorber, SlidingAbsorber):
        raise ParameterError(
            f"absorber = {absorber} is not allowed: one impact absorber between rigid walls"
        )
    widest = tolerances_of(absorber)
    limit = positive("limit_level", limit)
    alone_draws, together_draws, checked = (count("draws", number, 2) for number in draws)
    others = [one for one in uncertain if one.name not in OF_ABSORBER]
    used = (alone_draws, together_draws)
    total = 2 * (NOMINAL_RUNS + len(widest) * alone_draws + together_draws + checked)
    runs = _Draws(case, absorber, limit, others, progress, executor, total)

    exact = runs.above(np.zeros((NOMINAL_RUNS, len(widest))), widest, seed)
    nominal = 1 - float(np.mean(exact))
    nothing = dict.fromkeys(widest, 0.0)
    if nominal < SURE:
        return Tolerances(limit, nothing, nothing, nominal, 0, 0, runs.done, used)

    alone = {}
    for k, (name, width) in enumerate(widest.items()):
        distances, points = surface_points(alone_draws, 1, seed + 1 + k)
        above = runs.above(points, {name: width}, seed + 1 + k)
        alone[name] = width * largest_scale(distances, above, 1)

    together = nothing
    below = 0
    if all(width > 0 for width in alone.values()):
        distances, points = surface_points(together_draws, len(alone), seed + 11)
        above = runs.above(points, alone, seed + 11)
        scale = largest_scale(distances, above, len(alone))
        together = {name: scale * width for name, width in alone.items()}
    if all(width > 0 for width in together.values()):
        cube = scipy.stats.qmc.Halton(len(together), rng=np.random.default_rng(seed + 12))
        above = runs.above(2 * cube.random(checked) - 1, together, seed + 12)
        below = checked - int(np.sum(above))
    else:
        checked = 0
    return Tolerances(limit, alone, together, nominal, checked, below, runs.done, used)


@dataclass(eq=False)
class _Draws:
    """Runs of an absorber with drawn deviations, each with an ensemble member of its own.

    ``others``: further uncertain quantities. ``total``, ``done``: numbers of all sweeps and of the
    finished sweeps, for ``progress``.
    """

    case: CurveCase
    absorber: SlidingAbsorber
    limit: float
    others: Sequence[Distribution]
    progress: Callable[[int, int], None] | None
    executor: Executor | None
    total: int
    done: int = 0

    def above(self, points: Array, widths: dict[str, float], seed: int) -> Flags:
        """Return whether each point's level is above the limit, (n,), from two sweeps a point.

        ``points`` (n, d): deviations of the d quantities of ``widths``, relative to their half
        widths, from -1 to 1. Raises KeyboardInterrupt if the runs are stopped.
        """
        number = len(points)
        members = draw_members(number + 1, seed)[1:]
        force = float(self.case.forces[0])
        own = [spread_of(name, width, self.absorber) for name, width in widths.items()]
        lanes = []
        sweeps = [members.drives(force, schedule) for schedule in self.case.schedules()]
        for k, share in enumerate(shares(self.others, members)):
            placed = dict(zip(widths, ((points[k] + 1) / 2).tolist(), strict=True))
            for drives in sweeps:
                lane = Lane(self.case.scene, drives[k], self.case.steady_start)
                lanes.append(
                    draw_lane(
                        lane,
                        [*own, *self.others],
                        share | placed,
                        self.case.resonance,
                        force,
                    )
                )
        before = self.done
        show = None
        if self.progress is not None:
            report = self.progress
            show = lambda done, _all: report(before + done, self.total)  # noqa: E731
        levels = run_lanes(lanes, progress=show, executor=self.executor)
        if not levels.complete:
            raise KeyboardInterrupt
        self.done += len(lanes)
        return np.asarray(levels.level.reshape(number, 2).max(axis=1) > self.limit)
