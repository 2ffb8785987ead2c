"""Measures of a design from its runs, and the statistics of their values.

The measures are level, fatigue damage, stroke, impacts and heat, under loads others. The statistics
are ratios of two designs with intervals, predictions of a fresh run, and ensembles with two
branches of response.

A chunk consists of a few lanes and the measures to compute. It can be pickled, so that a thread or
a worker on another machine computes the same numbers.
"""

import hashlib
import re
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import ParameterError, require
from impact_env.drive import Excitation, find_schedule
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane
from impact_env.level import require_sampled
from impact_env.loads import Loads, Shock, Strike
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import SeveralAbsorbers, SlidingAbsorber
from impact_env.results import Record, Response, require_recorded
from impact_env.scene import Scene
from impact_env.sweep import IntegrationError, simulate

# What is read from a response under loads: one definition for each kind of load, smaller is better.
#
# - level: loads with a schedule, which sweep. The paper's response level, as everywhere.
# - rms: records, random loads and fixed tones. Root mean square of the displacement (relative to
#   the base) where the level is read, after a start that is left out: `SETTLING` time constants
#   1/(D omega) of the first mode, at most half of the record.
# - decay: shocks and strikes. The integral of the structure's energy from the end of the pulse on
#   over its value at that end, in s: 1/(2 D omega) where it decays as exp(-2 D omega t).


LEVEL = "level"
RMS = "rms"
DECAY = "decay"
UNITS = {LEVEL: "m", RMS: "m", DECAY: "s"}
LABELS = {LEVEL: "response level", RMS: "RMS", DECAY: "decay time of the energy"}
DISPLAY_UNITS = {"m": (1e3, "mm"), "s": (1.0, "s")}  # factor and unit for people
SETTLING = 5.0
SAMPLES = 64  # a pseudo period
STRANGE = 1e6  # a gap over the free motion, or this over it
START = 1.5  # of the size of the free motion at the absorber: a gap where there is no rule


def format_number(value: float) -> str:
    """Return a number for people, with at most four significant digits, as "2.149" or "12350"."""
    return f"{float(f'{value:.4g}'):g}"


def shorten_numbers(text: str) -> str:
    """Return a text whose decimal numbers have at most four significant digits, for a title."""
    return re.sub(r"\d+\.\d+", lambda number: format_number(float(number[0])), text)


def measure_of(loads: Loads) -> str:
    """Return which measure belongs to loads."""
    if any(find_schedule(part) for part in loads.parts):
        return LEVEL
    return DECAY if any(isinstance(part, Shock | Strike) for part in loads.parts) else RMS


def _level(response: Response) -> float:
    return require_recorded("level", response.level).value


def settled_after(response: Response) -> float:
    """Return the duration of the start that is left out, in s; 0 for sweeps and shocks."""
    drive = response.drive
    model = response.scene.model
    if measure_of(drive) != RMS if isinstance(drive, Loads) else np.ptp(drive.schedule.omegas) > 0:
        return 0.0
    decay = float(model.damping_ratio[0] * model.omega[0])
    half = float(drive.schedule.times[-1]) / 2
    return min(SETTLING / decay, half) if decay > 0 else half


def _rms(response: Response) -> float:
    history = require_recorded("history", response.history)
    late = (history.modal_displacement @ response.scene.model.level_shape)[
        history.time >= settled_after(response)
    ]
    return float(np.sqrt(np.mean(late**2)))


def after_pulse(response: Response) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times (S,) in s after the last pulse, and the modes' energies (S, N_m) in J."""
    history = require_recorded("history", response.history)
    late = history.time >= max(
        part.width for part in response.drive.parts if isinstance(part, Shock | Strike)
    )
    return history.time[late], mechanical_energy(response.scene, history).modal[late]


def _decay(response: Response) -> float:
    times, modal = after_pulse(response)
    energy = np.sum(modal, axis=1)
    return float(np.trapezoid(energy, times) / energy[0])


OF_LOADS: dict[str, tuple[Callable[[Response], float], Record]] = {
    LEVEL: (_level, Record()),
    RMS: (_rms, Record(level=False, series=True, samples_per_period=SAMPLES)),
    DECAY: (_decay, Record(level=False, series=True, samples_per_period=SAMPLES)),
}


def record_of(loads: Loads) -> Record:
    """Return the `Record` that the loads' measure needs."""
    return OF_LOADS[measure_of(loads)][1]


def read(response: Response) -> float:
    """Return the measure of a run's loads, of a harmonic force the response level."""
    return OF_LOADS[measure_of(response.drive) if isinstance(response.drive, Loads) else LEVEL][0](
        response
    )


