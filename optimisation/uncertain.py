"""Uncertain quantities as distributions, and runs with all of them drawn.

The quantities are damping, frequency, force, gap, restitution and friction.

``uncertain=`` of Python and ``--uncertain`` of commands say the same: ``{"gap": "5%"}`` is a normal
distribution around the number itself with this standard deviation, cut at three of them; ``{"gap":
(0.9e-3, 1.1e-3)}`` is uniform, in SI units (frequency in Hz); ``("-3%", "5%")`` is uniform around
the number. The draws of a calibration's posterior are joint: those of one member are one row of
them (`posterior_spreads`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from impact_env.checks import ParameterError, describe_error, finite, instance, one_of, require
from impact_env.drive import Drive, FrequencySchedule
from impact_env.ensemble import Lane, Members
from impact_env.parameters import Absorber, RigidWalls, SeveralAbsorbers, SlidingAbsorber
from impact_env.scene import Scene
from optimisation.calibration.posterior import Posterior

DAMPING = "damping"
FREQUENCY = "frequency"
FORCE = "force"
GAP = "gap"
RESTITUTION = "restitution"
FRICTION = "friction"
OF_ABSORBER = (GAP, RESTITUTION, FRICTION)
NAMES = (DAMPING, FREQUENCY, FORCE, *OF_ABSORBER)
CUT = 3.0  # standard deviations
MOST_SHARE = 1 / CUT  # so that nothing is drawn below 0
FORM = 'a standard deviation as "5%", or two numbers, the lower one first, in SI units or both in %'
UncertainInput = Mapping[str, str | Sequence[float | str]]


@dataclass(frozen=True)
class Distribution:
    """Distribution of the quantity ``name``.

    It is uniform from ``low`` to ``high``, which are shares if ``relative``. If ``normal``,
    ``high`` is the standard deviation.
    """

    name: str
    low: float
    high: float
    relative: bool
    normal: bool

    @property
    def column(self) -> str:
        """Name of the random share that draws it: its own."""
        return self.name

    @property
    def words(self) -> str:
        """The distribution as it is given."""
        if self.normal:
            return f"{self.name} {100 * self.high:g}%"
        return (
            f"{self.name} {100 * self.low:g}% {100 * self.high:g}%"
            if self.relative
            else f"{self.name} {self.low:g} {self.high:g}"
        )

    def drawn(self, share: float, nominal: float) -> float:
        """Return the value at a ``share`` (0 to 1) of the quantity's distribution.

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
    """A quantity's column of the draws of a posterior.

    All columns of a member are of the same row, so that correlations are preserved.
    """

    values: tuple[float, ...] = ()

    @property
    def column(self) -> str:
        """Name of the random share that draws it: one for all quantities of a posterior."""
        return POSTERIOR

    @property
    def words(self) -> str:
        """The distribution in words: its median and 90 % interval."""
        low, median, high = np.quantile(self.values, (0.05, 0.5, 0.95))
        return f"{self.name} {median:.4g} ({low:.4g} to {high:.4g})"

    def drawn(self, share: float, nominal: float) -> float:  # noqa: ARG002 - of every distribution
        """Return the value of the row at a ``share`` (0 to 1) of all rows."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]


def posterior_spreads(posterior: Posterior, absorber: Absorber) -> tuple[Distribution, ...]:
    """Return the distributions of a posterior for a device whose gap is to be chosen.

    They are those of restitution, friction, damping and frequency.

    The measured gap is that of the measured device, and is left out; so is friction where the
    absorber has none.
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
    """Return a number and whether it was given in %, then as a share."""
    text = str(word).strip()
    try:
        value = finite(path, float(text.removesuffix("%")))
    except ValueError as error:
        raise ParameterError(f"{path} = {word!r} is not allowed: {FORM}") from error
    return (value / 100, True) if text.endswith("%") else (value, False)


def spreads(uncertain: UncertainInput) -> tuple[Distribution, ...]:
    """Return the distributions that are given by name, in the order of `NAMES`.

    Raises ParameterError for a value that is not a distribution.
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
    """Return distributions as JSON values, in words."""
    return {one.name: one.words.split()[1:] for one in every}


def require_parts(every: Sequence[Distribution], absorber: Absorber) -> None:
    """Raise ParameterError if an absorber lacks what is uncertain."""
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
    """Return for each member its share (0 to 1) of each distribution.

    It is drawn from the member's phase and factor, so that it is the same in every run of that
    member.
    """
    columns = []
    for phase, factor in zip(members.phases, members.factors, strict=True):
        own = np.random.default_rng(
            np.frombuffer(np.array([phase, factor]).tobytes(), dtype=np.uint32).tolist()
        )
        columns.append({name: float(own.uniform()) for name in (*NAMES, POSTERIOR)})
    return [{one.name: row[one.column] for one in every} for row in columns]


def drawn(
    lane: Lane,
    every: Sequence[Distribution],
    share: Mapping[str, float],
    resonance: int,
    force: float,
) -> Lane:
    """Return a lane with each uncertain quantity at its share.

    The sweep follows the structure's own frequency. ``force``: that of the drive in N.

    Raises ParameterError where the damping is uncertain and the resonance has none.
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
        one.name: one.drawn(share[one.name], nominal[one.name]) / nominal[one.name]
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
    """Return a lane with damping, frequencies and force multiplied by factors.

    The sweep follows the structure's own frequency.
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
    walls = absorber.walls
    friction = absorber.friction
    for one in every:
        if one.name == GAP and walls is not None:
            walls = replace(walls, gap=one.drawn(share[GAP], walls.gap))
        elif one.name == RESTITUTION and isinstance(walls, RigidWalls):
            walls = replace(
                walls,
                restitution=float(
                    np.clip(one.drawn(share[RESTITUTION], walls.restitution), 0.0, 1.0)
                ),
            )
        elif one.name == FRICTION and friction is not None:
            limit = one.drawn(share[FRICTION], friction.limit)
            friction = replace(friction, limit=limit) if limit > 0 else None
    return replace(absorber, walls=walls, friction=friction)