def check_sampling(lane: Lane, measures: Container[str] = ()) -> None:
    """Raise ParameterError if a lane's run has too few samples.

    The samples must suffice for the measure of its loads and for other ``measures`` of its motion.
    """
    loads = lane.drive if isinstance(lane.drive, Loads) else None
    record = Record() if loads is None else record_of(loads)
    rms = loads is not None and measure_of(loads) == RMS
    if rms or any(name in measures for name in _OF_SAMPLES):
        require_sampled(lane.scene, lane.drive, record.samples_per_period, lane.start)


def measure_lane(lane: Lane) -> float:
    """Return the measure of a lane's loads."""
    check_sampling(lane)
    return read(simulate(lane.scene, lane.drive, initial=lane.start, record=record_of(lane.drive)))


def loads_key(loads: Loads) -> str:
    """Return a key, equal for equal loads only."""
    strikes = [part for part in loads.parts if isinstance(part, Strike)]
    known = hashlib.sha256(f"{loads.reference!r} {loads.start!r} {strikes}".encode())
    for part in loads.on_one_clock():
        known.update(np.ascontiguousarray(part).tobytes())
    return known.hexdigest()


def free_size(lane: Lane) -> float:
    """Return the unit of gaps in m, the RMS of the free motion of the absorber's place.

    It is the root mean square over the whole run.

    For a shock, whose mean square depends on the length of the record, it is the largest
    displacement over the root of two.
    """
    check_sampling(lane)
    history = simulate(lane.scene, lane.drive, initial=lane.start, record=OF_LOADS[RMS][1]).history
    assert history is not None
    motion = history.tip_displacement
    return float(
        np.max(np.abs(motion)) / np.sqrt(2)
        if measure_of(lane.drive) == DECAY
        else np.sqrt(np.mean(motion**2))
    )


def design_gap_for(model: ModalModel, loads: Loads) -> float:
    """Return the gap in m from which a search starts if there is no design rule.

    It is `START` times `free_size`, and 0 if nothing moves.
    """
    return START * free_size(Lane(Scene(model), loads, steady_start=True))


def check_size(scene: Scene, drive: Excitation) -> None:
    """Raise ParameterError if a place moves far too little or too much under the loads.

    The motion is compared with the gap of the absorber at that place. A large mismatch means a
    wrong unit.
    """
    walls = scene.cavity(0)
    if not isinstance(drive, Loads) or walls is None or walls.gap == 0:
        return
    size = free_size(Lane(Scene(scene.model), drive))
    allowed = (
        f"from {1 / STRANGE:g} to {STRANGE:g} times the free motion at the absorber, {size:.3g} "
        "m: look at the load's units and scale"
    )
    require(size / STRANGE <= walls.gap <= size * STRANGE, "gap", walls.gap, allowed)


Array = NDArray[np.float64]

# what a lane can be measured by; the order is that of the columns
STROKE = "stroke"
IMPACT_POWER = "impact_power"
IMPACT_SPEED = "impact_speed"
FRICTION_HEAT = "friction_heat"
DAMAGE = "damage"
IMPACT_RATE = "impact_rate"
IMPACT_RMS = "impact_rms_speed"
ACCELERATION = "acceleration"
STRESS = "stress"
LEVEL_RATIO = "level_ratio"
MEASURES = {
    LEVEL: (
        "response level in m (paper, Eq. barqtip) where it is read, on a cantilever the free end; "
        "of loads the measure that belongs to them"
    ),
    STROKE: "largest distance of the absorber from the middle of its cavity in m",
    IMPACT_POWER: (
        "energy lost in impacts over the sweep, or after the start (`settled_after`), per second, "
        "in W"
    ),
    IMPACT_SPEED: "largest relative velocity before an impact in m/s",
    IMPACT_RMS: (
        "root of the mean square of the relative velocities before impacts in m/s, after the start"
    ),
    FRICTION_HEAT: (
        "energy lost in dry friction over the sweep, or after the start, per second, in W, from "
        "the mean relative speed at the samples"
    ),
    DAMAGE: (
        "sum over the rainflow cycles of the bending moment at the clamp, or of a modal model's "
        "stress, to the power of the fatigue exponent"
    ),
    IMPACT_RATE: "impacts per second over the sweep, or after the start",
    ACCELERATION: (
        "largest change of velocity where the level is read from sample to sample, over the time "
        "between, in m/s^2, impacts included"
    ),
    STRESS: (
        "largest bending moment at the clamp in N m, or of a modal model's stress in the file's "
        "unit"
    ),
    RMS: (
        "root of the mean square of the free end's displacement in m over the second half of the "
        "run"
    ),
    LEVEL_RATIO: (
        "frequency over the resonance at which the response level of a swept force was read; 0 of "
        "other loads"
    ),
}
_OF_IMPACTS = {IMPACT_POWER, IMPACT_SPEED, IMPACT_RMS, IMPACT_RATE}
_OF_SAMPLES = {STROKE, FRICTION_HEAT, DAMAGE, RMS, ACCELERATION, STRESS}


FATIGUES = (
    "for a beam that is clamped at its left end, or a modal model whose file gives the stress "
    "that fatigues"
)


def stress_shape(structure: Structure) -> Array | None:
    """Return the mode shapes (N_m,) of the stress that causes fatigue, or None.

    For a beam it is the bending moment at the left clamp in N/sqrt(kg), for a modal model the
    stress of its file. The result is None if there is none.

    A Hermite element at the clamp deflects as a x^2 + b x^3, so the curvature 2 a there follows
    from the shapes at two points of it.
    """
    if isinstance(structure, ModalModel):
        return structure.stress_shape
    if not structure.ends.startswith("clamped"):
        return None
    near = 0.5 / structure.elements
    far = 1.0 / structure.elements
    first, second = (
        modal_model(replace(structure, force_position=x)).one_phase_force_shape for x in (near, far)
    )
    slopes = [shape / (x * structure.length) ** 2 for shape, x in ((first, near), (second, far))]
    a = (slopes[0] * far - slopes[1] * near) / (far - near)
    stiffness = (
        structure.sections[0].bending_stiffness
        if structure.sections
        else structure.bending_stiffness
    )
    return np.asarray(2 * a * stiffness)


@dataclass(frozen=True, eq=False)
class Chunk:
    """Lanes and the measures that are computed from them.

    ``measures``: columns of the result. ``stress_shape`` (N_m,): result of the function of this
    name.
    """

    lanes: tuple[Lane, ...]
    measures: tuple[str, ...]
    stress_shape: Array | None
    fatigue_exponent: float

    def __post_init__(self) -> None:
        for name in self.measures:
            require(name in MEASURES, "measure", name, f"one of {', '.join(MEASURES)}")

    @property
    def record(self) -> Record:
        """Recording options of the runs: only what the measures need.

        This is the level during the run, and impacts or samples of the state if a measure needs
        them.

        The energy account would give losses too, but it takes many times the time of the run
        itself.
        """
        wanted = set(self.measures)
        loads = [lane.drive for lane in self.lanes if isinstance(lane.drive, Loads)]
        own = record_of(loads[0]) if loads else Record()
        return replace(
            own, events=bool(wanted & _OF_IMPACTS), series=own.series or bool(wanted & _OF_SAMPLES)
        )


def measure(chunk: Chunk) -> Array:
    """Run a chunk and return its measures, (lanes, measures).

    The measures are NaN in lanes that the integrator gives up.
    """
    rows = np.full((len(chunk.lanes), len(chunk.measures)), np.nan)
    for row, lane in zip(rows, chunk.lanes, strict=True):
        try:
            check_sampling(lane, chunk.measures)
            response = simulate(lane.scene, lane.drive, initial=lane.start, record=chunk.record)
        except IntegrationError:
            continue
        except ParameterError as error:
            raise ParameterError(f"{lane}: {error}") from error
        row[:] = [_value(name, chunk, response) for name in chunk.measures]
    return rows


def _value(name: str, chunk: Chunk, response: Response) -> float:
    if name == LEVEL:
        return read(response)
    if name == LEVEL_RATIO:
        swept = not isinstance(response.drive, Loads)
        return require_recorded("level", response.level).frequency_ratio if swept else 0.0
    if name in _OF_IMPACTS:
        return _of_impacts(name, response)
    history = require_recorded("history", response.history)
    if name == RMS:
        return float(
            np.sqrt(
                np.mean(
                    (
                        history.modal_displacement[len(history.time) // 2 :]
                        @ response.scene.model.level_shape
                    )
                    ** 2
                )
            )
        )
    if name in (DAMAGE, STRESS):
        require(chunk.stress_shape is not None, "measure", name, FATIGUES)
        stress = np.asarray(history.modal_displacement @ np.asarray(chunk.stress_shape))
        return (
            fatigue_damage(stress, chunk.fatigue_exponent)
            if name == DAMAGE
            else float(np.max(np.abs(stress)))
        )
    if name == ACCELERATION:
        change = np.diff(history.modal_velocity @ response.scene.model.level_shape)
        return float(np.max(np.abs(change) / np.diff(history.time)))
    return of_motion(name, response)


def _of_impacts(name: str, response: Response) -> float:
    impacts = require_recorded("impacts", response.impacts)
    if name == IMPACT_SPEED:
        return float(np.max(np.abs(impacts.relative_velocity), initial=0.0))
    start = settled_after(response)
    late = impacts.time >= start
    if name == IMPACT_RMS:
        return float(np.sqrt(np.mean(impacts.relative_velocity[late] ** 2))) if late.any() else 0.0
    total = float(np.sum(impacts.energy_lost[late] if name == IMPACT_POWER else late))
    return total / (float(response.drive.schedule.times[-1]) - start)


def impact_measures(response: Response) -> tuple[float, float, float, float]:
    """Return the measures of a run's impacts (see `MEASURES`).

    They are the largest and RMS speed in m/s, the number of impacts in a second, and the power in W
    lost in them.
    """
    speed, rms, rate, power = (
        _of_impacts(name, response)
        for name in (IMPACT_SPEED, IMPACT_RMS, IMPACT_RATE, IMPACT_POWER)
    )
    return speed, rms, rate, power


def of_motion(name: str, response: Response) -> float:
    """Return the stroke or the friction heat of a run with samples of the state (`MEASURES`).

    The stroke is the largest of all absorbers, the heat is the sum over all absorbers.
    """
    history = require_recorded("history", response.history)
    absorber = response.scene.absorber
    if absorber is None:
        return 0.0
    shapes = response.scene.absorber_shapes.T
    samples = len(history.time)
    if name == STROKE:
        return float(
            np.max(
                np.abs(
                    history.absorber_displacement.reshape(samples, -1)
                    - history.modal_displacement @ shapes
                )
            )
        )
    speed = np.abs(history.absorber_velocity.reshape(samples, -1) - history.modal_velocity @ shapes)
    speed = speed[history.time >= settled_after(response)]
    every = absorber.absorbers if isinstance(absorber, SeveralAbsorbers) else (absorber,)
    limits = [
        a.friction.limit if isinstance(a, SlidingAbsorber) and a.friction is not None else 0.0
        for a in every
    ]
    return float(np.mean(speed, axis=0) @ np.array(limits))  # sticking loses nothing


def turning_points(values: Array) -> Array:
    """Return first, last and local extrema of samples (S,), each extremum once."""
    moved = values[np.concatenate([[True], np.diff(values) != 0])]
    if len(moved) < 3:
        return moved
    turns = (
        np.sign(np.diff(moved[:-1])) * np.sign(np.diff(moved[1:])) < 0
    )  # of signs: products of tiny steps are zero
    return moved[np.concatenate([[True], turns, [True]])]


def rainflow_amplitudes(values: Array) -> tuple[Array, Array]:
    """Return amplitudes and counts of the rainflow cycles of samples (S,).

    Amplitudes are half ranges. Counts are 1, or 0.5 for cycles that remain open.

    The four-point rule: a range between two larger-or-equal neighbours is a closed cycle and is
    taken out; the rest counts by halves.
    """
    amplitudes: list[float] = []
    stack: list[float] = []
    for point in turning_points(values).tolist():
        stack.append(point)
        while len(stack) >= 4:
            inner = abs(stack[-2] - stack[-3])
            if inner > abs(stack[-1] - stack[-2]) or inner > abs(stack[-3] - stack[-4]):
                break
            amplitudes.append(inner / 2)
            del stack[-3:-1]
    rest = np.abs(np.diff(stack)) / 2 if len(stack) > 1 else np.empty(0)
    return np.concatenate([np.array(amplitudes), rest]), np.concatenate(
        [np.ones(len(amplitudes)), np.full(len(rest), 0.5)]
    )


def fatigue_damage(values: Array, exponent: float) -> float:
    """Return the fatigue damage of samples by Miner's rule on a straight Basquin line.

    It is the sum over the rainflow cycles of count times amplitude to the power of ``exponent``.
    """
    amplitudes, counts = rainflow_amplitudes(values)
    return float(np.sum(counts * amplitudes**exponent))


# Statistics of noisy values: the ratio of two designs' quantiles, with an interval.
#
# Runs part after some impacts, so the same members (phases, roundings) of two designs have
# nothing in common: the correlation of their levels was measured as -0.17. Pairing them buys
# nothing, and the interval resamples each design's members on its own.

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
    """Return the prediction of a further run of a design from its own ``values`` (M,).

    ``groups`` has the values of all designs, including this one. Their logarithms have separate
    means and a common spread; the uncertainty of the mean of M values adds 1/M to the variance.
    None if no design ran twice.
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
